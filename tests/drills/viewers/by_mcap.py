"""Prints the ROS 2 messages of a recording as the MCAP project's own decoder reads them, as lines of JSON."""

from __future__ import annotations

import json
import sys
from typing import Any

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory  # type: ignore[import-not-found]


def plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if hasattr(value, "__slots__"):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    return value


def main() -> None:
    with open(sys.argv[1], "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        channels = reader.get_summary().channels.values()
        topics = [channel.topic for channel in channels if channel.message_encoding == "cdr"]
        for _, channel, _, told in reader.iter_decoded_messages(topics):
            print(json.dumps({"topic": channel.topic, "told": plain(told)}))


if __name__ == "__main__":
    main()
