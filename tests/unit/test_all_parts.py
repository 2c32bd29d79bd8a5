"""`make test`: every part runs, whatever the result of the one before, and one summary says what to report."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest

import all_parts
import left_behind
from repeating import family

TESTS = """
import pytest

def test_good(record_property):
    record_property("repeated", "other programs took 90% of a processor")

class TestGroup:
    def test_bad(self):
        assert 1 == 2, "one is not two"

@pytest.fixture
def broken():
    raise OSError("no board")

def test_without_its_board(broken):
    pass

@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.skipif(True, reason="forbidden here")
def test_forbidden(number):
    pass
"""


@pytest.fixture
def parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, list[list[str]]]:
    """The parts of `make test`, with their logs in a separate folder."""
    (tmp_path / "pytest.ini").touch()
    (tmp_path / "test_of_many.py").write_text(TESTS)
    (tmp_path / "test_of_one.py").write_text("def test_good(): pass\n")
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setattr(all_parts, "LOGS", tmp_path / "logs")
    found = {
        "first": [["-c", "print('here'); raise SystemExit(3)"], ["-c", "print('and there')"]],
        "second": [[*all_parts.PYTEST, "--rootdir", str(tmp_path), str(tmp_path / "test_of_many.py")]],
        "third": [[*all_parts.PYTEST, "--rootdir", str(tmp_path), str(tmp_path / "test_of_one.py")]],
    }
    monkeypatch.setattr(all_parts, "PARTS", found)
    return found


def outcome(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], *names: str) -> tuple[int, list[str]]:
    """The exit code, and the summary's lines."""
    monkeypatch.setattr(sys, "argv", ["all_parts.py", *names])
    code = all_parts.main()
    return code, capfd.readouterr().out.rpartition("=" * 78)[2].strip().splitlines()


@pytest.mark.usefixtures("parts")
def test_all_parts_run_and_summary_shows_each_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    code, lines = outcome(monkeypatch, capfd)
    assert code == 1
    assert [line.split()[:2] for line in lines[:3]] == [["first", "FAILED"], ["second", "FAILED"], ["third", "passed"]]
    text = "\n".join(lines)
    assert "ended with 3" in text
    assert "test_of_many.py::TestGroup::test_bad: AssertionError: one is not two" in text
    assert 'test_of_many.py::test_without_its_board: failed on setup with "OSError: no board"' in text
    assert "test_of_many.py::test_good: other programs took 90% of a processor" in text
    assert "forbidden here: test_of_many.py::test_forbidden[1] and 1 more" in text
    assert lines[-1].startswith("2 of 3 parts failed. To report it: ")
    assert lines[-1].endswith(f"{tmp_path}/logs/first.log {tmp_path}/logs/second.log")
    assert (tmp_path / "logs/first.log").read_text() == "here\nand there\n"
    assert "one is not two" in (tmp_path / "logs/second.log").read_text()


WAITS = """
import pathlib, subprocess, time

def test_waits():
    child = subprocess.Popen(["sleep", "60"], start_new_session=True)
    pathlib.Path(__file__).with_name("child").write_text(str(child.pid))
    time.sleep(60)
"""

LEAVES_A_CHILD = """
import subprocess, sys, time
print(subprocess.Popen(["sleep", "60"], start_new_session=True).pid, flush=True)
time.sleep(float(sys.argv[1]))
"""


def test_part_without_end_is_ended_with_all_that_it_started(
    tmp_path: Path,
    parts: dict[str, list[list[str]]],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    parts["first"] = [["-c", LEAVES_A_CHILD, "60"]]
    monkeypatch.setattr(all_parts, "PART_LIMIT_S", 5)
    start_s = time.monotonic()
    code, lines = outcome(monkeypatch, capfd, "first")
    assert code == 1
    assert "did not end within 5 s" in "\n".join(lines)
    assert time.monotonic() - start_s < 30.0
    wait_for_end(int((tmp_path / "logs/first.log").read_text()))


def wait_for_end(process: int) -> None:
    until = time.monotonic() + 30.0  # a killed process ends when the kernel next runs it
    while any(said[0] != "Z" for said in family(process).values()):
        assert time.monotonic() < until, "a child, in a session of its own, still runs"
        time.sleep(0.01)


def test_part_that_leaves_a_process_behind_is_not_waited_for(
    parts: dict[str, list[list[str]]], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    parts["first"] = [["-c", LEAVES_A_CHILD, "0"]]
    start_s = time.monotonic()
    assert outcome(monkeypatch, capfd, "first")[0] == 0
    assert time.monotonic() - start_s < 30.0


def test_test_without_end_fails_by_its_name(
    tmp_path: Path,
    parts: dict[str, list[list[str]]],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "conftest.py").write_text('pytest_plugins = ["left_behind"]\n')
    (tmp_path / "test_of_one.py").write_text(WAITS)
    monkeypatch.setenv("PYTHONPATH", str(Path(left_behind.__file__).parent))
    monkeypatch.delenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD")
    bounded = [word.replace(f"={all_parts.TEST_LIMIT_S}", "=1") for word in all_parts.BOUNDED]
    parts["third"] = [[*bounded, "-n", "1", "--rootdir", str(tmp_path), str(tmp_path / "test_of_one.py")]]
    code, lines = outcome(monkeypatch, capfd, "third")
    assert code == 1
    assert "crashed while running 'test_of_one.py::test_waits'" in "\n".join(lines)
    assert "line 7 in test_waits" in (tmp_path / "logs/third.log").read_text()
    wait_for_end(int((tmp_path / "child").read_text()))  # a child that the worker could not end


@pytest.mark.usefixtures("parts")
def test_part_that_passes_passes(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    code, lines = outcome(monkeypatch, capfd, "third")
    assert (code, len(lines)) == (0, 1)
    assert "1 tests" in lines[0]


def test_tests_that_end_without_a_report_are_a_failure(
    parts: dict[str, list[list[str]]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "test_of_one.py").write_text("import os\ndef test_that_kills(): os._exit(0)\n")
    code, _ = outcome(monkeypatch, capfd, "third")
    assert code == 1


def test_part_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["all_parts.py", "everything"])
    with pytest.raises(SystemExit, match="2"):
        all_parts.main()
    assert "lint, unit, processes, clock" in capfd.readouterr().err
