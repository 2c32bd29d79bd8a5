"""Gathers what goes into a report. Missing facts are sentences in `missing`; they never end the report."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from fmfts.bus.lock import serving_pid
from fmfts.common.reading import read_regular
from fmfts.config import BridgeSource, Config, I2cSource
from fmfts.config.file import ConfigError, find, load
from fmfts.contact.no_model import NO_MODEL
from fmfts.contact.shipped import SHIPPED_PATHS
from fmfts.sensor import SourceError
from fmfts.sensor.bridge.serial_port import candidates
from fmfts.sensor.i2c.scan import Found, scanned
from fmfts.sensor.probing import once_connected
from fmfts.sensor.tasks import PATIENCE_S, SELFTEST_S
from fmfts.service.child import ChildDaemon, child_daemon
from fmfts.view.progress import Show
from fmfts_client import request
from fmfts_client.endpoints import OVERRIDE, for_client, named_base
from fmfts_recording.file import read
from fmfts_recording.recorder import Recorder
from fmfts_report import machine, state
from fmfts_report.log import journal

FORMAT = 1
LARGEST_TEXT = 200_000  # bytes of the configuration, and of a log
LARGEST_LOG = 10 * LARGEST_TEXT  # of which the end is taken
BUS_IN_TEXT = re.compile(r"^[ \t]*bus[ \t]*=[ \t]*(\d{1,3})\b", re.MULTILINE)


@dataclass(slots=True)
class Gathering:
    """config_file: as `--config` names it. buses: I2C buses to look at besides those of the configuration."""

    config_file: Path | None
    seconds: float
    with_selftest: bool
    buses: Sequence[int]
    folder: Path
    show: Show
    missing: list[str] = field(default_factory=list)
    recording: Path | None = None
    started: ChildDaemon | None = None  # a daemon for this report alone
    config: Config | None = None
    configuration: dict[str, str] = field(default_factory=dict)

    def facts(self) -> dict[str, Any]:
        self._configure()
        measured = self._measured()
        self.show(0.9, "chips and their registers")
        facts = {
            "format": FORMAT,
            "made_utc": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "missing": self.missing,
            "versions": machine.versions(),
            "machine": machine.machine(),
            "buses": [self._bus(bus) for bus in self._buses()],
            "ports": [machine.serial_port(port) for port in machine.ports_of(self._ports(), candidates())],
            **measured,
            "state": self._state(measured["pads"]),
            "environment": machine.environment(),
            "configuration": self.configuration,
        }
        with self._missing_on_error("the log of the service"):
            facts["log_of_service"] = journal(LARGEST_TEXT)
        return facts

    @contextmanager
    def _missing_on_error(self, what: str) -> Iterator[None]:
        """Every error inside is a sentence in `missing`: a report is written exactly when something is broken."""
        try:
            yield
        except Exception as error:  # noqa: BLE001
            named = re.compile(r"^(?:selftest: )?(?:pad '[\w-]+': )?(?:no self-test: )?")
            self.missing.append(f"{what}: {named.sub('', str(error)) or type(error).__name__}")

    def _configure(self) -> None:
        with self._missing_on_error("configuration"):
            file = find(self.config_file)
            self.configuration["file"] = str(file.absolute())
            try:
                self.config, _ = load(file)
            except ConfigError as error:
                self.configuration["error"] = str(error)
                self.missing.append(f"frames and self-test: the configuration is bad: {error}")
                if not file.exists():
                    return
            self.configuration["text"] = read_regular(file, LARGEST_TEXT).decode(errors="replace")
        for pad in self.config.pad if self.config is not None else ():
            if pad.contact.model not in (NO_MODEL, *SHIPPED_PATHS):
                self.missing.append(f"pad '{pad.name}': its contact model {pad.contact.model}: send that file, too")

    # Through a daemon

    def _measured(self) -> dict[str, Any]:
        measured: dict[str, Any] = {"pads": [], "selftests": [], "recorded": {}, "through": "nobody"}
        with ExitStack() as until_stopped:
            base = None
            with self._missing_on_error("frames and self-test"):
                base, measured["through"] = self._daemon(until_stopped)
            if measured["through"] != "nobody":
                measured |= self._asked(base)
            if self.started is not None and self.started.process.poll() is not None:
                self.missing.append(f"the rest: {self._why_ended('ended while it was asked')}")
        log = self.folder / "daemon.log"
        if log.exists():
            text = read_regular(log, LARGEST_LOG).decode(errors="replace")
            measured["log_of_this_run"] = text[-LARGEST_TEXT:]
        return measured

    def _daemon(self, until_stopped: ExitStack) -> tuple[str | None, str]:
        """The endpoint of the daemon that runs, or of one that is started for the report; and which one that is."""
        base = named_base(None if self.config is None else self.config.bus.endpoint)
        if serving_pid(for_client(base).control) is not None:
            return base, "the running daemon"
        if self.config is None:
            return None, "nobody"
        self.show(0.05, "starting a daemon for the report")
        own = f"ipc://{self.folder}"
        # Its state is a copy: a report changes no baseline and no gains.
        with self._missing_on_error("baselines in use"):
            state.copy_to(self.folder / "state" / "fmfts")
        environment = {name: value for name, value in os.environ.items() if name != "STATE_DIRECTORY"}
        environment |= {OVERRIDE: own, "XDG_STATE_HOME": str(self.folder / "state")}
        child = until_stopped.enter_context(child_daemon(Path(self.configuration["file"]), self.folder, environment))
        if not child.is_serving():
            raise SourceError(self._why_ended("does not serve"))
        self.started = child
        once_connected(lambda: request("probe", endpoint=own))
        return own, "a daemon started for the report"

    def _why_ended(self, what: str) -> str:
        end = (self.folder / "daemon.log").read_text(errors="replace").strip().splitlines()[-1:]
        return f"a daemon started for the report {what}: {''.join(end)}"

    def _asked(self, base: str | None) -> dict[str, Any]:
        facts: dict[str, Any] = {}
        self.show(0.1, f"{self.seconds:g} s of frames")
        with self._missing_on_error("frames"):
            facts["recorded"] = self._record(base)
        with self._missing_on_error("devices"):
            facts["pads"] = _probed(base)
        frames = facts.get("recorded", {}).get("frames", {})
        for pad in facts.get("pads", ()):
            if not frames.get(pad["pad"]):
                reason = pad["reason"] or "; ".join(pad["faults"]) or "no reason is known"
                self.missing.append(f"frames of pad '{pad['pad']}': {reason}")
        facts["selftests"] = self._selftests(base, facts.get("pads", ()))
        return facts

    def _record(self, base: str | None) -> dict[str, Any]:
        path = self.folder / "frames.mcap"
        with closing(Recorder(path, None, base)) as recorder:
            facts = recorder.run(self.seconds)  # Ctrl-C ends the recording only
        self.recording = path
        frames: dict[str, int] = {}
        for one in read(path):
            if one.kind == "frame":
                frames[one.pad] = frames.get(one.pad, 0) + 1
        return {key: facts[key] for key in ("seconds", "messages", "missed_contacts")} | {"frames": frames}

    def _selftests(self, base: str | None, pads: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = []
        for pad in pads if self.with_selftest else ():
            name = pad["pad"]
            self.show(0.7, f"self-test of pad '{name}'")
            with self._missing_on_error(f"self-test of pad '{name}'"):
                found.append(request("selftest", endpoint=base, pad=name, timeout_s=SELFTEST_S + PATIENCE_S))
        if not self.with_selftest:
            self.missing.append("self-test: left out with --no-selftest")
        return found

    # On the devices: no daemon started here holds them any more

    def _buses(self) -> list[int]:
        if self.config is not None:
            sources = (pad.source for pad in self.config.pad)
            named = {source.bus for source in sources if isinstance(source, I2cSource)}
        else:
            named = {int(number) for number in BUS_IN_TEXT.findall(self.configuration.get("text", ""))}
        buses = sorted(named | set(self.buses))
        if not buses and self.config is None:
            there = ", ".join(map(str, machine.adapters())) or "none"
            self.missing.append(f"chips: no I2C bus is named: --i2c BUS names one; this computer has {there}")
        return buses

    def _ports(self) -> list[str]:
        sources = [pad.source for pad in self.config.pad] if self.config is not None else []
        if any(isinstance(source, BridgeSource) for source in sources):
            self.missing.append("registers of chips on a board: they can be read on this computer's I2C buses only")
        return [source.serial_port for source in sources if source.serial_port is not None]

    def _bus(self, bus: int) -> dict[str, Any]:
        facts = machine.adapter(bus)
        with self._missing_on_error(f"chips on /dev/i2c-{bus}"):
            try:
                found = scanned(bus, registers=True)
            except SourceError as error:
                holder = "" if "in use" not in str(error) else " (the service: `systemctl stop fmfts`), then `report`"
                facts["reason"] = f"{error}{holder}"
                raise SourceError(facts["reason"]) from error
            facts["chips"] = [_chip(one) for one in found]
            if not found:
                self.missing.append(f"chips on /dev/i2c-{bus}: no chip that this daemon knows answers")
        return facts

    # In files

    def _state(self, pads: Sequence[dict[str, Any]]) -> dict[str, str]:
        """The files of baselines and self-tests, by their places."""
        files: dict[str, str] = {}
        for name in [pad.name for pad in self.config.pad] if self.config is not None else [pad["pad"] for pad in pads]:
            with self._missing_on_error(f"baseline of pad '{name}'"):
                files |= state.files_of(name)
                if str(state.baseline_file(name)) not in files:
                    self.missing.append(f"baseline of pad '{name}': there is no {state.baseline_file(name)}")
        return files


def _probed(base: str | None) -> list[dict[str, Any]]:
    pads: list[dict[str, Any]] = request("probe", endpoint=base)["pads"]
    return pads


def _chip(found: Found) -> dict[str, Any]:
    facts: dict[str, Any] = {"chip": found.chip, "address": found.address}
    if found.mux_address is not None:
        facts |= {"mux_address": found.mux_address, "channel": found.channel}
    return facts | {"registers": list(found.registers)}


def new_name() -> Path:
    return Path(f"fmfts-report-{time.strftime('%Y%m%d-%H%M%S')}.mcap")
