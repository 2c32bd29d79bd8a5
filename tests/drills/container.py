"""A plain Debian or Ubuntu with its own systemd: debootstrap makes the tree, systemd-nspawn boots a copy of it."""

from __future__ import annotations

import os
import secrets
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
import weakref
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

BOOTED = ["systemd", "systemd-sysv", "dbus", "udev"]  # packages of a minimal installation beyond the base


@dataclass(frozen=True)
class System:
    """A release, and where debootstrap finds it."""

    name: str
    codename: str
    mirror: str = "http://deb.debian.org/debian"
    components: str = "main"
    keyring: Path = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
    script: str = "sid"  # script of debootstrap, for releases that are newer than it


DEBIAN_12 = System("debian-12", "bookworm")


def debian_tree(
    cache: Path,
    name: str = "debian-12",
    packages: Sequence[str] = BOOTED,
    prepare: Callable[[Path], object] = lambda tree: None,
    system: System = DEBIAN_12,
) -> Path:
    """The tree, made by debootstrap when it is not there yet (two minutes; 300 MB), and then prepared."""
    tree = cache / name
    if not tree.exists():
        cache.mkdir(parents=True, exist_ok=True)
        making = Path(tempfile.mkdtemp(dir=cache, prefix=f"{name}."))
        command = ["debootstrap", "--variant=minbase", f"--include={','.join(packages)}"]
        command += [f"--components={system.components}", f"--keyring={system.keyring}"]
        command += [system.codename, str(making), system.mirror, system.script]
        try:
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            making.chmod(0o755)
            prepare(making)
        except BaseException:
            shutil.rmtree(making)
            raise
        making.rename(tree)
    return tree


class Container:
    """Booted from a copy of `tree`, which is deleted at the end."""

    def __init__(self, tree: Path) -> None:
        self.name = f"fmfts-drill-{secrets.token_hex(4)}"
        self.root = Path(tempfile.mkdtemp(prefix="fmfts-container."))
        self._remove = weakref.finalize(self, shutil.rmtree, self.root, ignore_errors=True)  # even if the copy fails
        subprocess.run(["cp", "-a", "--reflink=auto", f"{tree}/.", self.root], check=True)
        (self.root / "etc/hostname").write_text("robot\n")
        self._process: subprocess.Popen[bytes] | None = None
        self._leader = 0

    def unbooted(self, *command: str) -> str:
        """Run in the unbooted tree, like an installer; with the host's network."""
        words = ["systemd-nspawn", "--quiet", *self._options(), "--resolv-conf=replace-host", *command]
        return subprocess.run(words, check=True, capture_output=True, text=True, stdin=subprocess.DEVNULL).stdout

    def boot(self) -> None:
        words = ["systemd-nspawn", "--quiet", *self._options(), "--resolv-conf=off", "--private-network", "--boot"]
        # systemd 256 and later refuse the cgroups of an older computer without it; others leave it out.
        words += ["--console=pipe", "SYSTEMD_CGROUP_ENABLE_LEGACY_FORCE=1"]
        self._process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children")
        wait_for(lambda: children.read_text().split(), "the container's init")
        self._leader = int(children.read_text().split()[0])
        wait_for(lambda: self.run("systemctl is-system-running", check=False) in ("running", "degraded"), "its boot")

    def run(self, command: str, user: str = "root", check: bool = True, timeout_s: float = 120.0) -> str:
        """A shell command in the booted container; its output, both streams. With `check`, it must succeed."""
        words = ["nsenter", "--all", "--target", str(self._leader), "runuser", "-u", user, "--", "sh", "-c", command]
        environment = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LANG": "C.UTF-8", "TERM": "dumb"}
        ended = subprocess.run(
            words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=timeout_s, env=environment,
            check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        if check and ended.returncode:
            raise AssertionError(f"{command}: exit {ended.returncode}: {ended.stdout}")
        return ended.stdout.strip()

    def python(self, program: str, user: str = "root") -> str:
        return self.run(f"cd / && /usr/bin/python3 -c {shlex.quote(program)}", user)

    def property(self, name: str, unit: str = "fmfts") -> str:
        return self.run(f"systemctl show --value -p {name} {unit}")

    def shut_down(self) -> None:
        if self._process is not None:
            with suppress(ProcessLookupError):
                os.kill(self._leader, signal.SIGRTMIN + 4)  # systemd(1): poweroff.target
            try:
                self._process.wait(30)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None

    def _options(self) -> list[str]:
        return [f"--directory={self.root}", f"--machine={self.name}", "--register=no", "--keep-unit", "--timezone=off"]

    def __enter__(self) -> Container:
        return self

    def __exit__(self, *_: object) -> None:
        self.shut_down()
        self._remove()
        # systemd-nspawn leaves this behind if /run is no file system of its own.
        self.root.with_name(f".#{self.root.name}.lck").unlink(missing_ok=True)
        shutil.rmtree(f"/run/systemd/nspawn/propagate/{self.name}", ignore_errors=True)


def wait_for(condition: Callable[[], object], what: str, patience_s: float = 180.0) -> float:
    """Wait until `condition` holds; returns the seconds that took."""
    start = time.monotonic()
    while not condition():
        if time.monotonic() - start > patience_s:
            raise AssertionError(f"{what}: nothing of the kind within {patience_s:g} s")
        time.sleep(0.05)
    return time.monotonic() - start
