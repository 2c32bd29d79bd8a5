"""Damages files of every kind at random, and wants of each reader that it fails in one way: with its own named error.

    python tests/drills/file_fuzz.py --inputs 1000000

Half of the damages hit the bytes: bits flipped, bytes replaced, cut, doubled, inserted. The others are to what decodes:
any value of a JSON or TOML document becomes another one, and the hash of a baseline is made to fit again. No file is
believed by chance alone: of the damages to bytes, a file with a hash must let none in that changes a number.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from fmfts.baseline import Baseline, BaselineError, load
from fmfts.baseline.files import path_of, store_gains, stored_gains
from fmfts.bus.client_list import ClientList, KeysError
from fmfts.bus.keys import KeyFolder
from fmfts.calibrate.dataset import read_calibration_set
from fmfts.calibrate.field_table import DataError
from fmfts.collect.errors import RefusedError
from fmfts.collect.machine_log import read_log
from fmfts.collect.plan import PRESETS, PlanError, read_plan
from fmfts.config import PadConfig, SimulatedSource, file
from fmfts.config.file import ConfigError
from fmfts.contact import ContactModel, ModelError
from fmfts.contact.inference import NetworkInference
from fmfts.contact.shipped import DEFAULT_PATH
from fmfts.offline.replay import Replay
from fmfts.recording.file import RecordingError, RecordingWriter
from fmfts.recording.file import read as read_recording
from fmfts.simulation.baseline import simulated_baseline
from fmfts.simulation.pad_file import PadFileError, read_pad_file, write_pad_file
from fmfts.simulation.slab import Slab
from fmfts.simulation.solved_table import standard_mechanics
from fmfts_client.keys import BadKeyError, client_key

ROOT = Path(__file__).parents[2]
CONFIG = PadConfig(name="left", source=SimulatedSource())
WEIRD: Sequence[Any] = (
    None, True, -1, 0, 1, 2**31, 2**63, 10**400, -(2**63), 0.0, -0.5, 1e-300, 1e300, 1.5, "", "left", "é\x00",
    "9" * 5000, [], {}, [[]], [1.0, 2.0], {"": None}, "NaN", "2024-01-01",
)  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """A kind of file: a whole one, how it is read, and the only error that the reader may raise.

    structured: how a document with other values becomes bytes; None: only bytes are damaged. hashed: a file whose bytes
    differ from the whole one is refused, or says the same.
    """

    whole: bytes
    read: Callable[[Path], object]
    error: type[Exception]
    name: str
    structured: Callable[[Any], bytes] | None = None
    hashed: bool = False


def damaged(whole: bytes, dice: random.Random) -> bytes:
    spoilt = bytearray(whole)
    for _ in range(dice.choice((1, 1, 1, 2, 5, 40))):
        at = dice.randrange(len(spoilt) + 1)
        some = dice.randrange(1, 20)
        match dice.randrange(7):
            case 0 if at < len(spoilt):
                spoilt[at] ^= 1 << dice.randrange(8)
            case 1 if at < len(spoilt):
                spoilt[at] = dice.choice((0, 0xFF, 0x80, 0xC3, dice.randrange(256)))
            case 2:
                del spoilt[at : at + some]
            case 3:
                spoilt[at:at] = spoilt[at : at + some]
            case 4:
                spoilt[at:at] = dice.randbytes(some)
            case 5:
                spoilt[at : at + some] = dice.choice((b"1e999", b"-", b"NaN", b"[" * 2000, b"\x00", b'"', b"9" * 30))
            case _ if dice.random() < 0.2:
                del spoilt[at:]
    return bytes(spoilt)


def mutated(document: Any, dice: random.Random) -> Any:
    """The document with one value replaced, left out or doubled, anywhere in it."""
    document = json.loads(json.dumps(document))
    at: Any = document
    while True:
        keys = list(at) if isinstance(at, dict) else list(range(len(at)))
        if not keys:
            return document
        key = dice.choice(keys)
        if isinstance(at[key], (dict, list)) and at[key] and dice.random() < 0.9:
            at = at[key]
            continue
        match dice.randrange(4):
            case 0:
                del at[key]
            case 1 if isinstance(at, list):
                at.append(at[key])
            case _:
                at[key] = dice.choice(WEIRD)
        return document


def resealed(document: Any) -> bytes:
    """A baseline's bytes with the id that fits, as somebody who edits it by hand may write."""
    if isinstance(document, dict):
        blank = json.dumps({**document, "id": ""})
        try:
            document = {**document, "id": msgspec.json.decode(blank, type=Baseline).sealed().id}
        # The reader under test is judged by what it makes of it.
        except (msgspec.MsgspecError, ValueError, TypeError, ArithmeticError):
            document = {**document, "id": hashlib.sha256(blank.encode()).hexdigest()[:12]}
    return json.dumps(document).encode()


