"""A bus with the messages of many touched pads: `python load.py BASE PADS`. The traffic of a daemon with 64 pads."""

from __future__ import annotations

import math
import sys
import time

import msgspec
import zmq

from fmfts.bus.messages import ContactMessage, PoseMessage
from fmfts_client import Endpoints

RATE_HZ = 220
POSE = PoseMessage(
    position_m=(1e-4, 2e-4, 0.0115),
    position_sd_m=(8e-6, 8e-6, 5e-6),
    axis=(0.01, 0.02, 0.9997),
    axis_sd_rad=0.002,
    remanence_t=1.23,
    remanence_sd_t=0.02,
    ambient_t=(1e-6, 2e-6, 3e-6),
    ambient_sd_t=(2e-7, 2e-7, 2e-7),
    residual_t=2e-7,
    chi2=4.0,
)
CONTACT = ContactMessage(
    pad="p00",
    boot="load",
    seq=0,
    t_sample_ns=0,
    t_publish_ns=0,
    utc_ns=0,
    temperature_c=25.0,
    health="ok",
    reason="",
    contact=True,
    x_m=0.0,
    x_sd_m=1e-4,
    y_m=0.0,
    y_sd_m=1e-4,
    force_n=1.0,
    force_sd_n=0.02,
    shear_x_n=None,
    shear_x_sd_n=None,
    shear_y_n=None,
    shear_y_sd_n=None,
    over_range=False,
    force_min_n=None,
    displacement_m=None,
    displacement_sd_m=None,
    pose=POSE,
    sensors_ok=15,
    model="ad969445ebda",
    baseline="0123456789ab",
)


def main(base: str, pads: int) -> None:
    bus = zmq.Context.instance().socket(zmq.PUB)
    bus.bind(Endpoints.from_base(base).bus)
    encode = msgspec.msgpack.encode
    names = [f"p{number:02}" for number in range(pads)]
    topics = [f"contact/{name}".encode() for name in names]
    begun_ns, seq = time.monotonic_ns(), 0
    while True:
        seq += 1
        now_ns, utc_ns = time.monotonic_ns(), time.time_ns()
        turn = 2.0 * math.pi * seq / RATE_HZ
        for number, (name, topic) in enumerate(zip(names, topics, strict=True)):
            x_m, y_m = 6e-3 * math.sin(turn / 3 + number), 6e-3 * math.cos(turn / 2 + number)
            message = msgspec.structs.replace(
                CONTACT, pad=name, seq=seq, t_sample_ns=now_ns - 5_000_000, t_publish_ns=now_ns, utc_ns=utc_ns,
                x_m=x_m, y_m=y_m, force_n=1.0 + 0.5 * math.sin(turn + number),
            )  # fmt: skip
            bus.send_multipart((topic, encode(message)))
        due_ns = begun_ns + seq * 1_000_000_000 // RATE_HZ
        time.sleep(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
