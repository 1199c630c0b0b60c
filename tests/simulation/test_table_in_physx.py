"""Objects on a table in PhysX: they rest on it, jaws lift them off it, and it is in the way."""

from __future__ import annotations

import numpy as np
import pytest
from gdg_plugins.simulator_sapien.options import SapienOptions
from gdg_plugins.simulator_sapien.scene import GraspScene
from jaws import grasp_of, protocol_of, verdict_of
from table_samples import BELOW_CUBE, put

from gdg.data.table import Table
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.simulation.lift import raise_hand, weight

PROTOCOL = protocol_of("tabletop-lift")
#: The palm's height over the cube's middle with the jaws' tips 5 mm above the table, metres.
CLEAR_M = 0.05


def world_without_hand(hand: HandModel, obj: ObjectModel, table: Table) -> GraspScene:
    scene = GraspScene(hand.hand, put(obj, table), PROTOCOL, SapienOptions())
    scene.reset_alone()
    return scene


def test_an_object_rests_on_the_table_and_stays_behind_with_it(
    gripper_model: HandModel, cube: ObjectModel
):
    assert PROTOCOL.lift is not None
    scene = world_without_hand(gripper_model, cube, BELOW_CUBE)
    before = scene.object_state()
    scene.step(250, weight(PROTOCOL.lift, BELOW_CUBE))
    resting = scene.object_state()
    assert resting.displacement_from(before) < 1e-3
    assert scene.on_table()
    assert not scene.touch().touching
    raise_hand(scene, PROTOCOL.lift, PROTOCOL.timestep_ms / 1000, BELOW_CUBE)
    # in the hand's frame the table sinks by 10 cm, and the cube with it
    sunk = resting.center - scene.object_state().center
    np.testing.assert_allclose(sunk, [0, 0, 0.1], atol=1e-3)
    assert scene.on_table()


def test_a_cube_that_touches_a_tilted_table_by_an_edge_tips_onto_it(
    gripper_model: HandModel, cube: ObjectModel
):
    assert PROTOCOL.lift is not None
    slope = 0.3
    up = (float(np.sin(slope)), 0.0, float(np.cos(slope)))
    table = Table(up, -0.02 * (up[0] + up[2]))
    scene = world_without_hand(gripper_model, cube, table)
    before = scene.object_state()
    scene.step(250, weight(PROTOCOL.lift, table))
    after = scene.object_state()
    # its bottom comes to lie on the slope, its middle half an edge above
    assert after.rotation_from(before) == pytest.approx(slope, abs=0.02)
    assert table.up @ after.center - table.offset == pytest.approx(0.02, abs=5e-4)
    assert scene.on_table()


def test_the_table_is_put_back_for_every_trial(gripper_model: HandModel, cube: ObjectModel):
    assert PROTOCOL.lift is not None
    scene = world_without_hand(gripper_model, cube, BELOW_CUBE)
    raise_hand(scene, PROTOCOL.lift, PROTOCOL.timestep_ms / 1000, BELOW_CUBE)
    scene.reset_alone()
    scene.step(50, weight(PROTOCOL.lift, BELOW_CUBE))
    assert abs(scene.object_state().center[2]) < 1e-3


def test_jaws_lift_the_cube_off_the_table(gripper_model: HandModel, cube: ObjectModel):
    grasps = grasp_of(cube, squeeze=0.004, below=CLEAR_M, from_above=True)
    verdict = verdict_of(gripper_model, put(cube), grasps, PROTOCOL)
    assert (verdict.success, verdict.failure) == (True, "")
    assert verdict.lift_contact
    assert verdict.lift_displacement_m < 0.005
    assert np.isnan(verdict.displacement_m).all()
    # without a hand the cube stays on the table, 10 cm below
    assert verdict.free_displacement_m == pytest.approx(0.1, abs=2e-3)


def test_jaws_that_do_not_press_leave_it_on_the_table(gripper_model: HandModel, cube: ObjectModel):
    grasps = grasp_of(cube, gap=0.005, squeeze=None, below=CLEAR_M, from_above=True)
    verdict = verdict_of(gripper_model, put(cube), grasps, PROTOCOL)
    assert verdict.failure == "dropped"
    assert verdict.drift_m < 0.001
    assert verdict.lift_displacement_m == pytest.approx(0.1, abs=0.005)


def test_the_hand_collides_with_the_table(gripper_model: HandModel, cube: ObjectModel):
    """Of two jaws that open far from the cube, a wall stops the left one."""
    wall = Table((0.0, -1.0, 0.0), -0.03)
    scene = GraspScene(gripper_model.hand, put(cube, wall), PROTOCOL, SapienOptions())
    grasps = grasp_of(cube, shift=0.2)
    scene.reset(grasps.poses[0].numpy(), np.array([0.04]), np.array([0.0]))
    scene.step(200)
    placed = scene.hand.link_poses()
    assert placed["right"][1, 3] == pytest.approx(-0.05, abs=1e-3)
    # its outer face lies 10 mm beyond its inner one
    assert placed["left"][1, 3] == pytest.approx(0.02, abs=1e-3)
