"""`fmfts-daemon demo`: runs the daemon, a live view in the terminal and the page, with their own sockets and state.

Its simulated pads are set up before the daemon starts, as a user sets up a real one.
"""

# Slow imports are in `main`, where Ctrl-C is handled.
from __future__ import annotations

import argparse
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from fmfts.cli.verb import AddVerb, VerbError, seconds
from fmfts.common import exit_codes
from fmfts.service.child import ENDING, START_S, child_daemon

LAST_LINES = 20


@contextmanager
def running_daemon(config: Path, folder: Path) -> Iterator[str]:
    """Run `fmfts-daemon run` as a process with state and log in `folder`; yield the base of its endpoints.

    Its sockets are there, too, unless FMFTS_BUS names another folder: a client can reconnect only to the same one.
    The caller handles Ctrl-C; it also gets a KeyboardInterrupt when the daemon ends by itself. If the daemon ends or
    does not start, prints the end of its log and raises SystemExit.
    """
    sockets = _sockets(folder)
    base, environment = _base(sockets), _environment(folder, sockets)
    serving, daemon = False, None
    try:
        with child_daemon(config, folder, environment, sockets) as daemon:
            serving = daemon.is_serving()
            if serving:
                with _interrupted_by_the_end_of(daemon.process):
                    yield base
    finally:
        ended = None if daemon is None else daemon.ended
        if ended is not None or (not serving and sys.exc_info()[0] is None):
            _explain(folder / "daemon.log", ended)


def _base(sockets: Path) -> str:
    return f"ipc://{sockets}"


def _environment(folder: Path, sockets: Path) -> dict[str, str]:
    """The daemon's."""
    from fmfts_client.endpoints import OVERRIDE

    return os.environ | {OVERRIDE: _base(sockets), "XDG_STATE_HOME": str(folder / "state")}


def _sockets(folder: Path) -> Path:
    """The folder that FMFTS_BUS names, else `folder`. VerbError if a demo cannot serve there."""
    from fmfts.bus.lock import BusError, serving_pid, socket_path
    from fmfts_client.endpoints import OVERRIDE, EndpointError, for_daemon, named_base

    if (named := named_base()) is None:
        return folder
    try:
        endpoints = for_daemon()
        bus = socket_path(endpoints.bus)
        if bus is None:
            raise VerbError(
                exit_codes.USAGE, f"{OVERRIDE}={named} is no folder: give ipc:///absolute/directory, or unset it"
            )
        if serving_pid(endpoints.control) is not None:
            raise VerbError(
                exit_codes.UNAVAILABLE, f"another fmfts-daemon serves {named}: stop it, or unset {OVERRIDE}"
            )
    except (BusError, EndpointError) as error:
        raise VerbError(exit_codes.code_of(error), str(error)) from error
    if bus.is_socket():
        bus.unlink()  # left by a daemon that was killed; the new one would seem to serve already
    return bus.parent


@contextmanager
def _interrupted_by_the_end_of(daemon: subprocess.Popen[bytes]) -> Iterator[None]:
    def interrupt(*_: object) -> None:
        if daemon.poll() is not None:  # SIGCHLD also tells of a stop (Ctrl-Z)
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGCHLD, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGCHLD, before)


def _explain(log: Path, code: int | None) -> None:
    """Prints the end of the log, because the log's folder will be deleted, and raises SystemExit."""
    what = f"did not serve within {START_S:g} s" if code is None else f"ended with {code}"
    lines = log.read_text().splitlines()[-LAST_LINES:]
    print(f"fmfts-daemon {what}; the end of its log:", *lines, sep="\n", file=sys.stderr)
    raise SystemExit(max(code or 1, 1))


def end_on_signals() -> None:
    """Make signals raise KeyboardInterrupt, so that the daemon is stopped and its folder deleted.

    An ignored SIGINT stays ignored: then make's shell passes Ctrl-C on as SIGTERM.
    """
    for number in ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)


