"""Writes wire_vectors.ini from firmware/wire.md, field by field, sharing no code with the daemon or the firmware.

Run by hand: python tests/data/make_wire_vectors.py > tests/data/wire_vectors.ini. A changed byte is a new wire version.
"""

from __future__ import annotations

HEADER = """\
# Golden packets of firmware/wire.md, read by the C tests and the Python tests; made by make_wire_vectors.py.
# Every value is a number (0x… or decimal) or a list of them with spaces between; `line` is hex, closing zero included.
# Lists over pads: i2c_port, mux_address, bus_errors, bus_recoveries, config_repairs; sensor_count in hello and status.
# Lists over pads and then sensors: channel, state; identification has three numbers a sensor.
# Lists over sensors: counts (x y z a sensor), age_us, positive and negative (x y z a sensor).
"""


def u(value, size):
    return value.to_bytes(size, "little")


def i16(value):
    return value.to_bytes(2, "little", signed=True)


def crc(data):
    register = 0xFFFF
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1) ^ 0x1021 if register & 0x8000 else register << 1
            register &= 0xFFFF
    return register


def cobs(data):
    out, block = bytearray(), bytearray()
    for byte in [*data, 0]:
        if byte:
            block.append(byte)
        else:
            out += bytes([len(block) + 1]) + block
            block = bytearray()
    return bytes(out)


def sample(v):
    body = u(v["pad_index"] + 16 * v["sensor_count"], 1) + u(v["sequence"], 4) + u(v["time_us"], 6)
    body += u(v["gain_code"] + 8 * v["trigger"], 1) + u(v["valid"], 1) + u(v["fresh"], 1) + i16(v["temperature_raw"])
    for sensor in range(v["sensor_count"]):
        for axis in range(3):
            body += i16(v["counts"][3 * sensor + axis])
        body += u(v["age_us"][sensor], 2)
    return 1, body


def hello(v):
    body = bytes(v["firmware_version"]) + u(v["reset_cause"], 1) + u(v["clock"], 1) + bytes(v["uid"])
    settings = v["gain_code"] + 8 * v["trigger"] + 16 * v["running"] + 32 * v["can_send_early"]
    settings += 64 * v["can_make_pads"]
    body += u(v["rate_hz"], 2) + u(settings, 1) + u(v["pad_count"], 1)
    sensor = 0
    for pad in range(v["pad_count"]):
        body += bytes([v["i2c_port"][pad], v["mux_address"][pad], v["sensor_count"][pad]])
        for _ in range(v["sensor_count"][pad]):
            body += bytes([v["channel"][sensor], v["state"][sensor]])
            body += bytes(v["identification"][3 * sensor : 3 * sensor + 3])
            sensor += 1
    return 2, body


def status(v):
    body = u(v["time_us"], 6) + u(v["transmit_dropped"], 4) + u(v["receive_errors"], 4) + u(v["pad_count"], 1)
    sensor = 0
    for pad in range(v["pad_count"]):
        for key in ("bus_errors", "bus_recoveries", "config_repairs"):
            body += u(v[key][pad], 4)
        count = v["sensor_count"][pad]
        body += u(count, 1) + bytes(v["state"][sensor : sensor + count])
        sensor += count
    return 3, body


def reply(v):
    return 4, bytes([v["request_id"], v["request_type"], v["result"]])


def selftest(v):
    body = bytes([v["request_id"], v["pad_index"] + 16 * v["sensor_count"], v["gain_code"]])
    for sensor in range(v["sensor_count"]):
        body += u(v["state"][sensor], 1)
        for key in ("positive", "negative"):
            for axis in range(3):
                body += i16(v[key][3 * sensor + axis])
    return 5, body


def load(v):
    return 6, u(v["sequence"], 4) + u(v["time_us"], 6) + v["counts"].to_bytes(4, "little", signed=True)


def early(v):
    body = u(v["pad_index"] + 16 * v["sensor"] + 128, 1) + u(v["gain_code"], 1) + u(v["time_us"], 6)
    return 7, body + b"".join(i16(count) for count in v["counts"])


def request(v):
    return v["request_type"], bytes([v["request_id"], v["pad_index"]]) + u(v["argument"], 2)


KINDS = {f.__name__: f for f in (sample, hello, status, reply, selftest, load, early, request)}
H43 = [0x48, 0x34, 0x33]
UID = [0x34, 0xFF, 0x6D, 0x06, 0x50, 0x4D, 0x38, 0x33, 0x00, 0x26, 0x17, 0x43]
PAPER = [-112, 35, 901, -108, -40, 897, 109, 41, 905, 115, -37, 894]


