"""Make the contact model that ships, with a report of how good it is: the same file every time.

    python -m fmfts.calibrate.default_model [CALIBRATION.csv [OUTPUT.onnx]]

It is `fmfts-daemon calibrate` for the standard pad, with the size that k-fold selection chose (docs/calibration.md).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from fmfts.calibrate.dataset import read_calibration_set
from fmfts.calibrate.training import Options, calibrate
from fmfts.contact.model import DEFAULT_PATH

CALIBRATION = Path("tests/data/calibration_1.23T.csv")
HIDDEN = 24


def main(arguments: list[str]) -> int:
    source = Path(arguments[0]) if arguments else CALIBRATION
    target = Path(arguments[1]) if len(arguments) > 1 else DEFAULT_PATH
    made = calibrate(str(source), read_calibration_set(source), Options(hidden=HIDDEN), print)
    target.write_bytes(made.model)
    target.with_suffix(".json").write_text(json.dumps(made.report, indent=1) + "\n")
    print(f"{target}: {made.report['model']}, {len(made.model)} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
