"""PlotJuggler's ZMQ subscriber on a daemon's bus, as docs/foxglove.md sets it up.

PlotJuggler (DataStreamZMQ) subscribes to a topic's prefix over tcp, treats each part of a message as a message, and
skips those that its parser refuses. The parser requires the whole part to be one MessagePack value.
"""

from __future__ import annotations

import time
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import msgpack
import zmq

from end_to_end.processes import PATIENCE_S, RunningDaemon
from ports import tcp_base

TOPIC = "contact/left"
LAYOUT = Path(__file__).parents[2] / "extras/foxglove/layouts/plotjuggler.xml"
CONFIG = '[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\n'


def series(value: Any, name: str) -> dict[str, float]:
    """The curves from a value: numbers and truth values by their path."""
    if isinstance(value, dict):
        return {key: each for part in value for key, each in series(value[part], f"{name}/{part}").items()}
    if isinstance(value, list):
        parts = [series(each, f"{name}[{index}]") for index, each in enumerate(value)]
        return {key: each for part in parts for key, each in part.items()}
    return {name: float(value)} if isinstance(value, (int, float)) else {}


def test_plotjuggler_gets_the_curves_of_its_layout(tmp_path: Path) -> None:
    base = tcp_base()
    received: set[str] = set()
    layout = ET.parse(LAYOUT)
    curves = {curve.attrib["name"] for curve in layout.iter("curve")}
    assert "contact/left/force_n" in curves
    skipped = 0
    with (
        RunningDaemon(tmp_path, CONFIG, endpoint=base),
        zmq.Context() as context,
        context.socket(zmq.SUB) as subscriber,
    ):
        subscriber.connect(base)
        subscriber.subscribe(TOPIC)
        subscriber.rcvtimeo = round(PATIENCE_S * 1e3)
        until = time.monotonic() + PATIENCE_S  # some have values only while the pad is touched
        while (not curves <= received or skipped < 220) and time.monotonic() < until:
            part = subscriber.recv()
            try:
                message = msgpack.unpackb(part)
            except (ValueError, msgpack.UnpackException):
                assert part == TOPIC.encode(), "only the topic is skipped"
                skipped += 1
                continue
            received.update(series(message, TOPIC))
    assert skipped >= 220
    assert curves <= received, "each curve of the layout has values"
