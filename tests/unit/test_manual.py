"""Manual pages and completion: all that `--help` says is in them, and the shells take them."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fmfts.cli.main import command_line

sys.path.insert(0, str(Path(__file__).parents[2] / "systemd"))

import manual_pages as manual

VERBS = manual.verbs_of(command_line())


def plain(page: str) -> str:
    """A page's text without troff's escapes."""
    return page.replace("\\-", "-").replace("\\e", "\\").replace("\\&", "")


def test_there_is_a_page_for_each_verb_and_one_for_all() -> None:
    pages = manual.man_pages()
    assert set(pages) == {"fmfts-daemon.1", *(f"fmfts-daemon-{name}.1" for name in VERBS)}
    assert {"run", "init", "demo", "baseline", "collect"} <= set(VERBS)
    whole = plain(pages["fmfts-daemon.1"])
    assert all(f".B {name}\n" in whole for name in VERBS)
    assert "exit codes, the same for every verb" in whole


@pytest.mark.parametrize("name", VERBS)
def test_page_says_all_that_help_says(name: str) -> None:
    page = " ".join(plain(manual.man_pages()[f"fmfts-daemon-{name}.1"]).split())
    for action in VERBS[name]._actions:
        for word in action.option_strings:
            assert word in page
        if action.help:
            assert " ".join(manual._help(VERBS[name], action).split()) in page


@pytest.mark.parametrize("completion", [manual.bash_completion, manual.zsh_completion])
def test_completion_has_each_verb_and_each_of_its_options(completion: object) -> None:
    text = completion()  # type: ignore[operator]
    for name, verb in VERBS.items():
        (line,) = [line for line in text.splitlines() if line.strip().startswith(f"{name}) ")]
        for action in manual.options_of(verb):
            assert all(word in line for word in action.option_strings), (name, action)


def completed(tmp_path: Path, *words: str) -> list[str]:
    """The completions that bash offers for the last word."""
    (tmp_path / "completion").write_text(manual.bash_completion())
    array = " ".join(f"'{word}'" for word in words)
    script = (
        f"source {tmp_path}/completion; COMP_WORDS=({array}); COMP_CWORD={len(words) - 1}; _fmfts_daemon; "
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    return subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True).stdout.split()


def test_bash_completes_verbs_and_options(tmp_path: Path) -> None:
    assert completed(tmp_path, "fmfts-daemon", "check") == ["check-config"]
    assert completed(tmp_path, "fmfts-daemon", "baseline", "--re") == ["--rest", "--refine", "--restore", "--replaced"]


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
def test_zsh_can_read_its_completion(tmp_path: Path) -> None:
    manual.main(tmp_path)
    file = tmp_path / "share/zsh/vendor-completions/_fmfts-daemon"
    assert subprocess.run(["zsh", "-n", file], capture_output=True, text=True, check=False).stderr == ""


@pytest.mark.skipif(shutil.which("man") is None, reason="man is not installed")
def test_man_has_no_complaint_about_a_page(tmp_path: Path) -> None:
    manual.main(tmp_path)
    for page in sorted((tmp_path / "share/man/man1").iterdir()):
        shown = subprocess.run(
            ["man", "--warnings", "-l", page],
            env={"MANWIDTH": "80", "LC_ALL": "C.UTF-8", "PATH": "/usr/bin:/bin"},
            capture_output=True,
            text=True,
            check=True,
        )
        assert shown.stderr == "", page


def test_all_is_written_where_debian_looks_for_it(tmp_path: Path) -> None:
    manual.main(tmp_path)
    assert (tmp_path / "share/man/man1/fmfts-daemon-baseline.1").exists()
    assert (tmp_path / "share/bash-completion/completions/fmfts-daemon").read_text() == manual.bash_completion()
