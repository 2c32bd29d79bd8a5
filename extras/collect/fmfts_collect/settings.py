"""Defines and checks `[collect]` of the configuration: the machine that presses the pad, and the force gauge."""

from __future__ import annotations

import ipaddress
import math
import re
from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta, field

from fmfts.config import Config
from fmfts.config.section import NonNegativeFloat, PositiveFloat, Problem, Section

Span = tuple[float, float]
Port = Annotated[int, Meta(ge=1, le=65535)]
LONGEST_SILENCE_MS = 1000
DECIMAL = r"([-+]?\d+(?:\.\d+)?)"


class _Gauge(Section, frozen=True):
    delay_ms: NonNegativeFloat = 0.0  # age of a reading when it arrives


class _AsciiGauge(_Gauge, frozen=True):
    pattern: str = DECIMAL  # a regular expression for one line; its first group is the number
    newton_per_unit: float = 1.0  # negative where pressing makes the number smaller


class SerialGauge(_AsciiGauge, frozen=True, kw_only=True, tag="serial", tag_field="type"):
    port: str
    baud: Annotated[int, Meta(ge=300)] = 9600
    ask: str = ""  # sent for each reading, to gauges that do not stream


class UdpGauge(_AsciiGauge, frozen=True, kw_only=True, tag="udp", tag_field="type"):
    port: Port
    address: str = "127.0.0.1"  # where to listen
    sender: str = ""  # host, or host:port; "" means any socket of the same user on the loopback interface


class LoadCellGauge(_Gauge, frozen=True, kw_only=True, tag="hx711", tag_field="type"):
    newton_per_count: float  # `fmfts-daemon collect --weigh-g` finds it with two known weights


GaugeConfig = SerialGauge | UdpGauge | LoadCellGauge


class StageConfig(Section, frozen=True):
    """A G-code machine. Places are machine coordinates after homing; z points away from the pad."""

    port: str
    dialect: Literal["marlin", "grbl"]
    travel_mm: tuple[Span, Span, Span]  # x, y, z: limits of the rod's travel; required, because only the user knows it
    force_limit_n: PositiveFloat  # above it the rod is lifted and the work ends; required too
    origin_mm: Span  # machine x, y at which the rod stands above the pad's origin
    clear_z_mm: float  # height at which the rod can travel without touching anything
    baud: Annotated[int, Meta(ge=1200)] = 115200
    turn_deg: float = 0.0  # angle from the machine's x axis to the pad's
    travel_mm_per_s: PositiveFloat = 20.0  # sideways, clear of the pad
    lift_mm_per_s: PositiveFloat = 4.0  # up, and down to the pad; at most the machine's limit for z (M203, $112)
    press_mm_per_s: PositiveFloat = 2.0
    step_mm: PositiveFloat = 0.1  # the longest step towards a force
    overshoot_mm: NonNegativeFloat = 0.2  # each place is approached from this far below in x and y, because of backlash


class CollectConfig(Section, frozen=True):
    gauge: GaugeConfig | None = None
    stage: StageConfig | None = None
    average_s: Annotated[float, Meta(ge=0.3, le=10)] = 0.3  # each row is the mean over this time
    settle_s: NonNegativeFloat = 0.3  # wait after the force is reached: silicone creeps
    silence_ms: Annotated[float, Meta(gt=0, le=LONGEST_SILENCE_MS)] = 100.0  # of gauge or board; then the rod is lifted


class CollectingConfig(Config, frozen=True):
    """The whole file, with its table [collect], which the daemon leaves unread."""

    collect: CollectConfig = field(default_factory=CollectConfig)  # type: ignore[assignment]

    def problems_of_extras(self) -> Iterator[Problem]:
        for keys, text in problems(self.collect):
            yield ("collect", *keys), text


def problems(collect: CollectConfig) -> Iterator[Problem]:
    """Yields the problems that the types do not exclude."""
    gauge, stage = collect.gauge, collect.stage
    if isinstance(gauge, SerialGauge | UdpGauge):
        try:
            groups = re.compile(gauge.pattern).groups
        except re.error as error:
            yield ("gauge", "pattern"), f"is no regular expression: {error}"
        else:
            if groups < 1:
                yield ("gauge", "pattern"), "the number needs (brackets) around it"
    if gauge is not None:
        name = "newton_per_count" if isinstance(gauge, LoadCellGauge) else "newton_per_unit"
        scale = getattr(gauge, name)
        if scale == 0.0 or not math.isfinite(scale):
            yield ("gauge", name), f"is {scale:g}: with it no force can be measured"
    if isinstance(gauge, UdpGauge):
        yield from _of_the_sender(gauge)
    if stage is None:
        return
    if gauge is None:
        yield ("stage",), "a stage needs a [collect.gauge], without which it cannot know when to stop pressing"
    for axis, (low, high) in zip("xyz", stage.travel_mm, strict=True):
        if not low < high:
            yield ("stage", "travel_mm"), f"{axis} goes from {low:g} to {high:g}: the lower end comes first"
    low, high = stage.travel_mm[2]
    if not low < stage.clear_z_mm <= high:
        yield ("stage", "clear_z_mm"), f"must lie within travel_mm's z, above {low:g} and at most {high:g}"
    for axis, place, (low, high) in zip("xy", stage.origin_mm, stage.travel_mm[:2], strict=True):
        if not low <= place <= high:
            yield ("stage", "origin_mm"), f"{axis} = {place:g} is outside travel_mm ({low:g} to {high:g})"


def _of_the_sender(gauge: UdpGauge) -> Iterator[Problem]:
    host, colon, port = gauge.sender.partition(":")
    if not gauge.sender:
        if not _is_loopback(gauge.address):
            yield (
                ("gauge", "sender"),
                f"must name the machine that sends, because everybody in the network reaches {gauge.address!r}: its "
                'address, as "192.168.1.20" or with the port that it sends from',
            )
    elif not _is_ipv4(host) or (colon and not re.fullmatch(r"[1-9]\d{0,4}", port)):
        yield ("gauge", "sender"), 'must be an IPv4 address like "192.168.1.20", or with a port "192.168.1.20:5006"'


def _is_ipv4(host: str) -> bool:
    try:
        ipaddress.IPv4Address(host)
        return True
    except ValueError:
        return False


def _is_loopback(host: str) -> bool:
    return host == "localhost" or (_is_ipv4(host) and ipaddress.IPv4Address(host).is_loopback)
