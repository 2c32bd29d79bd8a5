"""An emulated chip whose first byte written is a register's number."""

from __future__ import annotations

try:
    from emulator.magnetometer import Magnetometer
except ImportError:  # run by a Python that has this folder on its path, and not the one above
    from magnetometer import Magnetometer  # type: ignore[no-redef]


class RegisterChip(Magnetometer):
    """A transfer sees one sample: outputs do not change during it."""

    def started(self, reading: bool) -> None:
        self.run()
        self._pointer_next = not reading

    def put(self, byte: int) -> None:
        if self._pointer_next:
            self.pointer, self._pointer_next = byte, False
            return
        self.written(self.number(), byte)
        self.advance()

    def get(self) -> int:
        value = self.value(self.number())
        self.advance()
        return value

    def number(self) -> int:
        return self.pointer

    def advance(self) -> None:
        self.pointer = (self.pointer + 1) & 0xFF

    def reset(self, values: dict[int, int]) -> None:
        self.registers = bytearray(256)
        for register, value in values.items():
            self.registers[register] = value
        self.pointer, self._pointer_next = 0, False
        self.next_conversion_s = None

    def written(self, register: int, value: int) -> None:
        raise NotImplementedError

    def value(self, register: int) -> int:
        return self.registers[register]
