"""Random requests to a running daemon: each is answered, nothing changes, and contacts keep coming."""

from __future__ import annotations

import math
import random
from collections import Counter
from pathlib import Path
from typing import Any

import msgpack
import zmq

from drills.rig import PATIENCE_S, resident_kb
from end_to_end.processes import UNTOUCHED_CONFIG, RunningDaemon
from fmfts.bus.control import VERBS

BATCH = 100  # fewer than the daemon serves in a turn of its loop: none waits for another's answer
GROWN_KB = 8_000  # a leak of a request's 60 bytes would be this after 130,000 of them
CHANGING = ("baseline", "selftest")


def random_request(dice: random.Random, harmless: bool = False) -> bytes:
    """Anything from noise over damaged requests to well-formed ones; harmless: only requests that change nothing."""
    choice = dice.random()
    verbs = sorted(VERBS)  # the order of a set changes with each process, and with it these random choices
    if choice < 0.3:
        return dice.randbytes(dice.randrange(60))
    content: dict[Any, Any] = {"id": dice.randrange(1000), "verb": dice.choice([*verbs, "x", None, 3])}
    for _ in range(dice.randrange(4)):
        value = dice.choice([None, 1, -1.5, math.inf, "text", [1, [2]], {"a": {}}, b"\xff", True])
        content[dice.choice(["pad", "id", "verb", "mode", "é", 7])] = value
    if harmless and content["verb"] in CHANGING:
        content["surplus"] = 1
    payload = bytearray(msgpack.packb(content))
    if choice < 0.6:
        payload[dice.randrange(len(payload))] = dice.randrange(256)
    return bytes(payload)


def fuzzed_control(folder: Path, count: int) -> dict[str, Any]:
    """`count` requests, a hundred at a time."""
    dice, answers = random.Random(1), Counter[str]()
    with RunningDaemon(folder, UNTOUCHED_CONFIG) as daemon, zmq.Context.instance().socket(zmq.DEALER) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        socket.connect(f"{daemon.base}/control")
        daemon.wait_for(lambda contact: contact.health == "ok")
        before, memory_kb = _lasting(daemon), resident_kb(daemon.process.pid)
        for _ in range(count // BATCH):
            for _ in range(BATCH):
                socket.send(random_request(dice, harmless=True))
            for _ in range(BATCH):
                assert socket.poll(PATIENCE_S * 1e3), (answers, daemon.log.read_text())
                answer = msgpack.unpackb(socket.recv())
                answers["error" if "error" in answer else "ok"] += 1
        assert daemon.process.poll() is None, daemon.log.read_text()
        assert _lasting(daemon) == before
        daemon.wait_for(lambda contact: contact.health == "ok")
        grown_kb = resident_kb(daemon.process.pid) - memory_kb
        assert "Traceback" not in daemon.log.read_text()
    facts = {"requests": answers.total(), **answers, "memory_grown_kb": grown_kb}
    assert answers.total() == count // BATCH * BATCH, facts
    # 40 % are undamaged, 3 of 8 verbs are harmless and known, and 29 % of those carry no surplus key: 4.3 % of these
    # choices.
    assert min(answers["ok"], answers["error"]) > 0.04 * count, facts
    assert grown_kb < GROWN_KB, facts
    return facts


def _lasting(daemon: RunningDaemon) -> list[dict[str, Any]]:
    """Facts of each pad that must not change. Health does not count: a busy computer may delay a frame."""
    return [{key: value for key, value in pad.items() if key != "health"} for pad in daemon.request("pads")["pads"]]
