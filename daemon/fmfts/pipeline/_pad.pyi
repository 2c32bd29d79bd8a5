"""One pad's frames judged in C; frame.h says how."""

from typing import Any, Literal

from numpy.typing import NDArray
from typing_extensions import Buffer

from fmfts.bus.messages import Health
from fmfts.contact._contact import Evaluated
from fmfts.pipeline.words import Words

Numbers = NDArray[Any]
Field = tuple[str, str, int]  # name, type as NumPy names it, and how many; 0: one, which is no array

PARAMETERS: list[Field]  # of fmfts_parameters
MEMORY: list[Field]  # of fmfts_memory
FOLLOWED: list[Field]  # of fmfts_followed_memory
FOUND: list[Field]  # of fmfts_frame_found
MOUNTED: list[Field]  # of fmfts_mounted_parameters
FELT: int  # magnets of neighbouring pads, at most
STATE: int  # numbers of a state, and of a step
STEP: int
TRUSTED_FRAMES: int  # FMFTS_TRUSTED_FRAMES of pose/tracking.h

# health, contact, over_range, t_sample_ns, t_publish_ns of a message.
Gist = tuple[Health, bool | None, bool, bool, int, int]
# See encoded.py.
Passed = tuple[int, int, int, int, int, int, int, bytes, tuple[bytes, ...], list[float]]

def distance(change: Numbers, covariance: Numbers, /) -> tuple[float, float]:
    """How far (m) a change (5,) of pose moved the magnet's centre, and the deviation along that direction.

    covariance (5, 5): of the change. Without a direction, the largest deviation of the three.
    """

def drawn(parameters: Buffer, state: Numbers, covariance: Numbers, pose: Numbers, spread: Numbers, /) -> None:
    """Fills pose (6,) and spread (6, 6) with the pose that the drawing's pad would have: NominalFrame of drawn.py.

    state (15,), covariance (14, 14): of the mounted pad.
    """

def left_behind(parameters: Buffer, memory: Buffer, left: Numbers, elapsed_s: float, /) -> None:
    """Notes the load of the memory's state. Fills left (5, 5) with the covariance of what earlier loads have left."""

def track_field(
    parameters: Buffer,
    memory: Buffer,
    field_t: Buffer,
    deviation_t: Buffer,
    lasting_t: Buffer,
    covariance: Buffer,
    elapsed_s: float,
    temperature_c: float,
    errors: Buffer | None,
    /,
) -> tuple[str, str, int, bool, float, float]:
    """The tracker alone, on the magnet's field (3N) in sensor axes. lasting_t (3N): the part of the deviations that
    averaging does not reduce. Writes the covariance (14, 14) of the memory's `state`.

    Returns health, reason, mask of the sensors used, whether there is an estimate, χ², residual_t.
    """

