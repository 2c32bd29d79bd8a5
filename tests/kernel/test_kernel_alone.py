"""The kernel without Python: here under the sanitizers, on aarch64 under QEMU, and compiled for a Cortex-M3."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from fmfts.common.toml import parse
from fmfts.pose import Problem, Status
from fmfts.pose.kernel import STATUSES, solve_problem
from kernel.problems import random_problem
from needed import missing

ROOT = Path(__file__).parents[2]
POSE = ROOT / "daemon/fmfts/pose"
STRICT = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wshadow", "-ffp-contract=off", f"-I{POSE}"]


def kernel_sources() -> list[Path]:
    """The sources that pyproject.toml compiles, without the binding."""
    modules = parse((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["ext-modules"]
    extension = next(module for module in modules if module["name"] == "fmfts.pose._kernel")
    return [ROOT / source for source in extension["sources"] if not Path(source).name.startswith("_")]


def compiler(name: str) -> str:
    if shutil.which(name) is None:
        missing(name)
    return name


def build(cc: str, *flags: str, output: Path) -> Path:
    command = [compiler(cc), *STRICT, *flags, ROOT / "tests/kernel/solve_file.c", *kernel_sources()]
    built = subprocess.run([*command, "-lm", "-o", output], capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    return output


def problems() -> list[Problem]:
    """Sixty with three to eight sensors, one to three magnets, and every third from samples of different ages."""
    return [random_problem(seed, 3 + seed % 6, seed % 3, seed % 4 == 0) for seed in range(60)]


def written(problem: Problem) -> np.ndarray:
    """As solve_file.c reads it."""
    columns, motion = problem.start.columns, problem.motion
    assert problem.prior is not None
    parts = [
        [len(problem.measurements), len(problem.magnets), problem.project],
        problem.measurements,
        problem.magnets,
        problem.parts,
        problem.start.vector(),
        problem.prior.mean.vector(),
        problem.prior.covariance,
        np.zeros(columns) if motion is None else motion.rate,
        np.zeros(columns) if motion is None else motion.diffusion,
    ]
    return np.concatenate([np.asarray(part, dtype="<f8").ravel() for part in parts])


def check(command: list[str | Path], folder: Path) -> None:
    """Run the program on all problems and compare each answer with the package's, which tests/oracle judges."""
    asked = problems()
    source, target = folder / "problems", folder / "answers"
    np.concatenate([written(problem) for problem in asked]).astype("<f8").tofile(source)
    run = subprocess.run([*command, source, target], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    answers, at, solved = np.fromfile(target, dtype="<f8"), 0, 0
    for problem in asked:
        expected, columns = solve_problem(problem), problem.start.columns
        values = len(problem.start.vector())
        status, chi2, residual, _, rows, unknowns = answers[at : at + 6]
        state = answers[at + 6 : at + 6 + values]
        covariance = answers[at + 6 + values :][: columns**2].reshape(columns, columns)
        at += 6 + values + columns**2 + columns
        assert STATUSES[int(status)] is expected.status
        if expected.status is not Status.CONVERGED:
            continue
        solved += 1
        assert (rows, unknowns) == (expected.rows, expected.unknowns)
        assert [chi2, residual] == pytest.approx([expected.chi2, expected.residual_t], rel=1e-9)
        assert state == pytest.approx(expected.state.vector(), rel=1e-9, abs=1e-14)
        deviation = np.sqrt(np.diagonal(expected.covariance))
        assert (np.abs(covariance - expected.covariance) <= 1e-9 * deviation[:, None] * deviation).all()
    assert at == len(answers)
    assert solved > 55


def test_kernel_alone_agrees_with_package_under_sanitizers(tmp_path: Path) -> None:
    sanitizers = "-fsanitize=address,undefined"
    program = build("gcc", "-O0", "-g", sanitizers, "-fno-sanitize-recover=all", output=tmp_path / "solve")
    check([program], tmp_path)


def test_kernel_on_aarch64_agrees_with_the_package(tmp_path: Path) -> None:
    program = build("aarch64-linux-gnu-gcc", "-O3", "-static", output=tmp_path / "solve")
    check([compiler("qemu-aarch64"), program], tmp_path)


def test_kernel_compiles_for_a_cortex_m3(tmp_path: Path) -> None:
    target = ["-mcpu=cortex-m3", "-mthumb", "-O2", "-DFMFTS_MAX_MAGNETS=1", "-c"]
    for source in kernel_sources():
        command = [compiler("arm-none-eabi-gcc"), *STRICT, *target, source, "-o", tmp_path / f"{source.stem}.o"]
        built = subprocess.run(command, capture_output=True, text=True)
        assert built.returncode == 0, built.stderr


def test_kernel_allocates_nothing_and_keeps_nothing(tmp_path: Path) -> None:
    """Its objects have no data of their own, and need only mathematics and memory moves of the C library."""
    needed: set[str] = set()
    for source in kernel_sources():
        target = tmp_path / f"{source.stem}.o"
        subprocess.run([compiler("gcc"), *STRICT, "-O2", "-c", source, "-o", target], check=True)
        listing = subprocess.run(["nm", target], capture_output=True, text=True, check=True).stdout
        symbols = [line.split()[-2:] for line in listing.splitlines()]
        assert not [name for kind, name in symbols if kind in "BbDdCGgSs"], "a global variable"
        needed |= {name for kind, name in symbols if kind == "U" and not name.startswith("fmfts_")}
    # GCC passes the address of the global offset table to calls through it.
    assert needed <= {
        "frexp",
        "sqrt",
        "fmax",
        "fmin",
        "memcpy",
        "memset",
        "_GLOBAL_OFFSET_TABLE_",
        "__stack_chk_fail",
    }
