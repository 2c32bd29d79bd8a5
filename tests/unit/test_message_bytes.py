"""The messages that C encodes: byte for byte those that msgspec makes of the same ContactMessage."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from fmfts.bus.encoding import decode_contact, encode
from fmfts.bus.messages import (
    NO_ESTIMATE,
    ContactMessage,
    FingerMessage,
    Health,
    NowMessage,
    PoseMessage,
    SlipMessage,
)
from fmfts_client.fields import SCHEMA_VERSION
from needed import missing

ROOT = Path(__file__).parents[2]
SOURCES = ("tests/unit/write_message.c", "daemon/fmfts/pipeline/message.c")
FLAGS = ["-std=c11", "-O1", "-shared", "-fPIC", "-ffp-contract=off", "-fno-math-errno"]

OUTPUTS = ("x", "y", "force", "shear_x", "shear_y")
# The numbers of a reading in their order, and the count of each.
NUMBERS = {
    "temperature_c": 1, "place": 5, "deviation": 5, "force_n": 1, "force_sd_n": 1, "force_min_n": 1,
    "displacement_m": 1, "displacement_sd_m": 1, "position_m": 3, "position_sd_m": 3, "axis": 3, "axis_sd_rad": 1,
    "remanence_t": 1, "remanence_sd_t": 1, "ambient_t": 3, "ambient_sd_t": 3, "residual_t": 1, "chi2": 1, "value": 5,
    "now_deviation": 5, "rate": 5, "rate_deviation": 5, "sticking_probability": 1, "speed_m_per_s": 1,
    "speed_sd_m_per_s": 1, "direction_rad": 1, "direction_sd_rad": 1, "friction": 1, "friction_sd": 1, "margin_n": 1,
    "margin_sd_n": 1,
}  # fmt: skip
POSE = PoseMessage.__struct_fields__
# Contents of a reading: the flags of write_message.c after `contact`.
TOLD = ("over_range", "force", "place", "force_min", "displacement", "pose", "outputs", "now", "now_places")
TOLD += ("slip", "slip_known", "slipping", "friction")
TOLD += ("several", "more", "tells_fingers", "fingers", "tells_poses", "magnets")
MOST_FINGERS, MOST_MAGNETS = 2, 9
SLIP = SlipMessage.__struct_fields__[1:]
EDGES = [0, 23, 31, 32, 127, 128, 255, 256, 65535, 65536, 2**31, 2**32 - 1, 2**32, 2**53, 2**63 - 1]

Words = tuple[str, str, str, str, str | None]


class Written:
    """message.c, compiled."""

    def __init__(self, library: Path) -> None:
        self._library = ctypes.CDLL(str(library))
        self._library.health_name.restype = ctypes.c_char_p
        self._library.write_message.restype = self._library.room.restype = ctypes.c_size_t
        self._room = self._library.room()
        self.health: list[str] = []
        while (name := self._library.health_name(len(self.health))) is not None:
            self.health.append(name.decode())

    def message(
        self, numbers: dict[str, Any], flags: list[int], integers: list[int], words: Words
    ) -> tuple[bytes, bool]:
        """The message, empty if there is no room; and whether all its numbers are finite."""
        content, finite = ctypes.create_string_buffer(self._room), ctypes.c_int()
        flat = np.concatenate([np.ravel(numbers[name]) for name in NUMBERS])
        size = self._library.write_message(
            flat.ctypes.data_as(ctypes.c_void_p),
            (ctypes.c_int * len(flags))(*flags),
            (ctypes.c_int64 * len(integers))(*integers),
            (ctypes.c_char_p * len(words))(*(None if each is None else each.encode() for each in words)),
            content,
            ctypes.byref(finite),
        )
        return content.raw[:size], bool(finite.value)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    if shutil.which("gcc") is None:
        missing("gcc")
    library = tmp_path_factory.mktemp("message") / "message.so"
    subprocess.run(["gcc", *FLAGS, *(ROOT / source for source in SOURCES), "-lm", "-o", library], check=True)
    return Written(library)


def random_numbers(random: np.random.Generator) -> dict[str, Any]:
    numbers = {name: random.normal(size=count) * 10.0 ** random.integers(-9, 9) for name, count in NUMBERS.items()}
    return {name: value if len(value) > 1 else float(value[0]) for name, value in numbers.items()}


def magnet(numbers: dict[str, Any], times: float) -> PoseMessage:
    """times: the number that write_message.c multiplies this magnet's own numbers by."""
    of_all = "ambient_t", "ambient_sd_t", "residual_t", "chi2"
    scaled = {name: np.asarray(numbers[name]) * (1.0 if name in of_all else times) for name in POSE}
    pose = {name: tuple(value.tolist()) if NUMBERS[name] > 1 else float(value) for name, value in scaled.items()}
    if np.isnan(numbers["ambient_t"][0]):
        pose |= {"ambient_t": None, "ambient_sd_t": None}  # type: ignore[dict-item]
    return PoseMessage(**pose)  # type: ignore[arg-type]


