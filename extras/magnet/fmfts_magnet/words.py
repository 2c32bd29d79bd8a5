"""Says an explanation in words, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fmfts_magnet.cost import MIRRORED_Z, Description
from fmfts_magnet.readings import Array
from fmfts_magnet.search import Found
from fmfts_magnet.verdict import SAME_READINGS, Verdict

AXES = "xyz"
NEODYMIUM_T = 1.25
NAMED_SCALES = {0.5: "half", 2.0: "twice"}


def sentences(verdict: Verdict) -> list[str]:
    """The verdict, what remains open, and what decides it."""
    said = [*_dead(verdict)]
    if not verdict.found:
        worst = "" if verdict.worst is None else f" Sensor {verdict.worst + 1} fits worst."
        said.append(
            f"Nothing that this check knows explains the readings.{worst} Is steel or another magnet nearby, did the "
            "board move, or are sensors_mm in the configuration those of another board? Repeat the check."
        )
        return said
    best = verdict.found[0]
    if verdict.layouts:
        said.append(_other_layout(verdict.layouts))
    elif len(verdict.found) == 1:
        said += report(best, verdict.dead) or (
            [] if said else ["Places, axes, signs and scales are as the configuration says."]
        )
    else:
        said.append(f"{len(verdict.found)} explanations remain:")
        for letter, found in zip("abcdefgh", verdict.found, strict=False):
            said.append(f"({letter}) " + " ".join(report(found, verdict.dead) or ["All is as the configuration says."]))
        said.append(_what_decides(verdict))
    if verdict.blind:
        other = " ".join(report(verdict.blind[0], verdict.dead))
        said.append(
            f"But the readings do not exclude another explanation: {other} The magnet was {_height_mm(best):.0f} mm "
            "above the board: repeat the check with it nearer, or with longer ways to +x and +y."
        )
    return said


def _other_layout(names: tuple[str, ...]) -> str:
    if len(names) == 1:
        return f'The configuration names another board. This is board "{names[0]}": set board = "{names[0]}".'
    return (
        f"{len(names)} boards explain the readings: {' and '.join(names)}. The sketch of the board's firmware says the "
        "order of the chips (docs/anyskin.md). A name with _back means that z points out of the face without chips. "
        "Repeat the check with the magnet lower, moved further, and with --pole up or --pole down."
    )


def report(found: Found, dead: NDArray[np.bool_]) -> list[str]:
    """The faults by this explanation, a sentence for each cause; none if all is as drawn.

    dead (N, 3): axes that are reported elsewhere.
    """
    description = found.description
    return [
        *_whole(description),
        *_order(description),
        *(
            sentence
            for channel in np.flatnonzero(dead.sum(axis=1) < 2).tolist()
            for sentence in _channel(found, channel)
        ),
    ]


def is_wrong(description: Description, channel: int) -> bool:
    """Whether this channel has a fault."""
    return bool(
        not description.image.is_same
        or (description.common != np.eye(3)).any()
        or description.place[channel] != channel
        or (description.turn[channel] != np.eye(3)).any()
        or description.scale[channel] != 1.0
        or description.free[channel]
        or not description.used[channel]
    )


def magnet(found: Found) -> str:
    """The apparent size of the magnet, for the person to compare: only this shows a common scale error."""
    moment = float(np.linalg.norm(found.fit.magnets.moment[0, 0]))
    size_mm = 1e3 * (16.0 * moment / NEODYMIUM_T) ** (1.0 / 3.0)  # B_T = Br·r²·L/4 with L = 2r
    return (
        f"The magnet was {_height_mm(found):.0f} mm above the sensors, and as strong as a neodymium cylinder of about "
        f"{size_mm:.1f} mm diameter and length. "
        "If yours has half or twice that volume, all chips read half or twice the field."
    )


def _whole(description: Description) -> Iterator[str]:
    matrix = description.image.matrix
    if not description.image.is_same:
        if np.linalg.det(matrix) > 0.0:
            angle = int(np.degrees(np.arctan2(matrix[1, 0], matrix[0, 0])).round()) % 360
            yield (
                f"The whole board is turned by {angle}° (counterclockwise, seen from the finger) against the drawing, "
                "or the magnet was moved to other sides than +x and +y."
            )
        else:
            moved = "or the magnet was moved to other sides than +x and +y"
            yield f"The whole board is mirrored against the drawing, {moved}."
    if (description.common == MIRRORED_Z).all():
        yield "All chips read z with the wrong sign: invert geometry.sensors_mirrored."
    elif (description.common != np.eye(3)).any():
        how = _turned(description.common).replace("it has", "they have").replace("its ", "their ")
        yield f"All chips are {how}."


def _order(description: Description) -> Iterator[str]:
    """Exchanged channels, cycle by cycle."""
    seen: set[int] = set()
    for first in range(len(description.place)):
        cycle = [first]
        while (following := int(description.place[cycle[-1]])) != first:
            cycle.append(following)
        if len(cycle) > 1 and not seen & set(cycle):
            names = [str(each + 1) for each in cycle]
            if len(cycle) == 2:
                yield f"Sensors {names[0]} and {names[1]} are swapped: exchange their channels or their wires."
            else:
                moves = ", ".join(
                    f"sensor {one} is at the place of {other}"
                    for one, other in zip(names, [*names[1:], names[0]], strict=True)
                )
                yield f"{len(cycle)} sensors are exchanged in a cycle: {moves}. Correct their channels or their wires."
        seen |= set(cycle)


def _channel(found: Found, channel: int) -> Iterator[str]:
    description, name = found.description, f"Sensor {channel + 1}"
    if not description.used[channel]:
        yield f"{name} alone fits nothing: a bad chip (run selftest), a bad place, or steel beside it."
        return
    turn = description.turn[channel]
    if (turn != np.eye(3)).any():
        yield f"{name} is {_turned(turn)}."
    scale = float(description.scale[channel])
    if description.free[channel]:
        factor = float(np.exp(found.fit.magnets.log_scale[0, channel]))
        yield f"{name} reads {factor:.2f} times the field: its range or its kind of chip is not the configured one."
    elif scale != 1.0:
        how = f"{NAMED_SCALES[scale]} the field (factor {scale:g})"
        yield f"{name} reads {how}: its range or its kind of chip is not the configured one."


def _turned(turn: Array) -> str:
    """The chip's orientation, to follow "is"; `turn` goes from its expected reading to its actual one."""
    if np.linalg.det(turn) > 0.0:
        return _rotated(turn.T)
    wrong = [AXES[axis] for axis in range(3) if turn[axis, axis] == -1.0]
    if np.abs(np.diag(turn)).sum() == 3.0:
        signs = f"wrong signs of {', '.join(wrong)}" if len(wrong) > 1 else f"the wrong sign of {wrong[0]}"
        return f"mirrored: it has {signs}"
    if not (turn < 0.0).any():
        one, other = (AXES[axis] for axis in range(3) if turn[axis, axis] == 0.0)
        return f"mirrored: its {one} and {other} are exchanged"
    return f"mirrored: {_reads(turn)}"


