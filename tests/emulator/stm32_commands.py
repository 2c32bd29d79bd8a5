"""The commands of fmfts-host (firmware/host/commands.c), for the emulated chip: one a line, `ok` or `error: …` each."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from emulator.board_port import WrongCommandError
from emulator.stm32_board import SENSORS, Board

TESLA_PER_MICROTESLA, GAUSS_PER_MICROTESLA = 1e-6, 1e-2
AXES = "xyz"


class Line:
    """Changes of the stream on its way to the host."""

    def __init__(self) -> None:
        self.garbage = b""
        self.cut_next = False


class Session(NamedTuple):
    board: Board
    line: Line


def number(word: str, low: float, high: float) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise WrongCommandError("not a finite number within range")
    return value


def place(word: str, count: int, what: str) -> int:
    if not (word.isdecimal() and int(word) < count):
        raise WrongCommandError(f"no such {what}: they count from 0")
    return int(word)


def field(session: Session, pad: int, *words: str) -> None:
    values = [number(word, -1e5, 1e5) for word in words]
    session.board.set_field(pad, np.array(values).reshape(SENSORS, 3) * TESLA_PER_MICROTESLA)


def temperature(session: Session, pad: int, celsius: str) -> None:
    value = number(celsius, -100, 200)
    for sensor in session.board.sensors[pad]:
        sensor.temperature_c = value


def noise(session: Session, pad: int, microtesla: str) -> None:
    value = number(microtesla, 0, 1e4)
    for sensor in session.board.sensors[pad]:
        sensor.noise_gauss = value * GAUSS_PER_MICROTESLA


def ppm(session: Session, pad: int, sensor: int, faster: str) -> None:
    session.board.sensors[pad][sensor].clock_error = 1 / (1 + number(faster, -1e5, 1e5) * 1e-6) - 1


def fault(session: Session, pad: int, sensor: int, kind: str) -> None:
    board = session.board
    if kind == "none":
        board.replug(pad, sensor)
    elif kind == "unplugged":
        board.unplug(pad, sensor)
    elif kind == "wrong-id":
        board.replace(pad, sensor, b"H44")
    elif kind == "stuck":
        board.sensors[pad][sensor].frozen = True
    elif kind == "config-corrupt":
        board.corrupt(pad, sensor)
    elif kind.startswith("saturate-") and kind[9:] in tuple(AXES):
        board.saturate(pad, sensor, AXES.index(kind[9:]))
    else:
        kinds = "none, unplugged, wrong-id, stuck, saturate-x, saturate-y, saturate-z or config-corrupt"
        raise WrongCommandError(f"fault is {kinds}")


def mux(session: Session, pad: int, kind: str) -> None:
    if kind not in ("none", "unplugged"):
        raise WrongCommandError("mux is none or unplugged")
    session.board.unplug_mux(pad, absent=kind == "unplugged")


def load(session: Session, counts: str) -> None:
    session.board.converter.counts = None if counts == "none" else int(number(counts, -(2**23), 2**23 - 1))


def garbage(session: Session, count: str, seed: str) -> None:
    random = np.random.default_rng(int(number(seed, 0, 2**32 - 1)))
    session.line.garbage += random.bytes(int(number(count, 0, 4096)))


def truncate(session: Session) -> None:
    session.line.cut_next = True


def reset(session: Session) -> None:
    session.board.reset("software")


def jump(session: Session, microseconds: str) -> None:
    raise WrongCommandError("no time can be jumped over here: the chip's watchdog would bark")


class Command(NamedTuple):
    execute: Callable[..., None]
    words: int
    has_pad: bool = False
    has_sensor: bool = False


COMMANDS = {
    "field": Command(field, 2 + 3 * SENSORS, has_pad=True),
    "temperature": Command(temperature, 3, has_pad=True),
    "noise": Command(noise, 3, has_pad=True),
    "ppm": Command(ppm, 4, has_pad=True, has_sensor=True),
    "fault": Command(fault, 4, has_pad=True, has_sensor=True),
    "mux": Command(mux, 3, has_pad=True),
    "load": Command(load, 2),
    "garbage": Command(garbage, 3),
    "truncate": Command(truncate, 1),
    "reset": Command(reset, 1),
    "time": Command(jump, 2),
}


def execute(session: Session, line: str) -> None:
    """Execute the line; WrongCommandError if it is not a command."""
    name, *words = line.split() or [""]
    command = COMMANDS.get(name)
    if command is None:
        raise WrongCommandError(f"unknown command; there are {', '.join(COMMANDS)} and quit")
    if len(words) + 1 != command.words:
        raise WrongCommandError("wrong number of words for this command")
    places = []
    if command.has_pad:
        places.append(place(words.pop(0), len(session.board.sensors), "pad"))
    if command.has_sensor:
        places.append(place(words.pop(0), SENSORS, "sensor"))
    command.execute(session, *places, *words)