def finger(numbers: dict[str, Any], outputs: int, number: int) -> FingerMessage:
    """As write_message.c makes it."""
    told: dict[str, Any] = dict.fromkeys(FingerMessage.__struct_fields__)
    for index, name in enumerate(OUTPUTS[:outputs]):
        unit = "m" if name in "xy" else "n"
        told[f"{name}_{unit}"] = float(numbers["place"][index] * (1.0 + number))
        told[f"{name}_sd_{unit}"] = float(numbers["deviation"][index] * (1.0 + number))
    return FingerMessage(**(told | {"id": 100 * number + 7}))


def expected(
    numbers: dict[str, Any], flags: list[int], integers: list[int], words: Words, health: str
) -> ContactMessage:
    """The message of a reading, as ContactMessage has it."""
    contact, told = flags[1], dict(zip(TOLD, flags[2:], strict=True))
    version, number, sampled_ns, published_ns, utc_ns, now_ns, sensors_ok = integers
    pad, boot, reason, model, baseline = words
    fields: dict[str, Any] = dict(NO_ESTIMATE)
    places = [name for name in OUTPUTS[: told["outputs"]] if name != "force"] if told["place"] else []
    for name in places:
        index, unit = OUTPUTS.index(name), "m" if name in "xy" else "n"
        fields |= {f"{name}_{unit}": numbers["place"][index], f"{name}_sd_{unit}": numbers["deviation"][index]}
    for what, names in (
        ("force", ("force_n", "force_sd_n")),
        ("force_min", ("force_min_n",)),
        ("displacement", ("displacement_m", "displacement_sd_m")),
    ):
        fields |= {name: numbers[name] for name in names} if told[what] else {}
    if told["now"]:
        columns = numbers["value"], numbers["now_deviation"], numbers["rate"], numbers["rate_deviation"]
        now: dict[str, Any] = dict.fromkeys(NowMessage.__struct_fields__)
        for index, name in enumerate(OUTPUTS[: told["outputs"]]):
            unit = "m" if name in "xy" else "n"
            forms = f"{name}_{unit}", f"{name}_sd_{unit}", f"{name}_rate_{unit}_per_s", f"{name}_rate_sd_{unit}_per_s"
            if told["now_places"] or name == "force":
                now |= {form: column[index] for form, column in zip(forms, columns, strict=True)}
        fields["now"] = NowMessage(**(now | {"t_ns": now_ns}))
    if told["slip"]:
        known = {name: numbers[name] if told["friction"] or SLIP.index(name) < 5 else None for name in SLIP}
        fields["slip"] = SlipMessage(slipping=bool(told["slipping"]), **known) if told["slip_known"] else SlipMessage()
    if told["pose"] and not told["several"]:
        fields["pose"] = magnet(numbers, 1.0)
    if told["several"]:
        fingers = [finger(numbers, told["outputs"], number) for number in range(told["fingers"])]
        poses = [magnet(numbers, 1.0 + number) for number in range(told["magnets"])]
        fields["contacts"], fields["more"] = fingers if told["tells_fingers"] else None, bool(told["more"])
        fields["poses"] = poses if told["tells_poses"] else None
    return ContactMessage(
        v=version,
        pad=pad,
        boot=boot,
        seq=number,
        t_sample_ns=sampled_ns,
        t_publish_ns=published_ns,
        utc_ns=utc_ns,
        temperature_c=None if np.isnan(numbers["temperature_c"]) else numbers["temperature_c"],
        health=health,  # type: ignore[arg-type]
        reason=reason,
        over_range=bool(told["over_range"]),
        sensors_ok=sensors_ok,
        model=model,
        baseline=baseline,
        **(fields | {"contact": (None, False, True)[contact]}),
    )


