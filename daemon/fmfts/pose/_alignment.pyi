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
    stopped_us: float,
    longest_gap_us: float,
    old_us: float,
    gap_share: float,
    unseen_share: float,
    jump_t: float,
    most_without_news: int,
    without_news: int,
    has_time: bool,
    frame_us: int,
    /,
) -> tuple[int, bool, bool, int]: ...
