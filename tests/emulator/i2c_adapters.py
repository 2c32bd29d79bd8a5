"""What the I2C adapters of Linux accept, refuse and report, each according to its kernel driver.

Sources, all of torvalds/linux (6.1 and later), by function:
- all: `i2cdev_ioctl_rdwr` of drivers/i2c/i2c-dev.c (42 messages, 8192 bytes); `i2c_check_for_quirks` of
  drivers/i2c/i2c-core-base.c (-EOPNOTSUPP); `__i2c_transfer` there (-EOPNOTSUPP without I2C transfers)
- bcm2835: `bcm2835_i2c_xfer`, `bcm2835_i2c_func`, `bcm2835_i2c_probe` of drivers/i2c/busses/i2c-bcm2835.c
- designware: `i2c_dw_xfer_msg`, `i2c_dw_quirks`, `i2c_dw_configure_master` of i2c-designware-master.c,
  `i2c_dw_handle_tx_abort` of i2c-designware-common.c, DW_IC_DEFAULT_FUNCTIONALITY of i2c-designware-core.h
- tegra: `tegra_i2c_error_recover`, `tegra_i2c_func`, `tegra194_i2c_quirks` of i2c-tegra.c
- imx: `i2c_imx_acked`, `i2c_imx_func` of i2c-imx.c
- gpio: `bit_doAddress`, `bit_func` of drivers/i2c/algos/i2c-algo-bit.c, `i2c_gpio_probe` of i2c-gpio.c
- i801: `i801_check_post`, `i801_func`, `i801_probe` of i2c-i801.c
- mcp2221: `mcp_i2c_xfer`, `mcp_get_i2c_eng_state`, `mcp_i2c_func` of drivers/hid/hid-mcp2221.c
- ft260: `ft260_i2c_quirks`, `ft260_xfer_status`, `ft260_functionality` of drivers/hid/hid-ft260.c
- cp2112: `cp2112_i2c_xfer`, `cp2112_i2c_write_read_req`, `cp2112_raw_event` of drivers/hid/hid-cp2112.c (revision 2)

The times of USB bridges are the least that their drivers can take. The docstring of `Adapter` explains them.
"""

from __future__ import annotations

import errno
from collections.abc import Callable, Sequence
from typing import NamedTuple

MOST_MESSAGES, LONGEST_MESSAGE = 42, 8192  # I2C_RDWR_IOCTL_MAX_MSGS; i2cdev_ioctl_rdwr
READ = 0x0001  # I2C_M_RD
# include/uapi/linux/i2c.h
I2C, TEN_BIT, MANGLING, PEC, NOSTART = 0x1, 0x2, 0x4, 0x8, 0x10
BLOCK_PROC_CALL, QUICK, BYTE, BYTE_DATA, WORD_DATA, PROC_CALL = 0x8000, 0x10000, 0x60000, 0x180000, 0x600000, 0x800000
READ_BLOCK_DATA, BLOCK_DATA, I2C_BLOCK = 0x1000000, 0x3000000, 0xC000000
SMBUS_EMULATED = 0x0EFF0008
CLOCK_HZ = 400_000  # of_node/clock-frequency of controllers on a board


class Message(NamedTuple):
    """The parts of a struct i2c_msg that a rule may use."""

    address: int
    flags: int
    size: int

    @property
    def reads(self) -> bool:
        return bool(self.flags & READ)


Rule = Callable[[Sequence[Message]], int]  # the errno of a refusal, 0: none


class Adapter(NamedTuple):
    """device: its path in /sys, whose last part is the device that `driver` drives. name: as in its sysfs file.

    no_answer: errno for an address that nobody acknowledges. write_s, exchange_s: minimum times of a write, and of a
    write with a read. Each report to a full-speed HID device waits for a frame of USB (1 ms): the FT260 takes one for a
    write and two for both, the CP2112 two and three, the MCP2221 two and four, and its driver sleeps 1 ms after each.
    """

    device: str
    driver: str
    name: str
    functions: int
    no_answer: int
    rule: Rule
    write_s: float = 0.0
    exchange_s: float = 0.0

    def refusal(self, messages: Sequence[Message]) -> int:
        """The errno with which the kernel refuses an I2C_RDWR of these messages, 0 if it carries it out."""
        if not 0 < len(messages) <= MOST_MESSAGES or any(each.size > LONGEST_MESSAGE for each in messages):
            return errno.EINVAL
        return self.rule(messages) if self.functions & I2C else errno.EOPNOTSUPP

    def took_s(self, messages: Sequence[Message]) -> float:
        return self.exchange_s if len(messages) > 1 else self.write_s

    @property
    def clock_hz(self) -> int | None:
        return CLOCK_HZ if self.device.endswith(".i2c") else None


def _anything(_: Sequence[Message]) -> int:
    return 0


