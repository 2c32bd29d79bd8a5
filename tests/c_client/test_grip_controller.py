"""The controllers in examples/grip.py and grip.c decide alike, tighten where they must, and never open blindly."""

from __future__ import annotations

import importlib.util
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import ModuleType

import msgpack
import numpy as np
import pytest

from c_client.built import CLIENT, HERE, SANITIZED, build
from c_client.grip_messages import NAMES, PYTHON_EXAMPLE, held, untouched
from fmfts.bus.encoding import encode
from fmfts.bus.messages import ContactMessage, SlipMessage
from fmfts_client import Contact

PATIENCE_S, STEPS = 60.0, 2400


@pytest.fixture(scope="module")
def python() -> ModuleType:
    spec = importlib.util.spec_from_file_location("grip_example", PYTHON_EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def drawn(random: np.random.Generator) -> Iterator[tuple[bool, list[ContactMessage | None]]]:
    """Steps of a grip that is lost, found, slips, grows heavier and goes blind."""
    force_n, sticks, friction, place_m = 0.0, 1.0, None, 2e-3
    for number in range(STEPS):
        force_n = abs(force_n + random.normal(0.01, 0.03)) if force_n < 2.2 else 0.3
        sticks = float(np.clip(sticks + random.normal(0.02, 0.3), 0.0, 1.0))
        friction = random.uniform(0.1, 1.0) if random.uniform() < 0.02 else friction
        place_m = float(np.clip(place_m + random.normal(0.0, 2e-4), -8e-3, 8e-3))
        slip = SlipMessage(
            slipping=sticks < 0.1,
            sticking_probability=sticks,
            friction=friction,
            margin_n=None if friction is None else friction * force_n - random.uniform(0.1, 1.0),
        )
        told: list[ContactMessage | None] = [
            held(
                name,
                force_n + random.normal(0.0, 0.01),
                x_m=place_m,
                slip=slip,
                force_sd_n=random.choice([0.05, 1.5], p=[0.7, 0.3]),
            )
            for name in NAMES
        ]
        for pad, name in enumerate(NAMES):
            kind = random.uniform()
            if kind < 0.02:
                told[pad] = None
            elif kind < 0.05:
                told[pad] = held(name, force_n, None)
            elif number < 20 or kind < 0.06:
                told[pad] = untouched(name)
        yield number % 800 > 300, told


Steps = list[tuple[bool, list[ContactMessage | None]]]
Decided = list[tuple[float, bool, bool]]


def decided_by_python(python: ModuleType, steps: Steps) -> Decided:
    grip, decided = python.Grip(), []
    for loosen, told in steps:
        contacts = [None if each is None else Contact.from_message(msgpack.unpackb(encode(each))) for each in told]
        command = grip.step(contacts, loosen)
        decided.append((command.close_m_per_s, command.may_lift, grip.found))
    return decided


def decided_by_c(program: Path, steps: Steps) -> Decided:
    asked = bytearray()
    for loosen, told in steps:
        asked += bytes([loosen])
        for message in told:
            body = b"" if message is None else encode(message)
            asked += struct.pack("=I", len(body)) + body
    ended = subprocess.run([program], input=bytes(asked), capture_output=True, timeout=PATIENCE_S, check=False)
    assert ended.returncode == 0, ended.stderr.decode()
    answers = [line.split() for line in ended.stdout.decode().splitlines()]
    return [(float(speed), lift == "1", found == "1") for speed, lift, found in answers]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    flags = [f"-I{CLIENT}", "-lm", *SANITIZED]
    return build(tmp_path_factory.mktemp("grip") / "grip_steps", "gcc", [HERE / "grip_steps.c"], *flags)


@pytest.fixture(params=["c", "python"])
def decide(request: pytest.FixtureRequest, python: ModuleType, program: Path) -> Callable[[Steps], Decided]:
    return partial(decided_by_c, program) if request.param == "c" else partial(decided_by_python, python)


def test_both_languages_decide_alike(python: ModuleType, program: Path) -> None:
    steps = list(drawn(np.random.default_rng(3)))
    answers = np.array(decided_by_c(program, steps), dtype=float)
    np.testing.assert_allclose(answers, np.array(decided_by_python(python, steps), dtype=float), rtol=1e-12, atol=1e-15)
    speeds, lifts, found = answers.T
    assert found[-1] == 1.0
    assert 0.1 < lifts.mean() < 0.9
    assert len(np.unique(speeds)) > STEPS / 4


@pytest.mark.parametrize("dead", [0, 1])
def test_grip_with_one_dead_pad_never_opens(decide: Callable[[Steps], Decided], dead: int) -> None:
    def alone(message: Callable[..., ContactMessage], *values: float) -> list[ContactMessage | None]:
        return [None if pad == dead else message(name, *values) for pad, name in enumerate(NAMES)]

    touches = (False, [held(name, 0.6) for name in NAMES])
    too_tight = (True, alone(held, 1.2))
    slips = (False, alone(held, 0.6, 0.02))
    for first in ([too_tight], [touches, too_tight]):
        assert decide(first * 50)[-1][:2] == (0.0, False)
    assert all(speed >= 0.0 and not lift for speed, lift, _ in decide([too_tight] * 300))
    # It keeps closing neither on an object that is gone nor on one that was never there.
    assert decide([touches] + [(False, alone(untouched))] * 50)[-1][:2] == (0.0, False)
    assert decide([(False, alone(untouched))])[-1][:2] == (0.0, False)
    speed, lift, _ = decide([touches, slips])[-1]
    assert speed > 0.0  # the other pad feels a slip
    assert not lift


def test_grip_tightens_at_a_slip_and_as_the_load_grows(python: ModuleType) -> None:
    def stepped(grip: object, force_n: float, steps: int, loosen: bool = False, **slip: float | bool) -> float:
        for _ in range(steps):
            told = [held(name, force_n, slip=SlipMessage(**slip)) for name in NAMES]  # type: ignore[arg-type]
            contacts = [Contact.from_message(msgpack.unpackb(encode(each))) for each in told]
            speed = grip.step(contacts, loosen).close_m_per_s  # type: ignore[attr-defined]
        return float(speed)

    grip = python.Grip()
    assert stepped(grip, 0.9, 50, slipping=False, sticking_probability=1.0) < 0.0
    slips = {"slipping": True, "sticking_probability": 0.01, "friction": 0.5, "margin_n": 0.0}
    per_n = python.CLOSE_M_PER_S_PER_N
    assert stepped(grip, 0.8, 1, loosen=True, **slips) == pytest.approx(per_n * python.RESERVE * 0.8, rel=0.02)
    assert grip.found
    holds = {"slipping": False, "sticking_probability": 1.0, "friction": 0.5}
    assert stepped(grip, 0.92, 60, margin_n=0.06, **holds) == pytest.approx(0.0, abs=1e-3)
    heavier_n = 0.92 * 1.5  # its shear is 1.5 times what it was
    assert stepped(grip, heavier_n, 200, margin_n=0.5 * heavier_n - 1.5 * 0.4, **holds) == pytest.approx(0.0, abs=1e-3)


def test_load_that_grew_stays_known_when_a_pad_joins_or_falls_silent(decide: Callable[[Steps], Decided]) -> None:
    """It holds still at the force it wants: the 0.8 N with which it slipped last, its reserve, times the growth."""

    def told(force_n: float, left_n: float | None, right_n: float | None, steps: int) -> Steps:
        """Shear of each pad at friction 0.5; None: its margin is not known."""
        slips = [
            SlipMessage(
                sticking_probability=1.0, friction=0.5, margin_n=None if shear_n is None else 0.5 * force_n - shear_n
            )
            for shear_n in (left_n, right_n)
        ]
        return [(False, [held(name, force_n, slip=slip) for name, slip in zip(NAMES, slips, strict=True)])] * steps

    unknown = SlipMessage(slipping=True, sticking_probability=0.01)
    right = SlipMessage(slipping=True, sticking_probability=0.01, friction=0.5, margin_n=0.4 - 0.9)
    cases: list[tuple[list[tuple[float | None, float | None, int]], float]] = [
        ([(0.3, None, 60), (0.6, None, 200), (0.6, 0.6, 100)], 2.0),
        ([(0.3, 0.3, 60), (0.9, 0.3, 200), (None, 0.3, 100)], 2.0),
        ([(0.3, 0.3, 60), (0.5, 0.3, 200), (0.5, None, 100)], 5 / 3),
        ([(0.3, 0.3, 60), (0.9, 0.3, 200), (None, 0.3, 50), (0.3, 0.3, 200)], 1.0),
    ]
    for (shears, growth), slipped in [*zip(cases, [unknown] * len(cases), strict=True), (cases[0], right)]:
        found: Steps = [(True, [held("left", 0.8, slip=unknown), held("right", 0.8, slip=slipped)])]
        force_n = 1.15 * 0.8 * growth
        speed, _, is_found = decide(found + [step for each in shears for step in told(force_n, *each)])[-1]
        assert is_found
        assert speed == pytest.approx(0.0, abs=1e-3), growth


def slipping(slips: bool) -> SlipMessage:
    return SlipMessage(slipping=slips, sticking_probability=0.01 if slips else 1.0)


def told_of(*forces: tuple[float, float], slips: bool = False, loosen: bool = False) -> Steps:
    """A step in which each pad tells a force and its deviation."""
    pads = zip(NAMES, forces, strict=True)
    return [(loosen, [held(name, force_n, slip=slipping(slips), force_sd_n=sd_n) for name, (force_n, sd_n) in pads])]


def test_forces_that_are_hardly_known_do_not_open_the_gripper_and_a_slip_still_closes_it(
    decide: Callable[[Steps], Decided], python: ModuleType
) -> None:
    """At the rim of both pads: then the way that the fingers close tells how much harder they press."""
    found = told_of((0.8, 0.05), (0.8, 0.05), slips=True, loosen=True)
    holds = told_of((0.92, 0.05), (0.92, 0.05)) * 100
    vague = told_of((2.4, 1.6), (2.2, 1.5))
    answers = decide(found + holds + vague * 50)[-50:]
    assert all(speed == pytest.approx(0.0, abs=1e-3) and not lift for speed, lift, _ in answers)
    slips = told_of((2.4, 1.6), (2.2, 1.5), slips=True)
    closed_m = sum(speed for speed, _, _ in decide(found + holds + slips + vague * 100)[-101:]) * python.PERIOD_S
    assert 200.0 * closed_m == pytest.approx(python.RESERVE * 0.92, rel=0.05)


def test_pad_whose_force_is_known_tells_the_mean_of_both_by_its_share(decide: Callable[[Steps], Decided]) -> None:
    """The right pad of 0.6 and 1 N reaches its rim: the left one's 0.6 N still are 0.8 N."""
    found = told_of((0.6, 0.05), (1.0, 0.05), slips=True, loosen=True)
    holds = told_of((0.69, 0.05), (1.15, 0.05)) * 100
    for right in ((3.0, 2.0), (0.1, 0.5)):
        speed, lift, _ = decide(found + holds + told_of((0.69, 0.05), right) * 50)[-1]
        assert speed == pytest.approx(0.0, abs=1e-3)
        assert not lift
        assert decide(found + holds + told_of((0.5, 0.05), right) * 50)[-1][0] > 0.01


def test_slips_on_the_table_tighten_no_pad_beyond_its_range(decide: Callable[[Steps], Decided]) -> None:
    """The arm would not lift. The right pad reads 1.28 of the mean: 2 N of it are 1.5625 N. In the air it loosens."""
    touches = told_of((0.45, 0.05), (0.8, 0.05)) * 30
    slips = told_of((0.9, 0.05), (1.6, 0.05), slips=True) * 200
    at_limit = ((1.125, 0.05), (2.0, 0.05))
    speed, _, _ = decide(touches + slips + told_of(*at_limit))[-1]
    assert speed == pytest.approx(0.0, abs=1e-3)
    assert decide(touches + slips + told_of(*at_limit, loosen=True) * 20)[-1][0] < -1e-3
