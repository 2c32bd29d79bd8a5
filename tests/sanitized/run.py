"""The package's C and the C client under AddressSanitizer and UndefinedBehaviorSanitizer: `make sanitize`.

    python tests/sanitized/run.py [--short]

First, errors made on purpose must be found. Then come odd calls of every exported function, the tests that exercise the
compiled parts, and those of the C client. --short: fewer calls, and the tests that take seconds.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from sanitized.build import BUILD, ROOT, SUFFIX, build, compiled, environment, library_of, parts

UNIT = "tests/unit/test_{}.py"
SHORT = (
    "compiled_refuses", "wire_compiled", "arithmetic", "pad_arguments", "odd_memory", "bend", "touch",
    "ordinary_frames",
)  # fmt: skip
LONG = (
    "refine", "contact_network", "pose_kernel", "several_compiled", "free_poses", "valley", "every_frame", "fast_loop",
    "fast_loop_of_a_board", "frame_beside", "neighbours_in_the_loop", "missing_sensors", "early", "now", "clock",
    "memory", "tracker", "mean_residuals",
)  # fmt: skip
NET = ("tests/golden", "tests/oracle")
CLIENT = ("tests/c_client/test_decoder.py", "tests/c_client/test_connecting.py")
MISTAKES = {
    "read_behind(bytes(64))": "heap-buffer-overflow",
    "overflow(2**31 - 1)": "signed integer overflow",
    "as_index(float('nan'))": "outside the range of representable values",
}


def in_python(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *words], env=environment(), cwd=ROOT, capture_output=True, text=True, check=False
    )


def check_mistakes() -> None:
    """Ends the program unless each mistake is found, and every compiled part of the package is the instrumented one."""
    compiled([ROOT / "tests/sanitized/wrong.c"], BUILD / f"wrong{SUFFIX}")
    for mistake, report in MISTAKES.items():
        ended = in_python("-c", f"import wrong; wrong.{mistake}")
        if ended.returncode == 0 or report not in ended.stderr:
            raise SystemExit(f"the sanitizers do not find wrong.{mistake}:\n{ended.stderr}")
    for part in parts():
        ended = in_python("-c", f"import {part['name']} as part; print(part.__file__)")
        if ended.stdout.strip() != str(library_of(part)):
            raise SystemExit(f"{part['name']} is not the instrumented one: {ended.stdout}{ended.stderr}")


def run(what: str, *words: str) -> bool:
    begun = time.monotonic()
    ended = subprocess.run([sys.executable, *words], env=environment(), cwd=ROOT, check=False)
    print(f"{what}: {'passed' if ended.returncode == 0 else 'FAILED'}, {time.monotonic() - begun:.0f} s", flush=True)
    return ended.returncode == 0


def pytest(what: str, files: Sequence[str]) -> bool:
    words = ("-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", "-p", "no:cacheprovider", "-m", "not long")
    return run(what, *words, *files)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="a minute")
    options = parser.parse_args()
    begun = time.monotonic()
    build()
    check_mistakes()
    print(f"built, and errors made on purpose are found: {time.monotonic() - begun:.0f} s", flush=True)
    calls = "150" if options.short else "5000"
    good = run("odd calls", "tests/sanitized/odd_calls.py", "--calls", calls)
    good &= pytest("unit tests", [UNIT.format(name) for name in (SHORT if options.short else SHORT + LONG)])
    if not options.short:
        good &= pytest("frozen worlds and oracle", NET)
    if not options.short:  # `make test` runs these, too: the programs have sanitizers of their own
        words = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-p", "no:cacheprovider", *CLIENT]
        good &= subprocess.run(words, cwd=ROOT, check=False).returncode == 0
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
