"""The C client compiled as strictly as it can be, and the programs that its tests talk to."""

from __future__ import annotations

import hashlib
import json
import os
import select
import shutil
import struct
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fmfts.bus.publisher import Publisher
from needed import missing
from unit.bus_messages import contact_message

ROOT = Path(__file__).parents[2]
CLIENT = ROOT / "clients" / "c"
HERE = Path(__file__).parent
BUILT = ROOT / "build/c_client"
STRICT = ["-std=c11", "-g", "-O1", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wshadow", "-Wpedantic"]
SANITIZED = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer"]
NEW, NOTHING, REFUSED, WRONG_VERSION = 1, 0, -1, -2
LIVENESS_S = 60.0  # a generous bound for anything that must happen at all
ANSWER_S = 60.0  # no question takes longer, why() of 20 s among them


def need(program: str) -> str:
    """The path of a program; the test is skipped where it is missing, and fails on CI."""
    found = shutil.which(program)
    if found is None:
        missing(program)
    return found or ""


def pkg_config(*words: str, environment: dict[str, str] | None = None) -> list[str]:
    asked = subprocess.run([need("pkg-config"), *words], capture_output=True, text=True, env=environment, check=False)
    if asked.returncode != 0:
        missing("libzmq3-dev")
    return asked.stdout.split()


def run(command: Sequence[str | Path], **options: Any) -> str:
    """The output of a program that succeeded."""
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, **options)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def ended(process: subprocess.Popen[bytes], patience_s: float = LIVENESS_S) -> tuple[bytes, bytes]:
    """The rest of its stdout and stderr until it ends; it is killed if that takes too long."""
    try:
        return process.communicate(timeout=patience_s)
    finally:
        process.kill()


def build(output: Path, compiler: str, sources: Sequence[Path], *flags: str) -> Path:
    """A program of the client's source and `sources`; as by `make`, it is built again only when a file changed."""
    zmq = pkg_config("--cflags", "--libs", "libzmq")
    words = [need(compiler), *STRICT, *flags, *sources, CLIENT / "fmfts.c", *zmq]
    read = sorted(
        file for folder in (CLIENT, HERE) for file in folder.rglob("*") if file.suffix in (".c", ".h", ".cpp")
    )
    told = [str(word).encode() for word in words] + [file.read_bytes() for file in read]
    told.append(run([words[0], "--version"]).encode())
    key = hashlib.sha256(b"".join(hashlib.sha256(each).digest() for each in told)).hexdigest()
    BUILT.mkdir(parents=True, exist_ok=True)
    program = BUILT / key
    if not program.exists():
        unfinished = BUILT / f"{key}.{os.getpid()}"
        run([*words, "-o", unfinished])
        unfinished.replace(program)  # at once: tests run in several processes
    output.unlink(missing_ok=True)
    output.symlink_to(program)
    return output


def build_listener(folder: Path) -> Path:
    """The program that prints each contact that it receives, under the sanitizers."""
    return build(folder / "listen", "gcc", [HERE / "listen.c", HERE / "shown.c"], *SANITIZED)


class Talker:
    """A program that answers each line with a line of JSON; a failing exit fails the test."""

    def __init__(self, *command: str | Path, environment: dict[str, str] | None = None) -> None:
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment
        )

    def decode(self, message: bytes) -> dict[str, Any]:
        return self._ask(struct.pack("<I", len(message)) + message)

    def latest(self, timeout_ms: int = 0) -> dict[str, Any]:
        return self._ask(b"%d\n" % timeout_ms)

    def why(self, timeout_ms: int) -> dict[str, Any]:
        return self._ask(b"?%d\n" % timeout_ms)

    def accept(self, largest_force_sd_n: float) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(b"s%f\n" % largest_force_sd_n)

    def heard(self) -> dict[str, Any]:
        """Its output without a question; no question may follow."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.stdin = None
        return self._answer()

    def _ask(self, question: bytes) -> dict[str, Any]:
        assert self._process.stdin is not None
        self._process.stdin.write(question)
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        assert self._process.stderr is not None
        answers, _, _ = select.select([self._process.stdout], [], [], ANSWER_S)
        line = self._process.stdout.readline() if answers else b""
        if not line:  # it ended, or never will
            self._process.kill()
            said = self._process.stderr.read().decode()
            raise AssertionError(said or ("no answer" if answers else f"no answer in {ANSWER_S} s"))
        answer: dict[str, Any] = json.loads(line)
        return answer

    def __enter__(self) -> Talker:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        _, said = ended(self._process)
        assert kind is not None or self._process.returncode in (0, 69), said.decode()


def eventually(look: Callable[[], dict[str, Any]], wanted: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    deadline = time.monotonic() + LIVENESS_S
    while not wanted(answer := look()):
        assert time.monotonic() < deadline, answer
    return answer


def connect(publisher: Publisher, client: Talker) -> None:
    """Send until the client hears the newest: a subscription takes a moment to arrive. Then nothing is on the way."""
    sent = 0

    def heard() -> dict[str, Any]:
        nonlocal sent
        sent += 1
        publisher.send_contact("demo", contact_message(seq=0, force_n=float(sent)))
        return client.latest(100)

    eventually(heard, lambda answer: answer.get("force_n") == sent)
