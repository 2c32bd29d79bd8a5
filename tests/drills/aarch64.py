"""The wheel for aarch64, cross-built, and the tests of its C and of plain Python under qemu-user: `make aarch64`.

onnxruntime's library ends with a segmentation fault while qemu 7.2 (Debian 12) loads it, on every CPU model. So a
process of this machine lets it look at a contact model; qemu starts programs of either kind.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
UNIT = ROOT / "tests/unit"
EXTRAS = sorted(path.parent for path in ROOT.glob("extras/*/pyproject.toml"))  # the tests use their packages
DEBIAN = "python3,libpython3.11-dev,python3-numpy,python3-scipy"
FROM_PYPI = ["msgspec", "msgpack", "pyzmq", "pyserial", "smbus2", "onnx", "protobuf", "typing_extensions"]
FROM_PYPI += ["mcap", "zstandard", "lz4", "mpmath", "threadpoolctl"]
FROM_PYPI += ["ml_dtypes==0.5.1"]  # the next one wants numpy 1.25, and Debian 12 has 1.24
FROM_PYPI += ["pytest", "hypothesis", "sortedcontainers", "iniconfig", "pluggy", "packaging", "pygments"]
PLATFORMS = ("linux", "manylinux_2_28", "manylinux_2_27", "manylinux2014", "manylinux_2_17")
# The modules that each frame runs through, those they rest on, and recordings that must replay to the last bit:
# patterns of tests/unit/test_….py.
# Not client_clock: it is judged by the clock, and an emulated client on a busy machine is late.
TESTS = ["pose_kernel", "pose_solver", "pose_refusals", "chi2", "alignment", "tracker", "mean_residuals", "touch"]
TESTS += ["smoothing", "contact_network", "refine", "near_magnet", "hmc5983", "wire*", "link", "clock"]
TESTS += ["arithmetic", "bridge", "messages", "config_file", "schedule", "pipeline", "kept_recordings"]
ONNXRUNTIME = "asks onnxruntime"
ONE_SEED = "half a minute, and another seed runs"
STATISTICS = "a long count of noise in plain Python"
LEFT_OUT = {
    "contact_network.py::test_network_answers_like_onnxruntime_and_repeats": ONNXRUNTIME,
    "contact_network.py::test_onnxruntime_model_gives_the_same_answers": ONNXRUNTIME,
    "contact_network.py::test_model_that_needs_much_memory_is_refused_before_it_is_loaded": ONNXRUNTIME,
    "contact_network.py::test_model_without_weights_is_left_to_onnxruntime": ONNXRUNTIME,
    "contact_network.py::test_graph_with_one_other_weight_is_left_to_onnxruntime": ONNXRUNTIME,
    "contact_network.py::test_network_that_answers_otherwise_is_not_used": ONNXRUNTIME,
    "touch.py::test_false_contacts_of_noise_come_at_the_stated_rate": STATISTICS,
    "mean_residuals.py::test_healthy_noise_is_never_a_lasting_fault": STATISTICS,
    "clock.py::test_hour_of_a_crystal_that_warms_and_cools_is_followed": "minutes; a shorter drift is followed",
    "refine.py::test_fit_meets_a_smooth_response_between_its_points": "minutes of SciPy, by which pads are calibrated",
    "pipeline.py::test_scripted_finger_is_detected_within_published_deviations[2-scene0]": ONE_SEED,
    "pipeline.py::test_scripted_finger_is_detected_within_published_deviations[2-scene1]": ONE_SEED,
}
PIP = ["/usr/bin/python3", "-m", "pip", "--disable-pip-version-check", "-q"]


def debian(cache: Path) -> Path:
    """A tree with arm64's Python: unpacked, never configured, because nothing in it has to boot."""
    tree = cache / "debian-12-arm64"
    if not tree.exists():
        command = ["debootstrap", "--foreign", "--arch=arm64", "--variant=minbase", f"--include={DEBIAN}"]
        subprocess.run([*command, "bookworm", f"{tree}.new"], check=True, stdout=subprocess.DEVNULL)
        for package in sorted(Path(f"{tree}.new/var/cache/apt/archives").glob("*.deb")):
            subprocess.run(["dpkg-deb", "-x", package, f"{tree}.new"], check=True)
        # This machine's Python writes the same bytecode; the emulated one would take a minute for it at every start.
        libraries = [f"{tree}.new/usr/lib/python3", f"{tree}.new/usr/lib/python3.11"]
        subprocess.run(["/usr/bin/python3.11", "-m", "compileall", "-q", *libraries], check=True)
        Path(f"{tree}.new").rename(tree)
    (tree / "dev/ptmx").unlink(missing_ok=True)  # this file would hide the host's, and then no pty opens
    return tree


def cross_compiler(tree: Path, sources: str | Path) -> dict[str, str]:
    """Variables with which setuptools compiles for arm64."""
    return {
        "CC": "aarch64-linux-gnu-gcc",
        "LDSHARED": "aarch64-linux-gnu-gcc -shared",
        "CFLAGS": f"-I{tree}/usr/include -I{tree}/usr/include/python3.11 {without_folder(sources)}",
        "_PYTHON_HOST_PLATFORM": "linux-aarch64",
    }


