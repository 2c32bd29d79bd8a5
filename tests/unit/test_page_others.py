"""Programs of others that the pages name: their own parsers take the options, and what is named exists here.

tests/unit/test_page_commands.py does the same for `fmfts-daemon`, and test_page_programs.py for make and Python.
"""

from __future__ import annotations

import fnmatch
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

from fmfts.common.toml import parse
from fmfts.config.file import DEFAULT_PATHS
from pages.commands import PARSED_ELSEWHERE, ROOT, every_command, parts_of

FOLDERS = [path.parent for path in ROOT.glob("**/pyproject.toml") if ".venv" not in path.parts]
PROJECTS = {project["name"]: project for project in (parse((one / "pyproject.toml").read_text())["project"]
                                                     for one in FOLDERS)}  # fmt: skip
MADE = "dist"  # the folder of a release's files
SHELL = {"cd", ".", "$EDITOR"}  # each takes one file
FILES = {"mkdir", "chmod", "ln", "scp", "zip", "sha256sum", "gpg", "ssh-keygen", "cmake", "journalctl", "git"}


@cache
def options_of(program: str, *words: str) -> frozenset[str]:
    """Every word of a program's own help that begins with -."""
    said = subprocess.run([program, *words], capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    return frozenset(re.findall(r"(?<![\w-])--?\w[\w-]*", said.stdout + said.stderr))


HELP = {"ssh-keygen": ("-Y",), "gpg": ("--dump-options",), "scp": (), "zip": ("-h2",)}


def unknown_options(words: list[str]) -> list[str]:
    program, given = words[0], [word for word in words[1:] if word.startswith("-")]
    if not given:
        return []
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    asked = (words[1], "-h") if program == "git" else HELP.get(program, ("--help",))
    known = options_of(program, *asked)
    letters = {option[1] for option in known if len(option) == 2}
    return [word for word in given if word.partition("=")[0] not in known
            and (word.startswith("--") or not set(word[1:]) <= letters)]  # fmt: skip


def faults_of_shell(words: list[str]) -> list[str]:
    return [] if len(words) == 2 else [f"{words[0]} takes one file"]


def faults_of_pip(words: list[str]) -> list[str]:
    """The faults by pip's own parser of options. A requirement is a folder here, a file of `make dist` or a project."""
    command = pytest.importorskip("pip._internal.commands").create_command(words[1])
    try:
        options, requirements = command.parse_args(words[2:])
    except SystemExit:
        return [f"pip refuses {words}"]
    found = [one for one in options.requirements if not (ROOT / one).is_file()]
    places = [after for option, after in pairwise(words) if option == "--find-links"]  # not those of pip's own settings
    found += [one for one in places if one != MADE]
    named = [one for word in [*requirements, *options.editables] for one in in_full(word)]
    return found + [one for one in named if not is_ours(one)]


def in_full(word: str) -> list[str]:
    """As a shell writes braces out: a/{b,c} is a/b and a/c."""
    braces = re.search(r"\{([^{}]*,[^{}]*)\}", word)
    return [word] if braces is None else [word.replace(braces[0], one, 1) for one in braces[1].split(",")]


def is_ours(requirement: str) -> bool:
    named, _, extras = requirement.rstrip("]").partition("[")
    if requirement.startswith(f"{MADE}/"):
        pattern = Path(requirement).name
        return any(fnmatch.fnmatch(f"{name.replace('-', '_')}-0.1.0-any_x86_64.whl", pattern) for name in PROJECTS)
    if named not in PROJECTS:
        file = ROOT / named / "pyproject.toml"
        if not file.is_file():
            return False
        named = parse(file.read_text())["project"]["name"]
    return set(filter(None, extras.split(","))) <= set(PROJECTS[named].get("optional-dependencies", {}))


def faults_of_apt(words: list[str]) -> list[str]:
    """apt-get reads the options of its verb before it says its version."""
    given = [word for word in words[1:] if word.startswith("-")]
    verb, *packages = [word for word in words[1:] if not word.startswith("-")]
    if shutil.which("apt-get") is None:
        pytest.skip("apt-get is not installed")
    ended = subprocess.run(["apt-get", verb, *given, "--version"], capture_output=True, text=True, check=False)
    found = [ended.stderr] if ended.returncode else []
    found += [verb] if verb != "install" else []
    made = (ROOT / "systemd/install.mk").read_text()
    for one in packages:
        if "/" in one and f"{one.removeprefix('./').partition('*')[0]}$(VERSION)_*.deb" not in made:
            found.append(one)
    return found


def faults_of_systemctl(words: list[str]) -> list[str]:
    if shutil.which("systemctl") is None:
        pytest.skip("systemctl is not installed")
    said = subprocess.run(["systemctl", "--help"], capture_output=True, text=True, check=True).stdout
    verb, unit = [word for word in words[1:] if not word.startswith("-")]
    known = re.findall(r"^  ([a-z-]+) ", said, re.MULTILINE)
    return unknown_options(words) + [one for one in (verb,) if one not in known] + absent([f"systemd/{unit}.service"])


def faults_of_usermod(words: list[str]) -> list[str]:
    group = words[words.index("-aG") + 1]
    made = (ROOT / "systemd/fmfts.sysusers").read_text()
    return unknown_options(words) + ([] if re.search(rf"^[ug] {group} ", made, re.MULTILINE) else [group])


def faults_of_sudoedit(words: list[str]) -> list[str]:
    return [word for word in words[1:] if Path(word) not in DEFAULT_PATHS]


def faults_of_ros(words: list[str]) -> list[str]:
    """No ROS 2 is here: the package, its launch file and its topic are looked up in the sources."""
    package = ROOT / "clients/ros2/fmfts_ros"
    if words[:2] == ["ros2", "launch"]:
        return absent([package.parent / words[2] / "launch" / words[3]])
    if words[:3] == ["ros2", "topic", "echo"]:
        topic = words[3].rpartition("/")[2]
        sources = "".join(path.read_text() for path in (package / "fmfts_ros").glob("*.py"))
        return [] if re.search(rf'["/]{topic}"', sources) else [topic]
    if words[:3] == ["colcon", "build", "--packages-select"]:
        return absent([package.parent / one / "package.xml" for one in words[3:]])
    return words


def faults_of_dask(words: list[str]) -> list[str]:
    if shutil.which("dask") is None:
        pytest.skip("dask is not installed (fmfts[cluster])")
    known = options_of("dask", words[1], "--help")
    return [word for word in words[2:] if word.startswith("--") and word not in known]


def faults_of_firmware(words: list[str]) -> list[str]:
    """Our own programs in C: each option, and each test's name, stands in the sources."""
    folders = {"fmfts-host": "firmware/host", "test-core": "tests/firmware"}
    text = "".join(path.read_text() for path in (ROOT / folders[Path(words[0]).name]).glob("*.c"))
    found = [word for word in words[1:] if word.startswith("-") and word not in re.findall(r"--[\w-]+", text)]
    if words[0].endswith("test-core"):
        vectors, *names = words[1:]
        found += absent([vectors]) + [name for name in names if name.strip("_") not in text]
    return found


def faults_of_files(words: list[str]) -> list[str]:
    found = unknown_options(words)
    if words[0] == "ln":
        found += absent([words[-2].replace("$PWD", str(ROOT))])
    if words[:2] == ["journalctl", "-u"]:
        found += absent([f"systemd/{words[2]}.service"])
    return found


def absent(paths: list[str] | list[Path]) -> list[str]:
    return [str(path) for path in paths if not (ROOT / path).exists()]


CHECKS: dict[str, Callable[[list[str]], list[str]]] = {
    "pip": faults_of_pip, "apt": faults_of_apt, "apt-get": faults_of_apt, "systemctl": faults_of_systemctl,
    "usermod": faults_of_usermod, "sudoedit": faults_of_sudoedit, "ros2": faults_of_ros, "colcon": faults_of_ros,
    "dask": faults_of_dask, "firmware/build/fmfts-host": faults_of_firmware,
    "firmware/build/test-core": faults_of_firmware,
    **dict.fromkeys(SHELL, faults_of_shell), **dict.fromkeys(FILES, faults_of_files),
}  # fmt: skip
OTHERS = dict.fromkeys(part for one in every_command() for part in parts_of(one.words)
                       if not PARSED_ELSEWHERE.match(part.words))  # fmt: skip


def faults(words: str) -> list[str]:
    """Why a command cannot be typed; of a program that nobody checks, its name."""
    given = shlex.split(words.split(" < ")[0].split(" > ")[0])
    check = CHECKS.get(given[0])
    return [f"no check of {given[0]}"] if check is None else check(given)


@pytest.mark.parametrize("words", [part.words for part in OTHERS])
def test_program_of_others_takes_every_option_of_the_pages(words: str) -> None:
    assert faults(words) == []


@pytest.mark.parametrize("variable", sorted({name for one in every_command() for part in parts_of(one.words)
                                             for name in part.variables}))  # fmt: skip
def test_variable_in_front_of_a_command_is_read_somewhere(variable: str) -> None:
    folders = ("daemon", "clients", "tests", "extras")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in (".py", ".c")]
    assert any(f'"{variable}"' in path.read_text() for path in files)


@pytest.mark.parametrize(
    "words",
    [
        "pip install --no-such-option .",
        "pip install ./extras/nowhere",
        "pip install ./extras/{page,nowhere}",
        "pip install '.[nothing]'",
        "pip install --find-links elsewhere fmfts",
        "pip install -r release/nowhere.txt",
        "apt-get install --no-such-option gcc",
        "apt install ./build/other_*.deb",
        "systemctl frobnicate fmfts",
        "systemctl stop fmfts-other",
        "git tag --no-such-option v0.1.0",
        "mkdir --no-such-option keys",
        "usermod -aG others me",
        "ros2 launch fmfts_ros other.launch.py",
        "ros2 topic echo /fmfts/left/nothing",
        "firmware/build/fmfts-host --no-such-option",
        "firmware/build/test-core tests/data/wire_vectors.ini _no_such_test",
        "sudoedit /etc/other.toml",
        "frobnicate",
    ],
)
def test_wrong_option_or_name_is_found(words: str) -> None:
    assert faults(words) != []
