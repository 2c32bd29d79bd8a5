from typing import Any

from numpy.typing import NDArray

HEAD: list[tuple[str, str, int]]
MOST: dict[str, int]
WORK_BYTES: int
LANES: int
PANEL: int
SEARCH_HEAD: list[tuple[str, str, int]]

def predict(
    model: NDArray[Any],
    work: NDArray[Any],
    fingers: NDArray[Any],
    field: NDArray[Any],
    slope: NDArray[Any],
    by_pose: NDArray[Any],
    change: NDArray[Any],
    pressed: NDArray[Any],
    /,
) -> bool: ...
def covariance(
    model: NDArray[Any],
    work: NDArray[Any],
    fingers: NDArray[Any],
    field: NDArray[Any],
    slope: NDArray[Any],
    by_pose: NDArray[Any],
    change: NDArray[Any],
    pressed: NDArray[Any],
    variance: NDArray[Any],
    ambient: NDArray[Any],
    covariance: NDArray[Any],
    /,
) -> None: ...
def poses(
    model: NDArray[Any],
    work: NDArray[Any],
    unfelt: NDArray[Any],
    fingers: NDArray[Any],
    fingers_covariance: NDArray[Any],
    misfit: NDArray[Any],
    variance: NDArray[Any],
    foreign: NDArray[Any],
    used: NDArray[Any],
    ambient: NDArray[Any],
    change: NDArray[Any],
    position: NDArray[Any],
    axis: NDArray[Any],
    pose_variance: NDArray[Any],
    moves: NDArray[Any],
    told: NDArray[Any],
    by_finger: NDArray[Any],
    /,
) -> tuple[str | None, int, float]: ...
def free_poses(
    model: NDArray[Any],
    work: NDArray[Any],
    limits: NDArray[Any],
    start: NDArray[Any],
    field: NDArray[Any],
    variance: NDArray[Any],
    foreign: NDArray[Any],
    used: NDArray[Any],
    ambient: NDArray[Any],
    change: NDArray[Any],
    covariance: NDArray[Any],
    misfit: NDArray[Any],
    found_ambient: NDArray[Any],
    position: NDArray[Any],
    axis: NDArray[Any],
    /,
) -> tuple[str | None, int, float]: ...
def fit(
    model: NDArray[Any],
    work: NDArray[Any],
    search: NDArray[Any],
    start: NDArray[Any],
    field: NDArray[Any],
    variance: NDArray[Any],
    foreign: NDArray[Any],
    used: NDArray[Any],
    ambient: NDArray[Any],
    fingers: NDArray[Any],
    covariance: NDArray[Any],
    misfit: NDArray[Any],
    found_ambient: NDArray[Any],
    shear: NDArray[Any],
    shear_deviation: NDArray[Any],
    /,
) -> tuple[str | None, int, float]: ...
def whitener(
    model: NDArray[Any],
    work: NDArray[Any],
    fingers: NDArray[Any],
    variance: NDArray[Any],
    foreign: NDArray[Any],
    used: NDArray[Any],
    ambient: NDArray[Any],
    root: NDArray[Any],
    /,
) -> tuple[str | None, int, float]: ...
def chi2_with(
    model: NDArray[Any],
    work: NDArray[Any],
    root: NDArray[Any],
    fingers: NDArray[Any],
    field: NDArray[Any],
    used: NDArray[Any],
    /,
) -> tuple[str | None, int, float]: ...
def valley(
    model: NDArray[Any],
    work: NDArray[Any],
    search: NDArray[Any],
    fingers: NDArray[Any],
    away: NDArray[Any],
    direction: NDArray[Any],
    limits: NDArray[Any],
    field: NDArray[Any],
    variance: NDArray[Any],
    foreign: NDArray[Any],
    used: NDArray[Any],
    ambient: NDArray[Any],
    there: NDArray[Any],
    chi2: NDArray[Any],
    /,
) -> tuple[str | None, int, float]: ...
def best_single(
    search: NDArray[Any],
    work: NDArray[Any],
    room: NDArray[Any],
    root: NDArray[Any],
    field: NDArray[Any],
    used: NDArray[Any],
    finger: NDArray[Any],
    /,
) -> tuple[str | None, int, float]: ...
def another(
    search: NDArray[Any],
    work: NDArray[Any],
    room: NDArray[Any],
    root: NDArray[Any],
    field: NDArray[Any],
    used: NDArray[Any],
    predicted: NDArray[Any],
    slope: NDArray[Any],
    found: NDArray[Any],
    /,
) -> tuple[str | None, int, float]: ...
def best_pairs(
    search: NDArray[Any],
    work: NDArray[Any],
    room: NDArray[Any],
    root: NDArray[Any],
    field: NDArray[Any],
    used: NDArray[Any],
    starts: NDArray[Any],
    /,
) -> tuple[str | None, int, float]: ...
