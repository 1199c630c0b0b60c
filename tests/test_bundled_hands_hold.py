"""Every bundled hand holds a sphere and a box in simulation."""

from __future__ import annotations

import pytest

import gdg
from gdg.folders import HANDS

BUNDLED = tuple(name for name, found in HANDS.all().items() if found.tier == "bundled")
#: Enough grasps that one holds, few enough particles that the suite stays quick.
GRASPS, QUICK = 2, ["fitter.particles=8", "simulator.trials=decisive"]


@pytest.mark.parametrize("thing", ["baseball", "foam_brick"])
@pytest.mark.parametrize("hand", BUNDLED)
def test_a_bundled_hand_holds_a_sphere_and_a_box(hand: str, thing: str):
    grasps = gdg.grasp(hand, thing, GRASPS, settings=QUICK)
    assert grasps.verdicts is not None
    told = [f"{verdict.failure or 'pass'}" for verdict in grasps.verdicts]
    assert len(grasps.passed) >= 1, told
