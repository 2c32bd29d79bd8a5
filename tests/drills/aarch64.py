"""The wheel for aarch64, cross-built, and the tests of the kernel and of plain Python under qemu-user: `make aarch64`.

onnxruntime is left out: its library ends with a segmentation fault while qemu 7.2 (Debian 12) loads it, on every CPU
model. So are tests that start another Python: the host's kernel does not run its binary.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
DEBIAN = "python3,libpython3.11-dev,python3-numpy,python3-scipy"
FROM_PYPI = ["msgspec", "msgpack", "pyzmq", "onnx", "protobuf", "typing_extensions"]
FROM_PYPI += ["ml_dtypes==0.5.1"]  # the next one wants numpy 1.25, and Debian 12 has 1.24
FROM_PYPI += ["pytest", "hypothesis", "sortedcontainers", "iniconfig", "pluggy", "packaging", "pygments"]
PLATFORMS = ("linux", "manylinux_2_28", "manylinux_2_27", "manylinux2014", "manylinux_2_17")
TESTS = ["pose_kernel", "pose_solver", "chi2", "alignment", "clock", "wire", "wire_compiled", "hmc5983", "link"]
TESTS += ["pose_refusals", "messages", "config_file", "client_clock"]
# What each healthy frame runs through.
TESTS += ["healthy_path", "contact_network", "tracker", "touch", "refine"]
# Emulated, these take minutes each, and say nothing of the processor that the others do not.
TOO_SLOW = [
    "test_an_hour_of_a_crystal_that_warms_and_cools_is_followed",
    "test_a_session_says_the_same_in_c_and_in_python",  # the refined one, and faults at random, say it too
    "test_a_session_with_faults_says_the_same_and_comes_back",
    "test_a_warm_pad_whose_temperature_is_not_told_is_no_contact",
    "test_frames_leave_no_memory_behind",
    "test_false_contacts_of_noise_come_at_the_stated_rate",
    "test_fit_meets_a_smooth_response_between_its_points",
]
STARTS_ANOTHER_PYTHON = ["test_without_the_kernel_the_reference_serves"]
NEEDS_ONNXRUNTIME = [
    "test_any_other_graph_is_left_to_onnxruntime",
    "test_network_that_answers_otherwise_is_not_used",
    "test_process_that_ends_without_an_answer_is_no_answer",
    "test_it_answers_as_onnxruntime_does_and_repeats_itself",
    "test_one_wrong_weight_is_found",
    "test_healthy_frames_are_judged_the_same_with_onnxruntime",
]
PIP = ["/usr/bin/python3", "-m", "pip", "--disable-pip-version-check", "-q"]


def debian(cache: Path) -> Path:
    """A tree with arm64's Python: unpacked, never configured, for nothing in it has to boot."""
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
    return tree


def wheel(tree: Path, folder: Path) -> Path:
    """Built by this machine's Python with a cross compiler; the stable ABI needs arm64's headers and nothing more."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("fmfts-*.whl"):
        old.unlink()
    environment = os.environ | {
        "CC": "aarch64-linux-gnu-gcc",
        "LDSHARED": "aarch64-linux-gnu-gcc -shared",
        "CFLAGS": f"-I{tree}/usr/include -I{tree}/usr/include/python3.11",
        "_PYTHON_HOST_PLATFORM": "linux-aarch64",
    }
    subprocess.run([*PIP, "wheel", "--no-deps", "-w", folder, ROOT], check=True, env=environment)
    (built,) = folder.glob("fmfts-*-abi3-linux_aarch64.whl")
    return built


def install(built: Path, folder: Path) -> None:
    platforms = [word for name in PLATFORMS for word in ("--platform", f"{name}_aarch64")]
    command = [*PIP, "install", "--upgrade", "--target", folder, *platforms, "--python-version", "3.11"]
    subprocess.run([*command, "--only-binary=:all:", "--no-deps", built, *FROM_PYPI], check=True)


def run_tests(tree: Path, folder: Path) -> int:
    library = "/usr/lib/aarch64-linux-gnu"
    settings = [f"LD_LIBRARY_PATH={library}/blas:{library}/lapack", f"PYTHONPATH={folder}", "PYTHONDONTWRITEBYTECODE=1"]
    emulator = ["qemu-aarch64", "-L", tree, *(word for setting in settings for word in ("-E", setting))]
    python = [*emulator, tree / "usr/bin/python3.11"]
    which = "import platform, fmfts.pose as pose; print(platform.machine(), pose.SOLVER, pose.__file__)"
    print(subprocess.run([*python, "-c", which], check=True, capture_output=True, text=True).stdout, end="", flush=True)
    files = [f"tests/unit/test_{name}.py" for name in TESTS]
    deselected = " and ".join(f"not {name}" for name in STARTS_ANOTHER_PYTHON + NEEDS_ONNXRUNTIME + TOO_SLOW)
    options = ["-q", "-p", "no:cacheprovider", "--hypothesis-profile=few", "-k", deselected]
    return subprocess.run([*python, "-m", "pytest", *options, *files], cwd=ROOT, check=False).returncode


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--cache", type=Path, default=ROOT / "build")
    cache: Path = options.parse_args().cache.resolve()
    tree = debian(cache)
    built = wheel(tree, cache / "aarch64")
    print(built, flush=True)
    install(built, cache / "aarch64/site")
    return run_tests(tree, cache / "aarch64/site")


if __name__ == "__main__":
    sys.exit(main())
