"""Which room of the house may import which: no arrow up, no circle. docs/architecture.md draws the same."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import fmfts

PACKAGE = Path(fmfts.__file__).parent
ROOT = Path(__file__).parents[2]
EXTRAS = sorted(path.parent for path in ROOT.glob("extras/*/pyproject.toml"))
# Rooms that a package of extras/ may use: all but those of the running daemon, and the shared part of the verbs.
CLOSED = {"runtime"}
OPEN_VERBS = {"fmfts.cli.verb", "fmfts.cli.feed", "fmfts.cli.elsewhere"}
OF_ALL = {"fmfts_client"}
# Whose recordings or sets the package reads, whose field it takes, and whose server it fills.
READERS = {f"fmfts_{name}": OF_ALL | {"fmfts_recording"} for name in ("collect", "foxglove", "page", "report")}
OPEN_PACKAGES = READERS | {
    "fmfts_calibrate": OF_ALL | {"fmfts_simulation"},
    "fmfts_skin": OF_ALL | {"fmfts_calibrate"},
    "fmfts_fleet": OF_ALL | {"fmfts_page"},
}
# The lowest first: each may import those before it, and none of its own floor.
FLOORS = [
    {"arithmetic", "service", "sensor/chips"},
    {"common", "pad", "sensor"},
    {"pose", "contact", "sensor/wire", "bus", "view"},
    {"baseline", "sensor/bridge", "sensor/i2c", "config"},
    {"scene", "several"},
    {"sources", "pipeline"},
    {"runtime"},
    {"cli"},
]
FLOOR_OF = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
# A library that knows no configuration file: `sources.py` and `pipeline/configured.py` give it plain values.
STAGES = {"sensor", "baseline", "pose", "contact"}
LOOSE = {"__init__", "__main__", "pad", "sources"}


def room_of(module: str) -> str:
    """fmfts.pose.solver → pose: the folder that a module stands in; a loose module is a room of its own."""
    parts = module.split(".")[1:]
    folders = [name for depth, name in enumerate(parts, 1) if PACKAGE.joinpath(*parts[:depth]).is_dir()]
    return "/".join(folders) or (parts[0] if parts else "")


@cache
def imported(path: Path) -> list[str]:
    return list(_imported(path))


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = PACKAGE.parent.joinpath(*node.module.split("."), alias.name)
                yield (
                    f"{node.module}.{alias.name}"
                    if inner.is_dir() or inner.with_suffix(".py").exists()
                    else node.module
                )


def modules() -> list[Path]:
    return sorted(
        path for path in PACKAGE.rglob("*.py") if path.stem not in ("__main__", "__init__") or path.parent != PACKAGE
    )


def extra_modules() -> list[Path]:
    return sorted(path for folder in EXTRAS for path in folder.glob("fmfts_*/**/*.py"))


def test_rooms_import_only_from_the_floors_below() -> None:
    wrong = []
    for path in modules():
        module = path.relative_to(PACKAGE)
        own = room_of("fmfts." + ".".join(module.with_suffix("").parts).removesuffix(".__init__"))
        others = {room_of(name) for name in imported(path) if name == "fmfts" or name.startswith("fmfts.")} - {own, ""}
        if above := {other for other in others if FLOOR_OF[other] >= FLOOR_OF[own]}:
            told = ", ".join(sorted(above))
            wrong.append(f"{module}: {own} imports from {told}, which stands no lower: turn the arrow, or move")
        if own.partition("/")[0] in STAGES and "config" in others:
            wrong.append(f"{module}: {own} is part of a stage: give it plain values, not the configuration")
    assert not wrong, "\n".join(wrong)


def test_robot_knows_nothing_of_the_packages_beside_it() -> None:
    """Entry points lead to them; cli/elsewhere.py names their verbs."""
    packages = {path.parent.name for folder in (ROOT / "lab", *EXTRAS) for path in folder.glob("*/py.typed")}
    assert len(packages) == len(EXTRAS) + 1
    found = [path for path in PACKAGE.rglob("*.py") if {name.partition(".")[0] for name in imported(path)} & packages]
    assert found == []


def test_extras_import_only_what_is_open_to_them() -> None:
    wrong = []
    for path in extra_modules():
        names = {name for name in imported(path) if name == "fmfts" or name.startswith("fmfts.")}
        closed = {name for name in names if room_of(name) in CLOSED}
        closed |= {name for name in names if room_of(name) == "cli" and name not in OPEN_VERBS}
        module = path.relative_to(ROOT / "extras")
        own = module.parts[1]
        if closed:
            wrong.append(f"{module} imports {', '.join(sorted(closed))}: move what it needs to where both may use it")
        others = {name.partition(".")[0] for name in imported(path)} - {own} - OPEN_PACKAGES.get(own, OF_ALL)
        wrong += [f"{module} imports {name}, another package" for name in others if name.startswith("fmfts_")]
    assert not wrong, "\n".join(wrong)


def test_few_modules_are_outside_of_rooms() -> None:
    assert {path.stem for path in PACKAGE.glob("*.py")} == LOOSE


def test_every_room_is_on_the_plan() -> None:
    rooms = {str(path.relative_to(PACKAGE)) for path in PACKAGE.rglob("*") if path.is_dir() and any(path.glob("*.py"))}
    assert rooms | {"pad", "sources"} == set(FLOOR_OF)
