# ruff: noqa: E501  (a table of input and expected text reads best one case a line)
"""The configuration: valid files, and what a stranger is told about a wrong one."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmfts.cli.main import main
from fmfts.common import exit_codes
from fmfts.common.toml import parse
from fmfts.config import BridgeSource, Config, I2cSource, ReplaySource, SimulatedSource
from fmfts.config import file as config_file
from fmfts.config.conversion import convert
from fmfts.config.example import ARRAY_PATH
from fmfts.config.file import ConfigError, load, load_as
from fmfts.config.neighbour_checks import MOST_OTHER_MAGNETS
from fmfts.pose import _kernel
from fmfts_collect.settings import CollectingConfig
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_skin.settings import AnyskinSource

SHIPPED = Path(__file__).parents[2] / "config.toml"
PAD = '[[pad]]\nname = "a"\n[pad.source]\ntype = "simulated"\n'
BRIDGE = '[[pad]]\nname = "b"\n[pad.source]\ntype = "bridge"\nport = "/dev/ttyUSB0"\n'
STAGE = """[collect.stage]
port = "/dev/ttyACM0"
dialect = "marlin"
travel_mm = [[0, 200], [0, 200], [5, 60]]
force_limit_n = 3
origin_mm = [100, 100]
clear_z_mm = 20
"""
MLX = 'chip = "mlx90393"\n'
I2C = '[[pad]]\nname = "i"\n[pad.source]\ntype = "i2c"\nbus = 1\n'
SIXTEEN = [[i, 0, 0] for i in range(0, 32, 2)]
TWO_MUXES = (
    f"mux_addresses = {8 * [0x70] + 8 * [0x71]}\nchannels = {2 * list(range(8))}\n"
    f"[pad.geometry]\nsensors_mm = {SIXTEEN}\n"
)


def sensors(count: int) -> str:
    return f"[pad.geometry]\nsensors_mm = {[[i, 0, 0] for i in range(0, 2 * count, 2)]}\n"


def write(folder: Path, text: str) -> Path:
    file = folder / "config.toml"
    file.write_text(text)
    return file


def complaint(folder: Path, text: str, kind: type[Config] = Config) -> str:
    file = write(folder, text)
    with pytest.raises(ConfigError) as error:
        load_as(kind, file)
    assert str(error.value).startswith(f"{file}: ")
    return str(error.value).removeprefix(f"{file}: ")


def test_shipped_file_is_the_demo_and_shows_the_defaults() -> None:
    config, file = load(SHIPPED)
    assert file == SHIPPED
    assert [pad.name for pad in config.pad] == ["demo"]
    assert config.pad[0].source == SimulatedSource()
    minimal = msgspec.convert({"pad": [{"name": "demo", "source": {"type": "simulated"}}]}, Config)
    assert config == minimal


@pytest.mark.parametrize(
    ("keys", "rate_hz", "range_gauss"),
    [
        ("", 220, 2.5),
        ('chip = "qmc5883l"', 200, 8.0),
        ('chip = "mmc5983ma"', 220, 8.0),
        ('chip = "mlx90393"\nrange_gauss = 176', 220, 176.0),
        ('trigger = "simultaneous"', 152, 2.5),
        ('trigger = "simultaneous"\nrate_hz = 100', 100, 2.5),
    ],
)
def test_rate_and_range_that_the_file_leaves_out_suit_the_chip(
    tmp_path: Path, keys: str, rate_hz: int, range_gauss: float
) -> None:
    bridge = '[[pad]]\nname = "a"\n[pad.source]\ntype = "bridge"\nport = "/dev/ttyACM0"\n'
    source = load(write(tmp_path, bridge + keys))[0].pad[0].source
    assert (source.rate_hz, source.range_gauss) == (rate_hz, range_gauss)


def test_examples_in_the_shipped_file_are_right_when_uncommented(tmp_path: Path) -> None:
    text = re.sub(r"^# (?=\[|\w+ = )", "", SHIPPED.read_text(), flags=re.MULTILINE)
    (tmp_path / "touch.mcap").touch()
    config, _ = load(write(tmp_path, text))
    sources = [type(pad.source) for pad in config.pad]
    assert sources == [SimulatedSource, BridgeSource, I2cSource, AnyskinSource, ReplaySource]
    assert config.bus.endpoint == "ipc:///run/fmfts"


def test_second_standard_pad_has_four_magnets_in_tables_of_their_own(tmp_path: Path) -> None:
    config, _ = load(ARRAY_PATH)
    pad = config.pad[0]
    assert pad == msgspec.structs.replace(array_config(), name=pad.name)
    assert [one.rest_axis[2] for one in (pad.magnet, *pad.other_magnets)] == [1, -1, -1, 1]
    text = ARRAY_PATH.read_text()
    assert (
        load(write(tmp_path, text.replace("\n[[pad.magnet]]", "\n[[pad.magnet]]\nremanence_t = 1.4")))[0].pad[0].pad()
    )


MAGNET = "\n[[pad.magnet]]\nrest_mm = [6, 0, 12]\n"
OTHER = "[[pad.magnet]]\nrest_mm = [-6, 0, 12]\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (PAD + MAGNET + OTHER + "strength = 2\n", "magnet, value 2.strength"),
        (PAD + MAGNET + OTHER.replace("12", "0.5"), "magnet, value 2.rest_mm = [-6, 0, 0.5]"),
        (
            PAD + MAGNET + OTHER.replace("-6", "4"),
            "magnet, value 2.rest_mm = [4, 0, 12]: another magnet is within 5 mm of it",
        ),
        (PAD + MAGNET + OTHER, "two fingers need 5 sensors at least"),
        (PAD + "fingers = 2\n", "one magnet cannot distinguish two fingers"),
        (PAD + 'imperfections = ["silicone"]\n' + MAGNET + OTHER, "simulated with one magnet only"),
        (PAD + MAGNET + OTHER + '[pad.contact]\nmodel = "shear"\n', "a pad with several magnets needs"),
        (PAD + MAGNET + OTHER + '[pad.contact]\nmodel = "none"\n', "2 magnets need 7 sensors at least, not 4"),
        (PAD + MAGNET + OTHER + "[pad.rebaseline]\nenabled = true\n", "follows no drift"),
        (PAD + MAGNET + OTHER + "[pad.contact]\nrefine = true\n", "fingers are already the most likely ones"),
        (PAD + MAGNET + OTHER + "[pad.contact]\nsmoothing_ms = 40\n", "smooths nothing: leave it out"),
        (PAD + MAGNET + OTHER + "[pad.contact]\nfinger_mm = [6, 6]\n", "fingers of 4 to 8 mm, always"),
    ],
)
def test_errors_of_several_magnets_name_their_place(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in complaint(tmp_path, text)


def array_beside(name: str, x_mm: int, neighbours: list[str]) -> str:
    text = ARRAY_PATH.read_text().replace('name = "array"', f'name = "{name}"')
    return text + f"\n[pad.scene]\nneighbours = {neighbours}\n[pad.placement]\nposition_mm = [{x_mm}, 0, 0]\n"


def test_pads_with_several_magnets_may_have_neighbours(tmp_path: Path) -> None:
    one = array_beside("one", 40, ["two", "a"]) + array_beside("two", 90, ["one"])
    config, _ = load(write(tmp_path, one + PAD + '[pad.scene]\nneighbours = ["one", "two"]\n'))
    assert [pad.scene.neighbours for pad in config.pad] == [("two", "a"), ("one",), ("one", "two")]


def test_neighbours_of_more_magnets_than_a_state_holds_are_refused(tmp_path: Path) -> None:
    assert _kernel.MAX_MAGNETS == MOST_OTHER_MAGNETS + 1
    arrays = "".join(array_beside(name, 40 * number, []) for number, name in enumerate("xyz", 1))
    told = complaint(tmp_path, arrays + PAD + '[pad.scene]\nneighbours = ["x", "y", "z"]\n')
    assert "scene.neighbours, name 3 = 'z': with it, the neighbours have more than 8 magnets" in told


def test_magnet_where_neighbours_second_one_is_is_refused(tmp_path: Path) -> None:
    there = PAD + '[pad.scene]\nneighbours = ["x"]\n[pad.placement]\nposition_mm = [34, -6, 0]\n'
    assert "its magnet is where that of its neighbour 'x' is" in complaint(tmp_path, array_beside("x", 40, []) + there)


def all_keys(kind: Any) -> set[str]:
    info = msgspec.inspect.type_info(kind) if isinstance(kind, type) else kind
    if isinstance(info, msgspec.inspect.StructType):
        own = {field.name for field in info.fields} | ({"type"} if info.tag else set())
        return own.union(*(all_keys(field.type) for field in info.fields))
    if isinstance(info, msgspec.inspect.UnionType):
        return set().union(*(all_keys(each) for each in info.types))
    return all_keys(info.item_type) if isinstance(info, msgspec.inspect.VarTupleType) else set()


def test_every_key_is_explained_in_the_shipped_file() -> None:
    text = SHIPPED.read_text()
    keys = all_keys(CollectingConfig)
    assert {"clock_hz", "uid", "endpoint", "steel_nearby", "sensors_mm"} <= keys, "the walk finds the keys"
    for key in keys - {"other_magnets"}:  # they are tables [[pad.magnet]]
        assert re.search(rf"^(#+ )?(\[+((pad|collect)\.)?{key}\]|{key} = )", text, flags=re.MULTILINE), key


SIMULATED = "pad 'a' (first [[pad]]): "


NUMBER = re.compile(r"^(?:# )?(\w+) = (-?[\d.]+|\[[^\]]*\d[^\]]*\]\]?)(?:\s+#.*)?$", re.MULTILINE)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e300", "-1e300"])
def test_no_number_of_a_pad_may_be_out_of_all_bounds(tmp_path: Path, value: str) -> None:
    """Such numbers ended `run` with a traceback, or made a pad that never knew anything."""
    text = SHIPPED.read_text().partition("# --- A pad behind")[0]
    found = list(NUMBER.finditer(text))
    assert len(found) > 35
    for each in found:
        changed = f"{each[1]} = " + re.sub(r"-?\d[\d.]*", value, each[2], count=1)
        assert each[1] in complaint(tmp_path, text[: each.start()] + changed + text[each.end() :]), changed


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (PAD + "rate_hz = 5000", SIMULATED + "source.rate_hz = 5000: must be a whole number from 1 to 1000"),
        (PAD + "rate_hz = 219.5", SIMULATED + "source.rate_hz = 219.5: must be a whole number from 1 to 1000"),
        (PAD + "seed = -1", SIMULATED + "source.seed = -1: must be a whole number at least 0"),
        (PAD + 'rate_hz = "220"', SIMULATED + "source.rate_hz = '220': must be a whole number from 1 to 1000, without quotes"),
        (PAD + "rate = 100", SIMULATED + "source.rate: there is no such key; did you mean rate_hz, in hertz?"),
        (PAD + "[pad.magnet]\ndiameter = 2", SIMULATED + "magnet.diameter: there is no such key; did you mean diameter_mm, in millimetres?"),
        (PAD + "[pad.scene]\nx = 2", SIMULATED + "scene.x: there is no such key (there are ambient, remanence, neighbours, steel_nearby)"),
        ('[[pad]]\nname = "a"\nrate_hz = 100\n[pad.source]\ntype = "simulated"\n', SIMULATED + "rate_hz: there is no such key; did you mean [pad.source] rate_hz, in hertz?"),
        ('[[pad]]\nname = "a"\nrate = 100\n[pad.source]\ntype = "simulated"\n', SIMULATED + "rate: there is no such key; did you mean [pad.source] rate_hz, in hertz?"),
        ('[[pad]]\nname = "a"\ntype = "simulated"\n[pad.source]\ntype = "simulated"\n', SIMULATED + "type: there is no such key; did you mean [pad.source] type?"),
        (PAD + "friction = 0.5", SIMULATED + "source.friction: there is no such key; did you mean [pad.contact] friction?"),
        (PAD + "bus = 1", SIMULATED + 'source.bus: there is no such key; did you mean [pad.source] bus of type "i2c"?'),
        (PAD + "[scene]", "scene: there is no such key; did you mean [pad.scene]?"),
        ('name = "b"\n' + PAD, "name: there is no such key; did you mean [[pad]] name?"),
        (PAD + "[pad.contact]\nslip = true", SIMULATED + "contact.slip = true: needs a model with shear"),
        (PAD + "[pads]", "pads: there is no such key; did you mean pad?"),
        (PAD + "[pad.magnets]", SIMULATED + "magnets: there is no such key; did you mean magnet?"),
        (PAD + 'trigger = "Free"', SIMULATED + "source.trigger = 'Free': must be one of \"free\", \"simultaneous\"; did you mean \"free\"?"),
        (PAD + 'trigger = "both"', SIMULATED + "source.trigger = 'both': must be one of \"free\", \"simultaneous\""),
        (PAD + "[pad.geometry]\nsensors_mm = [[1, 2]]", SIMULATED + "geometry.sensors_mm, sensor 1 = [1, 2]: must be a list of 3, each a number"),
        (PAD + '[pad.magnet]\nrest_mm = [1, 2, "z"]', SIMULATED + "magnet.rest_mm, value 3 = 'z': must be a number"),
        (PAD + "[pad.magnet]\nremanence_t = 0", SIMULATED + "magnet.remanence_t = 0: must be a number from 0.001 to 2"),
        (PAD + "[pad.tolerance]\ngain = 5", SIMULATED + "tolerance.gain = 5: must be a number from 0 to 0.5"),
        (PAD + "[pad.scene]\nsteel_nearby = 1", SIMULATED + "scene.steel_nearby = 1: must be true or false"),
        (PAD + "[pad.contact]\nmodel = 3", SIMULATED + "contact.model = 3: must be text in quotes"),
        ('[[pad]]\nname = "a b"\n[pad.source]\ntype = "simulated"', "pad 'a b' (first [[pad]]): name = 'a b': must be 1 to 32 letters without accents, digits, - or _, and no spaces"),
        ('[[pad]]\nname = "a"', SIMULATED + "source is missing: give the table [pad.source]"),
        ('[[pad]]\nname = "a"\n[pad.source]', SIMULATED + 'source.type is missing: give one of "anyskin", "bridge", "i2c", "replay", "simulated"'),
        ('[[pad]]\nname = "a"\n[pad.source]\ntype = "usb"', SIMULATED + "source.type = 'usb': must be one of \"anyskin\", \"bridge\", \"i2c\", \"replay\", \"simulated\""),
        ('[[pad]]\nname = "a"\nsource = 3', SIMULATED + "source = 3: must be a table"),
        ('[[pad]]\nname = "a"\n[pad.source]\ntype = "bridge"', SIMULATED + "source.port is missing: give text in quotes"),
        (PAD + PAD.replace('name = "a"\n', ""), "second [[pad]]: name is missing: give text in quotes"),
        ('[pad]\nname = "a"', "pad: must be a list of tables ([[double brackets]])"),
        ("", "pad is missing: give the table [[pad]]"),
        ("pad = []", "pad = []: at least one [[pad]] is needed"),
        (BRIDGE + 'uid = "12"', "pad 'b' (first [[pad]]): source.uid = '12': must be 24 hexadecimal digits"),
        (I2C + "channels = [0, 1, 2, 9]", "pad 'i' (first [[pad]]): source.channels, sensor 4 = 9: must be a whole number from 0 to 7"),
        (PAD + "[pad.magnet]\nlength_mm = 0.002", SIMULATED + "magnet.length_mm = 0.002: must be a number from 0.2 to 50"),
    ],
)  # fmt: skip
def test_wrong_key_or_type_is_named_with_what_is_allowed(tmp_path: Path, text: str, expected: str) -> None:
    assert complaint(tmp_path, text).startswith(expected)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (PAD + "range_gauss = 3", "source.range_gauss = 3: the chip has no range of ±3.0 G: one of 0.88, 1.3,"),
        (PAD + 'rate_hz = 220\ntrigger = "simultaneous"', 'source.rate_hz = 220: at most 160 with trigger = "simultaneous"'),
        (PAD + 'rate_hz = 220\nchip = "hmc5883l"', 'source.rate_hz = 220: at most 75 with chip = "hmc5883l" running free'),
        (BRIDGE + 'chip = "hmc5883l"\nrate_hz = 75', "source.chip = 'hmc5883l': no firmware of a board reads an HMC5883L: connect it to an I2C bus"),
        *((I2C + f"mux_address = {address}", f"source.mux_address = {address}: a TCA9548A is at 0x70 to 0x77") for address in (0x50, 0x6F, 0x78)),
        (I2C + "channels = [0, 1]", "source.channels = [0, 1]: one channel for each of the 4 sensors"),
        (I2C + "channels = [0, 1, 2, 2]", "source.channels = [0, 1, 2, 2]: each sensor needs a channel of its own"),
        (PAD + "[pad.geometry]\nsensors_mm = [[8, 8, 0], [-8, -8, 0]]", "at least 3 sensors are needed: with two, a diagonal pair is singular"),
        (PAD + f"[pad.geometry]\nsensors_mm = {[[i, 0, 0] for i in range(0, 34, 2)]}", "at most 16 sensors"),
        (BRIDGE + sensors(9), '[12, 0, …: a board makes pads of at most 8 sensors: type = "i2c" reads more on a bus of this computer'),
        (BRIDGE + sensors(8) + BRIDGE.replace('"b"', '"c"') + "pad_index = 1\n" + sensors(5), "pad 'c' (second [[pad]]): source.pad_index = 1: with it, the pads of its board have 8, 5 sensors by their pad_index (one that is not configured has 4): at most 12 on a board"),
        (BRIDGE + "pad_index = 2\n" + sensors(8), "source.pad_index = 2: with it, the pads of its board have 4, 4, 8 sensors"),
        (I2C + "channels = []\nmux_addresses = [0x70, 0x70, 0x71, 0x71]", "source.mux_addresses = [112, 112, 113, 113]: without a mux leave it out"),
        (I2C + "mux_addresses = [0x70, 0x71]", "source.mux_addresses = [112, 113]: one mux for each of the 4 sensors"),
        (I2C + "mux_addresses = [0x70, 0x70, 0x71, 0x78]", "source.mux_addresses, sensor 4 = 120: a TCA9548A is at 0x70 to 0x77"),
        (I2C + "mux_addresses = [0x70, 0x71, 0x70, 0x71]\nchannels = [0, 0, 1, 0]", "each sensor needs a channel of its own: sensors 2 and 4 are both at 0x1e on channel 0 of mux 0x71"),
        (I2C + "rate_hz = 75\nmux_addresses = [0x70, 0x70, 0x71, 0x71]\n" + I2C.replace('"i"', '"j"') + "rate_hz = 75\nmux_address = 0x71\nchannels = [3, 4, 5, 6]", "pad 'j' (second [[pad]]): source.channels = [3, 4, 5, 6]: pad 'i' reads the same sensors"),
        (PAD + "[pad.geometry]\nsensors_mm = [[8, 8, 0], [8, -8, 0], [8, 8, 0.5]]", "geometry.sensors_mm, sensor 3 = [8, 8, 0.5]: is within 1 mm of sensor 1 (these are millimetres)"),
        ("".join(I2C.replace('"i"', f'"{name}"') + f"rate_hz = 50\nmux_address = {mux}\n" for name, mux in zip("ijkl", range(0x70, 0x74), strict=True)), "pad 'l' (fourth [[pad]]): source.bus = 1: at most 3 pads on one bus: i, j, k are there already"),
        (I2C + "rate_hz = 75\n" + MLX + "channels = []\naddresses = [12, 13, 14, 15]\n" + I2C.replace('"i"', '"j"') + "rate_hz = 75\n" + MLX, "pad 'j' (second [[pad]]): source.channels: pad 'i' has a chip at 0x0c straight on the bus, which would answer"),
        (PAD + "[pad.geometry]\nsensor_rotations_deg = [[0, 0, 90]]", "either empty or one rotation vector for each of the 4 sensors, not 1"),
        (PAD + "[pad.magnet]\nrest_axis = [0, 0, 0]", "magnet.rest_axis = [0, 0, 0]: the length of this vector is 0: give a direction"),
        (PAD + "[pad.magnet]\nrest_mm = [0, 0, -12]", "magnet.rest_mm = [0, 0, -12]: the magnet rests above the sensors"),
        (PAD + "[pad.magnet]\nrest_mm = [0, 0, 0.012]", "its z must be greater than theirs by 1 mm, half its size"),
        (PAD + "[pad.magnet]\nrest_mm = [8, 8, 1.5]", "magnet.rest_mm = [8, 8, 1.5]: at least 2.0 mm from every sensor, not 1.5 mm"),
        (PAD + "[pad.magnet]\nrest_mm = [0, 0, 12000]", "would feel next to nothing (these are millimetres)"),
        (PAD + '[pad.scene]\nneighbours = ["z"]', "scene.neighbours, name 1 = 'z': there is no such pad: the pads are a"),
        (PAD + '[pad.scene]\nneighbours = ["a"]', "a pad is not its own neighbour"),
        (PAD + '[pad.contact]\nmodel = "no.onnx"', 'neither "default" nor "shear" nor "none" nor a file: there is no /'),
        (PAD + '[pad.scene]\nneighbours = ["b"]\n' + PAD.replace('"a"', '"b"'), "pad 'a' (first [[pad]]): placement.position_mm: its magnet is where that of its neighbour 'b' is: say in [pad.placement] of both"),
        (PAD + PAD, "pad 'a' (second [[pad]]): name = 'a': another pad has this name"),
        (BRIDGE + BRIDGE.replace('"b"', '"c"'), "pad 'c' (second [[pad]]): source.pad_index: pad 'b' reads the same sensors"),
        (I2C + I2C.replace('"i"', '"j"'), "pad 'j' (second [[pad]]): source.channels: pad 'i' reads the same sensors"),
        # Of four HMC5983: 39 and 84 bits, 20 to select each, 20 to read the mux back; for a trigger 20 and 29 more.
        (I2C + "clock_hz = 100000", 'source.rate_hz: at most 168: more than bus 1 can carry, 4 sensors with trigger = "free" and clock_hz = 100000'),
        (I2C + 'trigger = "simultaneous"\nrate_hz = 129', "source.rate_hz = 129: at most 128: more than bus 1 can carry, 4 sensors"),
        (BRIDGE + 'trigger = "simultaneous"\nrate_hz = 153', 'source.rate_hz = 153: at most 152 with trigger = "simultaneous" over a bridge'),
        *(
            (BRIDGE + f'chip = "{chip}"\nrange_gauss = {gauss}\ntrigger = "simultaneous"\nrate_hz = {most + 1}\n' + sensors(8), f'at most {most} with trigger = "simultaneous" and 8 sensors on the board')
            for chip, gauss, most in (("mmc5983ma", 8, 130), ("mlx90393", 132, 109), ("lis3mdl", 4, 79))
        ),
        (PAD + 'publish = "sample"', 'source.publish = \'sample\': only a "bridge" or "i2c" gives samples as they come'),
        (BRIDGE + 'publish = "sample"\ntrigger = "simultaneous"\nrate_hz = 150', "source.publish = 'sample': chips of one trigger have their samples at once"),
        ('[bus]\nendpoint = "tcp://0.0.0.0:5570"\n' + PAD, "bus.endpoint = 'tcp://0.0.0.0:5570': other machines are let in with keys alone"),
        ('[bus]\nendpoint = "udp://x"\n' + PAD, "bus.endpoint = 'udp://x': 'udp://x' is not a base of endpoints"),
        *((PAD + f"[pad.magnet]\nrest_mm = [0, {number}, 12]", f"magnet.rest_mm, value 2 = {number}: must be a finite number") for number in ("nan", "inf", "-inf")),
        (PAD + "[pad.tolerance]\ngain = nan", "tolerance.gain = nan: must be a finite number"),
    ],
)  # fmt: skip
def test_impossible_input_is_refused_with_the_reason(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in complaint(tmp_path, text)


@pytest.mark.parametrize(
    "text",
    [
        PAD + 'trigger = "simultaneous"\nrate_hz = 160',
        PAD + 'chip = "hmc5883l"\nrate_hz = 75',
        BRIDGE + 'trigger = "simultaneous"\nrate_hz = 152',
        I2C + 'trigger = "simultaneous"\nrate_hz = 127',
        I2C + "clock_hz = 100000\nrate_hz = 168",
        I2C + "mux_address = 0x77",
        I2C + "mux_addresses = [0x70, 0x70, 0x71, 0x71]\nchannels = [0, 1, 0, 1]",
        I2C + "rate_hz = 75\n" + TWO_MUXES,
        PAD + f"[pad.geometry]\nsensors_mm = {SIXTEEN}",
        '[bus]\nendpoint = "tcp://127.0.0.1:5570"\n' + PAD,
        '[bus]\nendpoint = "tcp://0.0.0.0:5570"\nkeys = "keys"\n' + PAD,
        PAD + 'chip = "hmc5883l"\ntrigger = "simultaneous"\nrate_hz = 160',
        PAD + "[pad.geometry]\nsensors_mm = [[8, 8, 0], [8, -8, 0], [-8, 8, 0]]",
        PAD + "[pad.magnet]\nrest_mm = [8, 8, 2]",
        BRIDGE + 'uid = "0123456789abcdefABCDEF01"',
        BRIDGE + BRIDGE.replace('"b"', '"c"') + "pad_index = 1",
        BRIDGE + sensors(8) + BRIDGE.replace('"b"', '"c"') + "pad_index = 1",
        BRIDGE + "pad_index = 1\n" + sensors(8),
        BRIDGE + 'trigger = "simultaneous"\nrate_hz = 152\n' + sensors(8),
        BRIDGE + 'chip = "mmc5983ma"\nrange_gauss = 8\ntrigger = "simultaneous"\nrate_hz = 130\n' + sensors(8),
        I2C + I2C.replace('"i"', '"j"') + "channels = [4, 5, 6, 7]",
        "\ufeff" + PAD,
    ],
)
def test_limit_values_are_allowed(tmp_path: Path, text: str) -> None:
    load(write(tmp_path, text))


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("rate_hz = 2,0", "rate_hz = 2,0; a decimal number has a point: 2.0"),
        ("port = /dev/ttyUSB0", 'port = /dev/ttyUSB0; text stands in quotes: "/dev/ttyUSB0"'),
        ("name = left  # mine", 'name = left; text stands in quotes: "left"'),
        ("name = “left”  # mine", 'name = “left”; quotes are straight: "left"'),
        ("loop = True", "loop = True; TOML writes true"),
    ],
)
def test_line_that_is_no_toml_comes_with_a_hint(tmp_path: Path, line: str, hint: str) -> None:
    assert complaint(tmp_path, f"{PAD}{line}\n").endswith(hint)


def test_sensors_in_metres_are_reported_once(tmp_path: Path) -> None:
    metres = "[[0.008, 0.008, 0], [0.008, -0.008, 0], [-0.008, 0.008, 0], [-0.008, -0.008, 0]]"
    told = complaint(tmp_path, f"{PAD}[pad.geometry]\nsensors_mm = {metres}\n")
    assert "\n" not in told
    assert told.endswith("all sensors are within 0.0113 mm of the origin: is it in metres? Give millimetres")


@pytest.mark.parametrize("magnet", ["length_mm = 0.002", "rest_mm = [0, 0, 0.012]"])
def test_magnet_in_metres_is_questioned(tmp_path: Path, magnet: str) -> None:
    assert complaint(tmp_path, f"{PAD}[pad.magnet]\n{magnet}\n").endswith(": is it in metres?")


def test_syntax_error_is_shown_with_its_line(tmp_path: Path) -> None:
    said = complaint(tmp_path, PAD + "rate_hz = = 3\n")
    assert said == "is not TOML: Invalid value (at line 5, column 11): rate_hz = = 3"


def test_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError,
        match=r"nothing.toml: cannot be read: No such file .*: correct its name, or let `fmfts-daemon init` write",
    ):
        load(tmp_path / "nothing.toml")
    with pytest.raises(
        ConfigError, match=r"cannot be read: not a file, but a folder, .*: name the file in it with --config"
    ):
        load(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"a = 1\n\xff")
    with pytest.raises(ConfigError, match=r"is not UTF-8 text \(byte 6\)"):
        load(tmp_path / "binary.toml")


def test_files_are_searched_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [tmp_path / name for name in ("given.toml", "environment.toml", "etc.toml", "here.toml")]
    monkeypatch.setattr(config_file, "DEFAULT_PATHS", paths[2:])
    with pytest.raises(ConfigError, match=r"no configuration found.*etc\.toml or .*here\.toml"):
        load(None, {})
    for path in paths:
        path.write_text(PAD)
    environ = {"FMFTS_CONFIG": str(paths[1])}
    assert load(paths[0], environ)[1] == paths[0]
    assert load(None, environ)[1] == paths[1]
    assert load(None, {})[1] == paths[2]
    paths[2].unlink()
    assert load(None, {})[1] == paths[3]


def test_file_that_init_wrote_is_used_beside_the_example(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The clone's top folder has the example, of a simulated pad, as config.toml."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(config_file, "DEFAULT_PATHS", config_file.DEFAULT_PATHS[1:])  # this machine may have a service
    (tmp_path / "config.toml").write_text(PAD)
    assert load(None, {})[1] == Path("config.toml")
    assert not caplog.messages
    (tmp_path / "pad.toml").write_text(PAD)
    assert load(None, {})[1] == Path("pad.toml")
    assert caplog.messages == ["pad.toml is used, not config.toml: to use another file, add --config config.toml"]


def test_two_names_of_one_configuration_are_not_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    paths = [tmp_path / name for name in ("etc.toml", "here.toml")]
    monkeypatch.setattr(config_file, "DEFAULT_PATHS", paths)
    paths[0].write_text(PAD)
    paths[1].symlink_to(paths[0])
    assert load(None, {})[1] == paths[0]
    assert not caplog.messages


def test_second_place_where_nobody_may_look_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a folder of another user, so for root, too: the kernel refuses to look for such a long name."""
    used = tmp_path / "etc.toml"
    used.write_text(PAD)
    monkeypatch.setattr(config_file, "DEFAULT_PATHS", [used, tmp_path / ("x" * 300)])
    assert load(None, {})[1] == used


