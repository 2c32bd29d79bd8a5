from typing_extensions import Buffer

FACTS: dict[str, int]
MEMORY: dict[str, int]
NUMBERS: dict[str, int]
PASSAGE_BYTES: int

def judge(
    facts: Buffer,
    memory: Buffer,
    passage: Buffer,
    response: Buffer | None,
    network: Buffer,
    packed: tuple[int, int, int, bytes],
    time_us: int,
    temperature_c: float,
    /,
) -> tuple[int, int] | None: ...
def ask(
    facts: Buffer,
    memory: Buffer,
    passage: Buffer,
    response: Buffer | None,
    pose: Buffer,
    packed: tuple[int, int, int, bytes],
    time_us: int,
    temperature_c: float,
    /,
) -> bool: ...
def conclude(
    facts: Buffer, memory: Buffer, passage: Buffer, response: Buffer | None, contact: Buffer, jacobian: Buffer, /
) -> tuple[int, int] | None: ...
def express(
    pad: tuple[Buffer, Buffer, Buffer, Buffer | None, Buffer],
    clock: bytearray,
    pad_index: int,
    template: bytes,
    places: bytes,
    kind: int,
    seq: int,
    data: bytes,
    begin: int,
    arrival_ns: int,
    /,
) -> tuple[int, bytes, int, int, int] | None: ...
def message(
    template: bytes, places: bytes, passage: Buffer, seq: int, t_sample_ns: int, t_publish_ns: int, utc_ns: int, /
) -> bytes: ...
