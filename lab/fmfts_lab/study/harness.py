"""Common to every study: results that survive an interruption, a summary of facts, charts."""

from __future__ import annotations

import csv
import json
import os
import platform
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from fmfts import __version__
from fmfts.config import PadConfig
from fmfts.view.progress import progress_bar

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Value = str | int | float | bool | None
Row = dict[str, Value]
Facts = dict[str, Any]

PACKAGES = ("numpy", "scipy", "scikit-learn", "onnxruntime", "matplotlib")
POINT, ROWS_OF_POINT = "point", "rows_of_point"


@dataclass(frozen=True, slots=True)
class Request:
    """The options of a study: the pad, the folder for the files, how thorough it is, and the random seed.

    pads: all pads of the configuration that contains `pad`. chips: of the scene's study, the chips in place of models.
    controller: of the study of speed and accuracy, only what a controller acts on.
    """

    pad: PadConfig
    out: Path
    quick: bool = False
    seed: int = 1
    pads: tuple[PadConfig, ...] = ()
    chips: bool = False
    controller: bool = False


class Study:
    """One run of a study: `NAME.csv` (a row for each measurement), `NAME.json`, `NAME….png` and `.svg` in `out`.

    The same command continues an interrupted run: points whose rows are all in the CSV are not measured again. With
    other settings, or another version, it starts again.
    """

    def __init__(self, name: str, request: Request, columns: Sequence[str]) -> None:
        """OSError if `out` cannot be written."""
        self.name = name
        self.request = request
        self._columns = (POINT, ROWS_OF_POINT, *columns)
        request.out.mkdir(parents=True, exist_ok=True)
        self._csv, self._json = (request.out / f"{name}.{suffix}" for suffix in ("csv", "json"))
        self._settings: Facts = {
            "quick": request.quick,
            "seed": request.seed,
            "pad": json.loads(msgspec.json.encode(request.pad)),  # as it is read back
            "pads": json.loads(msgspec.json.encode(request.pads)),
            "columns": list(columns),
        }
        known = _read_json(self._json)
        goes_on = known.get("settings") == self._settings and known.get("versions") == versions()
        self._rows = _read_rows(self._csv, self._columns) if goes_on else {}
        self._runs = int(known["runs"]) + 1 if self._rows else 1
        self._write_csv()
        self._write_json(finished=False, facts={})

    def measure(self, points: Mapping[str, Callable[[], Iterable[Row]]]) -> list[Row]:
        """Rows of all points, in their order. A point's rows (at least one) are written as soon as it is done."""
        waiting = [point for point in points if point not in self._rows]
        with progress_bar(f"study {self.name}") as show:
            for done, point in enumerate(waiting):
                show(done / len(waiting))
                rows = list(points[point]())
                if not rows:
                    raise ValueError(f"study {self.name}: point {point!r} has no rows")
                self._rows[point] = rows
                self._append(point)
        return [row for point in points for row in self._rows[point]]

    def conclude(self, facts: Facts) -> Facts:
        """Write the summary, and return its content."""
        return self._write_json(finished=True, facts=facts)

    def draw(self, figure: Figure, suffix: str = "") -> None:
        """Write PNG and SVG. Dense artists of the figure should be `rasterized`, so that the SVG stays small."""
        for kind in ("png", "svg"):
            save(figure, self.request.out / f"{self.name}{suffix}.{kind}")

    def _append(self, point: str) -> None:
        with self._csv.open("a", newline="") as out:
            self._write_point(csv.DictWriter(out, self._columns), point)
            out.flush()

    def _write_point(self, writer: csv.DictWriter[str], point: str) -> None:
        rows = self._rows[point]
        writer.writerows({POINT: point, ROWS_OF_POINT: len(rows)} | row for row in rows)

    def _write_csv(self) -> None:
        with self._csv.open("w", newline="") as out:
            writer = csv.DictWriter(out, self._columns)
            writer.writeheader()
            for point in self._rows:
                self._write_point(writer, point)

    def _write_json(self, finished: bool, facts: Facts) -> Facts:
        whole = {
            "study": self.name,
            "finished": finished,
            "written_utc": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "runs": self._runs,
            "machine": machine(),
            "versions": versions(),
            "settings": self._settings,
        } | facts
        self._json.write_text(json.dumps(whole, indent=1) + "\n")
        return whole


def save(figure: Figure, target: Path) -> None:
    """PNG or SVG, by the suffix: the same picture for the same rows, and text that can be searched."""
    import matplotlib

    vector = target.suffix == ".svg"
    with matplotlib.rc_context({"svg.hashsalt": target.stem, "svg.fonttype": "none"}):
        figure.savefig(target, dpi=120, metadata={"Date": None} if vector else None)


def read_table(path: Path) -> list[Row]:
    """All rows of a study's CSV, or of one whose columns were thinned out."""
    with path.open(newline="") as file:
        return [{name: _value(text) for name, text in row.items()} for row in csv.DictReader(file)]


def machine() -> Facts:
    """The facts about this computer on which measured times depend."""
    return {"processor": _processor(), "cores": os.cpu_count(), "system": platform.platform()}


def versions() -> Facts:
    """The versions of the package, of Python, and of the libraries that the studies use."""
    return {"fmfts": __version__, "python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def say(line: str) -> None:
    print(line, file=sys.stderr)


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:  # not Linux
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith(("model name", "Model"))]
    return names[0] if names else platform.machine()


def _read_json(path: Path) -> Facts:
    """The content of a JSON file; empty if it does not exist, or is incomplete."""
    try:
        known = json.loads(path.read_text())
    except (FileNotFoundError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}


def _read_rows(path: Path, columns: tuple[str, ...]) -> dict[str, list[Row]]:
    """Point → its rows, for the points that are complete."""
    if not path.exists():
        return {}
    with path.open(newline="") as file:
        reader = csv.DictReader(file)
        if tuple(reader.fieldnames or ()) != columns:
            return {}
        raw = [row for row in reader if None not in row.values()]
    found = Counter(row[POINT] for row in raw)
    rows: dict[str, list[Row]] = {}
    for row in raw:
        point, wanted = row.pop(POINT), row.pop(ROWS_OF_POINT)
        if str(found[point]) == wanted:
            rows.setdefault(point, []).append({name: _value(text) for name, text in row.items()})
    return rows


def _value(text: str) -> Value:
    """The value that `csv` wrote as `text`."""
    if text in ("", "True", "False"):
        return None if text == "" else text == "True"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
