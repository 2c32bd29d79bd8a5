from typing_extensions import Buffer

PARAMETERS: dict[str, int]
MEMORY: dict[str, int]
NUMBERS: dict[str, int]
SIGHTING: dict[str, int]
NEIGHBOURS: int
OUTCOME_BYTES: int

Pad = tuple[Buffer | None, ...]

def judge(
    pad: Pad,
    packed: tuple[int, int, int, bytes],
    sequence: int,
    time_us: int,
    host_ns: int,
    temperature_c: float,
    /,
) -> tuple[int, float, int] | None: ...
def early(
    pad: Pad,
    sensor: int,
    gain_code: int,
    x: int,
    y: int,
    z: int,
    time_us: int,
    /,
) -> float | None: ...
def message(
    template: bytes,
    places: bytes,
    outcome: Buffer,
    seq: int,
    t_sample_ns: int,
    t_publish_ns: int,
    utc_ns: int,
    now_ns: int,
    /,
) -> bytes: ...

Template = tuple[bytes, bytes]
Passed = tuple[int, int, int, int, int, bytes, tuple[bytes, ...], int, int, int, int, int, list[float]]

class Lane:
    def __init__(
        self,
        pad: Pad,
        clock: bytearray,
        topic: bytes,
        pad_index: int,
        overdue_ns: int,
        /,
    ) -> None: ...
    def begin(
        self,
        templates: tuple[Template, Template, Template],
        kind: int,
        number: int,
        sequence: int,
        t_sample_ns: int,
        frame_us: int,
        frame_ns: int,
        /,
    ) -> None: ...
    def end(self) -> Passed | None: ...
    def last_ns(self) -> int: ...

class Loop:
    def __init__(
        self, epoll: int, send: int, socket: int, in_time: tuple[int, int], behind: tuple[int, int], /
    ) -> None: ...
    def begin(self, descriptor: int, unread: bytes, lanes: tuple[Lane, ...], /) -> None: ...
    def end(self, descriptor: int, /) -> tuple[bytes, int, tuple[int, int, int], int] | None: ...
    def is_behind(self) -> bool: ...
    def take(self, descriptor: int, data: bytes, arrival_ns: int, /) -> bool: ...
    def wait(self, until_ns: int, /) -> list[int]: ...
