"""What is in dist/, installed into clean environments of every Python, and the demo from there: `make test-dist`.

In an empty folder, without the repository. Also the source archive, built if no wheel fits, extras, and the client
alone. Prints how large an installation is, by package, for docs/installing.md.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from drills.versions import Project, find_uv_bin, uv  # noqa: E402

DIST = ROOT / "dist"
DEMO_S = 10
# The summary that ends a demo: every frame arrived, at the pad's 220 Hz, and all were healthy.
SEEN = re.compile(r"pad (?:demo|array): (\d+) messages; .* ok ")
LEAST_MESSAGES = 220  # one second of frames: a busy computer starts the daemon late
LARGEST_LISTED = 8
# A source from a package, with a chip that it does not support.
SKIN = '[[pad]]\nname = "skin"\n[pad.source]\ntype = "anyskin"\nport = "/dev/null"\nchip = "hmc5983"\n'
SIMULATED = '[[pad]]\nname = "pad"\n[pad.source]\ntype = "simulated"\n'
# A verb that cannot use them says so if the extra is installed.
MISUSED = {
    "calibrate": (["calibrate", "x.csv", "-o", "x.onnx", "--hidden", "1"], "--hidden is 1: from 2 to 64"),
    "magnet": (["probe", "--magnet", "--config", "simulated.toml"], "nobody can hold a magnet above it"),
    "collect": (["collect", "--weigh-g", "100"], "expected 2 arguments"),
    "fleet": (["view", "--robot", "arm"], "give NAME=ENDPOINT"),
    "foxglove": (["view", "--foxglove", "--host", "0.0.0.0"], "serves this machine alone"),
    "page": (["view", "--port", "99999"], "give 0 to 65535"),
    "recording": (["record", "--seconds", "0", "x.mcap"], "must be more than 0 seconds"),
    "report": (["report", "x.mcap", "--show", "y.mcap"], "writes nothing: leave x.mcap out"),
    "simulation": (["demo", "--seconds", "0"], "must be more than 0 seconds"),
    "skin": (["check-config", "--config", "skin.toml"], "a streamed chip belongs to an AnySkin board"),
}
# For a verb without its package, or a wrong call; and for a package's file, which is an error either way.
LACKING, USAGE, CONFIG = 72, 2, 78


@contextmanager
def environment(python: str, *words: str | Path) -> Iterator[Path]:
    """A new environment with what `uv pip install` makes of `words`; its folder is deleted afterwards."""
    with tempfile.TemporaryDirectory(prefix="fmfts-clean-") as folder:
        uv("venv", "--python", python, f"{folder}/venv")
        uv("pip", "install", "--python", f"{folder}/venv", *words)
        yield Path(folder)


def require(condition: object, what: str) -> None:
    if not condition:
        raise SystemExit(f"test-dist: {what}")


def built(pattern: str) -> Path:
    found = sorted(DIST.glob(pattern))
    require(len(found) == 1, f"dist/ has {len(found)} files {pattern}: run `make dist`")
    return found[0]


def clean_variables() -> dict[str, str]:
    """Without any variable that refers to the repository."""
    return {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "FMFTS", "VIRTUAL_ENV"))
    }


def demos_run(folder: Path) -> str:
    return " and ".join(f"{demo_runs(folder, pad)} messages of the {pad} pad" for pad in ("standard", "array"))


def demo_runs(folder: Path, pad: str) -> int:
    """How many messages the demo showed in DEMO_S seconds; it must end with 0."""
    command = [folder / "venv/bin/fmfts-daemon", "demo", "--pad", pad, "--seconds", str(DEMO_S)]
    ended = subprocess.run(
        command,
        cwd=folder,
        env=clean_variables(),
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    require(ended.returncode == 0, f"the demo ended with {ended.returncode}:\n{ended.stdout[-2000:]}{ended.stderr}")
    seen = SEEN.search(ended.stdout)
    require(seen is not None and int(seen[1]) >= LEAST_MESSAGES, f"the demo said:\n{ended.stdout[-2000:]}")
    assert seen is not None
    return int(seen[1])


def is_compiled(folder: Path) -> bool:
    command = [folder / "venv/bin/python", "-c", "import fmfts.pose, fmfts.pipeline._pad"]
    return subprocess.run(command, cwd=folder, env=clean_variables(), capture_output=True).returncode == 0


def sizes(folder: Path) -> dict[str, float]:
    """Megabytes of each folder of the environment's packages, the largest first."""
    (packages,) = folder.glob("venv/lib/python3*/site-packages")
    found: dict[str, float] = {}
    for path in packages.iterdir():
        name = re.sub(r"\.libs$|-[\d.]+\.dist-info$", "", path.name)
        files = path.rglob("*") if path.is_dir() else [path]
        found[name] = found.get(name, 0.0) + sum(each.stat().st_size for each in files if each.is_file()) / 1e6
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def print_sizes(label: str, folder: Path) -> None:
    found = sizes(folder)
    listed = ", ".join(f"{name} {size:.0f}" for name, size in list(found.items())[:LARGEST_LISTED])
    print(f"{label}: {sum(found.values()):.0f} MB ({listed})", flush=True)


