"""The force that a passing tool may look like without being detected."""

from __future__ import annotations

from dataclasses import replace

from fmfts.contact import ContactModel, NoContactModel
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.pose.hidden_gradient import HiddenGradient
from fmfts.pose.state import turned


def hidden_force_n(baselined: BaselinedPad, hidden: HiddenGradient, model: ContactModel | NoContactModel) -> float:
    """The largest force (N) that the model makes of a change that only looks like one, at rest.

    0 where the scene has no steel nearby, and where there is no pose at rest or no contact model.
    """
    resting = baselined.resting() if baselined.tracking.steel_nearby and isinstance(model, ContactModel) else None
    if resting is None or not isinstance(model, ContactModel):
        return 0.0
    state, forces_n = resting.state, [0.0]
    for change in hidden.unseen_changes():
        moved = replace(state, position_m=state.position_m + change[:3], axis=turned(state.axis, change[3:]))
        pose = baselined.in_nominal_frame(replace(resting, state=moved))
        forces_n.append(model.estimate(*pose, baselined.magnet_off_m).force_n)
    return max(forces_n)
