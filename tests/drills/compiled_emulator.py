"""The emulated chips compiled to machine code by mypyc from the same sources, which halves the time of a day.

mypyc comes with mypy. Without it, or without a C compiler, the same Python runs as it is.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

SOURCES = (
    "magnetometer",
    "register_chip",
    "lis3mdl",
    "memsic_film",
    "memsic",
    "qst",
    "magnetometers",
    "mlx90393",
    "chips",
)
EMULATOR = Path(__file__).parents[1] / "emulator"


def compile_into(folder: Path) -> bool:
    """Whether `import emulator.chips` finds compiled chips from now on; call it before the first such import."""
    copies = folder / "emulator"
    copies.mkdir()
    for name in SOURCES:
        shutil.copy(EMULATOR / f"{name}.py", copies)
    made = subprocess.run(
        [sys.executable, "-m", "mypyc", "--ignore-missing-imports", "--namespace-packages", "--explicit-package-bases"]
        + [f"emulator/{name}.py" for name in SOURCES],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    if made.returncode:
        print("the emulated chips were not compiled, and run as Python:", made.stdout[-500:], made.stderr[-500:])
        return False
    for name in SOURCES:
        (copies / f"{name}.py").unlink()
    sys.path.insert(0, str(folder))  # the other modules of `emulator` are found where they were
    return True