def test_path_of_a_model_is_taken_from_the_folder_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.onnx").touch()
    (tmp_path / "elsewhere").mkdir()
    file = write(tmp_path, PAD + '[pad.contact]\nmodel = "mine.onnx"')
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert load(file)[0].pad[0].contact.model == str(tmp_path / "mine.onnx")


VALUES = st.recursive(
    st.integers() | st.floats() | st.booleans() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["type", "a"]), inner, max_size=2),
    max_leaves=6,
)


@given(table=st.sampled_from(["", "source", "geometry", "magnet", "tolerance", "scene", "contact"]), data=st.data())
def test_any_wrong_value_of_any_key_is_an_error_that_names_it(table: str, data: st.DataObject) -> None:
    """The parser alone, without the file: every path that msgspec may report must be found again."""
    content = parse(SHIPPED.read_text())
    target = content["pad"][0][table] if table else content["pad"][0]
    key = data.draw(st.sampled_from(sorted(target)))
    target[key] = data.draw(VALUES)
    try:
        msgspec.convert(content, Config)
    except msgspec.ValidationError:
        (said, *_) = convert(content, Config).wrong
        assert key in said or f"{table}." in said
        assert "must be" in said or "is missing" in said or "no such key" in said


def test_all_errors_are_reported_at_once(tmp_path: Path) -> None:
    text = (
        PAD + "rate = 100\nrange_gauss = 3\n[pad.geometry]\nsensors_mm = [[8, 8, 0], [1, 2], [3, 4, 5]]\n"
        "[pad.magnet]\nremanence_t = nan\nlength_mm = 0.002\n[pad.scene]\nsteel = true\n"
        '[[pad]]\n[pad.source]\ntype = "bridge"\n'
    )
    lines = complaint(tmp_path, text).splitlines()
    assert lines[0] == "8 things are wrong:"
    expected = (
        "magnet.remanence_t = nan: must be a finite number",
        "source.rate: there is no such key",
        "geometry.sensors_mm, sensor 2 = [1, 2]",
        "magnet.length_mm = 0.002",
        "scene.steel: there is no such key; did you mean steel_nearby?",
        "second [[pad]]: name is missing",
        "second [[pad]]: source.port is missing",
        "source.range_gauss = 3: the chip has no range",
    )
    assert [number for number, part in enumerate(expected) if not any(part in line for line in lines)] == []