def without_folder(sources: str | Path) -> str:
    """The compiler's option that keeps the folder's name out of its output."""
    return f"-ffile-prefix-map={sources}=."


def wheel(tree: Path, folder: Path, sources: str | Path = ROOT) -> Path:
    """Built by this machine's Python with a cross compiler; the stable ABI needs only arm64's headers."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("fmfts-*.whl"):
        old.unlink()
    for old in Path(sources).glob("build/*.linux-aarch64*"):  # a deleted module would still be packed
        shutil.rmtree(old)
    environment = os.environ | cross_compiler(tree, sources)
    subprocess.run([*PIP, "wheel", "--no-deps", "-w", folder, sources], check=True, env=environment)
    (built,) = folder.glob("fmfts-*-abi3-linux_aarch64.whl")
    return built


ASK_THIS_MACHINE = '''"""Stands for the module that imports onnxruntime: this machine's Python asks it."""

import subprocess
import sys

SCRIPT = """import sys
from fmfts.contact import session
try:
    sys.stdout.buffer.write(getattr(session, sys.argv[1])(sys.stdin.buffer.read()))
except Exception as error:
    sys.exit(str(error))
"""


def asked(what, content):
    ended = subprocess.run([sys.executable, "-c", SCRIPT, what], input=content, capture_output=True)
    if ended.returncode != 0:
        raise ValueError(ended.stderr.decode().strip().splitlines()[-1])
    return ended.stdout


def tell(content):
    return asked("tell", content)


def try_out(content):
    return asked("try_out", content)
'''


def start_others_on_this_machine(folder: Path) -> None:
    """The emulated Python starts this machine's Python as `sys.executable`, without arm64's packages."""
    native = folder / "native-python"
    native.write_text(f'#!/bin/sh\nexec env -u PYTHONPATH -u LD_LIBRARY_PATH {sys.executable} "$@"\n')
    native.chmod(0o755)
    (folder / "fmfts/contact/session.py").write_text(ASK_THIS_MACHINE)
    (folder / "sitecustomize.py").write_text(f"import sys\n\nsys.executable = {str(native)!r}\n")


def install(built: Path, folder: Path) -> None:
    platforms = [word for name in PLATFORMS for word in ("--platform", f"{name}_aarch64")]
    command = [*PIP, "install", "--upgrade", "--target", folder, *platforms, "--python-version", "3.11"]
    subprocess.run(
        [*command, "--only-binary=:all:", "--no-deps", built, ROOT / "clients/python", *EXTRAS, *FROM_PYPI], check=True
    )
    start_others_on_this_machine(folder)


def emulated(tree: Path, folder: Path) -> list[str | Path]:
    """The command of arm64's Python, with the packages in `folder`."""
    library = "/usr/lib/aarch64-linux-gnu"
    settings = [f"LD_LIBRARY_PATH={library}/blas:{library}/lapack", f"PYTHONPATH={folder}", "PYTHONDONTWRITEBYTECODE=1"]
    words = (word for setting in settings for word in ("-E", setting))
    return ["qemu-aarch64", "-L", tree, *words, tree / "usr/bin/python3.11"]


def load_compiled(python: list[str | Path]) -> None:
    """Checks each compiled module: build and package treat it as optional, so that its tests would only be skipped."""
    with (ROOT / "pyproject.toml").open("rb") as project:
        modules = tomllib.load(project)["tool"]["setuptools"]["ext-modules"]
    script = "import importlib, platform, sys; print(platform.machine())\n"
    script += "for name in sys.argv[1:]: print(importlib.import_module(name).__file__)"
    names = [module["name"] for module in modules]
    if subprocess.run([*python, "-c", script, *names], check=False).returncode != 0:
        raise SystemExit("the wheel lacks a compiled module, or it does not load: `pip wheel -v` shows why")


def run_tests(python: list[str | Path]) -> int:
    for test, reason in LEFT_OUT.items():
        file, name = test.split("::")
        if f"def {name.partition('[')[0]}(" not in (UNIT / f"test_{file}").read_text():
            raise SystemExit(f"LEFT_OUT in {__file__} names {test}, which does not exist")
        print(f"left out: {test}: {reason}", flush=True)
    files = [path.relative_to(ROOT) for name in TESTS for path in sorted(UNIT.glob(f"test_{name}.py"))]
    options = ["-q", "-p", "no:cacheprovider", "--hypothesis-profile=few", "--durations=10"]
    options += [f"--deselect=tests/unit/test_{test}" for test in LEFT_OUT]
    return subprocess.run([*python, "-m", "pytest", *options, *files], cwd=ROOT, check=False).returncode


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--cache", type=Path, default=ROOT / "build")
    cache: Path = options.parse_args().cache.resolve()
    tree = debian(cache)
    built = wheel(tree, cache / "aarch64")
    print(built, flush=True)
    install(built, cache / "aarch64/site")
    python = emulated(tree, cache / "aarch64/site")
    load_compiled(python)
    return run_tests(python)


if __name__ == "__main__":
    sys.exit(main())
