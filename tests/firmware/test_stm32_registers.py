"""Every register and bit that the STM32 firmware names, compared with pyOCD's SVD files.

The STM32F103 file describes the peripherals. It lacks SysTick and SCB, which belong to the core and are the same in
every ARMv7-M part: those come from the STM32L4x2's file.
"""

from __future__ import annotations

import importlib.util
import io
import re
import subprocess
import zipfile
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import pytest

HEADER = Path(__file__).parents[2] / "firmware/stm32f103/registers.h"
STRUCTS = {
    "rcc": ["RCC"],
    "flash": ["FLASH"],
    "gpio": ["GPIOA", "GPIOB"],
    "i2c": ["I2C1", "I2C2"],
    "usart": ["USART1"],
    "iwdg": ["IWDG"],
    "systick": ["STK"],
    "nvic_enable": ["NVIC"],
    "scb": ["SCB"],
}
NOT_IN_SVD = {"UNIQUE_ID": 0x1FFFF7E8}  # RM0008 30.2


@dataclass
class Register:
    address: int
    masks: dict[str, int] = field(default_factory=dict)


@dataclass
class Peripheral:
    base: int
    registers: dict[str, Register] = field(default_factory=dict)
    interrupts: dict[str, int] = field(default_factory=dict)


def number(element: ElementTree.Element, tag: str) -> int:
    text = element.findtext(tag)
    assert text is not None, f"{element.findtext('name')} has no {tag}"
    return int(text, 0)


def read_svd(content: bytes) -> dict[str, Peripheral]:
    elements = {p.findtext("name", ""): p for p in ElementTree.parse(io.BytesIO(content)).iter("peripheral")}
    peripherals = {}
    for name, element in elements.items():
        template = elements[element.get("derivedFrom", name)]
        peripheral = Peripheral(number(element, "baseAddress"))
        for interrupt in element.iter("interrupt"):
            peripheral.interrupts[interrupt.findtext("name", "")] = number(interrupt, "value")
        for register in template.iter("register"):
            masks = {
                bits.findtext("name", ""): ((1 << number(bits, "bitWidth")) - 1) << number(bits, "bitOffset")
                for bits in register.iter("field")
            }
            address = peripheral.base + number(register, "addressOffset")
            peripheral.registers[register.findtext("name", "")] = Register(address, masks)
        peripherals[name] = peripheral
    return peripherals


@cache
def svd() -> dict[str, Peripheral]:
    spec = importlib.util.find_spec("pyocd")
    assert spec is not None, "pyocd is not installed: pip install -e clients/python -e '.[test]'"
    assert spec.submodule_search_locations is not None
    archive = Path(spec.submodule_search_locations[0]) / "debug/svd/svd_data.zip"
    with zipfile.ZipFile(archive) as files:
        names = {Path(name).name: name for name in files.namelist()}
        core = read_svd(files.read(names["STM32L4x2.svd"]))
        chip = read_svd(files.read(names["STM32F103xx.svd"]))
    return {"STK": core["STK"], "SCB": core["SCB"], **chip}


@cache
def header() -> tuple[dict[str, list[str]], list[str]]:
    """The members of each struct, and the names of all macros."""
    text = re.sub(r"//.*", "", HEADER.read_text())
    structs = {
        name: re.findall(r"\w+", body.replace("volatile uint32_t", ""))
        for name, body in re.findall(r"struct (\w+) \{(.*?)\};", text, re.S)
    }
    return structs, re.findall(r"#define (\w+) ", text)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> dict[str, int]:
    """A compiler's values for the header: member offsets as `struct.MEMBER`, macro values by name."""
    structs, macros = header()
    folder = tmp_path_factory.mktemp("registers")
    lines = ["#include <stddef.h>", "#include <stdio.h>", f'#include "{HEADER}"', "int main(void) {"]
    lines += [
        f'printf("{name}.{member} %zu\\n", offsetof(struct {name}, {member}));'
        for name, members in structs.items()
        for member in members
    ]
    lines += [f'printf("{name} %lu\\n", (unsigned long){name});' for name in macros]
    (folder / "registers.c").write_text("\n".join([*lines, "}"]))
    subprocess.run(["cc", "registers.c", "-o", "registers"], cwd=folder, check=True, timeout=300)
    output = subprocess.run([folder / "registers"], capture_output=True, text=True, check=True, timeout=300).stdout
    return {name: int(value) for name, value in (line.split() for line in output.splitlines())}


INSTANCES = [(struct, instance) for struct, names in STRUCTS.items() for instance in names]


def test_layout_check_covers_every_struct() -> None:
    assert set(header()[0]) == set(STRUCTS)


@pytest.mark.parametrize(("struct", "instance"), INSTANCES)
def test_every_member_lies_where_its_register_does(struct: str, instance: str, compiled: dict[str, int]) -> None:
    registers = svd()[instance].registers
    for member in header()[0][struct]:
        assert compiled[instance] + compiled[f"{struct}.{member}"] == registers[member].address, member


def test_base_addresses_are_the_peripherals_own(compiled: dict[str, int]) -> None:
    # NVIC's first enable register stands for its base: the header names no other of its registers.
    bases = {name: p.base for name, p in svd().items()} | {"NVIC": svd()["NVIC"].registers["ISER0"].address}
    for _, instance in INSTANCES:
        assert compiled[instance] == bases[instance], instance


def field_of(macro: str) -> tuple[int, bool]:
    """The mask of the field that `PERIPHERAL_REGISTER_FIELD` or `…_FIELD_VALUE` names, and whether it has a value."""
    peripheral, register, name = macro.split("_", 2)
    masks = svd()[{"I2C": "I2C1"}.get(peripheral, peripheral)].registers[register].masks
    for known in sorted(masks, key=len, reverse=True):
        if name == known or name.startswith(known + "_"):
            return masks[known], name != known
    raise AssertionError(f"{macro}: {peripheral} {register} has no such field, only {', '.join(masks)}")


def test_every_bit_belongs_to_its_field(compiled: dict[str, int]) -> None:
    checked = 0
    for macro in header()[1]:
        if macro.count("_") < 2 or macro in NOT_IN_SVD:
            continue
        mask, names_value = field_of(macro)
        if names_value:
            assert compiled[macro] != 0, macro
            assert compiled[macro] & ~mask == 0, f"{macro} {compiled[macro]:#x} is not within {mask:#x}"
        else:
            assert compiled[macro] == mask, f"{macro} {compiled[macro]:#x}, SVD {mask:#x}"
        checked += 1
    assert checked == sum("U << " in line for line in HEADER.read_text().splitlines())


def test_no_macro_escapes_the_checks(compiled: dict[str, int]) -> None:
    others = [macro for macro in header()[1] if macro.count("_") < 2]
    known = {instance for _, instance in INSTANCES} | set(NOT_IN_SVD) | {"USART1_IRQ"}
    assert set(others) <= known
    assert compiled["USART1_IRQ"] == svd()["USART1"].interrupts["USART1"]
    for name, address in NOT_IN_SVD.items():
        assert compiled[name] == address
