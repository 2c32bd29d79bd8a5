"""The origin of a baseline: the board, the I2C bus and mux, or the simulation with the recorded sensors."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec


class Origin(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The sensors of one pad. A fact that is None is not known.

    kind: the type of its source.
    uid, pad_index: of a board. bus, mux_address, channels, addresses: of chips on an I2C bus, which have no numbers of
    their own; addresses: None where the mux's channels tell them apart; mux_addresses: of each sensor's mux, in place
    of mux_address, where there are several.
    port: of a board without an identity of its own. seed: of a simulated pad. chip: what kind of chip they are.
    """

    kind: str
    chip: str
    uid: str | None = None
    pad_index: int | None = None
    bus: int | None = None
    mux_address: int | None = None
    channels: tuple[int, ...] | None = None
    seed: int | None = None
    addresses: tuple[int, ...] | None = None
    port: str | None = None
    mux_addresses: tuple[int, ...] | None = None

    def on(self, board: Mapping[str, object]) -> Origin:
        """The same with the board's own facts (`SourceState.board`)."""
        uid = board.get("uid")
        return (
            msgspec.structs.replace(self, uid=uid.lower()) if self.kind == "bridge" and isinstance(uid, str) else self
        )

    def agrees_with(self, other: Origin) -> bool:
        """False if a fact that both know differs. One mux for all sensors, and one for each, are two wirings."""
        wirings = {(each.mux_address is None, each.mux_addresses is None) for each in (self, other)}
        if wirings == {(True, False), (False, True)}:
            return False
        mine, its = msgspec.structs.astuple(self), msgspec.structs.astuple(other)
        return all(one is None or two is None or one == two for one, two in zip(mine, its, strict=True))

    def __str__(self) -> str:
        match self.kind:
            case "bridge":
                board = "a board without a uid" if self.uid is None else f"board {self.uid}"
                return f"{board}, pad_index {self.pad_index}, {self.chip}"
            case "simulated":
                return f"a simulated pad, seed {self.seed}, {self.chip}"
            case "i2c" if self.channels is None and self.addresses is not None:
                addresses = ", ".join(f"0x{each:02x}" for each in self.addresses)
                return f"I2C bus {self.bus}, addresses {addresses}, {self.chip}"
            case "i2c":
                channels = ", ".join(map(str, self.channels or ()))
                return f"I2C bus {self.bus}, {self._muxes()}, channels {channels}, {self.chip}"
            case _:
                return f"a device of type {self.kind} on {self.port}"

    def _muxes(self) -> str:
        if self.mux_addresses is not None:
            return f"muxes {', '.join(f'0x{each:02x}' for each in self.mux_addresses)}"
        return f"mux {'?' if self.mux_address is None else f'0x{self.mux_address:02x}'}"


def foreign(pad: str, whose: Origin, mine: Origin) -> str:
    """The sentence that refuses a baseline. whose: its sensors; mine: the present sensors."""
    return (
        f"pad '{pad}': its baseline was recorded on {whose}, but the pad is on {mine}, which has other sensors: "
        f"record a baseline here: `fmfts-daemon baseline --bare --pad {pad}` without the pad, then `--rest` with it"
    )


def unbound(pad: str) -> str:
    """The sentence for a baseline file without an origin, as another program may write it."""
    return (
        f"pad '{pad}': its baseline does not say on which board it was recorded, so it is accepted; "
        f"`fmfts-daemon baseline --rest --pad {pad}` records one that does"
    )