def make_sample(n=4, **fields):
    everyone = (1 << n) - 1
    base = {
        "pad_index": 0,
        "sensor_count": n,
        "sequence": 0,
        "time_us": 0,
        "gain_code": 3,
        "trigger": 0,
        "valid": everyone,
    }
    base |= {"fresh": everyone, "temperature_raw": 0, "counts": [0] * 3 * n, "age_us": [0] * n}
    return ("sample", base | fields)


def make_hello(**fields):
    base = {
        "firmware_version": [0, 1, 0],
        "reset_cause": 1,
        "clock": 1,
        "uid": UID,
        "rate_hz": 220,
        "gain_code": 3,
        "trigger": 0,
    }
    base |= {
        "running": 1,
        "can_send_early": 0,
        "can_make_pads": 0,
        "pad_count": 1,
        "i2c_port": [1],
        "mux_address": [0x70],
        "sensor_count": [4],
        "channel": [0, 1, 2, 3],
    }
    base |= {"state": [0] * 4, "identification": H43 * 4}
    return ("hello", base | fields)


def make_status(**fields):
    base = {"time_us": 1_000_000, "transmit_dropped": 0, "receive_errors": 0, "pad_count": 1, "bus_errors": [0]}
    base |= {"bus_recoveries": [0], "config_repairs": [0], "sensor_count": [4], "state": [0] * 4}
    return ("status", base | fields)


def make_early(**fields):
    return ("early", {"pad_index": 0, "sensor": 0, "gain_code": 3, "time_us": 0, "counts": [0] * 3} | fields)


def make_request(verb, request_id, pad_index, argument):
    return ("request", {"request_type": verb, "request_id": request_id, "pad_index": pad_index, "argument": argument})