def add_to(verb: AddVerb) -> None:
    _add_seconds(verb("demo", _quietly, "show a simulated pad in this terminal", "another than the simulated pad's"))


def _add_seconds(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=seconds, help="end after this time; else Ctrl-C ends it")
    parser.add_argument("--pad", choices=["standard", "array"], default="standard", help="array: four magnets")
    parser.add_argument(
        "--fingers", type=int, choices=[1, 2], default=1, help="2: two that meet and part (--pad array)"
    )


def _quietly(options: argparse.Namespace) -> int:
    try:
        return _demo(options)
    except KeyboardInterrupt:
        return 0


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m fmfts_simulation.demo", description=__doc__)
    parser.add_argument("--config", type=Path, metavar="FILE", help="another than the simulated pad's")
    _add_seconds(parser)
    return _demo(parser.parse_args())


def _demo(options: argparse.Namespace) -> int:
    end_on_signals()
    with tempfile.TemporaryDirectory(prefix="fmfts-demo-") as name:
        folder = Path(name)
        config = options.config or _config(options, folder)
        set_up_pads(config, _environment(folder, folder))
        return _shown(config, folder, options.seconds)


def _shown(config: Path, folder: Path, seconds: float | None) -> int:
    from fmfts.view.listen import listen
    from fmfts_simulation.page_beside import page_beside

    with running_daemon(config, folder) as base, page_beside(folder, base) as page_line:
        print(page_line(), flush=True)
        print(f"another terminal: {command_beside(base)} listen    (or status)", flush=True)
        return listen(None, seconds, endpoint=base)


def set_up_pads(config: Path, environ: Mapping[str, str]) -> None:
    """Store baselines of the simulated pads after self-test, bare, rest and turn, and say so.

    environ: of the daemon that will use them. Does not report a wrong file, because the daemon does.
    """
    from fmfts.baseline.files import store
    from fmfts.config import SimulatedSource, neighbours_of
    from fmfts.config.file import ConfigError, load
    from fmfts_simulation.set_up import set_up

    try:
        pads = load(config)[0].pad
    except ConfigError:
        return
    for pad in pads:
        if not isinstance(pad.source, SimulatedSource):
            continue
        begun_s = time.monotonic()
        baseline, steps = set_up(pad, neighbours_of(pad, pads))
        store(baseline, pad.pad(), environ)
        print(
            f"pad {pad.name}: {', '.join(steps[:-1])} and {steps[-1]} were simulated in "
            f"{time.monotonic() - begun_s:.1f} s, as one sets up a real pad",
            flush=True,
        )


def command_beside(base: str) -> str:
    """The beginning of a shell's line for a verb that uses the daemon at `base`."""
    from fmfts_client.endpoints import OVERRIDE

    program = "fmfts-daemon"
    beside = Path(sys.executable).with_name(program)
    if shutil.which(program) is None:
        program = shlex.quote(str(beside)) if beside.exists() else f"{shlex.quote(sys.executable)} -m fmfts"
    return f"{OVERRIDE}={shlex.quote(base)} {program}"


def _config(options: argparse.Namespace, folder: Path) -> Path:
    """The requested standard pad's configuration."""
    from fmfts.config.example import ARRAY_PATH, EXAMPLE_PATH

    if options.pad == "standard":
        if options.fingers == 2:
            raise VerbError(
                exit_codes.USAGE, "one magnet cannot distinguish two fingers: --pad array has four (docs/several.md)"
            )
        return EXAMPLE_PATH
    config = folder / "array.toml"
    text = ARRAY_PATH.read_text(encoding="utf-8")
    config.write_text(text.replace("fingers = 1 ", f"fingers = {options.fingers} "), encoding="utf-8")
    return config


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except VerbError as refused:
        print(f"demo: {refused}", file=sys.stderr)
        raise SystemExit(refused.code) from None
    except KeyboardInterrupt:
        raise SystemExit(0) from None
