"""What Python hands to a compiled pad: what does not fit is refused, and a model that raises is heard."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest
from pad_frames import frames_of
from test_pipeline import config_of, pipeline_of

from fmfts.bus.encoding import decode_contact, encode
from fmfts.common.record import Record
from fmfts.contact import ContactModel, _contact
from fmfts.contact.inference import Inference, NetworkInference
from fmfts.pipeline import _pad
from fmfts.pipeline.encoded import EncodedMessage
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.words import Words, words_of
from fmfts.pose.hand import Hand
from fmfts.pose.sighting import Sighting
from fmfts.sensor import Frame
from fmfts_simulation.baseline import simulated_baseline

CONFIG = config_of(5)
PAD = CONFIG.pad()
SIGHTING = Sighting.unseen(PAD).table.buffer
NO_READINGS = bytes(8 * len(PAD.sensors))


def words(**changes: Any) -> Words:
    model = ContactModel.load("default", PAD)
    return words_of(PAD, "boot", model, None, "no baseline")._replace(**changes)


def record(fields: list[tuple[str, str, int]], **values: Any) -> Record:
    made = Record(fields)
    made.fill(values)
    return made


def parts(**changes: Any) -> list[Any]:
    """The arguments of a pad without a baseline. Other changes than of a whole part are of the parameters."""
    names = ("memory", "network", "response", "words", "own", "neighbours", "hand", "errors")
    chip = PAD.chip
    parameters = {
        "sensors": len(PAD.sensors),
        "saturated_count": chip.saturated_count,
        "largest_count": chip.largest_count,
        "step_t": chip.step_t,
        "period_us": 4545.0,
    } | {name: value for name, value in changes.items() if name not in names}
    whole: dict[str, Any] = {
        "memory": record(_pad.MEMORY).buffer,
        "network": None,
        "response": None,
        "words": words(),
        "own": Sighting.unseen(PAD).table.buffer,
        "neighbours": (),
        "hand": None,
        "errors": None,
    } | {name: value for name, value in changes.items() if name in names}
    return [record(_pad.PARAMETERS, **parameters).buffer, *whole.values()]


def misaligned(size: int) -> memoryview:
    return memoryview(bytearray(size + 1))[1:]


MEMORY_BYTES = record(_pad.MEMORY).buffer.nbytes
UNFIT: dict[str, tuple[Callable[[], list[Any]], str]] = {
    "a memory of another size": (lambda: parts(memory=np.zeros(3)), f"memory: 24 bytes, {MEMORY_BYTES} expected"),
    "a memory at an odd address": (lambda: parts(memory=misaligned(MEMORY_BYTES)), "odd address"),
    "no sensor": (lambda: parts(sensors=0), "1 to 16 sensors"),
    "too many sensors": (lambda: parts(sensors=17), "1 to 16 sensors"),
    "sensors that are no number": (lambda: parts(sensors=np.nan), "1 to 16 sensors"),
    "a model that is missing": (lambda: parts(has_model=1.0), "none is given"),
    "a network of another size": (lambda: parts(network=b"1234"), "not a network"),
    "a network without outputs": (lambda: parts(network=np.zeros(3, np.float32)), "not a network"),
    "own magnets of another number": (lambda: parts(own=np.zeros(3)), "sighting: 24 bytes"),
    "a neighbour with other magnets": (lambda: parts(neighbours=((SIGHTING, 2),)), "sighting: 424 bytes"),
    "a neighbour without a magnet": (lambda: parts(neighbours=((SIGHTING, 0),)), "one magnet each"),
    "too many neighbours": (lambda: parts(neighbours=((SIGHTING, 1),) * 9), "9 neighbours, 8 at most"),
    "too many magnets": (lambda: parts(neighbours=((SIGHTING, 1), (SIGHTING, 8))), "8 together at most"),
    "neighbours that the parameters lack": (lambda: parts(neighbours=((SIGHTING, 1),)), "other neighbours"),
    "a hand of another pad": (lambda: parts(hand=Hand(9).table.buffer), "hand: 448 bytes"),
    "a hand at an odd address": (lambda: parts(hand=misaligned(8 * 74)), "odd address"),
    "errors of another pad": (lambda: parts(errors=np.zeros(8 * 9 * 5)), "errors: 2880 bytes"),
    "errors at an odd address": (lambda: parts(errors=misaligned(8 * 8 * 12)), "odd address"),
    "a long name": (lambda: parts(words=words(pad="x" * 3000)), "more than 2048 bytes"),
    "a name with a zero": (lambda: parts(words=words(pad="x\0y")), "null character"),
}


@pytest.mark.parametrize(("made", "why"), UNFIT.values(), ids=UNFIT)
def test_parts_that_do_not_fit_each_other_are_refused(made: Callable[[], list[Any]], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        _pad.Pad(*made())


def test_pad_that_was_refused_refuses_every_call() -> None:
    pad = _pad.Pad.__new__(_pad.Pad)
    calls: list[Callable[[], object]] = [
        lambda: pad.judge(0, 0, 0, NO_READINGS, 0, 0, 0, 0.0),
        lambda: pad.early(0, 0, 0, 0, 0, 0),
        lambda: pad.absent("lost", ""),
        lambda: pad.begin(bytearray(8), b"topic", 0, 0),
        pad.missing,
    ]
    for call in calls:
        with pytest.raises(ValueError, match="failed to initialise"):
            call()
    assert (pad.last, pad.end(), pad.last_ns()) == (None, None, 0)


def test_each_pad_is_made_once() -> None:
    pad = _pad.Pad(*parts())
    with pytest.raises(TypeError, match="only once"):
        pad.__init__(*parts())  # type: ignore[misc]


def test_frame_of_another_shape_or_time_is_refused() -> None:
    pad = _pad.Pad(*parts())
    for arguments, why in (
        ((5, 15, 15, NO_READINGS[1:], 1, 1, 1, 0.0), "31 bytes, 32 expected"),
        ((32, 15, 15, NO_READINGS, 1, 1, 1, 0.0), "gain code 32"),
        ((5, 15, 15, NO_READINGS, -1, 1, 1, 0.0), "no board counts"),
        ((5, 15, 15, NO_READINGS, 1, -1, 1, 0.0), "no board counts"),
        ((5, 15, 15, NO_READINGS, 1, 2**60, 1, 0.0), "no board counts"),
        ((5, 15, 15, NO_READINGS, 1, 1, 2**63 - 1, 0.0), "no board counts"),
    ):
        with pytest.raises(ValueError, match=why):
            pad.judge(*arguments)
    assert pad.early(99, 5, 1, 1, 1, 1) is pad.early(-1, 5, 1, 1, 1, 1) is None
    assert pad.last is None


def test_parameters_that_no_longer_fit_are_refused_with_the_next_frame() -> None:
    parameters = record(_pad.PARAMETERS, sensors=len(PAD.sensors))
    pad = _pad.Pad(parameters.buffer, *parts()[1:])
    parameters.put("neighbours", 1.0)
    with pytest.raises(ValueError, match="other neighbours"):
        pad.judge(5, 15, 15, NO_READINGS, 1, 1, 1, 0.0)


def test_errors_of_a_pad_that_has_other_sensors_now_are_refused() -> None:
    parameters = record(_pad.PARAMETERS, sensors=len(PAD.sensors))
    pad = _pad.Pad(parameters.buffer, *parts(errors=np.zeros(8 * 3 * len(PAD.sensors)))[1:])
    parameters.put("sensors", len(PAD.sensors) + 1.0)
    with pytest.raises(ValueError, match="other sensors"):
        pad.judge(5, 15, 15, NO_READINGS, 1, 1, 1, 0.0)


def test_message_without_an_estimate_is_as_msgspec_writes_it() -> None:
    pad = _pad.Pad(*parts())
    for number, reason in enumerate(("", "the port '/dev/tty°' is gone", "x" * 5000), 1):
        content = pad.absent("disconnected", reason)
        message = decode_contact(content)
        assert encode(message) == content
        assert (message.seq, message.health, message.sensors_ok, message.pad) == (number, "disconnected", 0, PAD.name)
        assert message.reason == reason[:2047]
        assert pad.last == ("disconnected", None, False, False, message.t_sample_ns, message.t_publish_ns)
    with pytest.raises(ValueError, match="no health 'fine'"):
        pad.absent("fine", "")


class InPython(Inference):
    """The same network, which C does not know. failing: what a run raises, after `whole` others."""

    by = "Python"

    def __init__(self, network: bytes, outputs: int) -> None:
        super().__init__(outputs)
        self.failing: BaseException | None = None
        self.whole = 0
        self.answers = True
        self._network = network

    def run(self) -> None:
        self.whole -= 1
        if self.failing is not None and self.whole < 0:
            raise self.failing
        _contact.infer(self._network, self.pose, self.contact, self.jacobian)
        if not self.answers:
            self.contact[2] = np.inf


def pipelines() -> tuple[PadPipeline, PadPipeline, InPython]:
    """The same pad twice: with its network in C, and in Python."""
    in_c, in_python = (pipeline_of(CONFIG, simulated_baseline(CONFIG)) for _ in range(2))
    known = in_c.model.inference
    assert isinstance(known, NetworkInference)
    model = InPython(known.network, len(known.contact))
    in_python.model.inference = model
    in_python.use(simulated_baseline(CONFIG))
    return in_c, in_python, model


def essence(answer: EncodedMessage) -> dict[str, Any]:
    message = msgspec.to_builtins(answer.message)
    return {name: value for name, value in message.items() if name not in ("t_publish_ns", "utc_ns")}


def frames(count: int) -> list[Frame]:
    return list(frames_of(CONFIG, count / 220))


def test_python_model_gives_the_same_answers() -> None:
    in_c, in_python, _ = pipelines()
    for frame in frames(300):
        assert essence(in_c.answer(frame)) == essence(in_python.answer(frame))


def test_error_of_a_model_is_raised_and_its_frame_changes_nothing() -> None:
    in_c, in_python, model = pipelines()
    for number, frame in enumerate(frames(120)):
        if number in (50, 51, 100):
            model.failing = KeyError("the model is odd")
            with pytest.raises(KeyError, match="is odd"):
                in_python.answer(frame)
            model.failing = None
        if number == 70:
            model.answers = False
            with pytest.raises(ArithmeticError, match="not finite"):
                in_python.answer(frame)
            model.answers = True
        assert essence(in_c.answer(frame)) == essence(in_python.answer(frame))


def test_error_of_any_run_of_a_model_changes_nothing() -> None:
    """The last run of a frame is that of `now`: an error there kept the frame in the memory, and no message told it."""
    in_c, in_python, model = pipelines()
    for number, frame in enumerate(frames(120)):
        raised = 0
        model.failing = KeyError("the model is odd") if number >= 100 else None
        answer: EncodedMessage | None = None
        while answer is None:
            model.whole = raised
            try:
                answer = in_python.answer(frame)
            except KeyError:
                raised += 1
        assert essence(in_c.answer(frame)) == essence(answer)
        assert raised > 1 or number < 100