def tried_with(python: str) -> None:
    client, wheel = built("fmfts_client-*.whl"), built(f"fmfts-*_{os.uname().machine}.whl")
    with environment(python, client, wheel, built("fmfts_simulation-*.whl")) as folder:
        require(is_compiled(folder), f"Python {python}: the wheel's compiled parts do not load")
        print(f"Python {python}: wheel, demo, {demos_run(folder)}", flush=True)


def tried_from_source(python: str) -> None:
    archives = (built(f"{package}-*.tar.gz") for package in ("fmfts_client", "fmfts", "fmfts_simulation"))
    with environment(python, *archives) as folder:
        require(is_compiled(folder), f"Python {python}: the source archive gave no compiled parts")
        print(f"Python {python}: source archive, demo, {demos_run(folder)}", flush=True)


def extras_add_their_verbs(python: str) -> None:
    """Each extra's purpose, and without the extra a refusal that says how to install it."""
    client, wheel = built("fmfts_client-*.whl"), built(f"fmfts-*_{os.uname().machine}.whl")
    with environment(python, client, wheel) as folder:
        for extra, (words, _) in MISUSED.items():
            ended = said_by(folder, *words)
            require(
                ended.returncode in (LACKING, CONFIG) and f"'fmfts[{extra}]'" in ended.stderr,
                f"without {extra}:\n{ended}",
            )
    for extra, (words, said) in MISUSED.items():
        with environment(python, "--find-links", DIST, client, f"fmfts[{extra}] @ file://{wheel}") as folder:
            ended = said_by(folder, *words)
            require(ended.returncode in (USAGE, CONFIG) and said in ended.stderr, f"with {extra}:\n{ended}")
            print(f"Python {python}: {extra}, installed and not installed", flush=True)


def said_by(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [folder / "venv/bin/fmfts-daemon", *words]
    (folder / "skin.toml").write_text(SKIN)
    (folder / "simulated.toml").write_text(SIMULATED)
    return subprocess.run(command, cwd=folder, env=clean_variables(), capture_output=True, text=True, check=False)


def refused_without_a_compiler(python: str) -> None:
    with environment(python, built("fmfts_client-*.tar.gz")) as folder:
        command = [find_uv_bin(), "pip", "install", "--python", folder / "venv", "--no-deps", built("fmfts-*.tar.gz")]
        variables = clean_variables() | {"CC": "/missing/gcc"}
        ended = subprocess.run(command, env=variables, capture_output=True, text=True, check=False)
        require(
            ended.returncode != 0 and "install a C compiler" in ended.stderr, f"without a compiler:\n{ended.stderr}"
        )
        print(f"Python {python}: without a compiler, refused with what to install", flush=True)


def client_alone(python: str) -> None:
    with environment(python, built("fmfts_client-*.whl")) as folder:
        code = "import fmfts_client, importlib.util; print(importlib.util.find_spec('fmfts'))"
        said = subprocess.run([folder / "venv/bin/python", "-W", "error", "-c", code], capture_output=True, text=True)
        require(said.stdout == "None\n", f"Python {python}: the client alone: {said.stdout}{said.stderr}")
        print_sizes(f"Python {python}: the client alone", folder)


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--python", action="append", default=[], help="only this one, such as 3.12; may be repeated")
    options.add_argument("--sizes", action="store_true", help="how large each extra is, too")
    chosen = options.parse_args()
    require(shutil.which("gcc"), "gcc is needed for the source archive")
    (client_pythons, _), (pythons, lacking) = Project(ROOT / "clients/python").pythons(), Project(ROOT).pythons()
    wanted = [python for python in pythons if not chosen.python or python in chosen.python]
    for python in wanted:
        tried_with(python)
    tried_from_source(wanted[-1])
    extras_add_their_verbs(wanted[-1])
    refused_without_a_compiler(wanted[-1])
    client_alone(client_pythons[0])
    if chosen.sizes:
        client, wheel = built("fmfts_client-*.whl"), built(f"fmfts-*_{os.uname().machine}.whl")
        for extra in ("", *Project(ROOT).described["project"]["optional-dependencies"]):
            if extra not in ("study", "test", "versions", "dist"):
                words = ["--find-links", DIST, client, f"fmfts[{extra}] @ file://{wheel}" if extra else wheel]
                with environment(wanted[0], *words) as folder:
                    print_sizes(f"fmfts[{extra}]" if extra else "fmfts", folder)
    for python in lacking:
        print(f"Python {python}: not tried, for it is not on PATH, and uv cannot fetch it here")
    return 0


if __name__ == "__main__":
    sys.exit(main())
