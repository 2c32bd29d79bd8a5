"""A new user's steps: a fresh clone of HEAD on a plain Debian 12 with only what the README names.

An ordinary user learns which packages are missing, installs them, and sees the demo. Root sees the demo, and the tests
pass.
Run as root: `make test-fresh`.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from drills import registries  # noqa: E402
from drills.container import Container, debian_tree  # noqa: E402

NAMED_IN_THE_README = ["git", "make", "gcc", "libc6-dev", "python3"]
PACKAGES = [*NAMED_IN_THE_README, "ca-certificates", "sudo"]
USER, PROJECT = "newcomer", "project"
LOGS = ROOT / "build/test-fresh-logs"
DEMO = "make demo SECONDS=5"
QUICK_TEST = 'make test PARTS="lint unit"'
SEEN = re.compile(r"pad demo: \d+ messages; .* ok ")
# The arithmetic that an older processor would choose: OpenBLAS's kernels, NumPy's vectors, glibc's fused multiply-add.
NO_VECTORS = {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4"}
PROCESSORS = {
    "": {},
    "v1": NO_VECTORS | {"OPENBLAS_CORETYPE": "Prescott", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX"},
    "v2": NO_VECTORS | {"OPENBLAS_CORETYPE": "Sandybridge", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"},
    "v3": {"OPENBLAS_CORETYPE": "Haswell"},
}


class FreshClone(Container):
    """A clone of the HEAD of `source` in a tree of its own; commands run in it one by one, as `user`."""

    def __init__(self, tree: Path, user: str, environment: dict[str, str], source: Path = ROOT) -> None:
        super().__init__(tree)
        self._user = user
        self._home = Path("/root" if user == "root" else f"/home/{user}")
        self._environment = {"LANG": "C.UTF-8", "CI": "true"} | registries.environment() | environment
        registries.carry_to_user(self.root / self._home.relative_to("/"))
        subprocess.run(["git", "clone", "-q", f"file://{source}", self.project], check=True)
        self.unbooted("chown", "-R", f"{user}:", str(self._home))

    @property
    def project(self) -> Path:
        """On this computer."""
        return self.root / self._home.relative_to("/") / PROJECT

    def does(self, command: str) -> tuple[int, str]:
        """Its exit status and output, which is shown too."""
        print(f"\n{self._user}$ {command}", flush=True)
        words = ["systemd-nspawn", "--quiet", "--pipe", *self._options(), "--resolv-conf=replace-host"]
        words += [f"--setenv={name}={value}" for name, value in self._environment.items()]
        words += [f"--bind-ro={folder}" for folder in registries.package_folders()]
        words += [f"--user={self._user}", f"--chdir={self._home / PROJECT}", "sh", "-c", command]
        said = []
        with subprocess.Popen(
            words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        ) as process:
            assert process.stdout is not None
            try:
                for line in process.stdout:
                    print(line, end="", flush=True)
                    said.append(line)
            except BaseException:
                process.terminate()  # the command and everything that it started
                raise
        return process.returncode, "".join(said)


def plain_debian(cache: Path) -> Path:
    def prepare(tree: Path) -> None:
        registries.carry_into(tree)
        (tree / "etc/apt/apt.conf.d/yes").write_text('APT::Get::Assume-Yes "true";\nAcquire::Retries "3";\n')
        (tree / "etc/sudoers.d" / USER).write_text(f"{USER} ALL=(ALL) NOPASSWD: ALL\n")
        for words in (["useradd", "--create-home", USER], ["apt-get", "update", "-qq"]):
            command = ["systemd-nspawn", "--quiet", "--register=no", "--keep-unit", f"--directory={tree}"]
            subprocess.run([*command, "--resolv-conf=replace-host", *words], check=True, stdin=subprocess.DEVNULL)

    return debian_tree(cache, "debian-12-to-try", PACKAGES, prepare)


def require(condition: object, what: str) -> None:
    if not condition:
        raise SystemExit(f"test-fresh: {what}")


def end_on_sigterm() -> None:
    """Acts like Ctrl-C: its tree (gigabytes) is removed, and all its programs end. Also when the terminal closes."""
    for told in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(told) is not signal.SIG_IGN:  # nohup makes it ignore SIGHUP
            signal.signal(told, lambda number, _: sys.exit(128 + number))


def line_to_run(said: str) -> str:
    """What a user whose system lacks packages is told."""
    line = re.search(r"sudo apt-get install .*", said)
    require(line, "a user whose system lacks packages was not told how to install them")
    assert line is not None
    return line[0]


def as_an_ordinary_user(tree: Path, environment: dict[str, str], test: str | None) -> None:
    """test: None: check only that its packages are named."""
    with FreshClone(tree, USER, environment) as clone:
        code, said = clone.does(DEMO)
        line = line_to_run(said)
        require(code != 0, f"`{DEMO}` says what it lacks, and ends as if all were well")
        code, _ = clone.does(line)
        require(code == 0, f"the line that was printed does not install them: {line}")
        code, said = clone.does(DEMO)
        require(code == 0 and SEEN.search(said), f"after the line that was printed, `{DEMO}` does not work")
        line = line_to_run(clone.does("make test-packages")[1])
        if test is not None:
            require(clone.does(line)[0] == 0, f"the line that was printed does not install them: {line}")
            require(clone.does(test)[0] == 0, f"after the line that was printed, `{test}` fails for a user")


def as_root(tree: Path, environment: dict[str, str], test: str) -> None:
    with FreshClone(tree, "root", environment) as clone:
        code, said = clone.does(DEMO)
        require(code == 0 and SEEN.search(said), f"`{DEMO}` does not work")
        code, _ = clone.does(test)
        shutil.rmtree(LOGS, ignore_errors=True)
        if (clone.project / "build/test-logs").is_dir():
            shutil.copytree(clone.project / "build/test-logs", LOGS)
        require(code == 0, f"`{test}` failed in the fresh clone; its logs are in {LOGS.relative_to(ROOT)}")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="the installation, lint and unit tests")
    options.add_argument("--cpu", choices=PROCESSORS, default="", help="compute as an older processor (x86-64-v…)")
    options.add_argument("--cache", type=Path, default=ROOT / "build", help="where the tree of Debian is kept")
    arguments = options.parse_args()
    require(os.geteuid() == 0, "a tree of Debian is made and entered by root alone: sudo make test-fresh")
    end_on_sigterm()
    start = time.monotonic()
    tree = plain_debian(arguments.cache)
    environment = PROCESSORS[arguments.cpu]
    as_an_ordinary_user(tree, environment, None if arguments.quick else QUICK_TEST)
    as_root(tree, environment, QUICK_TEST if arguments.quick else "make test")
    print(f"all as it should be in a fresh clone, after {(time.monotonic() - start) / 60:.0f} minutes")


if __name__ == "__main__":
    main()
