from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = (
    "scipy",
    "rich",
    "sklearn",
    "onnx",
    "matplotlib",
    "magpylib",
    "hypothesis",
    "websockets",
    "asyncio",
    "multiprocessing",
)


@pytest.mark.parametrize(
    "module",
    [
        "fmfts_client",
        "fmfts.cli.main",
        "fmfts.runtime.daemon",
        "fmfts.sensor.bridge.bridge",
        "fmfts.sensor.i2c.source",
        "fmfts.sensor.i2c.reader",
    ],
)
def test_frequent_programs_import_nothing_heavy(module: str) -> None:
    code = f"import sys, {module}; print(*(name for name in {HEAVY} if name in sys.modules))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == []


def test_manual_pages_are_made_without_numpy() -> None:
    """Debian's package makes them where nothing but Python is installed."""
    code = "import sys; sys.modules['numpy'] = None; import manual_pages; print('made')"
    packaging = Path(__file__).parents[2] / "systemd"
    found = subprocess.run([sys.executable, "-c", code], cwd=packaging, capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["made"]


def test_running_daemon_does_without_onnxruntime_where_model_is_compiled() -> None:
    code = (
        "import sys, fmfts.runtime.daemon; from fmfts.config import PadConfig, SimulatedSource; "
        "from fmfts.contact import ContactModel; "
        "pad = PadConfig(name='a', source=SimulatedSource()).pad(); "
        "print(ContactModel.load('default', pad).inference.by, 'onnxruntime' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() in (["compiled", "False"], ["onnxruntime", "True"])


def test_reader_process_of_a_bus_does_without_the_model() -> None:
    code = (
        "import sys, fmfts.sensor.i2c.reader; print(*(name for name in ('onnxruntime', 'zmq') if name in sys.modules))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == []
