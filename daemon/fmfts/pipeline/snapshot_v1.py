"""Reads memories of format 1, which named the private attributes that the pipeline's objects had then."""

from __future__ import annotations

from typing import Any

Values = dict[str, Any]


def converted(old: Values) -> Values:
    """The memory in format 2. KeyError if something is missing."""
    alignment, estimator, sighting = old["_alignment"]["owner"], old["_estimator"], old["_sighting"]["owner"]
    return {
        "alignment": {
            "field_t": alignment["_field"],
            "time_us": alignment["_time"],
            "repeats": alignment["_repeats"],
        },
        "estimator": None if estimator is None else _estimator(estimator["owner"]),
        "number": old["_sender"]["owner"]["number"],
        "sampled_ns": old["_sender"]["owner"]["_sampled_ns"],
        "sighting": [_plain(sighting["last"]), sighting["covariance"], sighting["time_ns"]],
        "why_no_estimator": old["_why_none"],
    }


def _estimator(old: Values) -> Values:
    touch, smoother = old["_touch"]["owner"], old["_smoother"]["owner"]
    return {
        "tracker": _tracker(old["_tracker"]["owner"]),
        "touch": {"touched": touch["_touched"], "quiet_frames": touch["_quiet_frames"]},
        "smoother": {
            "pose": smoother["_pose"],
            "speed": smoother["_speed"],
            "acceleration": smoother["_acceleration"],
        },
        "ambient_motion": None if old["_constancy"] is None else _ambient_motion(old["_constancy"]["owner"]),
        "last_us": old["_last_us"],
        "lifted_s": old["_lifted_s"],
    }


def _tracker(old: Values) -> Values:
    return {
        "state": _plain(old["_last"]),
        "covariance": old["_covariance"],
        "unread_variance": old.get("_unread_variance", 0.0),  # the oldest memories lack it
        "watch": None if old["_watch"] is None else _watch(old["_watch"]["owner"]),
        "since_good_s": old["_since_good_s"],
        "warmth_variance": old["_warmth_variance"],
        "disturbed_frames": old["_disturbed_frames"],
        "misfit": old["_misfit"],
        "verdict": _plain(old["_verdict"]),
    }


def _watch(old: Values) -> Values:
    residuals = old["_innovations"]["owner"]
    return {
        "residuals": {
            "mean_t": residuals["_mean"],
            "lasting_t2": residuals["_lasting"],
            "frames": residuals["_frames"],
            "change": residuals["change"],
            "pushed": residuals["_pushed"],
            "since": residuals["_since"],
            "sound": residuals["sound"],
            "lasting_misfit": residuals["misfit"],
        },
        "finding": _plain(old["_finding"]),
        "heard": _plain(old["_heard"]),
    }


def _ambient_motion(old: Values) -> Values:
    return {
        "lowest_t": old["_lowest_t"],
        "highest_t": old["_highest_t"],
        "explained": _plain(old["_explained"]),
        "moved_t": old["_moved_t"],
        "frames_seen": old["_frames"],
        "well_frames": old["_well_frames"],
        "logged": old["_logged"],
    }


def _plain(value: Any) -> Any:
    """`value` without the class names that format 1 wrote."""
    if isinstance(value, dict) and "value" in value:
        return {name: _plain(member) for name, member in value["members"].items()}
    if isinstance(value, dict) and "items" in value:
        return [_plain(item) for item in value["items"]]
    return value
