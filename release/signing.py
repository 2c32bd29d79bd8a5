"""Checksums of a release, and a signature where there is a key: git's `user.signingkey`, or SIGN=1 for GnuPG's default.

Nothing here makes a key, asks for one or takes one along.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[1]
SUMS = "SHA256SUMS"
UNSIGNED = "not signed, for there is no key: set one with `git config user.signingkey`, or SIGN=1 for GnuPG's default"


def setting(name: str) -> str:
    said = subprocess.run(["git", "config", name], cwd=ROOT, capture_output=True, text=True, check=False)
    return said.stdout.strip()


def signs() -> bool:
    return bool(setting("user.signingkey")) or os.environ.get("SIGN") == "1"


def write_checksums(folder: Path) -> Path:
    """Write the checksums as `sha256sum -c` reads them."""
    files = sorted(path for path in folder.iterdir() if not path.name.startswith(SUMS))
    sums = folder / SUMS
    sums.write_text("".join(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files))
    return sums


def sign(file: Path) -> str:
    """Writes FILE.asc (GnuPG) or FILE.sig (git's gpg.format is ssh); what became of it, as a sentence."""
    if not signs():
        return f"{file.name}: {UNSIGNED}"
    key = setting("user.signingkey")
    if setting("gpg.format") == "ssh":
        program = setting("gpg.ssh.program") or "ssh-keygen"
        target = file.with_name(f"{file.name}.sig")
        target.unlink(missing_ok=True)  # ssh-keygen would ask
        command = [program, "-Y", "sign", "-n", "file", "-f", key, str(file)]
    else:
        program = setting("gpg.program") or "gpg"
        target = file.with_name(f"{file.name}.asc")
        chosen = ["--local-user", key] if key else []
        command = [program, "--batch", "--yes", *chosen, "--armor", "--output", str(target), "--detach-sign", str(file)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        raise SystemExit(f"{file.name} was not signed: {' '.join(command)}:\n{ended.stderr}")
    return f"{file.name}: signed, in {target.name}"


def tag_option() -> str:
    """How `git tag` makes this release's tag."""
    return "--sign" if signs() else "--annotate"
