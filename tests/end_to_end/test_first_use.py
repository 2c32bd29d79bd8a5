"""The transcript in docs/first-use.md is what the commands of the first use print today."""

from __future__ import annotations

from pathlib import Path

from end_to_end.first_use import COMMANDS, PAGE, shown, stable, transcript


def test_transcript_in_the_manual_is_what_is_printed_today(tmp_path: Path) -> None:
    """Figures and ids may differ. After a change of the output: `make transcript`."""
    assert stable(shown(PAGE.read_text())) == stable(transcript(tmp_path))


def test_transcript_has_each_listed_command_up_to_rest_baseline() -> None:
    text = PAGE.read_text()
    for command in COMMANDS[1:]:
        words = command.removeprefix("fmfts-daemon ").removesuffix(" --config pad.toml").split()
        assert any(
            line.split()[1:2] == words[:1] and set(words[1:]) <= set(line.split())
            for line in text.splitlines()
            if line.startswith("    fmfts-daemon")
        ), command
