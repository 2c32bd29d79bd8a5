"""The emulated magnetometers that have registers; mlx90393.py has one with commands, chips.py the HMC5983.

Pure Python without dependencies, for any carrier of transfers.
"""

from __future__ import annotations

try:
    from emulator.lis3mdl import Lis3mdl
    from emulator.memsic import Mmc5603nj, Mmc5983ma
    from emulator.qst import Qmc5883l, Qmc5883p
except ImportError:  # run by a Python that has this folder on its path, and not the one above
    from lis3mdl import Lis3mdl  # type: ignore[no-redef]
    from memsic import Mmc5603nj, Mmc5983ma  # type: ignore[no-redef]
    from qst import Qmc5883l, Qmc5883p  # type: ignore[no-redef]

__all__ = ["Lis3mdl", "Mmc5603nj", "Mmc5983ma", "Qmc5883l", "Qmc5883p"]
