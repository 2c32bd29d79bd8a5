"""Makes the harmful files in tests/data/harmful/: one folder a kind of file, as tests/drills/file_kinds.py names it.

    PYTHONPATH=tests:tests/unit python tests/data/make_harmful.py

Each file once ended the daemon, filled the memory or took minutes. `make fuzz-files` keeps what it finds; add it here,
too.
"""

from __future__ import annotations

from pathlib import Path

import lz4.frame
import msgspec
from bus_messages import contact_message

from drills.file_damage import varint
from drills.lying_mcap import channel, chunk, mcap, message
from fmfts.contact.array_model import ARRAY_PATH

HARMFUL = Path(__file__).with_name("harmful")
ON_CONTACT = channel(1, "contact/left")


def field(number: int, content: bytes) -> bytes:
    return varint(number << 3 | 2) + varint(len(content)) + content


def nested(depth: int, topic: str) -> bytes:
    """A recording with a message that is nested this deep."""
    return mcap([chunk(channel(1, topic) + message(1, b'{"v": ' + b"[" * depth + b"]" * depth + b"}"))])


def files() -> dict[str, bytes]:
    at_zero = msgspec.json.encode(contact_message(pad="left", t_publish_ns=0))
    dimensions = field(1, varint(9000) * 60_000) + b"\x10\x01" + field(8, b"w") + field(9, bytes(36_000))
    lying = mcap([chunk(ON_CONTACT, "lz4", stored=lz4.frame.compress(bytes(1 << 24)))])
    table = msgspec.msgpack.decode(ARRAY_PATH.read_bytes())
    flat = {"shape": (5, 5, 1, 5), "coefficient": bytes(1000), "shear": bytes(2000), "spacing_mm": 1e-300}
    return {
        "table-of-presses/no-spacing.response": msgspec.msgpack.encode(table | flat),
        "recording/nested.mcap": nested(100_000, "contact/left"),
        "played-recording/nested.mcap": nested(100_000, "state/left"),
        "recording/lz4-holds-more.mcap": lying,
        "recording/long-topics.mcap": mcap([chunk(channel(number, "x" * (1 << 20))) for number in range(40)]),
        "recording-of-the-page/time-zero.mcap": mcap([chunk(ON_CONTACT + message(1, at_zero))]),
        "config/key-of-many-parts.toml": b"a." * 3000 + b"a = 1\n",
        "plan/many-presses.toml": b"[lattice]\nfirst_mm = [0, 0]\nspacing_mm = 1\ncount = [1000, 1000]\nforces_n = ["
        + b", ".join(b"%d" % number for number in range(1, 100))
        + b"]\n",
        "model/many-dimensions.onnx": field(7, field(5, dimensions)),
    }


if __name__ == "__main__":
    for name, content in files().items():
        (HARMFUL / name).parent.mkdir(parents=True, exist_ok=True)
        (HARMFUL / name).write_bytes(content)