def random_words(random: np.random.Generator) -> Words:
    def text(longest: int) -> str:
        return "".join(random.choice(list("abc °→µ"), random.integers(longest)))

    reason = text(int(random.choice([1, 40, 700])))
    return text(40), text(12), reason, text(70), None if random.random() < 0.3 else text(70)


def random_integer(random: np.random.Generator) -> int:
    value = int(random.choice(EDGES)) if random.random() < 0.5 else int(random.integers(0, 2 ** random.integers(1, 63)))
    return -value if random.random() < 0.2 else value


def random_flags(random: np.random.Generator, healths: int) -> list[int]:
    flags = [
        int(random.integers(healths)),
        int(random.integers(3)),
        *(int(one) for one in random.integers(0, 2, len(TOLD))),
    ]
    flags[2 + TOLD.index("outputs")] = int(random.choice([3, 5]))
    flags[2 + TOLD.index("fingers")] = int(random.integers(MOST_FINGERS + 1))
    flags[2 + TOLD.index("magnets")] = int(random.integers(MOST_MAGNETS + 1))
    return flags


def test_each_reading_makes_the_bytes_that_msgspec_makes(written: Written) -> None:
    random = np.random.default_rng(5)
    for _ in range(4000):
        numbers, flags = random_numbers(random), random_flags(random, len(written.health))
        if random.random() < 0.2:
            numbers["temperature_c"] = np.nan
        if random.random() < 0.3:
            numbers["ambient_t"], numbers["ambient_sd_t"] = np.full(3, np.nan), np.full(3, np.nan)
        integers = [SCHEMA_VERSION, *(random_integer(random) for _ in range(5)), int(random.integers(0, 2**16))]
        words = random_words(random)
        content, is_finite = written.message(numbers, flags, integers, words)
        message = expected(numbers, flags, integers, words, written.health[flags[0]])
        assert is_finite
        assert content == encode(message)
        assert decode_contact(content) == message


def test_every_health_of_a_message_has_its_name(written: Written) -> None:
    assert set(written.health) == set(get_args(Health))
    assert len(written.health) == len(get_args(Health))


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_nan_is_found_only_in_published_numbers(written: Written, name: str, wrong: float) -> None:
    random = np.random.default_rng(6)
    for everything in (True, False):
        numbers = random_numbers(random)
        last = NUMBERS[name] - 1
        numbers[name] = np.append(np.atleast_1d(numbers[name])[:last], wrong) if last else wrong
        flags = [0, 2, *(int(everything) for _ in TOLD)]
        flags[2 + TOLD.index("outputs")] = 5
        _, is_finite = written.message(numbers, flags, [1] * 7, ("p", "b", "", "m", None))
        is_told = everything or name == "temperature_c"
        is_unknown = name == "temperature_c" and bool(np.isnan(wrong))
        assert is_finite is (is_unknown or not is_told)


def test_too_long_words_make_no_message(written: Written) -> None:
    numbers, long = random_numbers(np.random.default_rng(7)), "x" * 10_000
    flags = [0] * (2 + len(TOLD))
    for position in (0, 1, 3, 4):
        words = tuple(long if number == position else "short" for number in range(5))
        assert written.message(numbers, flags, [1] * 7, words) == (b"", True)  # type: ignore[arg-type]


def test_new_number_needs_no_line_of_message_c() -> None:
    """message.c writes what frame.h lists: docs/how-to.md counts the files of a new field."""
    header, code = ((ROOT / "daemon/fmfts/pipeline" / name).read_text() for name in ("frame.h", "message.c"))
    told = re.findall(r"TOLD\((?:\w+), (\w+)\)", header)
    pose = re.findall(
        r"^ +(?:ONE|MANY)\(double, (\w+)", header[header.index("#define FMFTS_TOLD_POSE") :], re.MULTILINE
    )
    assert {"force_min_n", "displacement_sd_m"} <= set(told) < set(ContactMessage.__struct_fields__)
    assert {"position_m", "remanence_sd_t"} <= set(pose) < set(POSE)
    assert not [name for name in told + pose if name in code]
