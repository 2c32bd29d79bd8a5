"""A fact that stands in two languages, or in two programs, is compared here: a change of one alone fails."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import chain
from pathlib import Path
from typing import get_args

import msgspec
import pytest

from fmfts.bus.messages import ContactMessage, FingerMessage, Health, PoseMessage, SlipMessage
from fmfts.config import BridgeSource
from fmfts.config.checks import FEWEST_SENSORS
from fmfts.sensor.chips import CHIPS, HMC5983, Chip, ChipName
from fmfts.sensor.chips.rates import BOARD_READ_US, BRIDGE_HZ, highest_rate_hz
from fmfts.sensor.frame import AGE_UNKNOWN_US, READING_BYTES
from fmfts.sensor.wire import codec, packets
from fmfts.sensor.wire.framing import MAX_LINE_BYTES
from fmfts_client.fields import SCHEMA_VERSION

REPOSITORY = Path(__file__).parents[2]
DAEMON = REPOSITORY / "daemon/fmfts"
CORE, WIRE = (REPOSITORY / path for path in ("firmware/core", "daemon/fmfts/sensor/wire"))
C_CLIENT = REPOSITORY / "clients/c"
# The C client's macro and kind for each annotation of a field of messages.py.
KIND_OF = {
    "int": "FIELD INTEGER",
    "float": "FIELD NUMBER",
    "float | None": "NULLABLE NUMBER",
    "Vector": "FIELD VECTOR",
    "Vector | None": "NULLABLE VECTOR",
    "bool": "FIELD FLAG",
    "bool | None": "FIELD TOUCH",
    "Health": "FIELD HEALTH",
    "str | None": "NULLABLE WORD",
}
# Text of 64 bytes, but for sentences: those may be longer.
TEXTS = {"reason": "FIELD SENTENCE"}
# Maps, lists of maps, and fields that only some pads send: written without a macro.
OTHER_KINDS = {
    "pose": "POSE",
    "now": "NOW",
    "slip": "SLIP",
    "slipping": "NULLABLE FLAG",
    "contacts": "FINGERS",
    "more": "FLAG",
    "poses": "POSES",
}


def constants(path: Path) -> dict[str, int]:
    """The enumerators of a C header that are a number, or the name of another one."""
    text = re.sub(r"//[^\n]*|/\*.*?\*/", "", path.read_text(), flags=re.DOTALL)
    found: dict[str, int] = {}
    for name, value in re.findall(r"\b([A-Z][A-Z0-9_]+) = (-?\w+)", text):
        if value in found or re.fullmatch(r"-?(0x[0-9A-Fa-f]+|\d+)", value):
            found[name] = found[value] if value in found else int(value, 0)
    return found


def hints(*kinds: type[msgspec.Struct]) -> dict[str, str]:
    return dict(chain.from_iterable(kind.__annotations__.items() for kind in kinds))


# Messages


def in_c_client(table: str) -> list[tuple[str, str]]:
    """Name and kind of each field in a table of fmfts.c."""
    text = (C_CLIENT / "fmfts.c").read_text()
    body = text[text.index(f"{table}[] = {{") :]
    body = body[: body.index("};")]
    rows = re.findall(r"(FIELD|NULLABLE)\((\w+), \w+, (\w+)\)|\{\"(\w+)\", (\w+),", body)
    return [(name or other, f"{macro} {kind}" if macro else which) for macro, kind, name, other, which in rows]


def due(kind: type[msgspec.Struct], *before: str) -> list[tuple[str, str]]:
    pairs = list(kind.__annotations__.items())
    named = [(name, OTHER_KINDS.get(name) or TEXTS.get(name, KIND_OF.get(hint, "FIELD WORD"))) for name, hint in pairs]
    return [*((name, "FIELD WORD") for name in before), *named]


@pytest.mark.parametrize(
    ("table", "fields"),
    [
        ("contact_fields", due(ContactMessage, "pad", "boot")),
        ("pose_fields", due(PoseMessage)),
        ("finger_fields", due(FingerMessage)),
        ("slip_fields", due(SlipMessage)),
    ],
    ids=["contact", "pose", "finger", "slip"],
)
def test_c_client_has_the_daemons_fields_in_the_daemons_order(table: str, fields: list[tuple[str, str]]) -> None:
    """The order is what makes looking one up cheap."""
    assert in_c_client(table) == fields


def test_c_client_knows_the_schema_and_every_word_of_health() -> None:
    header, text = constants(C_CLIENT / "fmfts.h"), (C_CLIENT / "fmfts.c").read_text()
    assert header["FMFTS_SCHEMA_VERSION"] == SCHEMA_VERSION
    words = re.findall(r'"(\w+)"', text[text.index("health_names[] =") :].partition("};")[0])
    assert words == ["unknown", *get_args(Health)]


# Frames


def number_in(path: str, name: str) -> float:
    """A number that a C file of the daemon defines."""
    (value,) = re.findall(rf"\b{name}(?: =)? ([0-9.e+-]+)", (DAEMON / path).read_text())
    return float(value)


def test_frames_have_the_same_limits_in_c_and_in_python() -> None:
    """C judges pads with one magnet; Python those with several, and what may be configured."""
    assert number_in("pose/pose_fields.h", "FMFTS_FEWEST_SENSORS") == FEWEST_SENSORS
    assert number_in("pose/alignment.c", "AGE_UNKNOWN_US") == AGE_UNKNOWN_US


# The wire


def test_firmware_and_daemon_have_the_same_limits() -> None:
    board, host = constants(CORE / "wire.h"), constants(WIRE / "sample.h") | constants(WIRE.parent / "reading.h")
    assert board["WIRE_VERSION"] == codec.VERSION
    assert board["WIRE_SENSORS_MAX"] == packets.BOARD_SENSORS
    assert host["FMFTS_SENSORS"] == packets.MAX_SENSORS
    assert board["WIRE_PADS_MAX"] == host["FMFTS_WIRE_PADS"] == packets.MAX_PADS
    assert board["WIRE_LINE_MAX"] == MAX_LINE_BYTES + 1
    assert host["FMFTS_LONGEST_LINE"] == MAX_LINE_BYTES
    assert host["FMFTS_READING_BYTES"] == READING_BYTES
    assert board["WIRE_ALL_PADS"] == packets.ALL_PADS
    assert board["WIRE_AGE_UNKNOWN"] == AGE_UNKNOWN_US
    assert board["WIRE_UID_SIZE"] == packets.UID_BYTES
    unknown = (board["WIRE_TEMPERATURE_UNKNOWN"], host["FMFTS_TEMPERATURE_UNKNOWN"])
    assert unknown == (packets.TEMPERATURE_UNKNOWN, packets.TEMPERATURE_UNKNOWN)


def test_firmware_and_daemon_number_packets_alike() -> None:
    board = constants(CORE / "wire.h")
    types = {f"WIRE_{one.name}": int(one) for one in packets.PacketType}
    types |= {f"WIRE_REQUEST_{one.name}": int(one) for one in packets.Verb}
    assert {name: board.get(name) for name in types} == types


def test_firmware_numbers_results_and_states_as_daemon_reads_them() -> None:
    text = (CORE / "wire.h").read_text()
    (results,), (states,) = (
        re.findall(rf"enum {name} \{{([^}}]*)\}}", text, flags=re.DOTALL) for name in ("wire_result", "sensor_state")
    )
    assert _words(results) == [f"RESULT_{one.name}" for one in packets.Result]
    # The firmware names two states differently; it has as many, and the first and last agree.
    assert len(_words(states)) == len(packets.SensorState)
    assert (_words(states)[0], _words(states)[-1]) == ("SENSOR_OK", "SENSOR_NOT_STARTED")


def _words(enumerators: str) -> list[str]:
    return re.findall(r"\b[A-Z_]+\b", enumerators)


def test_no_program_holds_more_than_the_wire_carries() -> None:
    sampler, pads = (CORE / "pad_bus.h").read_text(), (CORE / "pads.h").read_text()
    assert constants(CORE / "pads.h")["PAD_SENSORS_FOUND"] == packets.FOUND_SENSORS
    assert "PAD_SENSORS_MAX = WIRE_SENSORS_MAX" in pads
    assert "PADS_SENSORS_MAX = WIRE_PADS_MAX * PAD_SENSORS_FOUND" in pads
    assert packets.MAX_PADS * packets.FOUND_SENSORS == packets.ALL_BOARD_SENSORS
    assert "SAMPLER_PADS_MAX = WIRE_PADS_MAX" in sampler
    assert "SAMPLER_SENSORS_MAX = PADS_SENSORS_MAX" in sampler
    assert packets.BOARD_SENSORS < 1 << packets.COUNT_BITS
    assert packets.BOARD_SENSORS + 1 == packets.MORE_SENSORS < 16, "four bits hold it"
    assert constants(CORE / "sampler.h")["RATE_MAX_HZ"] == BRIDGE_HZ
    assert constants(CORE / "sampler.c")["READ_US"] == BOARD_READ_US


def test_configuration_takes_pads_that_board_may_have_and_no_more() -> None:
    source = {"type": "bridge", "port": "/dev/ttyUSB0"}
    last = msgspec.convert(source | {"pad_index": packets.MAX_PADS - 1}, BridgeSource)
    assert last.pad_index == packets.MAX_PADS - 1
    with pytest.raises(msgspec.ValidationError, match="pad_index"):
        msgspec.convert(source | {"pad_index": packets.MAX_PADS}, BridgeSource)


# The chips


def test_firmware_describes_the_chip_as_the_daemon_does() -> None:
    chip, board = HMC5983, constants(CORE / "hmc5983.h")
    source = (CORE / "hmc5983.c").read_text()
    assert board["HMC5983_ADDRESS"] == chip.address
    assert (board["HMC5983_RATE_HZ"],) == chip.board_rates_hz
    assert board["HMC5983_SINGLE_RATE_MAX_HZ"] == chip.board_single_hz
    assert board["HMC5983_OVERFLOW"] == chip.saturated_count
    assert board["HMC5983_GAIN_CODES"] == len(chip.counts_per_gauss)
    assert board["HMC5983_SELFTEST_GAIN"] == chip.bias_strap.gain_code
    assert board["HMC5983_RATE_HZ"] == chip.free_rate_hz
    assert board["HMC5983_PERIOD_US"] == int(1e6 / chip.free_rate_hz)
    assert board["HMC5983_SINGLE_CONVERSION_US"] == round(chip.single_conversion_s * 1e6)
    assert board["HMC5983_SINGLE_WAIT_US"] == round(chip.single_wait_s * 1e6)
    limits = constants(CORE / "hmc5983.c")
    assert (limits["SELFTEST_MIN"], limits["SELFTEST_MAX"]) == chip.bias_strap.limits
    counts = re.findall(r"\d+", source[source.index("hmc5983_lsb_per_gauss[") :].partition("{")[2].partition("}")[0])
    assert [(int(each),) * 3 for each in counts] == list(chip.counts_per_gauss)
    identity = re.findall(r"identification\[\d\] == '(.)'", source)
    assert "".join(identity).encode() == chip.identity


OTHERS = [CHIPS[name] for name in ("qmc5883l", "qmc5883p", "mmc5983ma", "mmc5603nj", "mlx90393", "lis3mdl")]


@pytest.mark.parametrize("chip", OTHERS, ids=lambda chip: chip.name)
def test_firmware_describes_the_other_chips_as_the_daemon_does(chip: Chip) -> None:
    path = CORE / f"chips/{chip.name}.c"
    board, source = constants(path), path.read_text()
    assert board["LARGEST"] == chip.largest_count
    assert chip.saturated_count == -(2**15)
    if chip.film is not None:
        for name, gauss in (("STRONG", chip.film.upset_gauss), ("DOUBTFUL", chip.film.doubtful_gauss)):
            limit = re.search(rf"{name} = (\d+) \* (\d+)", source)
            assert limit is not None
            assert [float(each) for each in limit.groups()] == [gauss, chip.counts_per_gauss[0][0]]
    assert f".gain_codes = {len(chip.counts_per_gauss)}," in source
    speeds = re.search(r"chip_speed speeds\[\] = \{(.*)\};", source)
    assert speeds is not None
    rates = [(int(rate), int(period)) for rate, period in re.findall(r"\{(\d+), (\d+)\}", speeds[1])]
    assert [rate for rate, _ in rates] == list(chip.board_rates_hz)
    assert set(chip.board_rates_hz) <= set(chip.output_rates_hz)
    assert all(period == pytest.approx(1e6 / rate, rel=0.02) for rate, period in rates)  # rates are whole hertz
    single = {name: int(number) for name, number in re.findall(r"\.(\w+) = (\d+),", source)}
    assert ("conversion_us" in single) == chip.has_trigger
    if chip.has_trigger:
        assert single["conversion_us"] == pytest.approx(chip.single_conversion_s * 1e6, abs=1)
        assert single["wait_us"] == pytest.approx(chip.single_wait_s * 1e6, abs=2)
        assert single["rate_max_hz"] == chip.single_rate_hz


def test_boards_look_for_each_chip_wherever_it_may_be() -> None:
    places = re.findall(r"\{&chip_(\w+), (0x\w\w)\}", (CORE / "chips/chips.c").read_text())
    for name in {name for name, _ in places}:
        assert [int(address, 16) for kind, address in places if kind == name] == list(CHIPS[name].addresses)


@pytest.mark.parametrize("chip", [chip for chip in CHIPS.values() if chip.on_boards], ids=lambda chip: chip.name)
def test_noise_on_a_board_is_what_the_daemon_takes_it_for(chip: Chip) -> None:
    """Where a board runs a chip faster than the daemon would by itself, that must not be noisier."""
    for rate_hz in range(1, highest_rate_hz(chip, "free", over_bridge=True) + 1):
        on_board = min((rate for rate in chip.board_rates_hz if rate >= rate_hz), default=chip.board_rates_hz[-1])
        assert chip.noise_at_t(on_board, "free") == chip.noise_at_t(rate_hz, "free")


def test_every_chip_that_boards_read_has_a_file_in_the_firmware() -> None:
    kinds = re.findall(r"&chip_(\w+)", (CORE / "chips/chips.c").read_text())
    assert {name for name, chip in CHIPS.items() if chip.on_boards} == set(kinds)


def test_configuration_names_every_chip_that_there_is() -> None:
    assert set(get_args(ChipName)) == set(CHIPS)
    assert all(name == chip.name for name, chip in CHIPS.items())


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def python_files() -> list[Path]:
    return [path for folder in ("daemon", "lab", "extras") for path in sorted((REPOSITORY / folder).rglob("*.py"))]


def test_daemon_never_branches_on_a_chip_name() -> None:
    """What depends on the chip is a fact of it: another chip is another file, and no other branch."""
    named = []
    for path in python_files():
        text = path.read_text()
        if path.parent.name == "chips" or not any(name in text for name in CHIPS):
            continue
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Compare | ast.Match | ast.Dict):
                values = [each.value for each in ast.walk(node) if isinstance(each, ast.Constant)]
                named += [f"{path.name}:{node.lineno}" for value in values if value in CHIPS]
    assert named == []


def test_chips_noise_is_written_once() -> None:
    number = re.compile(r"\d[\d_]*\.?[\d_]*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?")

    def may_write(path: Path) -> bool:
        return any(float(each.rstrip("_")) == HMC5983.noise_t for each in number.findall(path.read_text()))

    found = [
        f"{path.relative_to(REPOSITORY)}:{node.lineno}"
        for path in filter(may_write, python_files())
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value == HMC5983.noise_t
    ]
    assert [line.partition(":")[0] for line in found] == ["daemon/fmfts/sensor/chips/hmc5983.py"], found


# Comments

OF_OTHERS = {"Python.h", "protocol.c", "zmq.h", "mman.h", "sysexits.h"}


def sources() -> list[Path]:
    folders = ("daemon", "lab", "extras", "firmware", "clients")
    return [path for folder in folders for path in sorted((REPOSITORY / folder).rglob("*.*")) if _is_source(path)]


def _is_source(path: Path) -> bool:
    return path.suffix in (".py", ".c", ".h") and "build" not in path.relative_to(REPOSITORY).parts


def comments(path: Path) -> Iterator[str]:
    text = path.read_text()
    if path.suffix != ".py":
        yield from re.findall(r"//[^\n]*|/\*.*?\*/", text, flags=re.DOTALL)
        return
    yield from (
        one.string for one in tokenize.generate_tokens(io.StringIO(text).readline) if one.type == tokenize.COMMENT
    )
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def unknown_files(paths: Sequence[Path]) -> list[str]:
    there = {path.name for path in [*sources(), *(REPOSITORY / "tests").rglob("*.py")]} | OF_OTHERS
    file = re.compile(r"\b\w+\.(?:py|c|h)\b")
    suspects = (path for path in paths if not there.issuperset(file.findall(path.read_text())))  # before its comments
    named = ((path, name) for path in suspects for text in comments(path) for name in file.findall(text))
    return [f"{path.relative_to(REPOSITORY)} names {name}" for path, name in named if name not in there]


def test_comments_name_files_that_exist() -> None:
    assert unknown_files(sources()) == []
