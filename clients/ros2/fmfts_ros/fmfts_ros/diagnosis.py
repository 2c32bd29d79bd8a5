"""Says in diagnostic_msgs how a pad is, with the deviations for which the other messages have no place."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from fmfts_client import Contact, Status

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
LEVELS = {"ok": OK, "degraded": WARN}  # every other health means that there is no contact to act on
# Fields of a contact beside the force and place in the other messages.
SHOWN = ("force_sd_n", "x_sd_m", "y_sd_m", "shear_x_sd_n", "shear_y_sd_n", "force_min_n", "displacement_m")
SHOWN += ("displacement_sd_m", "temperature_c", "model", "baseline")
SHOWN_OF_STATUS = ("source", "rate_hz", "rate_nominal_hz", "dropped", "gaps", "crc_errors", "reconnects")
SHOWN_OF_STATUS += ("latency_p99_s", "remanence_t", "gains_from", "uptime_s")


def verdict(contact: Contact | None, silence_s: float, why_silent: str) -> tuple[bytes, str]:
    """Level and sentence.

    silence_s: since the daemon sent something of this pad; why_silent: "" unless that is too long.
    """
    if why_silent:
        return ERROR, f"the daemon has been silent for {silence_s:.1f} s: {why_silent}"
    if contact is None:
        return ERROR, "no contact of this pad has arrived"
    level = LEVELS.get(contact.health, ERROR)
    if contact.over_range:
        at_least = "" if contact.force_min_n is None else f" (at least {contact.force_min_n:.2f} N)"
        return max(level, WARN), f"pressed harder than its calibration knows{at_least}; no wrench is published"
    if level == OK and contact.more:
        return WARN, "two fingers do not explain the field; no contacts are published"
    return level, f"{contact.health}: {contact.reason}" if contact.reason else contact.health


def status_of(
    name: str, contact: Contact | None, status: Status | None, silence_s: float, why_silent: str
) -> DiagnosticStatus:
    """name: of the component, such as "fmfts: left". Numbers that are not known are "unknown"."""
    level, sentence = verdict(contact, silence_s, why_silent)
    values: dict[str, object] = {"silence_s": round(silence_s, 3)}
    if contact is not None:
        values.update(health=contact.health, reason=contact.reason, sample_age_s=round(contact.sample_age_s, 3))
        values.update({key: getattr(contact, key) for key in SHOWN})
        if contact.tells_fingers:
            values.update(fingers=None if contact.contacts is None else len(contact.contacts), more=contact.more)
    if status is not None:
        values.update({key: getattr(status, key) for key in SHOWN_OF_STATUS})
        values["sensor_faults"] = "; ".join(status.sensor_faults)
    board = "" if status is None else str(status.board.get("uid", ""))
    return DiagnosticStatus(level=level, name=name, message=sentence, hardware_id=board, values=_key_values(values))


def _key_values(values: dict[str, object]) -> list[KeyValue]:
    return [KeyValue(key=key, value="unknown" if value is None else _text(value)) for key, value in values.items()]


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
