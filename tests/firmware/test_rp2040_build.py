"""The RP2040's firmware as GCC builds it: size, boot block, vectors, UF2, and the deepest possible stack.

`make test-rp2040` (rp2040_drills.py) tests that it runs.
"""

from __future__ import annotations

import struct
import subprocess
from pathlib import Path

import pytest
from test_stm32_build import EXCEPTION_FRAME, FIRMWARE, POINTED, RAM, CallGraph, make, symbols

FLASH, FLASH_LIMIT, RAM_LIMIT = 0x1000_0000, 24 * 1024, 8 * 1024
USB, UART0, LAST = 16 + 5, 16 + 20, 16 + 25
STRIPED_END = 0x2004_0000
DIVISION = 40  # the compiler's own library has no data on its frames; its division pushes a few registers

pytestmark = pytest.mark.needs("arm-none-eabi-gcc")


@pytest.fixture(scope="module")
def image() -> bytes:
    make("rp2040")
    return (FIRMWARE / "build/fmfts-rp2040.bin").read_bytes()


def crc32_of_the_rom(data: bytes) -> int:
    """Bit by bit, as the data sheet defines it (2.8.1.3.1)."""
    register = 0xFFFF_FFFF
    for bit in (byte >> place & 1 for byte in data for place in range(7, -1, -1)):
        out, register = register >> 31, register << 1 & 0xFFFF_FFFF
        if out ^ bit:
            register ^= 0x04C1_1DB7
    return register


def test_crc_is_the_catalogued_one() -> None:
    assert crc32_of_the_rom(b"123456789") == 0x0376_E6E7  # CRC-32/MPEG-2


def test_image_and_ram_fit_their_shares(image: bytes) -> None:
    assert 4096 < len(image) <= FLASH_LIMIT
    names = symbols(FIRMWARE / "build/fmfts-rp2040.elf")
    in_ram = {name: address for name, address in names.items() if RAM <= address < STRIPED_END}
    assert max(in_ram.values()) <= RAM + RAM_LIMIT
    assert {name for name, address in in_ram.items() if address < names["stack_end"]} == set()
    (line,) = [line for line in make("rp2040").splitlines() if "flash" in line]
    assert f"flash {len(image)} of 24576 bytes, RAM " in line


def test_qt_py_s_image_has_its_own_name_and_its_own_pins(image: bytes) -> None:
    make("rp2040", "RP2040_BOARD=qtpy")
    other = (FIRMWARE / "build/fmfts-rp2040-qtpy.bin").read_bytes()
    assert (FIRMWARE / "build/fmfts-rp2040-qtpy.uf2").stat().st_size == 512 * -(-len(other) // 256)
    pico, qtpy = bytes([4, 5, 8]), bytes([24, 25, 26])  # SDA, SCL and RESET of port 1, as `struct i2c_port` has them
    assert (pico in image, qtpy in image) == (True, False)
    assert (pico in other, qtpy in other) == (False, True)


def test_another_board_s_name_is_refused_where_rp2040_is_built_and_nowhere_else(
    image: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BOARD", "nucleo")  # Zephyr's shells have it
    monkeypatch.setenv("RP2040_BOARD", "feather")
    make("-n", "host")
    with pytest.raises(AssertionError, match=r"RP2040_BOARD=feather is no board .* one of pico qtpy"):
        make("rp2040")
    monkeypatch.delenv("RP2040_BOARD")
    make("rp2040")
    assert (FIRMWARE / "build/fmfts-rp2040.bin").read_bytes() == image


def test_rom_accepts_the_boot_block(image: bytes) -> None:
    assert struct.unpack_from("<I", image, 252)[0] == crc32_of_the_rom(image[:252])


def test_every_vector_leads_to_its_handler(image: bytes) -> None:
    names = symbols(FIRMWARE / "build/fmfts-rp2040.elf")
    vectors = struct.unpack_from(f"<{LAST + 1}I", image, 256)
    assert vectors[0] == names["stack_end"]
    handlers = {1: "reset_handler", USB: "usbctrl_handler", UART0: "uart0_handler"}
    for number in range(1, LAST + 1):
        assert vectors[number] == names[handlers.get(number, "unexpected_handler")] | 1, f"exception {number}"


def test_uf2_holds_the_image_for_this_chip(image: bytes) -> None:
    """By Microsoft's definition of the format: blocks of 512 bytes, each for 256 of flash."""
    data = (FIRMWARE / "build/fmfts-rp2040.uf2").read_bytes()
    count, rest = divmod(len(data), 512)
    assert (rest, count) == (0, -(-len(image) // 256))
    held = b""
    for number in range(count):
        block = data[512 * number : 512 * (number + 1)]
        assert struct.unpack_from("<II", block) == (0x0A32_4655, 0x9E5D_5157)
        flags, address, size, place, blocks, family = struct.unpack_from("<6I", block, 8)
        assert (flags, address, size, place, blocks) == (0x2000, FLASH + 256 * number, 256, number, count)
        assert family == 0xE48B_FF56
        assert struct.unpack_from("<I", block, 508) == (0x0AB1_6F30,)
        held += block[32 : 32 + 256]
    assert held.rstrip(b"\0") == image.rstrip(b"\0")


@pytest.mark.parametrize("excess", ["const char excess[16384] = {1};", "char excess[4096];"])
def test_program_that_exceeds_a_limit_does_not_link(excess: str, tmp_path: Path) -> None:
    (tmp_path / "excess.c").write_text(excess)
    compiler = f"ARM_CC=arm-none-eabi-gcc {tmp_path}/excess.c -Wl,-u,excess"
    run = subprocess.run(
        ["make", "-C", FIRMWARE, f"BUILD={tmp_path}", compiler, tmp_path / "fmfts-rp2040.elf"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert run.returncode != 0
    assert "overflowed" in run.stderr


def test_stack_has_room_for_the_deepest_call_and_an_interrupt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    of_this_board = {"recover": "recover", "send": "host_link_send", "in_ram": "ask_flash", "use": "take_from_host"}
    for pointer, function in (of_this_board | {name: name for name in ("open_endpoints", "port_opened")}).items():
        monkeypatch.setitem(POINTED, pointer, [function])
    make(f"BUILD={tmp_path}", "ARM_CC=arm-none-eabi-gcc -fcallgraph-info=su", tmp_path / "fmfts-rp2040.elf")
    graph = CallGraph(tmp_path)
    assert len(graph.frames) > 100
    (reset,) = (title for title in graph.frames if title.endswith("reset_handler"))
    main, path = graph.deepest("main")
    handler, _ = max(graph.deepest(name) for name in ("uart0_handler", "usbctrl_handler"))
    needed = graph.frames[reset] + main + DIVISION + EXCEPTION_FRAME + handler
    reserved = symbols(tmp_path / "fmfts-rp2040.elf")["stack_end"] - RAM
    assert 500 < needed <= reserved, f"{needed} of {reserved} bytes: {' → '.join(path)}"
