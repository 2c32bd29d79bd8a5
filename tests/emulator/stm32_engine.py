"""Unicorn as a Cortex-M3: memory, one dispatch for all registers, and a block hook that counts time.

The library is called directly if its Python wrapper would cost more than the call. `emu_stop` is called from the
block hook only: called elsewhere, Unicorn may go on for a block that has been counted already.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import struct
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

from unicorn import (
    UC_ARCH_ARM,
    UC_HOOK_BLOCK,
    UC_HOOK_INTR,
    UC_MODE_MCLASS,
    UC_MODE_THUMB,
    UC_PROT_EXEC,
    UC_PROT_READ,
    Uc,
    UcError,
)
from unicorn.arm_const import (
    UC_ARM_REG_LR,
    UC_ARM_REG_PC,
    UC_ARM_REG_PRIMASK,
    UC_ARM_REG_R0,
    UC_ARM_REG_R1,
    UC_ARM_REG_R2,
    UC_ARM_REG_R3,
    UC_ARM_REG_R12,
    UC_ARM_REG_SP,
    UC_ARM_REG_XPSR,
    UC_CPU_ARM_CORTEX_M3,
)
from unicorn.unicorn_py3.unicorn import uclib

TICKS_PER_S = 576_000_000  # a multiple of 8, 36, 48, 64 and 72 MHz: every cycle is a whole number of ticks
FLASH, FLASH_SIZE, RAM, RAM_SIZE = 0x0800_0000, 0x10000, 0x2000_0000, 0x5000
SYSTEM_MEMORY, SYSTEM_MEMORY_SIZE = 0x1FFF_F000, 0x1000  # boot loader, flash size register, unique id
PERIPHERALS, PERIPHERALS_SIZE = 0x4000_0000, 0x24000
CORE, CORE_SIZE = 0xE000_0000, 0x100000
# Unicorn will not execute at 0xFFFFFFF9, where a Cortex-M returns from exceptions to; LR holds this instead.
TRAP = 0x1FFE_0000
NEVER = 2**63
READ_ONLY = UC_PROT_READ | UC_PROT_EXEC
FRAME = (
    *(UC_ARM_REG_R0, UC_ARM_REG_R1, UC_ARM_REG_R2, UC_ARM_REG_R3),
    *(UC_ARM_REG_R12, UC_ARM_REG_LR, UC_ARM_REG_PC, UC_ARM_REG_XPSR),
)

Read = Callable[[int, int], int]  # address, width; the value
Write = Callable[[int, int, int], None]  # address, width, value
_READ = ctypes.CFUNCTYPE(ctypes.c_uint64, ctypes.c_void_p, ctypes.c_uint64, ctypes.c_uint, ctypes.c_void_p)
_WRITE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint64, ctypes.c_uint, ctypes.c_uint64, ctypes.c_void_p)
_NOTHING = ctypes.c_void_p(None)


class Clock(ctypes.Structure):
    """struct clock of stm32_hooks.c, which reads and writes it between all instructions of ours."""

    _fields_ = [
        *((name, ctypes.c_uint64) for name in ("now", "deadline", "ticks_per_cycle", "stopped", "pc", "trap_page")),
        ("due", ctypes.c_uint64),
        *((name, ctypes.c_uint64) for name in ("systick_runs", "systick_load", "systick_zero", "icsr")),
        *((name, ctypes.c_void_p) for name in ("unicorn", "read")),
    ]


class Unicorn(ctypes.Structure):
    """struct unicorn of stm32_hooks.c."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("stop", "start", "read_registers", "write_registers")),
        *((name, ctypes.c_void_p) for name in ("read_memory", "write_memory")),
        ("frame", ctypes.c_int * len(FRAME)),
        ("stack", ctypes.c_int),
    ]

    @classmethod
    def loaded(cls) -> Unicorn:
        functions = (uclib.uc_emu_stop, uclib.uc_emu_start, uclib.uc_reg_read_batch, uclib.uc_reg_write_batch)
        functions += (uclib.uc_mem_read, uclib.uc_mem_write)
        return cls(*map(_address, functions), (ctypes.c_int * len(FRAME))(*FRAME), UC_ARM_REG_SP)


def _hooks() -> ctypes.CDLL:
    source = Path(__file__).with_name("stm32_hooks.c")
    name = f"fmfts-stm32-hooks-{os.getuid()}-{hashlib.sha256(source.read_bytes()).hexdigest()[:16]}.so"
    library = Path(tempfile.gettempdir()) / name
    if not library.exists():
        built = library.with_suffix(f".{os.getpid()}")
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", source, "-o", built], check=True)
        built.rename(library)
    return ctypes.CDLL(str(library))


def _address(function: object) -> int | None:
    return ctypes.cast(function, ctypes.c_void_p).value


class _Registers:
    """A fixed set of CPU registers, read and written in one call."""

    def __init__(self, handle: ctypes.c_void_p, numbers: tuple[int, ...]) -> None:
        self.values = (ctypes.c_uint32 * len(numbers))()
        size = ctypes.sizeof(ctypes.c_uint32)
        places = (ctypes.c_void_p * len(numbers))(
            *(ctypes.addressof(self.values) + size * i for i in range(len(numbers)))
        )
        self._arguments = (handle, (ctypes.c_int * len(numbers))(*numbers), places, len(numbers))

    def read(self) -> ctypes.Array[ctypes.c_uint32]:
        uclib.uc_reg_read_batch(*self._arguments)
        return self.values

    def write(self, *values: int) -> None:
        self.values[:] = values
        uclib.uc_reg_write_batch(*self._arguments)


