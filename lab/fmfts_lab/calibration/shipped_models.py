"""Makes the contact models that ship, and their reports; the same files every time.

    python -m fmfts_lab.calibration.shipped_models CALIBRATION.csv SHEARED.csv [FOLDER]

default.onnx is `fmfts-daemon calibrate CALIBRATION.csv --sheared SHEARED.csv` for the standard pad, shear.onnx is
the same with `--shear`, with the size that k-fold selection chose (docs/calibration.md): one network, and in shear.onnx
the response to shear. `make model` makes both.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from fmfts.contact.shipped import DEFAULT_PATH
from fmfts_calibrate.dataset import read_calibration_set
from fmfts_calibrate.training import Options, calibrate

HIDDEN = 24


def main(arguments: list[str]) -> int:
    if len(arguments) not in (2, 3):
        print(__doc__, file=sys.stderr)
        return 2
    (plain, sheared), folder = arguments[:2], Path(arguments[2]) if len(arguments) > 2 else DEFAULT_PATH.parent
    normal_set, sheared_set = (read_calibration_set(Path(path)) for path in (plain, sheared))
    for name in ("default", "shear"):
        options = Options(hidden=HIDDEN, shear=name == "shear")
        one = calibrate(plain, normal_set, options, print, (sheared, sheared_set))
        target = folder / f"{name}.onnx"
        target.write_bytes(one.model)
        target.with_suffix(".json").write_text(json.dumps(one.report, indent=1) + "\n")
        print(f"{target}: {one.report['model']}, {len(one.model)} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
