"""Defines and opens [pad.source] type = "anyskin": a ReSkin, AnySkin or eFlesh board with its own firmware."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from fmfts.config.section import Problem
from fmfts.config.sources import PluggedSource
from fmfts.sensor.chips import CHIPS, ChipName
from fmfts.sensor.source import Source

if TYPE_CHECKING:
    from fmfts.config import PadConfig


class AnyskinSource(PluggedSource, frozen=True, tag="anyskin", tag_field="type", kw_only=True):
    port: str
    baud: Annotated[int, Meta(ge=9600)] = 115200
    form: Literal["binary", "text"] = "binary"
    chip: ChipName = "mlx90393_streamed"

    @property
    def serial_port(self) -> str:
        return self.port

    def problems(self) -> Iterator[Problem]:
        if not CHIPS[self.chip].streamed:
            yield ("source", "chip"), "a streamed chip belongs to an AnySkin board, which has no other"

    def driver(self, pads: Mapping[int, PadConfig]) -> Source:
        from fmfts.sources import chips_of
        from fmfts_skin.board.source import Anyskin, PadOnStream

        (pad,) = pads.values()
        on_stream = PadOnStream(**chips_of(pad), port=self.port, baud=self.baud, is_text=self.form == "text")
        return Anyskin(on_stream)
