"""`make sizes`: reports modules that are longer than a reader likes. It never fails: how to split is a judgement."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("daemon/fmfts", "lab", "extras", "clients", "firmware")
SUFFIXES = {".py", ".c", ".h", ".pyi"}
LONGEST = 250
DEPTHS = {"daemon": 3, "extras": 2}  # folders that belong to a room


def sizes() -> dict[Path, int]:
    """Lines of each module, the longest first."""
    paths = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.suffix in SUFFIXES]
    lines = {path.relative_to(ROOT): len(path.read_text().splitlines()) for path in paths if "build" not in path.parts}
    return dict(sorted(lines.items(), key=lambda item: -item[1]))


def main() -> None:
    found = sizes()
    for path, lines in found.items():
        if lines > LONGEST:
            print(f"{lines:5} {path}")
    rooms: Counter[str] = Counter()
    for path, lines in found.items():
        rooms["/".join(path.parts[: DEPTHS.get(path.parts[0], 1)])] += lines
    print(f"\n{'lines':>5} room")
    for room, lines in rooms.most_common():
        print(f"{lines:5} {room}")


if __name__ == "__main__":
    main()
