"""Builds HEAD twice, under two conditions that have nothing in common, and compares the bytes: `make reproducible`.

Wheels, source archives and the bill of materials by release/dist.py, and the Debian package by `make deb`. Each clone
is in another folder, its files have other times and modes, and the build has another time zone, language and umask.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
LONG_AGO_S = 981_173_106
# Differences: the name of the clone's folder, the umask, and variables.
CONDITIONS: list[tuple[str, int, dict[str, str]]] = [
    ("a", 0o022, {"TZ": "UTC", "LC_ALL": "C.UTF-8"}),
    ("elsewhere/with-a-much-longer-name", 0o077, {"TZ": "Asia/Kathmandu", "LC_ALL": "C", "LANG": "tr_TR.UTF-8"}),
]


def clone(folder: Path, umask: int, commit: str) -> None:
    subprocess.run(["git", "clone", "-q", "--no-checkout", f"file://{ROOT}", folder], check=True, umask=umask)
    subprocess.run(["git", "checkout", "-q", "--detach", commit], cwd=folder, check=True, umask=umask)
    if umask != 0o022:
        for path in folder.rglob("*"):
            if ".git" not in path.relative_to(folder).parts and not path.is_symlink():
                os.utime(path, (LONG_AGO_S, LONG_AGO_S))


def built(commit: str, folder: Path, umask: int, variables: dict[str, str], quick: bool) -> dict[str, Path]:
    """The files of a release by name, made in a clone."""
    clone(folder, umask, commit)
    inherited = {name: value for name, value in os.environ.items() if name not in ("SOURCE_DATE_EPOCH", "SIGN")}
    # xz takes most of the time of a package.
    environment = inherited | variables | ({"DPKG_DEB_COMPRESSOR_TYPE": "none"} if quick else {})
    make = ["make", "--silent", "deb", f"VENV={Path(sys.prefix)}"]
    dist = [sys.executable, "release/dist.py", *(["--without-aarch64"] if quick else ["--cache", ROOT / "build"])]
    for command in (make, dist):
        ended = subprocess.run(command, cwd=folder, env=environment, umask=umask, capture_output=True, text=True)
        if ended.returncode != 0:
            raise SystemExit(
                f"in {folder}: {' '.join(map(str, command))}:\n{ended.stdout[-4000:]}{ended.stderr[-4000:]}"
            )
    return {path.name: path for path in [*folder.glob("dist/*"), *folder.glob("build/*.deb")]}


def members(archive: Path) -> dict[str, str]:
    """The facts that are compared for each member of an archive: its content's hash, mode and time."""
    found: dict[str, str] = {}
    if archive.suffix == ".whl":
        with zipfile.ZipFile(archive) as packed:
            for each in packed.infolist():
                digest = hashlib.sha256(packed.read(each)).hexdigest()[:12]
                found[each.filename] = f"{digest} {each.external_attr >> 16:o} {each.date_time}"
    elif archive.suffix == ".gz":
        with tarfile.open(archive) as file:
            for member in file.getmembers():
                content = file.extractfile(member)
                digest = hashlib.sha256(content.read() if content else b"").hexdigest()[:12]
                found[member.name] = f"{digest} {member.mode:o} {member.mtime}"
    elif archive.suffix == ".deb":
        listed = subprocess.run(["dpkg-deb", "-c", archive], check=True, capture_output=True, text=True).stdout
        found = {line.split()[-1]: line for line in listed.splitlines()}
        control = ["dpkg-deb", "-I", archive, "md5sums"]
        for line in subprocess.run(control, check=True, capture_output=True, text=True).stdout.splitlines():
            digest, name = re.split(r"\s+", line, maxsplit=1)
            found[f"./{name}"] = f"{digest} {found.get(f'./{name}')}"
    return found


def difference(first: Path, second: Path) -> str:
    """ "" if the bytes are the same; else which members differ, and how."""
    if first.read_bytes() == second.read_bytes():
        return ""
    one, other = members(first), members(second)
    lines = [
        f"  {name}: {one.get(name)} | {other.get(name)}"
        for name in sorted(one | other)
        if one.get(name) != other.get(name)
    ]
    return "\n".join(lines[:20] or ["  the members are the same: their order, or how they are packed"])


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true", help="not for aarch64, and the package without compression")
    quick = options.parse_args().quick
    if changed := subprocess.run(["git", "status", "--porcelain"], cwd=ROOT, capture_output=True, text=True).stdout:
        print(f"HEAD is built, without what is not committed:\n{changed}", file=sys.stderr)
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, check=True, capture_output=True, text=True)
    commit = head.stdout.strip()
    with tempfile.TemporaryDirectory(prefix="fmfts-twice-") as folder:
        first, second = (built(commit, Path(folder, name), mask, given, quick) for name, mask, given in CONDITIONS)
        wrong = sorted(first.keys() ^ second.keys())
        for name in sorted(first.keys() & second.keys()):
            found = difference(first[name], second[name])
            digest = hashlib.sha256(first[name].read_bytes()).hexdigest()
            print("differs" if found else "same", digest[:16], name, f"\n{found}" if found else "", flush=True)
            wrong += [name] if found else []
    print(f"not reproducible: {', '.join(wrong)}" if wrong else "reproducible", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
