"""The emulated I2C port is as strict as the chip: correct drivers work, and each classic wrong one fails as on a
board."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from emulator.stm32_board import Board

SOURCES = Path(__file__).parent / "stm32_drivers"
RESULT = 0x2000_0000
COMPILER = "arm-none-eabi-gcc"
SECTIONS = (".vectors=0x08000000", ".text=0x08000100", ".result=0x20000000")

pytestmark = pytest.mark.needs("arm-none-eabi-gcc")


class Ran:
    """A driver after its scenario: its findings, and the chip's complaints."""

    def __init__(self, board: Board) -> None:
        result = bytes(board.machine.engine.uc.mem_read(RESULT, 72))
        self.finished, self.failed = (int.from_bytes(result[at : at + 4], "little") for at in (0, 4))
        self.bytes = result[8:]
        self.complaints = board.complaints


@pytest.fixture
def build(tmp_path: Path) -> Callable[[str], Path]:
    def build(name: str) -> Path:
        elf = tmp_path / f"{name}.elf"
        flags = ["-mcpu=cortex-m3", "-mthumb", "-Os", "-Wall", "-Wextra", "-Werror", "-ffreestanding", "-nostdlib"]
        link = [f"-Wl,--section-start={section}" for section in SECTIONS] + ["-Wl,--entry=scenario", "-lgcc"]
        sources = [SOURCES / "driver.c", SOURCES / f"{name}.c"]
        subprocess.run([COMPILER, *flags, *sources, *link, "-o", elf], check=True)
        return elf

    return build


@pytest.fixture
def run(build: Callable[[str], Path]) -> Callable[[str], Ran]:
    def run(name: str) -> Ran:
        board = Board(build(name))
        board.sensors[0][0].registers[3:9] = bytes.fromhex("123456789abc")
        board.run(0.1)
        return Ran(board)

    return run


def test_manuals_receive_sequences_work(run: Callable[[str], Ran]) -> None:
    ran = run("right_reads")
    assert ran.finished
    assert ran.failed == 0
    data = b"\x12\x34\x56\x78\x9a\xbc"  # after the last of the six comes the first again
    assert ran.bytes[:25] == b"H" * 2 + b"H4" * 2 + b"H43" * 3 + data + data[:4]
    assert ran.complaints == []


def test_late_stop_reads_one_byte_too_many_for_the_next_time(run: Callable[[str], Ran]) -> None:
    ran = run("stop_after_last_byte")
    assert ran.bytes[:1] == b"H"
    assert ran.bytes[1:2] == b"\xff"  # released by the sensor when it was refused


def test_acknowledge_withdrawn_after_addr_is_too_late_for_one_byte(run: Callable[[str], Ran]) -> None:
    ran = run("ack_cleared_after_addr")
    assert ran.bytes[:3] != b"H43"
    assert any("acknowledged" in complaint for complaint in ran.complaints)


def test_address_before_sb_goes_nowhere(run: Callable[[str], Ran]) -> None:
    ran = run("no_wait_for_sb")
    assert ran.failed
    assert ran.bytes[:1] == b"\0"


def test_two_bytes_without_pos_bring_a_third(run: Callable[[str], Ran]) -> None:
    ran = run("late_refusal_of_two")
    assert ran.bytes[:2] == b"H4"
    assert ran.bytes[2:4] != b"H4"


def test_sensor_is_not_reached_in_the_transfer_that_selects_it(run: Callable[[str], Ran]) -> None:
    ran = run("mux_and_read_in_one_transfer")
    assert ran.failed
    assert ran.bytes[:1] == b"\0"


def test_emulator_notices_reads_with_two_open_channels(run: Callable[[str], Ran]) -> None:
    ran = run("two_channels_on")
    assert ran.failed == 0
    assert any("several channels" in complaint for complaint in ran.complaints)


def test_addr_without_sr2_holds_the_clock_for_ever(run: Callable[[str], Ran]) -> None:
    ran = run("addr_not_cleared")
    assert ran.failed
    assert ran.bytes[:1] == b"\0"


def test_stuck_busy_needs_the_lines_moved_before_the_reset(build: Callable[[str], Path]) -> None:
    board = Board(build("busy_reset_only"))
    board.run(0.001)
    board.latch_busy(0)
    board.run(0.01)
    assert Ran(board).bytes[:3] == bytes((False, True, True))