def test_wrong_type_is_reported_and_other_keys_still_checked(tmp_path: Path) -> None:
    usb = '[[pad]]\nname = "a"\n[pad.source]\ntype = "usb"\n'
    told = SIMULATED + 'source.type = \'usb\': must be one of "anyskin", "bridge", "i2c", "replay", "simulated"'
    assert complaint(tmp_path, usb + 'port = "/dev/ttyUSB0"\n') == told
    assert complaint(tmp_path, usb + "speed = 3\n") == told
    port = complaint(tmp_path, usb + 'port = 3\nrate_hz = 100\nchip = "HMC5983"\n')
    for part in (told, "source.port = 3: must be text", "source.chip = 'HMC5983': must be one of"):
        assert part in port


def test_table_of_another_package_is_judged_by_it_and_left_alone_by_daemon(tmp_path: Path) -> None:
    text = PAD + '[collect.gauge]\ntype = "usb"\nport = "/dev/ttyUSB0"\n'
    gauge = complaint(tmp_path, text, CollectingConfig)
    assert "collect.gauge.type = 'usb'" in gauge
    assert "simulated" not in gauge
    assert load(write(tmp_path, text))[0].collect == {"gauge": {"type": "usb", "port": "/dev/ttyUSB0"}}
    assert "collect.stage: a stage needs" in complaint(tmp_path, PAD + STAGE, CollectingConfig)
    assert complaint(tmp_path, "collect = 3\n" + PAD) == "collect = 3: must be a table"