class Pad:
    """Judges frames with what it was given, which it holds as long as it lives; the memory is a record of MEMORY, which
    Python may write to between two calls. ValueError where the parts do not fit each other.

    network: of a contact model, as in network.h; None without a model. response: as in refine.h. own: the doubles of
    the pad's own Sighting; neighbours: the same of those that it feels, each with its number of magnets.
    hand: the doubles of its Hand; None: it is on no hand that moves. errors: FieldErrors.table of its baseline.
    """

    def __init__(
        self,
        parameters: Buffer,
        memory: Buffer,
        network: Buffer | Evaluated | None,
        response: Buffer | None,
        words: Words,
        own: Buffer,
        neighbours: tuple[tuple[Buffer, int], ...],
        hand: Buffer | None = None,
        errors: Buffer | None = None,
        /,
    ) -> None: ...
    @property
    def last(self) -> Gist | None:
        """What the last message says; None before the first."""

    def judge(
        self,
        gain_code: int,
        valid: int,
        fresh: int,
        readings: bytes,
        sequence: int,
        time_us: int,
        host_ns: int,
        temperature_c: float,
        /,
    ) -> bytes:
        """The encoded message of a frame. gain_code … readings: Frame.packed. temperature_c: NaN if unknown.

        ArithmeticError, and the frame changes nothing, if a number of its message is not finite. What `network` raises.
        """

    def early(self, sensor: int, gain_code: int, x: int, y: int, z: int, time_us: int, /) -> bytes | None:
        """The message of a sample that came before its frame: the last one with another `now`. None: it has no news."""

    def absent(self, health: str, reason: str, /) -> bytes:
        """A message without an estimate, while no frame can be used. Whoever touches the pad may be gone."""

    def missing(self) -> dict[int, str]:
        """Sensor (from 0) → why the last frame could not use it."""

    def tell(self, health: str, reason: str, temperature_c: float, ahead: Buffer | None, /) -> tuple[bytes, bool]:
        """The message of what the record of FOUND says of a frame, and whether it has a `now`. ahead: such a record of
        the finger that the newest samples of an untouched frame show; None: they show none.

        ArithmeticError if a number of its message is not finite.
        """

    def align(
        self,
        gain_code: int,
        valid: int,
        fresh: int,
        readings: bytes,
        sequence: int,
        time_us: int,
        host_ns: int,
        temperature_c: float,
        field_t: Numbers,
        noise_share: Numbers,
        bend_t: Numbers,
        repeats: Numbers,
        newest_t: Numbers,
        /,
    ) -> tuple[int, bool, bool, int, bool]:
        """The samples of a frame of several magnets at one instant. The arguments up to temperature_c are those of
        `judge`; the others are filled as Aligned has them, and with the newest samples, NaN where the frame has none.

        Returns time_us, is_old, began_anew and leap_us of Aligned, and whether every axis has a field.
        """

    def bind(self, mounted: Buffer, found: Buffer, calm: tuple[Buffer | Numbers, ...], /) -> None:
        """Take what `tell` needs, records of MOUNTED and FOUND, and hold it; and what `calm` and `follow_early` need,
        or (): model, search and work of FieldModel and Fitter; FingersEstimator's calm_limits and rest_samples; of the
        magnets at rest their positions, axes and variances, and by how much each sample must change until a finger is
        looked for in it; a record of FOLLOWED."""

    def calm(
        self,
        count: int,
        places: Numbers,
        ids: Numbers,
        around_t: Numbers,
        recent_t: Numbers,
        factors: Numbers,
        temperature_c: float,
        /,
    ) -> tuple[bytes, bool] | tuple[bool, bool, float, int]:
        """The message of the aligned frame, if the last one's fingers explain it, and whether it has a `now`. count,
        places, ids: of CounterMemory; around_t, recent_t (written), factors: of since_rest.py.

        Else what Python needs for a closer look: whether the field jumped; whether the record of FOUND has a fit; its
        χ² and flags.
        """

    def follow_early(
        self, sensor: int, gain_code: int, x: int, y: int, z: int, time_us: int, ahead: Buffer | None, /
    ) -> bytes | Literal[True] | None:
        """The last message with what a sample says that came before its frame; None: it has no news; True: nothing
        pressed in the last frame, and now a finger may. ahead: as of `tell`, with this sample."""

    def begin(self, clock: Buffer, topic: bytes, pad_index: int, overdue_ns: int, /) -> None:
        """Until `end`, a Loop judges the frames, whatever their health.

        clock: `DeviceClock.line`. topic: of the messages on the bus. overdue_ns: older frames are left out.
        """

    def end(self) -> Passed | None:
        """What was handled since `begin`; None if there was no message."""

    def last_ns(self) -> int:
        """When the last frame since `begin` arrived (host clock, ns); 0 if there was none."""

class Loop:
    """Waits for bytes, and lets pads judge the frames in them: runtime/fast_loop.py."""

    def __init__(
        self, epoll: int, send: int, socket: int, in_time: tuple[int, int], behind: tuple[int, int], /
    ) -> None: ...
    def begin(self, descriptor: int, unread: bytes, pads: tuple[Pad, ...], /) -> None: ...
    def end(self, descriptor: int, /) -> tuple[bytes, int, tuple[int, int, int], int] | None: ...
    def is_behind(self) -> bool: ...
    def take(self, descriptor: int, data: bytes, arrival_ns: int, /) -> bool: ...
    def wait(self, until_ns: int, /) -> list[int]: ...
