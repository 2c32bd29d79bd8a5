"""Pads with several magnets search fingers by turns: one pad in a round, none starves, and a replay says the same."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.bus.frame_message import frame_message, frame_of
from fmfts.bus.messages import ContactMessage
from fmfts.pad import Array
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts.runtime.search_turns import PATIENCE_ROUNDS, SearchTurns, turns_of
from fmfts.sensor import Frame
from fmfts.sensor.frame import WireFrame
from fmfts.several import fit
from fmfts.several.searches import SEARCHED_FRAMES, number_of
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_recording.replay import essence
from fmfts_simulation.array import SimulatedArray
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, Touch, no_finger, steady_finger

CONFIG = array_config(seed=6)
LEFT = steady_finger(-6e-3, -1e-3, 0.8)
# 10 µT and more that change sign from sensor to sensor: no fingers make such a field.
PATTERN = np.array([1, -1, 1, -1, -1, 1, 1, -1])[:, None] * np.array([140, 0, 140])
PERIOD_NS = round(1e9 / 220)
STEEL = range(10, 40)


def frames(count: int, finger: Finger = LEFT, second: Finger | None = None) -> Iterator[Frame]:
    source = SimulatedArray(CONFIG)
    source.finger, source.second_finger = finger, second
    for step in range(count):
        yield from source.poll(step * PERIOD_NS)


def beside_steel(frame: Frame) -> Frame:
    near = frame.sequence in STEEL
    return replace(frame, counts=frame.counts + PATTERN.astype(np.int16)) if near else frame


@cache
def mounting() -> ArrayMounting:
    """The same for all, for it takes longer than the frames."""
    return simulated_baseline(CONFIG).array_mounting(CONFIG.pad())


def ready(name: str = "pad") -> SeveralPipeline:
    config = CONFIG if name == "pad" else array_config(seed=6, name=name)
    made = pipeline_of(config, contact_model_of(config), "boot")
    assert isinstance(made, SeveralPipeline)
    made.use(simulated_baseline(CONFIG), mounting())
    return made


def forbidden(frame: Frame) -> Frame:
    return replace(frame, may_search=False)


ANY_FRAME = next(frames(1))


def who_searched(turns: SearchTurns, order: list[str], wanting: set[str]) -> list[str]:
    """Pads of `wanting` search whenever they may. Returns who did, "" where nobody, frame by frame."""
    searched = []
    for pad in order:
        may = turns.allowed(pad, ANY_FRAME).may_search
        turns.told(pad, "none" if pad not in wanting else "made" if may else "due")
        searched.append(pad if may and pad in wanting else "")
    return searched


def test_one_pad_searches_in_a_round_and_each_in_its_turn() -> None:
    pads = ["a", "b", "c", "d"]
    searched = who_searched(SearchTurns(4), pads * 40, set(pads))
    assert all(sum(map(bool, searched[at : at + 4])) <= 1 for at in range(len(searched) - 3))
    order = [pad for pad in searched if pad]
    assert order[:8] == pads + pads
    assert set(Counter(order).values()) == {len(order) // 4}
    assert len(order) >= 32  # a round and a frame for each


@pytest.mark.parametrize("pads", [1, 16])
def test_only_pad_that_wants_to_search_does_so_each_frame(pads: int) -> None:
    others = [str(number) for number in range(1, pads)]
    searched = who_searched(SearchTurns(pads), ["0", *others] * 10, {"0"})
    assert searched.count("0") == 10


def test_single_present_pad_still_completes_rounds() -> None:
    assert who_searched(SearchTurns(16), ["a"] * 5, {"a"}) == ["a"] * 5


def test_pad_that_left_while_waiting_delays_few_rounds() -> None:
    turns = SearchTurns(3)
    assert who_searched(turns, ["a", "b", "c"], {"a", "b", "c"}) == ["a", "", ""]
    searched = who_searched(turns, ["c", "a"] * 40, {"a", "c"})  # it was pad b's turn
    first = next(number for number, pad in enumerate(searched) if pad)
    assert first <= (PATIENCE_ROUNDS + 1) * 3
    assert {"a", "c"} == set(filter(None, searched))


def test_slow_pad_has_its_turn_beside_fast_ones() -> None:
    searched = who_searched(SearchTurns(3), ["a", "b", "a", "b", "a", "b", "slow"] * 30, {"a", "b", "slow"})
    assert Counter(searched)["slow"] >= 10


def test_rare_searches_still_try_fingers_and_each_sensor_in_turn() -> None:
    rare = range(SEARCHED_FRAMES + 10, SEARCHED_FRAMES + 1000, 10)
    numbers = [number_of(count) for count in [*range(SEARCHED_FRAMES + 1), *rare]]
    assert numbers == list(range(len(numbers)))


def test_frame_without_a_search_is_not_ok_with_an_old_finger() -> None:
    """A second finger comes down: only one is known, and where both are is not searched."""
    made, late = ready(), steady_finger(7e-3, 3e-3, 0.7)

    def second(time_s: float) -> Touch:
        return late(time_s) if time_s >= 0.05 else no_finger(time_s)

    said = [made.process(f if f.sequence < 11 or f.sequence >= 20 else forbidden(f)) for f in frames(30, LEFT, second)]
    before, waiting, after = said[9], said[13:20], said[21]
    assert before.health == "ok"
    assert before.contacts
    assert all(message.health == "disturbed" and message.contacts is None for message in waiting)
    assert all("waits for the searches of other pads" in message.reason for message in waiting)
    assert all(message.force_n is None and message.poses is None for message in waiting)
    assert after.health == "ok"
    assert isinstance(after.contacts, list)
    assert len(after.contacts) == 2
    assert before.contacts[0].id in {finger.id for finger in after.contacts}  # the finger was held all the time


def test_possible_second_finger_degrades_until_it_is_searched(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As if each frame were explained just well enough: then it is told, with larger deviations."""
    monkeypatch.setattr("fmfts.several.count.SECOND_GAIN", -1.0)
    made, said = ready(), []
    for frame in frames(8):
        said.append(made.process(frame if frame.sequence < 4 else forbidden(frame)))
    assert made.search == "due"
    assert {message.health for message in said[4:]} == {"degraded"}
    assert all(message.contacts and "waits for the searches" in message.reason for message in said[4:])


