"""Checks that HEAD can be released, builds and tries dist/, and tags it: `make release`. Uploads nothing.

1. nothing is uncommitted; all pyproject.toml and fmfts.__version__ say the same version
2. CHANGELOG.md has a heading `## VERSION (date)`, and no tag vVERSION is there yet
3. `make dist DEB=1 test-dist`; SHA256SUMS is signed where there is a key
4. a tag, signed where there is a key, with the notes of this version as its text (`--check` leaves it out)
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from signing import UNSIGNED, signs, tag_option  # noqa: E402

EXTRAS = sorted(path.parent for path in ROOT.glob("extras/*/pyproject.toml"))
PROJECTS = (ROOT, ROOT / "clients/python", ROOT / "lab", *EXTRAS)


class NotReadyError(Exception):
    """HEAD cannot be released; the text says what to do."""


def versions(root: Path = ROOT) -> dict[str, str]:
    """The version by the file that states it, and what the packages want of each other."""
    found: dict[str, str] = {}
    for folder in PROJECTS:
        file = folder.relative_to(ROOT) / "pyproject.toml"
        project = tomllib.loads((root / file).read_text())["project"]
        found[str(file)] = project["version"]
        extras = project.get("optional-dependencies", {}).values()
        for word in [*project["dependencies"], *(word for extra in extras for word in extra)]:
            name, pinned, version = word.partition("==")
            if pinned and name.startswith("fmfts"):
                found[f"{file}: {name}"] = version
    stated = re.search(r'__version__ = "(.+)"', (root / "daemon/fmfts/__init__.py").read_text())
    found["daemon/fmfts/__init__.py"] = stated[1] if stated else ""
    return found


def the_version(root: Path = ROOT) -> str:
    found = versions(root)
    if len(set(found.values())) != 1:
        raise NotReadyError("the versions differ: " + ", ".join(f"{file} says {said}" for file, said in found.items()))
    return next(iter(found.values()))


def notes(version: str, changelog: str) -> str:
    """The entry of this version in CHANGELOG.md. Raises NotReadyError if it has no heading, or is empty."""
    part = re.search(
        rf"^## {re.escape(version)} \(\d{{4}}-\d\d-\d\d\)\n(.*?)(?=^## |\Z)", changelog, re.DOTALL | re.MULTILINE
    )
    if part is None:
        raise NotReadyError(
            f"CHANGELOG.md has no heading `## {version} (year-month-day)`: "
            "rename `## Unreleased`, and commit that as the release"
        )
    if not part[1].strip():
        raise NotReadyError(f"CHANGELOG.md says nothing about {version}")
    return part[1].strip()


def git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def require_clean() -> None:
    if changed := git("status", "--porcelain"):
        raise NotReadyError(f"commit or remove first:\n{changed}")


def tag(name: str, text: str, root: Path = ROOT) -> None:
    """SystemExit where it is not made, or is to be signed and is not: git 2.39 then says so, and makes it unsigned."""

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)

    ended = run("tag", tag_option(), "--cleanup=verbatim", name, "-m", text)
    if ended.returncode != 0:
        raise SystemExit(f"the tag {name} was not made: {ended.stderr}")
    if signs() and "\n-----BEGIN " not in run("cat-file", "tag", name).stdout:
        run("tag", "--delete", name)
        raise SystemExit(f"the tag {name} was not signed, and is removed: {ended.stderr}")
    print(f"tagged {name}, signed" if signs() else f"tagged {name}; {UNSIGNED}")


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--check", action="store_true", help="make no tag")
    chosen = options.parse_args()
    try:
        require_clean()
        version = the_version()
        text = notes(version, (ROOT / "CHANGELOG.md").read_text())
        if git("tag", "--list", f"v{version}"):
            raise NotReadyError(f"the tag v{version} is there already: raise the version")
    except NotReadyError as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    subprocess.run(["make", "dist", "DEB=1", "test-dist"], cwd=ROOT, check=True)
    if not chosen.check:
        tag(f"v{version}", f"fmfts {version}\n\n{text}\n")
        print(f"to publish: git push origin v{version} && .venv/bin/twine upload dist/*.whl dist/*.tar.gz")
    return 0


if __name__ == "__main__":
    sys.exit(main())