class Engine:
    """The CPU. `read` and `write` get an absolute register address; `run` raises their errors."""

    def __init__(self, read: Read, write: Write) -> None:
        self.uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M3)
        self._handle = self.uc._uch
        self._hooks = _hooks()
        self._unicorn = Unicorn.loaded()
        self.clock = Clock(trap_page=TRAP >> 12, unicorn=ctypes.addressof(self._unicorn), due=NEVER)
        self._arguments = self._handle, ctypes.byref(self.clock)
        self.vector_table = 0
        self.failure: Exception | None = None
        self.exception: int | None = None
        readable = READ_ONLY
        # BOOT0 low: flash also appears at 0.
        for base in (0, FLASH):
            self.uc.mem_map(base, FLASH_SIZE, readable)
        self.uc.mem_map(RAM, RAM_SIZE)
        self.uc.mem_map(SYSTEM_MEMORY, SYSTEM_MEMORY_SIZE, readable)
        self.uc.mem_map(TRAP, 0x1000, readable)
        self.uc.mem_write(TRAP, b"\xfe\xe7" * 0x800)  # b .
        blocks = ((PERIPHERALS, PERIPHERALS_SIZE), (CORE, CORE_SIZE))
        self._callbacks = [self._map(base, size, read, write) for base, size in blocks]
        self._frame = _Registers(self._handle, FRAME)
        self._stack = _Registers(self._handle, (UC_ARM_REG_SP,))
        self._pc = _Registers(self._handle, (UC_ARM_REG_PC,))
        self._primask = _Registers(self._handle, (UC_ARM_REG_PRIMASK,))
        self._hook = ctypes.c_size_t()
        every_address = (ctypes.c_uint64(1), ctypes.c_uint64(0))
        uclib.uc_hook_add(
            *(self._handle, ctypes.byref(self._hook), ctypes.c_int(UC_HOOK_BLOCK), self._hooks.on_block),
            *(ctypes.byref(self.clock), *every_address),
        )
        self.uc.hook_add(UC_HOOK_INTR, self._on_cpu_exception)

    def _map(self, base: int, size: int, read: Read, write: Write) -> tuple[object, object]:
        def on_read(_engine: int, offset: int, width: int, _context: int) -> int:
            try:
                return read(base + offset, width)
            except Exception as failure:  # noqa: BLE001 - ctypes would swallow it; `run` raises it
                self._fail(failure)
                return 0

        def on_write(_engine: int, offset: int, width: int, value: int, _context: int) -> None:
            try:
                write(base + offset, width, value)
            except Exception as failure:  # noqa: BLE001
                self._fail(failure)

        reader, writer = _READ(on_read), _WRITE(on_write)
        first = reader
        if base == CORE:  # asks the Python callback only for unknown values
            self.clock.read = _address(reader)
            first = self._hooks.on_core_read
        address, context = (ctypes.c_uint64(base), ctypes.c_uint64(size)), ctypes.byref(self.clock)
        uclib.uc_mmio_map(self._handle, *address, first, context, writer, _NOTHING)
        return reader, writer

    def _fail(self, failure: Exception) -> None:
        self.failure = self.failure or failure
        self.clock.deadline = 0

    def _on_cpu_exception(self, _uc: Uc, number: int, _context: object) -> None:
        self.exception = number
        self.faulting_pc = self.pc
        self._pc.write(TRAP | 1)  # otherwise Unicorn returns here for ever

    def load(self, segments: list[tuple[int, bytes]]) -> None:
        for address, content in segments:
            self.uc.mem_write(address, content)
            if FLASH <= address < FLASH + FLASH_SIZE:
                self.uc.mem_write(address - FLASH, content)

    @property
    def pc(self) -> int:
        return self._pc.read()[0]

    @property
    def primask(self) -> bool:
        return bool(self._primask.read()[0] & 1)

    @primask.setter
    def primask(self, masked: bool) -> None:
        self._primask.write(int(masked))

    def word(self, address: int) -> int:
        return int.from_bytes(self.uc.mem_read(address, 4), "little")

    def reset(self) -> None:
        self.primask = False
        self._frame.write(*(0,) * 5, 0xFFFF_FFFF, self.word(4) | 1, 0x0100_0000)
        self._stack.write(self.word(0))

    def jump(self, address: int) -> None:
        self._pc.write(address | 1)

    def run(self) -> bool:
        """Continue until the deadline, a WFI (then returns False) or the end of an exception handler."""
        self.exception = None
        status = self._hooks.run(*self._arguments)
        if self.failure:
            failure, self.failure = self.failure, None
            raise failure
        if status:
            raise UcError(status)
        return bool(self.clock.stopped)

    @property
    def in_trap(self) -> bool:
        """It stopped at the end of an exception handler."""
        return self.clock.pc >> 12 == TRAP >> 12

    def enter_exception(self, number: int) -> None:
        self._hooks.enter_exception(*self._arguments, self.vector_table + 4 * number)

    def leave_exception(self) -> None:
        self._hooks.leave_exception(*self._arguments)


def read_elf(path: Path) -> list[tuple[int, bytes]]:
    """The data that a flash tool would write: the loadable segments at their physical addresses (ELF32, little-endian,
    ARM)."""
    image = path.read_bytes()
    if image[:6] != b"\x7fELF\x01\x01" or struct.unpack_from("<H", image, 18)[0] != 40:
        raise ValueError(f"{path} is no 32-bit ARM ELF file")
    table, size, count = struct.unpack_from("<I", image, 28)[0], *struct.unpack_from("<HH", image, 42)
    segments = []
    for header in range(table, table + size * count, size):
        kind, offset, _, address, length = struct.unpack_from("<5I", image, header)
        if kind == 1 and length:
            segments.append((address, image[offset : offset + length]))
    return segments
