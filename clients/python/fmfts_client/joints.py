"""Tells the daemon where a hand's joints are, for pads with `scene.ambient = "posture"`.

python -m fmfts_client.joints TABLE.csv     # plays a recorded table: column t_s, and one for each joint, in rad
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Optional, Union

import msgpack  # type: ignore[import-untyped]
import zmq

from fmfts_client.endpoints import EndpointError, Endpoints, for_client
from fmfts_client.fields import SCHEMA_VERSION
from fmfts_client.keys import is_loopback, show_key

TOPIC = b"joints"


class JointPublisher:
    """Publishes joint positions. Never blocks: what no daemon receives is lost. Only one thread may use it.

    endpoint: of the daemon, as in `Client`. Raises EndpointError.
    """

    def __init__(self, endpoint: Optional[Union[str, Endpoints]] = None) -> None:
        endpoints = for_client(endpoint)
        self._address = endpoints.joints
        # Another computer's monotonic clock is useless here, so the time of arrival counts.
        self._is_here = not self._address.startswith("tcp://") or is_loopback(self._address)
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.PUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        show_key(self._socket, self._address, endpoints.key)
        self._socket.connect(self._address)

    def publish(self, position_rad: Mapping[str, float], t_ns: Optional[int] = None) -> None:
        """Send positions by the joints' names: of all, or of some; in rad, and a slide's in any unit that stays.

        t_ns: when they were measured, by time.monotonic_ns(); None: now. ValueError if a position is not finite.
        """
        for name, position in position_rad.items():
            if not math.isfinite(position):
                raise ValueError(f"the position of joint {name!r} is {position}")
        told = (time.monotonic_ns() if t_ns is None else t_ns) if self._is_here else None
        message = {
            "v": SCHEMA_VERSION,
            "t_ns": told,
            "names": list(position_rad),
            "position_rad": [float(one) for one in position_rad.values()],
        }
        self._socket.send_multipart((TOPIC, msgpack.packb(message)), flags=zmq.NOBLOCK)

    def close(self) -> None:
        self._socket.close()

    def __enter__(self) -> JointPublisher:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


def read_table(path: Path) -> tuple[list[str], list[float], list[list[float]]]:
    """Names, times in s and rows of a recorded table. ValueError says what is wrong with it."""
    with path.open(newline="") as file:
        header, *lines = list(csv.reader(file)) or [[]]
    if header[:1] != ["t_s"] or len(header) < 2 or len(lines) < 2:
        raise ValueError(
            f"{path}: the first column must be t_s, each other one a joint in rad, and there must be two rows or more"
        )
    try:
        rows = [[float(cell) for cell in line] for line in lines]
    except ValueError as error:
        raise ValueError(f"{path}: {error}: each cell below the first row must be a number") from error
    if any(len(row) != len(header) or not all(map(math.isfinite, row)) for row in rows):
        raise ValueError(f"{path}: a row has no {len(header)} finite numbers")
    times = [row[0] for row in rows]
    if any(one >= other for one, other in zip(times, times[1:])):
        raise ValueError(f"{path}: t_s does not rise")
    return header[1:], times, [row[1:] for row in rows]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m fmfts_client.joints", description=__doc__)
    parser.add_argument("table", type=Path, metavar="TABLE.csv")
    parser.add_argument("--bus", help="of the daemon; else FMFTS_BUS or the default")
    parser.add_argument("--loop", action="store_true", help="begin anew at the end; Ctrl-C ends it")
    options = parser.parse_args()
    try:
        names, times, rows = read_table(options.table)
        with JointPublisher(options.bus) as publisher:
            while True:
                begun_s = time.monotonic() - times[0]
                for t_s, row in zip(times, rows):
                    time.sleep(max(0.0, begun_s + t_s - time.monotonic()))
                    publisher.publish(dict(zip(names, row)))
                if not options.loop:
                    return
    except (OSError, ValueError, EndpointError) as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        return


if __name__ == "__main__":
    main()
