from typing import Any

from numpy.typing import NDArray

def push(
    fields: NDArray[Any],
    times: NDArray[Any],
    repeats: NDArray[Any],
    field: NDArray[Any],
    time: NDArray[Any],
    fresh: NDArray[Any],
    timed: NDArray[Any] | None,
    aligned: NDArray[Any],
    share: NDArray[Any],
    bend: NDArray[Any],
    repeated: NDArray[Any],
    period_us: float,
    without_news: int,
    has_time: bool,
    frame_us: int,
    /,
) -> tuple[int, bool, bool, int]: ...

# Arrays and numbers, in the order that the comments in _alignment.c give.
def see(*given: NDArray[Any] | memoryview | float) -> None: ...
def change_beside(*given: NDArray[Any] | float) -> None: ...
def leap_us(
    last_us: int, stood_ns: int, stood_sequence: int, frame_us: int, host_ns: int, sequence: int, period_us: float, /
) -> int: ...
def posture(newest: float, later_s: float, /) -> tuple[float, float, float, str]: ...

LONGEST_GAP_US: float
VAGUE_M: float
REACH_M: float
REACH_RAD: float
MOMENT_DEVIATION: float
SILENT_S: float
POSTURE_KNOWN: float
POSTURE_OUTSIDE: float
POSTURE_NO_REST: float
POSTURE_NO_JOINTS: float
POSTURE_UNTAUGHT: float
POSTURE_ANY: float
