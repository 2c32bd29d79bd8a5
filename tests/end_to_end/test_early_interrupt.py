"""Ctrl-C while the command still imports: it ends with 130, and prints no traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

# Blocks the import of a module until a byte comes, so that the signal arrives there on every computer.
HELD = """
import os, sys
class Hold:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.write(1, b"here")
            os.read(0, 1)
sys.meta_path.insert(0, Hold())
sys.argv = ["fmfts-daemon", {verb!r}]
from fmfts.cli.entry import main
sys.exit(main())
"""


@pytest.mark.parametrize(
    ("verb", "module"),
    [
        ("status", "fmfts.cli.main"),
        ("probe", "fmfts.cli.on_device"),
        ("status", "fmfts.service.log"),
        ("status", "fmfts.view.status"),
        ("status", "zmq"),
        ("probe", "numpy"),
        ("probe", "fmfts.config.file"),
    ],
)
def test_interrupt_in_an_import_prints_nothing(verb: str, module: str) -> None:
    held = subprocess.Popen(
        [sys.executable, "-c", HELD.format(module=module, verb=verb)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background job ignores it
        env=os.environ | {"FMFTS_CONFIG": "config.toml"},
    )
    assert held.stdout is not None
    assert held.stdout.read(4) == b"here"
    held.send_signal(signal.SIGINT)
    out, err = held.communicate(timeout=300)
    assert (held.returncode, out, err) == (130, b"", b"")
