"""Which kind of chip gave an identification, and what to do where it is not the configured one."""

from __future__ import annotations

from fmfts.sensor.chips import CHIPS, Chip


def why_not(chip: Chip, answer: bytes) -> str | None:
    """What is wrong with a sensor that identifies itself by `answer`, to follow its name; None if nothing is.

    What is sold as one chip is often another one, with other registers and another scale.
    """
    if chip.is_identity(answer):
        return None
    other = next((each for each in CHIPS.values() if each.is_identity(answer)), None)
    if other is None:
        return chip.why_not_identity(answer)
    where = f" at 0x{other.address:02X}" if len(other.addresses) == 1 else ""
    return f'is a {other.label}{where}, not an {chip.label}: set chip = "{other.name}"'
