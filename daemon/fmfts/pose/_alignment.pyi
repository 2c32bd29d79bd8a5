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
def see(
    turn: NDArray[Any],
    place: NDArray[Any],
    sighting: memoryview,
    time_ns: float,
    rest: NDArray[Any],
    now: NDArray[Any],
    covariance: NDArray[Any],
    /,
) -> None: ...
def change_beside(
    places: NDArray[Any],
    directions: NDArray[Any],
    magnets: NDArray[Any],
    rest: NDArray[Any],
    now: NDArray[Any],
    rest_error: NDArray[Any],
    covariance: NDArray[Any],
    placement_m: float,
    rest_t: NDArray[Any],
    change_t: NDArray[Any],
    covariance_t2: NDArray[Any],
    /,
) -> None: ...
def leap_us(
    last_us: int, stood_ns: int, stood_sequence: int, frame_us: int, host_ns: int, sequence: int, period_us: float, /
) -> int: ...

JUMP_T: float
LONGEST_GAP_US: float
VAGUE_M: float
SPEED_M_PER_S: float
TURN_RAD_PER_S: float
REACH_M: float
REACH_RAD: float
MOMENT_DEVIATION: float