def _rotated(rotation: Array) -> str:
    """rotation: from the drawn chip to the real one."""
    angle = int(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0))).round())
    if angle == 180:
        values = np.diag(rotation)
        if values.max() == 1.0:
            name = AXES[int(values.argmax())]
            return f"turned by 180° about its {name}" + ("" if name == "z" else " (mounted upside down)")
        return f"turned by 180° (mounted upside down and turned): {_reads(rotation.T)}"
    vector = np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    if angle == 90:
        axis = int(np.abs(vector).argmax())
        turned = 90 if vector[axis] > 0.0 else 270
        return f"turned by {turned}° about its {AXES[axis]}"
    return f"turned by 120°: {_reads(rotation.T)}"


def _reads(turn: Array) -> str:
    return ", ".join(
        f"its {AXES[axis]} reads {'−' if turn[axis].min() < 0.0 else ''}{AXES[int(np.abs(turn[axis]).argmax())]}"
        for axis in range(3)
    )


def _dead(verdict: Verdict) -> Iterator[str]:
    for sensor, axes in enumerate(verdict.dead):
        if axes.sum() >= 2:
            yield f"Sensor {sensor + 1} does not measure the magnet: it is dead, or repeats one value (run selftest)."
        elif axes.any():
            yield f"Sensor {sensor + 1} does not measure the magnet on {AXES[int(axes.argmax())]}: run selftest."


def _height_mm(found: Found) -> float:
    return float(found.fit.magnets.position_m[0, :, 2].mean()) * 1e3


def _what_decides(verdict: Verdict) -> str:
    first, second = verdict.found[:2]
    if (first.explanation.scale != second.explanation.scale).any() and (
        first.explanation.turn == second.explanation.turn
    ).all():
        return (
            "A magnet of unknown strength cannot decide between these: `fmfts-daemon selftest` measures the scale of "
            "chips that can, and `fmfts-daemon probe` says which chips were found."
        )
    if abs(float(first.fit.surprise[0] - second.fit.surprise[0])) < SAME_READINGS:
        return (
            "A magnet of unknown pole cannot decide between these. Find its north pole: it draws the south end of a "
            "compass needle. Repeat the check with --pole up or --pole down, which is where the north pole points. A "
            "magnet that is held on the back of the board reads like this, too."
        )
    one, other = first.explanation, second.explanation
    differ = [
        str(channel + 1)
        for channel in range(one.place.shape[1])
        if one.place[0, channel] != other.place[0, channel]
        or (one.turn[0, channel] != other.turn[0, channel]).any()
        or one.scale[0, channel] != other.scale[0, channel]
        or one.used[0, channel] != other.used[0, channel]
    ]
    return (
        f"Repeat the check with the magnet lower than {_height_mm(first):.0f} mm, and moved further, to above sensor "
        f"{' and sensor '.join(differ[:2])}."
    )
