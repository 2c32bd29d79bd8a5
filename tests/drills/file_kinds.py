"""The kinds of files that fmfts reads: a whole one of each, its reader, and the one error that the reader may raise."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

import msgspec

from drills.file_damage import LyingRecording, Remade, mutated, proto_damaged, retokened, toml_of
from fmfts.baseline import Baseline, BaselineError, load
from fmfts.baseline.files import path_of, store_gains, stored_gains
from fmfts.bus.keys import KeyFolder, KeysError
from fmfts.common.toml import parse
from fmfts.config import PadConfig, ReplaySource, SimulatedSource, file
from fmfts.config.file import ConfigError
from fmfts.contact import ContactModel, ModelError, beside
from fmfts.contact.array_model import ARRAY_PATH
from fmfts.contact.array_response import ArrayResponse, ResponseError
from fmfts.contact.inference import NetworkInference
from fmfts.contact.seal import unsealed, with_seal
from fmfts.contact.shipped import DEFAULT_PATH
from fmfts.sensor.source import SourceError
from fmfts_calibrate.dataset import read_calibration_set
from fmfts_calibrate.field_table import DataError
from fmfts_client.keys import BadKeyError, client_key
from fmfts_collect.errors import RefusedError
from fmfts_collect.machine_log import read_log
from fmfts_collect.plan import PRESETS, PlanError, read_plan
from fmfts_lab.finite_elements.pad_file import write_pad_file
from fmfts_lab.finite_elements.slab import Slab
from fmfts_page.recordings import messages_of, pads_of
from fmfts_recording.file import RecordingError, RecordingWriter
from fmfts_recording.file import read as read_recording
from fmfts_recording.repair import repair
from fmfts_recording.replay import Replay
from fmfts_recording.source import Replayed
from fmfts_report.file import lines_of
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.pad_file import PadFileError, read_pad_file
from fmfts_simulation.solved_table import standard_mechanics

ROOT = Path(__file__).parents[2]
CONFIG = PadConfig(name="left", source=SimulatedSource())
ASKED_EVERY = 5  # contact models: onnxruntime takes half a second, so it is asked about one in this many
POLLS, POLL_NS = 60, 5_000_000  # of a replayed recording


@dataclass(frozen=True)
class Kind:
    """A kind of file: an intact one, its reader, and the only error that the reader may raise.

    remade: rewrites one with an error that no checksum shows; None: only bytes are damaged. hashed: a file whose bytes
    differ from the intact one must be refused, or read the same. cost: of reading one, about, in ms.
    """

    whole: bytes
    read: Callable[[Path], object]
    error: type[Exception]
    name: str
    remade: Remade | None = None
    hashed: bool = False
    cost: float = 1.0


def kinds(folder: Path) -> list[Kind]:
    """Needs `folder` as XDG_STATE_HOME."""
    pad, baseline = CONFIG.pad(), simulated_baseline(CONFIG)
    gains = {"sensors": [{"gain_factor": [1.0, 1.01, 0.99]}] * 4, "gain_factor_sd": 0.005}
    store_gains(gains, pad, None)
    toml, plan = (ROOT / "config.toml").read_bytes(), (PRESETS / "experiment.toml").read_bytes()
    small = folder / "small.mcap"
    recording = _small_recording(small)
    report = ROOT / "tests" / "data" / "reports" / "qmc5883l-emulated.mcap"
    write_pad_file(folder / "pad.npz", standard_mechanics(), Slab())
    rows = (ROOT / "tests" / "data" / "calibration_1.23T.csv").read_bytes()
    log = b"t_s,x_mm,y_mm,force_n\n" + b"".join(b"%.1f,1,2,%.2f\n" % (row / 10, row % 7) for row in range(60))
    selftest, model = path_of("left", "selftest").read_bytes(), DEFAULT_PATH.read_bytes()
    table = msgspec.msgpack.decode(ARRAY_PATH.read_bytes())
    keys = KeyFolder(folder / "keys")
    keys.add("arm", folder / "arm.key")

    def use_baseline(path: Path) -> object:
        found = load(path, pad)
        return found and (found.id, found.mounting(pad).chi2)

    def use_model(path: Path) -> object:
        content = path.read_bytes()
        asked = beside._asked if content == model or zlib.crc32(content) % ASKED_EVERY == 0 else _nobody
        with patch.object(beside, "_asked", asked):
            found = ContactModel.load(str(path), pad)
        network = found.inference.network if isinstance(found.inference, NetworkInference) else None
        return network, found.facts

    def use_gains(path: Path) -> object:
        path_of("left", "selftest").write_bytes(path.read_bytes())
        return stored_gains(pad, None)

    def use_keys(name: str) -> Callable[[Path], object]:
        def use(path: Path) -> object:
            whole = (folder / "keys" / name).read_bytes()
            (folder / "keys" / name).write_bytes(path.read_bytes())
            try:
                keys.check()
            finally:
                (folder / "keys" / name).write_bytes(whole)
            return None

        return use

    def use_client_key(path: Path) -> object:
        path.chmod(0o600)
        return client_key(path)

    recorded = LyingRecording(small)
    return [
        Kind(
            msgspec.json.encode(baseline), use_baseline, BaselineError, "baseline", _json(baseline, _resealed), True, 6
        ),
        Kind(selftest, use_gains, BaselineError, "self-test", _json(json.loads(selftest))),
        Kind(model, use_model, ModelError, "model", _model(model), True, 100),
        Kind(ARRAY_PATH.read_bytes(), _array, ResponseError, "table of presses", _packed(table), cost=3),
        Kind(toml, lambda path: file.load(path)[0], ConfigError, "config", _toml(toml), cost=10),
        Kind(recording, _all_of, RecordingError, "recording", recorded, cost=5),
        Kind(
            recording, lambda path: sum(1 for _ in Replay(path).contacts()), RecordingError, "replay", recorded, cost=30
        ),
        Kind(recording, _played, SourceError, "played recording", recorded, cost=10),
        Kind(recording, _shown, RecordingError, "recording of the page", recorded, cost=5),
        Kind(recording[:-8], _repaired, RecordingError, "recording to repair", recorded, cost=10),
        Kind(
            report.read_bytes(),
            lambda path: list(lines_of(path)),
            RecordingError,
            "report",
            LyingRecording(report),
            cost=5,
        ),
        Kind(rows, read_calibration_set, DataError, "labelled data", lambda dice: retokened(rows, dice), cost=10),
        Kind(log, read_log, RefusedError, "machine's log", lambda dice: retokened(log, dice)),
        Kind(plan, lambda path: read_plan(str(path)), PlanError, "plan", _toml(plan), cost=3),
        Kind((folder / "pad.npz").read_bytes(), read_pad_file, PadFileError, "pad model", cost=3),
        Kind((folder / "keys" / "server.key").read_bytes(), use_keys("server.key"), KeysError, "daemon's key"),
        Kind((folder / "keys" / "clients").read_bytes(), use_keys("clients"), KeysError, "list of clients"),
        Kind((folder / "arm.key").read_bytes(), use_client_key, BadKeyError, "client's key"),
    ]


def _model(model: bytes) -> Remade:
    """Most have the matching seal, like a file that somebody edited."""

    def remade(dice: Random) -> bytes:
        damaged = proto_damaged(unsealed(model), dice)
        return damaged if dice.random() < 0.3 else with_seal(damaged)

    return remade


def _nobody(*_: object) -> bytes:
    """Replaces the process with onnxruntime for most inputs."""
    raise ValueError("not for this input")


def _array(path: Path) -> object:
    return ArrayResponse.of(path.read_bytes(), str(path)).pressed(1.0, 2.0, 3.0)


def _all_of(path: Path) -> object:
    return sum(1 for _ in read_recording(path))


def _played(path: Path) -> object:
    source = Replayed({0: PadConfig(name="left", source=ReplaySource(file=str(path), loop=True, rate_hz=220))})
    try:
        return [len(source.poll(10**12 + number * POLL_NS)) + (source.deadline_ns() or 0) for number in range(POLLS)]
    finally:
        source.close()


def _shown(path: Path) -> object:
    return pads_of(path), sum(len(body) for _, _, body in messages_of(path, lambda: False))


def _repaired(path: Path) -> object:
    new = path.with_suffix(".new")
    new.unlink(missing_ok=True)
    return repair(path, new)["messages"]


def _json(document: Any, made: Callable[[Any], bytes] | None = None) -> Remade:
    plain = msgspec.to_builtins(document)
    encode = made or (lambda one: json.dumps(one).encode())
    return lambda dice: retokened(encode(plain), dice) if dice.random() < 0.3 else encode(mutated(plain, dice))


def _packed(document: Any) -> Remade:
    def remade(dice: Random) -> bytes:
        for _ in range(3):
            with suppress(OverflowError):  # an integer that msgpack cannot encode
                return msgspec.msgpack.encode(mutated(document, dice))
        return b"\xc1"

    return remade


def _toml(text: bytes) -> Remade:
    document = parse(text.decode())
    return lambda dice: retokened(text, dice) if dice.random() < 0.5 else toml_of(mutated(document, dice))


def _resealed(document: Any) -> bytes:
    """A baseline's bytes with the matching id, like a file that somebody edited by hand."""
    if isinstance(document, dict):
        blank = json.dumps({**document, "id": ""})
        try:
            document = {**document, "id": msgspec.json.decode(blank, type=Baseline).sealed().id}
        # The reader under test is judged by its result.
        except (msgspec.MsgspecError, ValueError, TypeError, ArithmeticError):
            document = {**document, "id": hashlib.sha256(blank.encode()).hexdigest()[:12]}
    return json.dumps(document).encode()


def _small_recording(path: Path) -> bytes:
    """The first state of a recording, and the frames and contacts of a tenth of a second."""
    writer, kept = RecordingWriter(path), Counter[str]()
    for one in read_recording(ROOT / "tests" / "data" / "recordings" / "taps.mcap"):
        kept[one.kind] += 1
        if kept[one.kind] <= {"state": 1}.get(one.kind, 20):
            writer.add(one.kind, one.pad, msgspec.to_builtins(one.message))
    writer.finish()
    writer.close()
    return path.read_bytes()
