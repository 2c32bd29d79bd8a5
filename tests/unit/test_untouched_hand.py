"""leaphand's recordings: a hand that moves and touches nothing, by what another recording of it taught.

The recordings are not in this repository: FMFTS_RECORDED names their folder.
"""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.config import SceneConfig
from fmfts_lab.real.untouched_hand import SKINS, HandPad, HandRows, Reported, coverage, reported
from unit.recorded_files import needs


@pytest.mark.parametrize(("with_joints", "most_disturbed"), [(True, 0.05), (False, 0.15)])
@pytest.mark.parametrize(("taught_by", "recording"), [(1, 2), (2, 1)])
def test_recorded_hand_reports_presses_alone(
    taught_by: int, recording: int, with_joints: bool, most_disturbed: float
) -> None:
    teacher, rows = (HandRows.of(needs(f"leaphand_nocontact_{one}.txt")) for one in (taught_by, recording))
    pad = HandPad(SceneConfig(ambient="posture"))
    total = Reported()
    for skin in range(SKINS):
        posture = pad.taught(teacher, skin, with_joints)
        total += reported(pad, rows, skin, posture, with_joints, press_every=20)
    assert total.touching == 0
    assert total.disturbed <= most_disturbed * total.rows
    assert total.found >= 0.95 * total.presses
    assert total.beyond == 0


def test_deviations_of_a_posture_cover_another_recording() -> None:
    """93.0 and 94.6 % within two deviations. What left-out parts of the teacher showed covers 84.6 and 78.0 %."""
    recordings = [HandRows.of(needs(f"leaphand_nocontact_{one}.txt")) for one in (1, 2)]
    for _, (alone, whole) in coverage(recordings):
        assert np.mean(np.abs(alone) < 2.0) < 0.85
        assert 0.925 <= np.mean(np.abs(whole) < 2.0) <= 0.98
        assert np.mean(np.abs(whole) > 5.0) < 0.01