def test_check_config_judges_table_of_package_that_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["check-config", "--config", str(write(tmp_path, PAD + STAGE))]
    assert main(words) == exit_codes.CONFIG
    assert "collect.stage: a stage needs" in capsys.readouterr().err
    monkeypatch.setattr("fmfts.cli.elsewhere.configuration_with", lambda _: None)
    assert main(words) == exit_codes.DONE
    told = capsys.readouterr().err
    assert "warning: [collect] was not checked" in told
    assert "pip install 'fmfts[collect]'" in told


WITHOUT_PACKAGES = """
import importlib.metadata, sys
found = importlib.metadata.entry_points
importlib.metadata.entry_points = lambda group: found(group=group) if group in sys.argv[2:] else ()
from fmfts.cli.main import main
sys.exit(main(["check-config", "--config", sys.argv[1]]))
"""


def checked_without_packages(file: Path, *but: str) -> subprocess.CompletedProcess[str]:
    """but: the groups of entry points that there are."""
    command = [sys.executable, "-c", WITHOUT_PACKAGES, str(file), *but]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_source_of_package_not_installed_says_how_to_install_it(tmp_path: Path) -> None:
    text = PAD.replace("simulated", "anyskin") + 'port = "/dev/ttyUSB0"\nform = "text"\n'
    ended = checked_without_packages(write(tmp_path, text))
    assert ended.returncode == exit_codes.CONFIG
    assert "source.type = 'anyskin': belongs to a package of its own" in ended.stderr
    assert "pip install 'fmfts[skin]'" in ended.stderr
    assert "things are wrong" not in ended.stderr, "the keys of a type that nobody knows are not judged"


def test_shipped_configuration_needs_the_simulation_alone() -> None:
    ended = checked_without_packages(SHIPPED, "fmfts.simulations")
    assert (ended.returncode, ended.stderr) == (exit_codes.DONE, "")


@pytest.mark.parametrize("suffix", ["response", "force"])
def test_contact_model_of_package_not_installed_says_how_to_install_it(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / f"skin.{suffix}").touch()
    text = PAD + f'[pad.contact]\nmodel = "skin.{suffix}"\n'
    assert "is for a real skin" in complaint(tmp_path, text)
    monkeypatch.setattr("fmfts.config.model_kinds._added", lambda _: None)
    told = complaint(tmp_path, text)
    assert f"contact.model = 'skin.{suffix}': belongs" in told
    assert "pip install 'fmfts[skin]'" in told


def test_error_causes_no_further_errors(tmp_path: Path) -> None:
    """A wrong value's replacement is not judged."""
    text = I2C + 'channels = [0, 1, 2, "x"]\n[pad.geometry]\nsensors_mm = [[8, 8, 0], [8, -8, 0], [-8, 8, 0]]\n'
    assert "source.channels, sensor 4 = 'x'" in complaint(tmp_path, text)
    assert "\n" not in complaint(tmp_path, text)
