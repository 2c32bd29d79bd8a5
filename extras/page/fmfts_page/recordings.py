"""Recordings that the page makes and shows again: files of one folder, made by `fmfts-daemon record`."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from fmfts.bus.messages import AnyMessage, ContactMessage, EventMessage, StateMessage, StatusMessage
from fmfts.common.reading import damage_told
from fmfts.common.writing import why_not_written
from fmfts.config.pad_facts import pad_facts
from fmfts_client import KEY_VARIABLE
from fmfts_client.endpoints import OVERRIDE
from fmfts_recording.file import RecordingError, read
from fmfts_recording.pad_config import recorded_pad

BEGINNING_S, ENDING_S = 20.0, 10.0
LOOK_S = 0.02
LISTED = 100
SHOWN = ("contact", "event", "status")


class RecordingsError(Exception):
    """A request about recordings fails; the text says why, and what to do."""


class Recordings:
    """folder: where recordings are. base: the endpoint base of the recorded daemon, as in FMFTS_BUS; None: default.

    key: the file of the client's key, as in FMFTS_KEY; None: whatever that names. begins: what files' names begin with.
    """

    def __init__(self, folder: Path, base: str | None, key: Path | None = None, begins: str = "fmfts") -> None:
        self.folder = folder
        self._begins = begins
        self._environment = ({} if base is None else {OVERRIDE: base}) | (
            {} if key is None else {KEY_VARIABLE: str(key)}
        )
        self._lock = threading.Lock()  # two pages may press the button at once
        self._recorder: subprocess.Popen[str] | None = None
        self._path = folder
        self._failure: str | None = None

    @property
    def under_way(self) -> str | None:
        """The name of the file that is being written."""
        recorder = self._recorder
        return self._path.name if recorder is not None and recorder.poll() is None else None

    def begin(self) -> dict[str, Any]:
        """Start to record all pads into a new file, and wait until messages go there.

        RecordingsError if one is under way, or it fails.
        """
        with self._lock:
            if self.under_way is not None:
                raise RecordingsError(f"{self._path} is being recorded already")
            if not self.folder.is_dir() or not os.access(self.folder, os.W_OK):
                raise RecordingsError(
                    f"no recording can be written to {self.folder}: start `fmfts-daemon view` with --recordings FOLDER"
                )
            self._path = self.folder / f"{self._begins}-{datetime.now():%Y-%m-%d-%H%M%S}.mcap"
            command = [sys.executable, "-m", "fmfts", "record", str(self._path), "--json"]
            pipe = subprocess.PIPE
            try:
                self._recorder = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, text=True,
                    env=os.environ | self._environment,
                    start_new_session=True,  # Ctrl-C is for us; the recorder is told by `end`
                )  # fmt: skip
            except OSError as error:
                raise RecordingsError(f"the recorder cannot be started: {why_not_written(error)}") from error
            self._failure = None
            self._await_file(self._recorder)
            return {"recording": self._path.name}

    def _await_file(self, recorder: subprocess.Popen[str]) -> None:
        """The recorder makes its file when it has subscribed."""
        until_s = time.monotonic() + BEGINNING_S
        while not self._path.exists():
            if recorder.poll() is None and time.monotonic() < until_s:
                time.sleep(LOOK_S)
                continue
            self._recorder = None
            recorder.kill()
            _, said = recorder.communicate()
            raise RecordingsError(said.strip() or f"{self._path}: the recorder did not begin")

    def failure(self) -> str | None:
        """Why the recorder ended by itself; None if it did not. Does not wait."""
        if self._lock.acquire(blocking=False):
            try:
                recorder = self._recorder
                if recorder is not None and recorder.poll() is not None:
                    self._recorder = None
                    _, said = recorder.communicate()
                    self._failure = said.strip() or f"{self._path}: the recorder ended by itself"
            finally:
                self._lock.release()
        return self._failure

    def end(self) -> dict[str, Any]:
        """Stop recording; the facts of the file. RecordingsError if none is under way, or it failed."""
        with self._lock:
            recorder, self._recorder = self._recorder, None
        if recorder is None:
            raise RecordingsError("nothing is being recorded")
        if recorder.poll() is None:
            recorder.send_signal(signal.SIGTERM)
        try:
            out, said = recorder.communicate(timeout=ENDING_S)
        except subprocess.TimeoutExpired as error:
            recorder.kill()
            recorder.communicate()
            raise RecordingsError(f"{self._path}: the recorder did not end: its last second may be missing") from error
        if recorder.returncode != 0:
            raise RecordingsError(said.strip() or f"the recorder ended with {recorder.returncode}")
        facts: dict[str, Any] = json.loads(out)
        return facts

    def names(self) -> list[str]:
        """The files of the folder, the newest first."""
        try:
            found = [(path.stat().st_mtime_ns, path.name) for path in self.folder.glob("*.mcap")]
        except OSError:
            return []
        return [name for _, name in sorted(found, reverse=True)[:LISTED]]

    def path_of(self, name: str) -> Path:
        """The file of this name. RecordingsError unless the folder lists it: a page names no other file."""
        if name not in self.names():
            raise RecordingsError(f"there is no recording {name} in {self.folder}")
        return self.folder / name

    def close(self) -> None:
        if self.under_way is not None:
            self.end()


def pads_of(path: Path) -> list[dict[str, Any]]:
    """Facts of the pads in a recording, as `pads` of the control socket gives for running ones."""
    found: dict[str, dict[str, Any]] = {}
    named = set()
    for one in read(path):
        named.add(one.pad)
        if isinstance(one.message, StateMessage):
            found.setdefault(one.pad, _facts(path, one.message))
        elif one.kind == "frame" and named == found.keys():
            break  # a pad's state comes before its first frame
    return list(found.values())


def _facts(path: Path, state: StateMessage) -> dict[str, Any]:
    with damage_told(RecordingError, f"{path}: its configuration of pad '{state.pad}' is another version's"):
        return {"pad": state.pad} | pad_facts(recorded_pad(state.config))


def messages_of(path: Path, stopped: Callable[[], bool], since_ns: int = 0) -> Iterator[tuple[int, bytes, bytes]]:
    """Yields (time of sending in ns, topic, body) of each message that a page shows, in order.

    since_ns: UTC; earlier messages are left out.
    """
    encode = msgspec.msgpack.encode
    for one in read(path, since_ns):
        if stopped():
            return
        if one.kind in SHOWN:
            with damage_told(RecordingError, f"{path}: a message of {one.kind}/{one.pad} is damaged"):
                shown = sent_ns(one.message), f"{one.kind}/{one.pad}".encode(), encode(one.message)
            yield shown


def sent_ns(message: AnyMessage) -> int:
    assert isinstance(message, ContactMessage | EventMessage | StatusMessage)
    return message.t_ns if isinstance(message, EventMessage) else message.t_publish_ns