def _no_zero_length(messages: Sequence[Message]) -> int:
    """I2C_AQ_NO_ZERO_LEN."""
    return 0 if all(each.size for each in messages) else errno.EOPNOTSUPP


def _one_read_and_last(messages: Sequence[Message]) -> int:
    return errno.EOPNOTSUPP if any(each.reads for each in messages[:-1]) else 0


def _one_address(messages: Sequence[Message]) -> int:
    return _no_zero_length(messages) or (0 if len({each.address for each in messages}) == 1 else errno.EINVAL)


def _is_write_then_read(messages: Sequence[Message]) -> bool:
    first, *second = messages
    return len(second) == 1 and not first.reads and second[0].reads and first.address == second[0].address


def _one_or_write_then_read(messages: Sequence[Message]) -> int:
    return 0 if len(messages) == 1 or _is_write_then_read(messages) else errno.EOPNOTSUPP


def _short_write_then_read(messages: Sequence[Message]) -> int:
    """I2C_AQ_COMB_WRITE_THEN_READ with max_comb_1st_msg_len = 2."""
    too_long = len(messages) == 2 and messages[0].size > 2
    return errno.EOPNOTSUPP if too_long else _one_or_write_then_read(messages)


def _reports_of_cp2112(messages: Sequence[Message]) -> int:
    last = messages[-1]
    if len(messages) == 1:
        fits = 1 <= last.size <= 512 if last.reads else last.size <= 61
    elif _is_write_then_read(messages):
        fits = 1 <= last.size <= 512 and messages[0].size <= 16
    else:
        return errno.EOPNOTSUPP
    return 0 if fits else errno.EINVAL


PI_BUS = "platform/soc/fe804000.i2c"
HID = "platform/soc/fe980000.usb/usb1/1-1/1-1:1.0/0003:"
DESIGNWARE = I2C | BYTE | BYTE_DATA | WORD_DATA | BLOCK_DATA | I2C_BLOCK
TEGRA = I2C | SMBUS_EMULATED & ~QUICK | TEN_BIT | MANGLING | NOSTART | READ_BLOCK_DATA
BITS = I2C | NOSTART | SMBUS_EMULATED | READ_BLOCK_DATA | BLOCK_PROC_CALL | TEN_BIT | MANGLING
MCP2221 = I2C | READ_BLOCK_DATA | BLOCK_PROC_CALL | SMBUS_EMULATED & ~PEC
FT260 = I2C | BYTE | QUICK | BYTE_DATA | WORD_DATA | BLOCK_DATA | I2C_BLOCK
CP2112 = I2C | BYTE | BYTE_DATA | WORD_DATA | BLOCK_DATA | I2C_BLOCK | PROC_CALL | BLOCK_PROC_CALL
I801 = QUICK | BYTE | BYTE_DATA | WORD_DATA | BLOCK_DATA | I2C_BLOCK | PROC_CALL | PEC

ADAPTERS = {
    "bcm2835": Adapter(
        PI_BUS, "i2c-bcm2835", "bcm2835 (i2c@7e804000)", I2C | SMBUS_EMULATED, errno.EREMOTEIO, _one_read_and_last
    ),
    "designware": Adapter(
        "platform/axi/1f00074000.i2c", "i2c_designware", "Synopsys DesignWare I2C adapter", DESIGNWARE | TEN_BIT,
        errno.EREMOTEIO, _one_address,
    ),
    "tegra": Adapter(
        "platform/3160000.i2c", "tegra-i2c", "3160000.i2c", TEGRA, errno.EREMOTEIO, _no_zero_length
    ),
    "imx": Adapter(
        "platform/soc@0/30a20000.i2c", "imx-i2c", "30a20000.i2c", I2C | SMBUS_EMULATED | READ_BLOCK_DATA, errno.ENXIO,
        _anything,
    ),
    "gpio": Adapter("platform/i2c-gpio.3", "i2c-gpio", "i2c-gpio3", BITS, errno.ENXIO, _anything),
    "i801": Adapter(
        "pci0000:00/0000:00:1f.4", "i801_smbus", "SMBus I801 adapter at efa0", I801, errno.ENXIO, _anything
    ),
    "mcp2221": Adapter(
        f"{HID}04D8:00DD.0001", "mcp2221", "MCP2221 usb-i2c bridge", MCP2221, errno.ENXIO, _one_or_write_then_read,
        3e-3, 6e-3,
    ),
    "ft260": Adapter(
        f"{HID}0403:6030.0001", "ft260", "FT260 usb-i2c bridge on hidraw0", FT260, errno.EIO, _short_write_then_read,
        1e-3, 2e-3,
    ),
    "cp2112": Adapter(
        f"{HID}10C4:EA90.0001", "cp2112", "CP2112 SMBus Bridge on hidraw0", CP2112, errno.ETIMEDOUT,
        _reports_of_cp2112, 2e-3, 3e-3,
    ),
}  # fmt: skip