def kinds(folder: Path) -> list[Kind]:
    pad, baseline = CONFIG.pad(), simulated_baseline(CONFIG)
    gains = {"sensors": [{"gain_factor": [1.0, 1.01, 0.99]}] * 4, "gain_factor_sd": 0.005}
    store_gains(gains, pad, None)
    toml = (ROOT / "config.toml").read_bytes()
    recording = _small_recording(folder / "small.mcap")
    write_pad_file(folder / "pad.npz", standard_mechanics(), Slab())
    rows = (ROOT / "tests" / "data" / "calibration_1.23T.csv").read_bytes()
    log = b"t_s,x_mm,y_mm,force_n\n" + b"".join(b"%.1f,1,2,%.2f\n" % (row / 10, row % 7) for row in range(60))

    def use_baseline(path: Path) -> object:
        found = load(path, pad)
        return found and (found.id, found.mounting(pad).chi2)

    def use_model(path: Path) -> object:
        model = ContactModel.load(str(path), pad)
        assert isinstance(model.inference, NetworkInference)
        return model.inference.network, model.facts

    keys = KeyFolder(folder / "keys")
    for name in ("arm", "leg"):
        keys.add(name, folder / f"{name}.key")
    server_key, client_list = folder / "keys" / "server.key", folder / "keys" / "clients"

    def use_server_key(path: Path) -> object:
        server_key.write_bytes(path.read_bytes())
        return keys.server().public

    def use_client_key(path: Path) -> object:
        path.chmod(0o600)
        key = client_key(path)
        return key and key.public

    def use_gains(path: Path) -> object:
        path_of("left", "selftest").write_bytes(path.read_bytes())
        return stored_gains(pad, None)

    return [
        Kind(msgspec.json.encode(baseline), use_baseline, BaselineError, "baseline", resealed, hashed=True),
        Kind(path_of("left", "selftest").read_bytes(), use_gains, BaselineError, "self-test", _json),
        Kind(DEFAULT_PATH.read_bytes(), use_model, ModelError, "model", hashed=True),
        Kind(toml, lambda path: file.load(path)[0], ConfigError, "config"),
        Kind(recording, lambda path: sum(1 for _ in read_recording(path)), RecordingError, "recording"),
        Kind(recording, lambda path: sum(1 for _ in Replay(path).contacts()), RecordingError, "replay"),
        Kind(rows, read_calibration_set, DataError, "labelled data"),
        Kind(log, read_log, RefusedError, "machine's log"),
        Kind((PRESETS / "experiment.toml").read_bytes(), lambda path: read_plan(str(path)), PlanError, "plan"),
        Kind((folder / "pad.npz").read_bytes(), read_pad_file, PadFileError, "pad model"),
        Kind(server_key.read_bytes(), use_server_key, KeysError, "daemon's key", hashed=True),
        Kind((folder / "arm.key").read_bytes(), use_client_key, BadKeyError, "client's key", hashed=True),
        Kind(client_list.read_bytes(), lambda path: ClientList(path).read(), KeysError, "list of keys"),
    ]


def fuzzed(kind: Kind, folder: Path, inputs: int, seed: int) -> Counter[str]:
    """Counts of what the reader said. AssertionError with the damage that fooled it."""
    dice, said = random.Random(f"{kind.name} {seed}"), Counter[str]()
    path = folder / "damaged"
    path.write_bytes(kind.whole)
    right = kind.read(path)
    document = json.loads(kind.whole) if kind.structured else None
    for number in range(inputs):
        structured = kind.structured is not None and number % 2 == 1
        spoilt = kind.structured(mutated(document, dice)) if structured else damaged(kind.whole, dice)  # type: ignore[misc]
        path.write_bytes(spoilt)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # arithmetic beyond any pad's numbers
                answer = kind.read(path)
        except kind.error:
            said["refused"] += 1
        except Exception as error:
            kept = Path(tempfile.gettempdir()) / f"fooled-{kind.name.replace(' ', '-')}-{number}"
            kept.write_bytes(spoilt)
            raise AssertionError(f"{kind.name}, input {number}, kept as {kept}: {type(error).__name__}") from error
        else:
            said["read"] += 1
            if kind.hashed and not structured:
                assert answer == right, f"{kind.name}, input {number}: believed, and says something else"
    return said


def _json(document: Any) -> bytes:
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--inputs", type=int, default=1_000_000, help="in all; each kind of file gets its share of time"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("kinds", nargs="*", help="only these kinds")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        import os

        os.environ["XDG_STATE_HOME"] = folder
        chosen = [kind for kind in kinds(Path(folder)) if not options.kinds or kind.name in options.kinds]
        for kind in chosen:
            begun = time.monotonic()
            said = fuzzed(kind, Path(folder), options.inputs // len(chosen), options.seed)
            print(f"{kind.name}: {dict(said)}, {time.monotonic() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main()
