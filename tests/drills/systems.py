"""The package built, installed, booted and purged on each Debian and Ubuntu: `make test-systems` (root).

debootstrap makes each release from its own mirror. A release that cannot be fetched is named, and the others are tried.
On each, the first lines of docs/installing.md are typed in a clone of HEAD as well.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from drills import registries  # noqa: E402
from drills.clean_environments import SEEN  # noqa: E402
from drills.container import BOOTED, DEBIAN_12, Container, System, debian_tree  # noqa: E402
from drills.service import drill_access, drill_boot, drill_recording, drill_removal, install, require, say  # noqa: E402

UBUNTU_KEYRING = Path("usr/share/keyrings/ubuntu-archive-keyring.gpg")
DEBIAN_13 = System("debian-13", "trixie")
UBUNTU = {"ubuntu-22.04": "jammy", "ubuntu-24.04": "noble"}
NAMED_IN_THE_README = ["git", "make", "gcc", "libc6-dev", "python3", "ca-certificates"]
TO_COMPLETE = """
. /usr/share/bash-completion/completions/fmfts-daemon
COMP_WORDS=(fmfts-daemon basel) COMP_CWORD=1; _fmfts_daemon; echo "${COMPREPLY[@]}"
"""


def system_of(name: str, cache: Path) -> System:
    if name in UBUNTU:
        mirror = "http://archive.ubuntu.com/ubuntu"
        return System(name, UBUNTU[name], mirror, "main,universe", ubuntu_keyring(cache), "gutsy")
    return {system.name: system for system in (DEBIAN_12, DEBIAN_13)}[name]


def ubuntu_keyring(cache: Path) -> Path:
    """Debian 13 has it as a package, whose signature apt checks."""
    kept = cache / UBUNTU_KEYRING.name
    if not kept.exists():
        with Container(plain(DEBIAN_13, cache)) as container:
            container.unbooted("apt-get", "install", "-y", "-qq", "ubuntu-keyring")
            kept.write_bytes((container.root / UBUNTU_KEYRING).read_bytes())
    return kept


def plain(system: System, cache: Path) -> Path:
    def prepare(tree: Path) -> None:
        registries.carry_into(tree)
        words = ["systemd-nspawn", "--quiet", "--register=no", "--keep-unit", "--timezone=off", f"--directory={tree}"]
        command = [*words, "--resolv-conf=replace-host", "apt-get", "update", "-qq"]
        subprocess.run(command, check=True, stdin=subprocess.DEVNULL)

    return debian_tree(cache, f"{system.name}-systems", [*BOOTED, *NAMED_IN_THE_README], prepare, system)


def built(container: Container) -> Path:
    """The package of HEAD, made on this system."""
    subprocess.run(["git", "clone", "-q", f"file://{ROOT}", container.root / "root/project"], check=True)
    shell(container, "cd /root/project && DEBIAN_FRONTEND=noninteractive make deb")
    (package,) = (container.root / "root/project/build").glob("fmfts_*.deb")
    shell(container, f"dpkg-deb -f /root/project/build/{package.name} Depends")
    say("built", f"{package.name}, {package.stat().st_size / 1e6:.1f} MB")
    return package


def shell(container: Container, command: str) -> str:
    """In the unbooted tree, with this computer's access to packages."""
    words = [f"--setenv={name}={value}" for name, value in registries.environment().items()]
    words += [f"--bind-ro={folder}" for folder in registries.package_folders()]
    try:
        return container.unbooted(*words, "--setenv=LANG=C.UTF-8", "bash", "-c", command)
    except subprocess.CalledProcessError as error:
        raise AssertionError(f"{command}:\n{error.stdout[-3000:]}\n{error.stderr[-3000:]}") from error


def drill_manual(container: Container) -> None:
    """The package's files for `man` and for the shells."""
    listed = container.run("dpkg-query -L fmfts")
    require("/usr/share/man/man1/fmfts-daemon-baseline.1.gz" in listed, "manual pages", "/usr/share/man/man1")
    require("/usr/share/zsh/vendor-completions/_fmfts-daemon" in listed, "completion for zsh", "installed")
    (container.root / "root/complete").write_text(TO_COMPLETE)
    seen = container.run("bash /root/complete")
    require(seen == "baseline", "completion for bash: `basel`", seen)


def first_lines(page: Path) -> str:
    """The first block of a page to type."""
    block = re.search(r"(?:^    .+\n)+", page.read_text(), re.MULTILINE)
    assert block is not None
    return textwrap.dedent(block[0])


def drill_first_lines(container: Container) -> None:
    """A clone has been made already."""
    shell(container, "apt-get install -y -qq --no-install-recommends python3-venv python3-dev man-db")
    typed = first_lines(container.root / "root/project/docs/installing.md")
    check = "python -c 'import fmfts.pose; print(fmfts.pose.SOLVER)'; man -M ~/.local/share/man fmfts-daemon-baseline"
    seen = shell(container, f"set -e; export HOME=/root; cd /root/project; {typed}\n{check}")
    require(SEEN.search(seen), "the first lines of docs/installing.md", "the demo ran")
    require("\nc\n" in seen and "--turn" in seen, "compiled parts, manual pages", "there")


def tried(system: System, cache: Path) -> None:
    tree = plain(system, cache)
    with Container(tree) as builder:
        say(f"\n{system.name}", builder.unbooted("python3", "--version").strip())
        package = built(builder)
        with Container(tree) as container:
            install(container, package)
            container.boot()
            drill_boot(container)
            drill_access(container)
            drill_recording(container)
            drill_manual(container)
            drill_removal(container)
        drill_first_lines(builder)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--cache", type=Path, default=ROOT / "build", help="where the trees are kept")
    known = [DEBIAN_12.name, DEBIAN_13.name, *UBUNTU]
    options.add_argument("systems", nargs="*", default=known, help=", ".join(known))
    arguments = options.parse_args()
    lacking = []
    for name in arguments.systems:
        try:
            system = system_of(name, arguments.cache)
            plain(system, arguments.cache)
        except subprocess.CalledProcessError as error:
            lacking.append(f"{name}: not tried, because its mirror gave no tree: {error}")
            continue
        tried(system, arguments.cache)
    print("\n".join(["all as it should be", *lacking]))


if __name__ == "__main__":
    main()