VECTORS = {
    "sample_rest": make_sample(
        sequence=220, time_us=1_000_123, counts=PAPER, age_us=[0, 1200, 2400, 4544], temperature_raw=-320
    ),
    "sample_all_zero": make_sample(valid=0, fresh=0, gain_code=0),
    "sample_no_zero_byte": make_sample(
        n=1,
        pad_index=1,
        sequence=0x01020304,
        time_us=0x060504030201,
        counts=[257, 514, 771],
        age_us=[0x0101],
        temperature_raw=0x0102,
        trigger=1,
        gain_code=7,
    ),
    "sample_negative_and_overflow": make_sample(
        counts=[-4096, -1, -2048, 2047, -4096, 1, -1, -1, -4096, -4096, -4096, -4096],
        sequence=0xFFFFFFFF,
        trigger=1,
        temperature_raw=-1,
        fresh=0b0101,
    ),
    "sample_time_beyond_32_bits": make_sample(time_us=2**32 + 7, sequence=944_893, counts=PAPER),
    "sample_last_time": make_sample(time_us=2**48 - 1, pad_index=2, gain_code=5),
    "sample_eight_sensors": make_sample(
        n=8, counts=list(range(-1200, 1200, 100)), age_us=list(range(0, 4000, 500)), temperature_raw=1664
    ),
    "sample_one_sensor": make_sample(n=1, counts=[1, -1, 0], age_us=[65534], sequence=1),
    "sample_invalid_sensors": make_sample(
        valid=0b1001, fresh=0b0001, counts=[5, 6, 7, 0, 0, 0, 0, 0, 0, -5, -6, -7], age_us=[0, 65535, 65535, 4544]
    ),
    "sample_temperature_unknown": make_sample(temperature_raw=-32768, counts=PAPER),
    "sample_extremes": make_sample(
        n=2, pad_index=15, counts=[32767, -32768, 0, -32768, 32767, -1], age_us=[65535, 1], temperature_raw=32767
    ),
    "hello_one_pad": make_hello(),
    "hello_three_pads": make_hello(
        firmware_version=[255, 0, 12],
        reset_cause=4,
        clock=2,
        rate_hz=160,
        trigger=1,
        pad_count=3,
        i2c_port=[1, 1, 2],
        mux_address=[0x70, 0x71, 0x77],
        sensor_count=[4, 1, 8],
        channel=[0, 1, 2, 3, 7, *range(8)],
        state=[0, 1, 2, 3, 4, 5, 6, 7, 8, 0, 0, 0, 0],
        identification=H43 + [0] * 3 + [0x48, 0x34, 0x34] + H43 * 10,
    ),
    "hello_stopped_host_build": make_hello(reset_cause=0, clock=0, uid=[0] * 12, running=0, gain_code=0, rate_hz=1),
    "status_quiet": make_status(),
    "status_three_pads": make_status(
        time_us=2**40 + 1,
        transmit_dropped=0xFFFFFFFF,
        receive_errors=256,
        pad_count=3,
        bus_errors=[0, 1, 0x01000000],
        bus_recoveries=[2, 0, 0xFFFFFFFF],
        config_repairs=[0, 3, 4],
        sensor_count=[4, 8, 1],
        state=[0, 1, 2, 3, *range(8), 8],
    ),
    "reply_done": ("reply", {"request_id": 7, "request_type": 9, "result": 0}),
    "reply_busy": ("reply", {"request_id": 255, "request_type": 14, "result": 4}),
    "selftest_passed": (
        "selftest",
        {
            "request_id": 9,
            "pad_index": 0,
            "sensor_count": 4,
            "gain_code": 5,
            "state": [0] * 4,
            "positive": [452, 455, 421, 449, 460, 418, 470, 463, 425, 441, 450, 419],
            "negative": [-452, -454, -421, -450, -460, -418, -470, -464, -425, -441, -450, -420],
        },
    ),
    "selftest_of_eight": (
        "selftest",
        {
            "request_id": 10,
            "pad_index": 1,
            "sensor_count": 8,
            "gain_code": 5,
            "state": [0, 0, 0, 0, 0, 0, 1, 0],
            "positive": [452, 455, 421] * 6 + [0, 0, 0] + [449, 460, 418],
            "negative": [-452, -454, -421] * 6 + [0, 0, 0] + [-450, -460, -418],
        },
    ),
    "selftest_failures": (
        "selftest",
        {
            "request_id": 0,
            "pad_index": 2,
            "sensor_count": 2,
            "gain_code": 5,
            "state": [5, 1],
            "positive": [-4096, 12, 575, 0, 0, 0],
            "negative": [-4096, -243, 0, 0, 0, 0],
        },
    ),
    "load": ("load", {"sequence": 80, "time_us": 1_012_500, "counts": 84_213}),
    "load_least": ("load", {"sequence": 0xFFFFFFFF, "time_us": 2**48 - 1, "counts": -(2**23)}),
    "load_most": ("load", {"sequence": 0, "time_us": 0, "counts": 2**23 - 1}),
    "hello_that_can_send_early": make_hello(can_send_early=1, trigger=1, gain_code=7),
    "hello_pad_of_eight_beside_one_of_four": make_hello(
        can_send_early=1,
        can_make_pads=1,
        pad_count=2,
        i2c_port=[1, 1],
        mux_address=[0x70, 0x71],
        sensor_count=[8, 4],
        channel=[*range(8), *range(4)],
        state=[0] * 6 + [1] + [0] * 5,
        identification=H43 * 6 + [0] * 3 + H43 * 5,
    ),
    "early": make_early(sensor=2, time_us=1_000_123, counts=[-112, 35, 901]),
    "early_all_zero": make_early(gain_code=0),
    "early_extremes": make_early(pad_index=15, sensor=7, gain_code=7, time_us=2**48 - 1, counts=[32767, -32768, -4096]),
    "request_hello": make_request(8, 1, 255, 0),
    "request_pads_of_eight_and_four": make_request(8, 1, 255, 0x48),
    "request_three_pads_of_four": make_request(8, 1, 255, 0x444),
    "request_range": make_request(9, 2, 255, 3),
    "request_rate": make_request(10, 3, 255, 220),
    "request_trigger": make_request(11, 4, 255, 1),
    "request_start": make_request(12, 5, 255, 0),
    "request_start_early": make_request(12, 5, 255, 0b101),
    "request_stop": make_request(13, 0, 0, 0),
    "request_selftest": make_request(14, 255, 2, 65535),
    "request_status": make_request(15, 6, 255, 0),
}


def line(kind, values):
    packet_type, body = KINDS[kind](values)
    packet = bytes([1 << 4 | packet_type]) + body
    return cobs(packet + u(crc(packet), 2)) + b"\0"


def written(key, value):
    numbers = value if isinstance(value, list) else [value]
    form = "0x{:02x}" if key in ("uid", "identification", "mux_address") else "{}"
    return " ".join(form.format(number) for number in numbers)


if __name__ == "__main__":
    print(HEADER.rstrip())
    for name, (kind, values) in VECTORS.items():
        print(f"\n[{name}]\ntype = {kind}")
        for key, value in values.items():
            print(f"{key} = {written(key, value)}")
        print(f"line = {line(kind, values).hex()}")
