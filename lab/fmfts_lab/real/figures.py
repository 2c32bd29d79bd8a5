"""What each public recording shows, as lines of text, and as curves of a chart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fmfts.baseline.sensitivity import matrices, relative_deviation
from fmfts.config import GeometryConfig
from fmfts.pad import Array
from fmfts_calibrate.evaluation import printed
from fmfts_lab.real.other_day import UNCLIPPED, field_presses, read, rows_of
from fmfts_lab.real.sold_sensor import SESSIONS
from fmfts_lab.real.unlabelled import (
    first_session,
    learned_from_rough,
    left_of_sessions,
    left_t,
    rms_of,
    sketches_line,
)
from fmfts_lab.real.untouched_hand import HandRows, coverage, judged, line_of
from fmfts_lab.real.waved_boards import BOARDS, apart, chi_square_per_value, file_of, turned
from fmfts_skin.calibrate.force_judge import make_routes

GAUSS_UT = 100.0
FORCE_BINS, TIMES = 8, 24
HMC_SAMPLES_HZ = 74.5
ROUGH_STARTS, ROWS_DRAWN = 20, 100
ALLOWED_UNEVEN_UT = 5.0  # drift of the rest that the model of a skin allows


@dataclass(slots=True)
class Shown:
    """A chart: curves by name, each x and y; logarithmic axes where `log`. lines: the same in words. ticks: what x = 0,
    1, 2 … stand for, if x is no number."""

    title: str
    x: str
    y: str
    curves: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)
    log: bool = False
    points: bool = False
    ticks: tuple[str, ...] = ()


def sold_sensor(folder: Path) -> Shown:
    """Forces of each session by a model of the other."""
    shown = Shown(
        "Stated deviations (dashed) follow the errors on another day", "force, N", "rms error of each direction, N"
    )
    data = read(folder)
    parts = [field_presses(data)]
    (route,) = make_routes(parts, data.clipped, data.sessions, "two sessions", shown.lines.append)
    judged = route.left_out
    shown.lines.append(printed(judged.rows()))
    size = np.linalg.norm(judged.force_n, axis=1)
    edges = np.quantile(size, np.linspace(0.0, 1.0, FORCE_BINS + 1))
    bins = np.clip(np.searchsorted(edges, size, side="right") - 1, 0, FORCE_BINS - 1)
    middle = np.array([size[bins == one].mean() for one in range(FORCE_BINS)])
    square = (judged.found.force - judged.force_n) ** 2
    for number, direction in enumerate("xyz"):
        for name, values in (("error", square), ("deviation", judged.found.variance)):
            each = [np.sqrt(values[bins == one, number].mean()) for one in range(FORCE_BINS)]
            shown.curves[f"{direction}, {name}"] = middle, np.array(each)
    return shown


def another_day(folder: Path) -> Shown:
    """Forces of each session by methods that learnt the other one, with 0, 1 and 5 presses of known force."""
    shown = Shown(
        "On another day field and pose together err least, and softening explains much of the rest",
        "known of the day",
        "rms error of the force, N",
        ticks=("the day's presses", "rest", "rest, one force", "rest, five forces"),
    )
    shown.lines += [
        "| method | day | known forces | rows | rms x, y, z (N) | within 2 deviations | beyond 5 |",
        "|-" * 7 + "|",
    ]
    each: dict[str, dict[int | None, list[float]]] = {}
    for row in rows_of(folder):
        if row.way != UNCLIPPED:
            each.setdefault(row.method, {}).setdefault(row.known, []).append(row.size_n)
        x, y, z = row.rms_n
        known = "its own" if row.known is None else str(row.known)
        shown.lines.append(
            f"| {row.method} | {row.way} | {known} | {row.rows:,} | {x:.3f}, {y:.3f}, {z:.3f} "
            f"| {row.within_2:.1%} | {row.beyond_5:.2%} |"
        )
    for method, sizes in each.items():
        mean = np.array([np.sqrt(np.mean(np.square(one))) for one in sizes.values()])
        shown.curves[method.replace("`", "")] = np.arange(float(len(mean))), mean
    return shown


def waved_boards(folder: Path) -> Shown:
    """Gains of the chips of four boards by `--turn`."""
    shown = Shown(
        "Gains of a board's chips differ by up to 6 %; one board measured twice (Plain…) agrees",
        "chip",
        "gain, % off the mean",
    )
    shown.lines += ["| board | accepted | attitudes | gains known to | χ² per value |", "|-" * 5 + "|"]
    sensitivities = []
    for board in BOARDS:
        pad, turn, found = turned(folder / file_of(board))
        sensitivities.append(found)
        gain = np.einsum("iaa->i", matrices(found.mean)) / 3.0
        shown.curves[board] = np.arange(1.0, len(gain) + 1.0), 100.0 * (gain / gain.mean() - 1.0)
        worst = 100.0 * float(relative_deviation(found.covariance).max())
        shown.lines.append(
            f"| {board} | yes | {len(turn.field_t)} | {worst:.1f} % | {chi_square_per_value(pad, turn, found):.2f} |"
        )
    gains, rotations_deg = apart(*sensitivities[:2])
    shown.lines += ["| one board | gains apart | rotations apart |", "|-" * 3 + "|"]
    shown.lines.append(f"| {BOARDS[0]} and {BOARDS[1]} | {100.0 * gains:.1f} % | {rotations_deg:.1f}° |")
    return shown


def unlabelled(folder: Path) -> Shown:
    """The fields that a geometry explains which was learned from unlabelled rows."""
    shown = Shown(
        "A geometry learned without labels explains fields of 5 to 33 mT to 0.05 mT",
        "rows with less left, %",
        "left of a value, µT rms of a row",
    )
    shown.lines += ["| what is left of a value, rms | µT | asked | |", "|-" * 4 + "|"]
    for one in left_of_sessions(folder):
        shown.lines.append(f"| {' | '.join(one.cells)} |")
        rows = np.sort(one.row_ut)[:: max(len(one.row_ut) // ROWS_DRAWN, 1)]
        shown.curves[one.session.split(",")[0]] = np.linspace(0.0, 100.0, len(rows)), rows
    return shown


def rough_sketches(folder: Path) -> Shown:
    """The same from sketches that are further off."""
    shown = Shown(
        f"From {ROUGH_STARTS} rough sketches: what the learned geometry leaves of the other 30 %",
        "sketch",
        "left of a value, µT rms",
        points=True,
    )
    beginning, later = first_session(folder)
    rough = [learned_from_rough(seed, beginning) for seed in range(ROUGH_STARTS)]
    left_ut = np.array([np.nan if one is None else 1e6 * rms_of(left_t(one, later)) for one in rough])
    shown.curves["sketches"] = np.arange(1.0, ROUGH_STARTS + 1.0), left_ut
    shown.lines += [
        "| rough sketches | right | at most, µT | called ambiguous |",
        "|-" * 4 + "|",
        sketches_line(left_ut),
    ]
    return shown


def moving_hand(folder: Path) -> Shown:
    """The unevenness of the field of four skins while a hand moves and touches nothing, and their reports."""
    shown = Shown("A hand that touches nothing changes two of its four skins by 30 µT", "row", "uneven change, µT rms")
    rotations = GeometryConfig(board="anyskin5").sensor_rotations_deg
    turn = np.exp(1j * np.radians([z for *_, z in rotations]))
    for number in (1, 2):
        fields = np.loadtxt(folder / f"leaphand_nocontact_{number}.txt")[12:, :60].reshape(-1, 4, 5, 3)
        change = fields - fields[:15].mean(axis=0)
        plane = (change[..., 0] + 1j * change[..., 1]) * turn
        uneven = np.stack([plane.real, plane.imag, change[..., 2]], axis=-1)
        uneven = uneven - uneven.mean(axis=2, keepdims=True)
        rms = np.sqrt((uneven**2).mean(axis=(2, 3)))
        each = ", ".join(f"{one:.0f}" for one in np.median(rms, axis=0))
        shown.lines.append(
            f"recording {number}: median over the rows of each skin {each} µT, largest {rms.max():.0f} µT; "
            f"a skin's rest may drift by {ALLOWED_UNEVEN_UT:g} µT"
        )
        if number == 1:
            step = max(len(rms) // 100, 1)
            for skin in range(4):
                shown.curves[f"skin {skin + 1}"] = np.arange(0.0, len(rms), step), rms[::step, skin]
    recordings = [HandRows.of(path) for path in sorted(folder.glob("leaphand_nocontact_*.txt"))]
    shown.lines += [f"{rows}, {scene}: {line_of(each)}" for scene, rows, each in judged(recordings)]
    for rows, errors in coverage(recordings):
        for name, off in zip(("left-out parts alone", "the whole covariance"), np.abs(errors), strict=True):
            shown.lines.append(
                f"{rows}, {name}: {(off < 2.0).mean():.1%} within two, {(off > 5.0).mean():.2%} beyond five"
            )
    return shown


def resting_chip(folder: Path) -> Shown:
    """Noise and drift of an HMC5883L at rest for eleven minutes."""
    shown = Shown(
        "Averaging an HMC5883L at rest helps for 1 s along z, and for 10 s along x and y",
        "averaged over, s",
        "Allan deviation, mG",
        log=True,
    )
    try:
        import h5py  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        raise SystemExit("the HMC5883L's recording is in HDF5: pip install h5py") from None
    with h5py.File(folder / "sensor_fusion/hmc5883l_compass.mat") as file:
        values = np.array(file["compassBuffer"])[1:] * 1e3
    counts = np.unique(np.geomspace(1, values.shape[1] // 6, TIMES).astype(int))
    for axis, one in zip("xyz", values, strict=True):
        deviation = allan_deviation(one, counts)
        shown.curves[axis] = counts / HMC_SAMPLES_HZ, deviation
        noise = float(np.std(np.diff(one)) / np.sqrt(2.0))
        shown.lines.append(f"{axis}: noise {noise:.2f} mG, floor {deviation.min():.3f} mG")
    return shown


def allan_deviation(values: Array, counts: Array) -> Array:
    """The Allan deviation of values (K,) over means of each of `counts`."""
    out = []
    for count in counts:
        means = values[: len(values) // count * count].reshape(-1, count).mean(axis=1)
        out.append(np.sqrt(0.5 * np.mean(np.diff(means) ** 2)))
    return np.array(out)


def four_sensors(folder: Path) -> Shown:
    """The repeatability of four sensors at unknown places, for a magnet that returns to a grid of 1 cm."""
    shown = Shown(
        "A magnet that returns to its place repeats to 20 to 33 counts, in any field",
        "field at the place, counts",
        "spread of 80 returns, counts",
        log=True,
    )
    rows = np.load(folder / "tongue_drive/tcv_1_80.npy")
    _, place = np.unique(rows[:, 12:15], axis=0, return_inverse=True)
    for sensor in range(4):
        own = rows[:, 3 * sensor : 3 * sensor + 3]
        each = [own[place == one] for one in range(place.max() + 1)]
        size = np.array([np.linalg.norm(one.mean(axis=0)) for one in each])
        spread = np.array([np.sqrt(one.var(axis=0).sum()) for one in each])
        order = np.argsort(size)
        shown.curves[f"sensor {sensor + 1}"] = size[order], spread[order]
        shown.lines.append(f"sensor {sensor + 1}: spread {100.0 * float(np.median(spread / size)):.1f} % of the field")
    shown.points = True
    return shown


RECORDINGS: dict[str, tuple[Callable[[Path], Shown], str]] = {
    "sold-sensor": (sold_sensor, SESSIONS["first"][0]),
    "another-day": (another_day, SESSIONS["second"][0]),
    "unlabelled": (unlabelled, SESSIONS["second"][0]),
    "rough-sketches": (rough_sketches, SESSIONS["first"][0]),
    "waved-boards": (waved_boards, file_of(BOARDS[0])),
    "moving-hand": (moving_hand, "leaphand_nocontact_1.txt"),
    "resting-chip": (resting_chip, "sensor_fusion/hmc5883l_compass.mat"),
    "four-sensors": (four_sensors, "tongue_drive/tcv_1_80.npy"),
}
