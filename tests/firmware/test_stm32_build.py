"""The STM32 firmware as two compilers build it: size, layout, vectors, and the deepest possible stack."""

from __future__ import annotations

import re
import struct
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).parents[2] / "firmware"
FLASH, FLASH_LIMIT, RAM, RAM_LIMIT = 0x0800_0000, 20 * 1024, 0x2000_0000, 4 * 1024
NMI, SYSTICK, USART1, LAST = 2, 15, 16 + 37, 16 + 42
# Exception entry pushes eight words, and one more to align them (ARMv7-M B1.5.6).
EXCEPTION_FRAME = 36

pytestmark = pytest.mark.needs("arm-none-eabi-gcc")


def make(*words: object) -> str:
    run = subprocess.run(["make", "-C", FIRMWARE, *map(str, words)], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


@pytest.fixture(scope="module", params=["gcc", pytest.param("clang", marks=pytest.mark.needs("clang", "ld.lld"))])
def elf(request: pytest.FixtureRequest) -> Path:
    if request.param == "gcc":
        make("stm32")
        return FIRMWARE / "build/fmfts.elf"
    make("stm32-clang")
    return FIRMWARE / "build/fmfts-clang.elf"


def symbols(elf: Path) -> dict[str, int]:
    listing = subprocess.run(["arm-none-eabi-nm", elf], capture_output=True, text=True, check=True).stdout
    return {name: int(address, 16) for address, _, name in (line.split() for line in listing.splitlines())}


def image(elf: Path, tmp_path: Path) -> bytes:
    subprocess.run(["arm-none-eabi-objcopy", "-O", "binary", elf, tmp_path / "image"], check=True)
    return (tmp_path / "image").read_bytes()


def test_firmware_image_fits_into_flash(elf: Path, tmp_path: Path) -> None:
    assert 4096 < len(image(elf, tmp_path)) <= FLASH_LIMIT


def test_all_data_in_ram_lie_above_the_stack(elf: Path) -> None:
    names = symbols(elf)
    in_ram = {name: address for name, address in names.items() if RAM <= address < RAM + 0x5000}
    assert max(in_ram.values()) <= RAM + RAM_LIMIT
    # A stack that overflows must leave the RAM and fault, instead of overwriting variables.
    assert {name for name, address in in_ram.items() if address < names["stack_end"]} == set()


def test_every_vector_leads_to_its_handler(elf: Path, tmp_path: Path) -> None:
    names = symbols(elf)
    handlers = {1: "reset_handler", NMI: "nmi_handler", SYSTICK: "systick_handler", USART1: "usart1_handler"}
    vectors = struct.unpack_from(f"<{LAST + 1}I", image(elf, tmp_path))
    assert vectors[0] == names["stack_end"]
    for number in range(1, LAST + 1):
        expected = names[handlers.get(number, "unexpected_handler")]
        assert vectors[number] == expected | 1, f"exception {number}"  # bit 0: Thumb


def test_build_prints_its_sizes() -> None:
    (report,) = re.findall(r"flash (\d+) of 20480 bytes, RAM (\d+) of 4096 bytes", make("stm32"))
    assert (FIRMWARE / "build/fmfts.bin").stat().st_size == int(report[0])
    assert "Memory Configuration" in (FIRMWARE / "build/fmfts.map").read_text()


@pytest.mark.parametrize("excess", ["const char excess[8192] = {1};", "char excess[1024];"])
def test_program_that_exceeds_a_limit_does_not_link(excess: str, tmp_path: Path) -> None:
    (tmp_path / "excess.c").write_text(excess)
    compiler = f"ARM_CC=arm-none-eabi-gcc {tmp_path}/excess.c -Wl,-u,excess"
    run = subprocess.run(
        ["make", "-C", FIRMWARE, f"BUILD={tmp_path}", compiler, tmp_path / "fmfts.elf"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert run.returncode != 0
    assert "overflowed" in run.stderr


# The functions that a call through a pointer can reach, by the pointer's name.
KINDS = ["qmc5883l", "qmc5883p", "memsic", "mlx90393", "lis3mdl"]
MEMSIC = ["mmc5983ma", "mmc5603nj"]
POINTED = {
    "now_us": ["now_us"],
    "send": ["serial_send"],
    "turns": ["identify", "reset", "configure", "sensor_poll", "do_chore"],
    "identify": ["hmc5983_chip_identify", *(f"{kind}_identify" for kind in KINDS)],
    "is_identification": [
        "hmc5983_is_identification",
        *(f"{kind}_is_identification" for kind in [*KINDS, *MEMSIC] if kind != "memsic"),
    ],
    "reset": ["memsic_reset", "mlx90393_reset"],
    "set": ["memsic_set"],
    "set_up": ["hmc5983_chip_set_up", *(f"{kind}_set_up" for kind in KINDS)],
    "check": ["hmc5983_chip_check", *(f"{kind}_check" for kind in KINDS)],
    "read_status": ["hmc5983_chip_read_status", *(f"{kind}_read_status" for kind in KINDS)],
    "read_counts": ["hmc5983_chip_read_counts", *(f"{kind}_read_counts" for kind in KINDS if kind != "mlx90393")],
    "read_thermometer": ["hmc5983_chip_read_thermometer", "lis3mdl_read_thermometer"],
    "write": ["write"],
    "read": ["read"],
    "read_register": ["read_register"],
    "recover": ["i2c_recover"],
    "data_is_high": ["data_is_high"],
    "set_clock": ["set_clock"],
}


class CallGraph:
    """From GCC's `-fcallgraph-info=su`: frame sizes, and who calls whom."""

    def __init__(self, folder: Path) -> None:
        self.frames: dict[str, int] = {}
        self.calls: dict[str, set[str]] = {}
        text = "\n".join(path.read_text() for path in folder.glob("*.ci"))
        for title, frame in re.findall(r'node: \{ title: "(.*?)" label: ".*?(\d+) bytes \(static\)', text):
            self.frames[title] = int(frame)
        for caller, callee, label in re.findall(r'sourcename: "(.*?)" targetname: "(.*?)"(?: label: "(.*?)")?', text):
            targets = self._pointed(label) if callee == "__indirect_call" else [callee]
            self.calls.setdefault(caller, set()).update(targets)

    def _pointed(self, place: str) -> Iterator[str]:
        file, line, _ = place.split(":")
        (name,) = re.findall(
            r"(?:->|\b)(\w+)(?:\[[^]]*\])?\(", (FIRMWARE / file).read_text().splitlines()[int(line) - 1]
        )[-1:]
        for function in POINTED[name]:
            known = [title for title in self.frames if title.split(":")[-1] == function]
            assert known, f"{place}: {function} is not in the program"
            yield from known

    @cache  # noqa: B019 - lives as long as the test
    def deepest(self, function: str) -> tuple[int, tuple[str, ...]]:
        below = max((self.deepest(callee) for callee in self.calls.get(function, ())), default=(0, ()))
        return self.frames.get(function, 0) + below[0], (function, *below[1])


def test_stack_has_room_for_the_deepest_call_and_an_interrupt(tmp_path: Path) -> None:
    make(f"BUILD={tmp_path}", "ARM_CC=arm-none-eabi-gcc -fcallgraph-info=su", tmp_path / "fmfts.elf")
    graph = CallGraph(tmp_path)
    assert len(graph.frames) > 100
    main, path = graph.deepest("main")
    handler, _ = max(graph.deepest(name) for name in ("systick_handler", "usart1_handler"))
    # Handlers share one priority, so that at most one is on the stack.
    needed = graph.frames["reset_handler"] + main + EXCEPTION_FRAME + handler
    reserved = symbols(tmp_path / "fmfts.elf")["stack_end"] - RAM
    assert 500 < needed <= reserved, f"{needed} of {reserved} bytes: {' → '.join(path)}"
