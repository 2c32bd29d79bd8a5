"""Shared by all tests: the emulators on the path, Hypothesis without chance, and the pad for most tests."""

from __future__ import annotations

import gc
import os
import shutil
import signal
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as cli/entry.py does, and before anything imports NumPy

from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Pad

sys.path.insert(0, str(Path(__file__).parent))

# Daemons of the tests must not see what a service manager or a container set for this process.
for told in (
    "NOTIFY_SOCKET",
    "WATCHDOG_USEC",
    "WATCHDOG_PID",
    "STATE_DIRECTORY",
    "RUNTIME_DIRECTORY",
    "JOURNAL_STREAM",
    "PYTHONDONTWRITEBYTECODE",  # containers set it: each daemon would compile its modules anew
):
    os.environ.pop(told, None)

# A shell that starts this in the background makes it, and all programs that it starts, ignore Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

pytest_plugins = ["left_behind", "repeating"]


def without_chance_of_imports() -> None:
    """Hypothesis also draws numbers and texts that stand in the sources of whatever was imported before: other ones in
    each worker, and after any change. Its versions before 6.131 do not."""
    with suppress(ImportError, AttributeError):
        from hypothesis.internal.conjecture import providers

        none = providers.Constants()
        providers._get_local_constants = lambda: none


without_chance_of_imports()
settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.register_profile("few", settings.get_profile("deterministic"), max_examples=10)  # for emulated machines
settings.load_profile("deterministic")


# Files and tests that take long come first, so that no worker runs one alone at the end.
LONGEST = {
    "test_magnet_check.py",
    "test_baseline_turn.py",
    "test_weigh.py",
    "test_stated_world.py",
    "test_slip.py",
    "test_wire.py",
    "test_warming_offsets.py",
    "test_posture_pipeline.py",
    "test_reciprocity.py",
    "test_charts.py",
    "test_golden.py",
    "test_solver.py",
    "test_field_response.py",
    "test_moving_hand.py",
    "test_skin.py",
    "test_i2c_first_use.py",
    "test_collect_by_hand.py",
    "test_weigh_on_board.py",
    "test_stream_for_a_minute.py",
    "test_learn.py",
    "test_learned_geometry.py",
    "test_named_boards.py",
    "test_diagnosis.py",
    "test_baseline_refine.py",
    "test_fault_drills.py",
    "test_fast_loop_of_a_board.py",
    "test_firmware_in_the_loop.py",
    "test_emulator_load_cell.py",
    "test_emulator_pad_of_eight.py",
    "test_collect_array.py",
    "test_two_fingers_of_the_demo_meet_and_part",
    "test_early_samples_are_replayed_identically",
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: (item.name not in LONGEST, item.path.name not in LONGEST))


def pytest_collection_finish() -> None:
    """What is collected stays until the end: the garbage collector need not look through it again and again."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)  # before the fixtures that call them
def pytest_runtest_setup(item: pytest.Item) -> None:
    from needed import missing, package_is_absent

    for mark in item.iter_markers("needs"):
        for program in mark.args:
            if not shutil.which(program):
                missing(f"{program} (make test-packages)")
        for package, extra in mark.kwargs.items():
            if package_is_absent(package):
                missing(f"{package} (pip install -e clients/python -e '.[{extra}]')")


@pytest.fixture
def pad() -> Pad:
    """The standard pad, its magnet a dipole: fields that tests make of it are known to all digits."""
    drawn = PadConfig(name="standard", source=SimulatedSource()).pad()
    return replace(drawn, magnet=replace(drawn.magnet, as_cylinder=False))
