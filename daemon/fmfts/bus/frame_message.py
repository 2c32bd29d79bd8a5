"""Converts frames and early samples to messages of the bus and of recordings, and back."""

from __future__ import annotations

import struct

import msgspec
import numpy as np

from fmfts.bus.messages import EarlyMessage, FrameMessage, KnownJoints
from fmfts.common import possible
from fmfts.sensor.chips import DEFAULT_CHIP, Chip
from fmfts.sensor.early import EarlySample
from fmfts.sensor.frame import Frame, bits
from fmfts.sensor.joints import Joints

READING = struct.Struct("<hhhH")  # counts and age, as in firmware/wire.md


def frame_message(
    frame: Frame, pad: str, boot: str, utc_ns: int, used: bool = True, joints: Joints | None = None
) -> FrameMessage:
    """The message of a frame. used: whether the pipeline processed it. joints: those it used; None: no hand."""
    gain_code, valid, fresh, packed = frame.packed  # mostly a board's bytes: arrays would take longer
    readings = list(READING.iter_unpack(packed))
    return FrameMessage(
        pad=pad,
        boot=boot,
        sequence=frame.sequence,
        device_time_us=frame.device_time_us,
        host_time_ns=frame.host_time_ns,
        utc_ns=utc_ns,
        gain_code=gain_code,
        counts=[(x, y, z) for x, y, z, _ in readings],
        age_us=[age_us for *_, age_us in readings],
        fresh=bits(fresh, len(readings)).tolist(),
        valid=bits(valid, len(readings)).tolist(),
        temperature_c=frame.temperature_c,
        used=used,
        may_search=msgspec.UNSET if frame.may_search else False,
        joints=msgspec.UNSET if joints is None else _known(joints),
    )


def _known(joints: Joints) -> KnownJoints:
    return KnownJoints(
        t_ns=joints.time_ns,
        position_rad=list(joints.position_rad),
        before_ns=joints.before_ns,
        before_rad=list(joints.before_rad),
    )


def _joints(known: KnownJoints) -> Joints:
    """ValueError: impossible joint positions."""
    possible.JOINT_RAD.require([*known.position_rad, *known.before_rad])
    if any(time_ns is not None and abs(time_ns) >= 1 << 62 for time_ns in (known.t_ns, known.before_ns)):
        raise ValueError("joints at a time that no clock tells")
    return Joints(known.t_ns, tuple(known.position_rad), known.before_ns, tuple(known.before_rad))


def early_message(early: EarlySample, pad: str, boot: str, utc_ns: int) -> EarlyMessage:
    """The message of a sample that came before its frame, and that the pipeline processed."""
    return EarlyMessage(
        pad=pad,
        boot=boot,
        sensor=early.sensor,
        device_time_us=early.device_time_us,
        utc_ns=utc_ns,
        gain_code=early.gain_code,
        counts=early.counts,
    )


def early_of(message: EarlyMessage, chip: Chip = DEFAULT_CHIP) -> EarlySample:
    """The sample of a message. chip: of the recorded configuration. ValueError: a chip cannot give such a number."""
    early = EarlySample(0, message.sensor, message.device_time_us, message.gain_code, message.counts, chip)
    if not early.is_possible:
        raise ValueError("a sample that no chip gives")
    return early


def frame_of(message: FrameMessage, pad_index: int = 0, chip: Chip = DEFAULT_CHIP) -> Frame:
    """The frame of a message, as its source gave it. chip: of the recorded configuration, because messages do not name
    it.

    ValueError: a source cannot give such a number.
    """
    numbers = (message.sequence, message.device_time_us, message.host_time_ns)
    sensors = {len(each) for each in (message.counts, message.age_us, message.fresh, message.valid)}
    if len(sensors) != 1 or not 0 <= message.gain_code < len(chip.step_t) or max(map(abs, numbers)) >= 1 << 62:
        raise ValueError("a frame that no source gives")
    return Frame(
        pad_index=pad_index,
        sequence=message.sequence,
        device_time_us=message.device_time_us,
        host_time_ns=message.host_time_ns,
        gain_code=message.gain_code,
        counts=np.array(message.counts, dtype=np.int16).reshape(-1, 3),
        age_us=np.array(message.age_us, dtype=np.uint16),
        fresh=np.array(message.fresh, dtype=np.bool_),
        valid=np.array(message.valid, dtype=np.bool_),
        temperature_c=chip.believed_c(message.temperature_c),
        chip=chip,
        may_search=message.may_search is not False,
        joints=_joints(message.joints) if isinstance(message.joints, KnownJoints) else None,
    )
