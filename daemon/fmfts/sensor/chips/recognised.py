"""Which kind of chip gave an identification, and what to do where it is not the configured one."""

from __future__ import annotations

from collections.abc import Sequence

from fmfts.sensor.chips import CHIPS, Chip


def kind_of(answer: bytes) -> Chip | None:
    """The chip with this identification; None if there is none. If two kinds have the same, the first counts."""
    return next((each for each in CHIPS.values() if each.is_identity(answer)), None)


def why_not(chip: Chip, answer: bytes) -> str | None:
    """What is wrong with a sensor that identifies itself by `answer`, to follow its name; None if nothing is.

    Chips are often sold under another's name, with other registers and another scale.
    """
    if chip.is_identity(answer):
        return None
    other = kind_of(answer)
    if other is None:
        return chip.why_not_identity(answer)
    return f'{_not_but(chip, other)}: set chip = "{other.name}"'


def why_not_among(chip: Chip, answers: Sequence[bytes]) -> tuple[int, str] | None:
    """The first sensor of a pad that is of another kind than `chip`, and what to do; None where all may be `chip`s.

    answers: of each sensor; unknown ones are ignored.
    """
    kinds = [kind_of(answer) for answer in answers]
    for sensor, (answer, kind) in enumerate(zip(answers, kinds, strict=True)):
        if kind is not None and not chip.is_identity(answer):
            alike = all(each in (None, kind) for each in kinds)
            mend = f'set chip = "{kind.name}"' if alike else "a pad's chips must be of one kind: fit another one there"
            return sensor, f"{_not_but(chip, kind)}: {mend}"
    return None


def _not_but(chip: Chip, other: Chip) -> str:
    where = f" at 0x{other.address:02X}" if len(other.addresses) == 1 else ""
    return f"is {other.named}{where}, not {chip.named}"