def test_waiting_frames_use_up_no_search_and_keep_the_finger() -> None:
    """The first of them holds few new samples, and one finger explains it: what follows is left as after it."""
    made, kept = ready(), list[tuple[int, int, bytes]]()
    for frame in map(beside_steel, frames(26)):
        made.process(frame if frame.sequence < STEEL.start else forbidden(frame))
        memory = made.memory.fingers
        assert memory is not None
        kept.append((memory.unexplained, memory.counter.count, memory.counter.fingers.tobytes()))
    assert {*kept[STEEL.start :]} == {kept[STEEL.start]}
    assert kept[-1][:2] == (0, 1)
    assert made.search == "due"


def test_frame_without_search_needs_few_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """What takes the time: 32 fits a frame when all was searched in each frame, nearly all to the last iteration."""
    fits = Counter[int]()
    whole, made, number = fit.Fitter.fit, ready(), 0

    def counted(
        self: fit.Fitter, start: Array, measured: fit.Measured, around_t: Array, few_iterations: bool = False
    ) -> fit.Fit:
        fits[number] += fit.FEW_ITERATIONS if few_iterations else fit.ITERATIONS
        return whole(self, start, measured, around_t, few_iterations)

    monkeypatch.setattr(fit.Fitter, "fit", counted)
    for frame in map(beside_steel, frames(36)):
        number = frame.sequence
        made.process(frame)
    # Nobody, one, one fewer; six pairs and one fewer; then eight sensors, or nobody, one and six pairs again.
    assert max(fits.values()) <= 12 * fit.ITERATIONS + 8 * fit.FEW_ITERATIONS


def test_one_pad_searches_in_a_round_and_replays_alone_agree() -> None:
    names = ["one", "two", "three"]
    made = {name: ready(name) for name in names}
    turns, some = turns_of(made.values()), list(map(beside_steel, frames(70)))
    recorded: dict[str, list[tuple[Frame, ContactMessage]]] = {name: [] for name in names}
    searches = []
    for frame in some:
        for name in names:
            own = turns.allowed(name, frame)
            message = made[name].process(own)
            turns.told(name, made[name].search)
            searches.append(made[name].search)
            recorded[name].append((frame_of(frame_message(own, name, "boot", 0)), message))
    assert all(searches[at : at + 3].count("made") <= 1 for at in range(len(searches) - 2))
    assert searches.count("due") > 20
    for name in names:
        searched = [message for frame, message in recorded[name] if frame.sequence in STEEL]
        assert all(message.health != "ok" for message in searched[2:])  # filters of samples pass two frames
        assert any(message.health == "disturbed" for message in searched)
        assert recorded[name][-1][1].health == "ok"
        again = ready(name)
        assert [essence(again.process(frame)) for frame, _ in recorded[name]] == [
            essence(message) for _, message in recorded[name]
        ]


def test_packed_frame_of_a_board_is_complete_and_may_wait() -> None:
    readings = np.arange(16, dtype="<i2").tobytes()
    packed = WireFrame(0, 7, 5000, 6000, (3, 0b1111, 0b1011, readings), 25.0, run=2)
    waiting = packed.without_search()
    assert (packed.may_search, waiting.may_search) == (True, False)
    for each in fields(Frame):
        if each.name != "may_search":
            assert np.array_equal(getattr(packed, each.name), getattr(waiting, each.name)), each.name
    assert waiting.packed == packed.packed
