"""Lets onnxruntime look at a model in a process that then ends: inside the daemon it would keep 30 MB."""

from __future__ import annotations

import gc
import math
import os
import select
import signal
import warnings
from contextlib import ExitStack, suppress
from functools import lru_cache
from typing import Literal, NoReturn

import msgspec
import numpy as np

from fmfts.common.reading import shortened
from fmfts.contact.comparison import Answers
from fmfts.contact.inference import POSE

LONGEST_S = 30.0
HANDLED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # must not run the daemon's handlers in the other process
FORKS = hasattr(os, "fork") and hasattr(os, "memfd_create")  # else it looks in this process: macOS runs only `replay`
REFUSAL, ANSWER = b"\0", b"\1"  # the first byte of what the other process writes
MODELS = 8  # number of models whose result is kept: each is read only once, for all pads


class Told(msgspec.Struct):
    """What onnxruntime reports about a model. answers: its answers to `poses_of`, float32; empty unless it has
    weights."""

    metadata: dict[str, str]
    answers: bytes

    def answers_of(self, outputs: int) -> Answers:
        """(K, outputs, 1 + 6). ValueError if the graph has another number of outputs."""
        numbers = np.frombuffer(self.answers, "<f4").astype(np.float64)
        if numbers.size % (outputs * (1 + POSE)):
            raise ValueError(f"its graph has another number of outputs than {outputs}, which its weights have")
        return numbers.reshape(-1, outputs, 1 + POSE)


@lru_cache(MODELS)
def told(content: bytes) -> Told:
    """ValueError says why onnxruntime does not read the model."""
    return msgspec.msgpack.decode(_asked("tell", content), type=Told)


@lru_cache(MODELS)
def tried(content: bytes) -> bytes:
    """The checked model. ValueError if it may need more time or memory than a pad has: see operators.py, session.py."""
    return _asked("try_out", content)


def _asked(what: Literal["tell", "try_out"], content: bytes) -> bytes:
    """Forks, as a new Python would import for 0.2 s what this one has. What is forked needs no lock of another thread:
    it imports onnxruntime, computes, and ends."""
    if not FORKS:
        try:
            return _said(what, content)
        except Exception as error:  # of onnxruntime
            raise ValueError(shortened(_first_line(error))) from error
    with ExitStack() as files:
        try:
            answer = os.memfd_create("answer")
            files.callback(os.close, answer)
            ends, held = os.pipe()
            files.callback(os.close, ends)
        except OSError as error:
            raise ValueError(f"the process that looks at it got no files: {error.strerror}") from error
        try:
            os.write(answer, REFUSAL)
            blocked = signal.pthread_sigmask(signal.SIG_BLOCK, HANDLED)
            try:
                parent, child = os.getpid(), _forked()
                if child == 0:
                    _look(what, content, (answer, held), parent)
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
                os.close(held)
            ended = _ended(child, ends)
            said = os.pread(answer, os.fstat(answer).st_size, 0)
        except OSError as error:
            raise ValueError(
                f"the process in which onnxruntime looks at it did not end: {type(error).__name__}"
            ) from error
    if said[:1] != ANSWER:
        words = said[1:].decode(errors="replace").strip().splitlines()
        raise ValueError(shortened(words[-1]) if words else f"onnxruntime, in a process of its own, ended{ended}")
    return said[1:]


def _forked() -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of Python 3.12: other threads may hold locks
        try:
            return os.fork()
        except OSError as error:
            raise ValueError(
                f"no process could be forked in which onnxruntime looks at it: {error.strerror}"
            ) from error


def _ended(child: int, ends: int) -> str:
    """How, for a sentence. `ends` is closed when it ends; TimeoutError, which is an OSError."""
    in_time, how = None, ""
    try:
        until = select.poll()  # select.select takes no descriptor above 1023
        until.register(ends)
        in_time = until.poll(LONGEST_S * 1e3)
        if not in_time:
            raise TimeoutError
    finally:
        if not in_time:
            os.kill(child, signal.SIGKILL)
        with suppress(ChildProcessError):  # where SIGCHLD is ignored
            how = f" with {os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])}"
    return how


def _look(what: Literal["tell", "try_out"], content: bytes, kept: tuple[int, int], parent: int) -> NoReturn:
    """Writes the answer, or as its last line what is wrong, and ends this process, at the latest with its parent.
    Signals wait for that.

    kept: the file for the answer, and the pipe that tells of the end.
    """
    answer, _ = kept
    try:
        os.dup2(answer, 2)  # what onnxruntime says when it aborts
        _leave(kept, parent)
        said = _said(what, content)
        os.ftruncate(answer, len(REFUSAL))
        os.pwrite(answer, said, len(REFUSAL))
        os.pwrite(answer, ANSWER, 0)
    except BaseException as error:  # noqa: BLE001  # of onnxruntime, which says so where memory is short
        os.write(2, f"\n{_first_line(error)}".encode())
    finally:
        os._exit(0)


def _leave(kept: tuple[int, int], parent: int) -> None:
    """Keeps none of the daemon's sockets, locks and devices, and does not outlive it."""
    import ctypes

    from fmfts.service.child import end_with
    from fmfts.service.open_files import OWN

    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGALRM})
    signal.alarm(math.ceil(LONGEST_S) + 1)  # the parent, which can say why, is first
    end_with(parent, signal.SIGKILL, ctypes.CDLL(None))
    gc.disable()  # a file object of the daemon would close a descriptor that is by then another's
    first = 3
    for each in (*sorted(kept), max(map(int, os.listdir(OWN))) + 1):
        os.closerange(first, each)
        first = max(first, each + 1)


def _said(what: Literal["tell", "try_out"], content: bytes) -> bytes:
    from fmfts.contact import session

    return session.tell(content) if what == "tell" else session.try_out(content)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
