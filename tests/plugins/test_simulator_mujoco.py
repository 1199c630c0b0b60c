"""What is MuJoCo's own in its simulator: drives, contact softness, friction, options.

What must hold of every simulator stands in ``test_simulators.py``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from engines import Mujoco
from gdg_plugins.simulator_mujoco.options import MujocoOptions
from gdg_plugins.simulator_mujoco.world import MujocoWorld
from jaws import grasp_of, protocol_of

from gdg.errors import GdgError
from gdg.hands.hand import Hand, load_hand
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, find_object
from gdg.protocols import Protocol
from gdg.registry import get_registry
from gdg.simulation.bodies import joint_drive

MUJOCO = Mujoco()
ALLEGRO = Path(__file__).resolve().parents[2] / "hands" / "allegro"


@pytest.fixture(scope="module")
def allegro() -> Hand:
    return load_hand(ALLEGRO)


def gripping(
    hand: Hand, obj: ObjectModel, protocol: Protocol, squeeze: float, **options: object
) -> MujocoWorld:
    """A world in which the two jaws hold the object and have come to rest."""
    world = MujocoWorld(hand, obj, protocol, MujocoOptions.model_validate(options))
    grasps = grasp_of(obj, squeeze=squeeze)
    assert grasps.targets is not None
    world.reset(grasps.poses[0].numpy(), grasps.joints[0].numpy(), grasps.targets[0].numpy())
    world.step(100)
    return world


# -- contact -----------------------------------------------------------------------------------


@pytest.mark.parametrize("timestep_ms", [4.0, 10.0, 100 / 6])
def test_overlap_stays_small_under_the_force_of_a_strong_hand(
    timestep_ms: float, gripper_model: HandModel, cube: ObjectModel
):
    protocol = protocol_of(
        "dro-2024", timestep_ms=timestep_ms, drive={"stiffness": 5000.0, "damping": 100.0}
    )
    world = gripping(gripper_model.hand, cube, protocol, squeeze=0.02, force_limits=False)
    assert MUJOCO.forces(world)["left"] == pytest.approx(100.0, rel=0.1)  # on a cube of 32 g
    assert world.touch().overlap < 0.0005


def test_a_softer_impedance_overlaps_more(gripper_model: HandModel, cube: ObjectModel):
    overlaps = [
        gripping(gripper_model.hand, cube, protocol_of("dro-2024"), 0.005, impedance=d)
        .touch()
        .overlap
        for d in (0.9999, 0.999, 0.99, 0.9)
    ]
    assert overlaps == sorted(overlaps)
    assert overlaps[-1] > 5 * overlaps[1]


@pytest.mark.parametrize("friction", [0.2, 0.8, 3.0])
def test_friction_is_coulombs(friction: float, gripper_model: HandModel, cube: ObjectModel):
    """Two jaws bear 2 µ N: a little less does not move the object, a little more does."""
    protocol = protocol_of("dro-2024", friction=friction)
    world = gripping(gripper_model.hand, cube, protocol, squeeze=0.004)
    held, snapshot = world.object_state(), world.save()
    most = 2 * friction * MUJOCO.forces(world)["left"] / float(world.model.body("object").mass[0])
    world.step(20, np.array([0.95 * most, 0.0, 0.0]))
    assert world.object_state().displacement_from(held) < 1e-4
    world.restore(snapshot)
    world.step(20, np.array([1.1 * most, 0.0, 0.0]))
    assert world.object_state().displacement_from(held) > 1e-3


@pytest.mark.parametrize("share", [0.8, 1.25])
def test_torsional_friction_bears_a_twist_up_to_its_limit(share: float, gripper_model: HandModel):
    """About the line through the two contacts of a ball, where Coulomb friction has no lever."""
    lever = 0.01
    protocol = protocol_of("dro-2024", friction=0.3, torsional_friction=lever)
    world = gripping(gripper_model.hand, find_object("tennis_ball"), protocol, squeeze=0.01)
    assert turn_by(world, share * 2 * lever * MUJOCO.forces(world)["left"]) == (share > 1)


def test_without_torsional_friction_a_ball_spins_between_points(gripper_model: HandModel):
    protocol = protocol_of("dro-2024", friction=0.3)
    world = gripping(gripper_model.hand, find_object("tennis_ball"), protocol, squeeze=0.01)
    assert turn_by(world, 0.05)


def turn_by(world: MujocoWorld, twist: float) -> bool:
    """Whether a torque about the line through the jaws (N m) turns the object well, or hardly."""
    before = world.object_state()
    world.data.xfrc_applied[world.model.body("object").id, 4] = twist
    world.step(20)
    angle = world.object_state().rotation_from(before)
    assert angle < 0.05 or angle > 0.2
    return angle > 0.2


# -- drives ------------------------------------------------------------------------------------


def test_limited_drives_close_without_overshoot_or_chatter(allegro: Hand, cube: ObjectModel):
    """Stiff gains under a small force limit, as in dro-2024: the speed is that of the gains."""
    protocol = protocol_of("dro-2024")
    assert protocol.drive is not None
    rate = protocol.drive.stiffness / protocol.drive.damping
    world = MujocoWorld(allegro, cube, protocol, MujocoOptions())
    low, high = allegro.limits()
    start = low + 0.3 * (high - low)
    away = np.eye(4)
    away[0, 3] = 5.0
    world.reset(away, start, start + 0.2)
    hand_dofs = slice(0, len(start))
    speeds = []
    for _ in range(150):
        world.step(1)
        speeds.append(np.abs(world.data.qvel[hand_dofs]).copy())
    speeds = np.array(speeds)
    assert speeds.max() < rate * 0.2
    # past the first steps speeds only fall
    assert np.diff(speeds[5:], axis=0).max() < 1e-4
    way = 1 - np.exp(-rate * 150 * protocol.timestep_ms / 1000)
    moved = world.data.qpos[hand_dofs] - start
    np.testing.assert_allclose(moved, 0.2 * way, rtol=0.01)


def test_a_drive_gives_its_limit_and_not_more(allegro: Hand, cube: ObjectModel):
    protocol = protocol_of("dro-2024")
    world = MujocoWorld(allegro, cube, protocol, MujocoOptions())
    joints = [allegro.urdf.joints[name] for name in allegro.spec.joints]
    limits = [
        joint_drive(allegro, joint, protocol, MujocoOptions()).force_limit for joint in joints
    ]
    limit = max(value for value in limits if value is not None)
    low, high = allegro.limits()
    away = np.eye(4)
    away[0, 3] = 5.0
    world.reset(away, low, high)
    world.step(1)
    forces = np.abs(world.data.actuator_force)
    assert forces.max() <= limit * (1 + 1e-9)
    world.reset(away, low, low + 1e-5)  # far below the limit the gains are the protocol's
    world.step(1)
    assert world.model.actuator_gainprm[:, 0] == pytest.approx(1000.0)


def test_a_drive_without_a_limit_keeps_its_gains(gripper_model: HandModel, cube: ObjectModel):
    world = gripping(
        gripper_model.hand, cube, protocol_of("dro-2024"), squeeze=0.02, force_limits=False
    )
    assert world.model.actuator_gainprm[:, 0] == pytest.approx(1000.0)
    assert not world.hand.limited


# -- the engine --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("timestep_ms", "longest", "substeps"), [(10.0, 5.0, 2), (5.0, 5.0, 1), (100 / 6, 5.0, 4)]
)
def test_steps_are_divided_until_they_are_short_enough(
    timestep_ms: float,
    longest: float,
    substeps: int,
    gripper_model: HandModel,
    cube: ObjectModel,
):
    options = MujocoOptions(max_timestep_ms=longest)
    protocol = protocol_of("dro-2024", timestep_ms=timestep_ms)
    world = MujocoWorld(gripper_model.hand, cube, protocol, options)
    assert world.substeps == substeps
    assert world.model.opt.timestep == pytest.approx(timestep_ms / 1000 / substeps)
    world.reset(np.eye(4), np.zeros(1), np.zeros(1))
    world.step(3)
    assert world.data.time == pytest.approx(3 * timestep_ms / 1000)


def test_the_hand_does_not_collide_with_itself(allegro: Hand, cube: ObjectModel):
    world = MujocoWorld(allegro, cube, protocol_of("dro-2024"), MujocoOptions())
    closed = np.array(allegro.limits()[1])
    away = np.eye(4)
    away[0, 3] = 5.0
    world.reset(away, closed, closed)
    world.step(1)
    assert world.data.ncon == 0


def test_warnings_of_others_are_theirs_again_after_a_step(
    gripper_model: HandModel, cube: ObjectModel
):
    def mine(message: str) -> None:
        raise AssertionError(message)

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(mine)
    try:
        world = gripping(gripper_model.hand, cube, protocol_of("dro-2024"), squeeze=0.002)
        world.step(2, np.array([1e13, 0.0, 0.0]))
        assert mujoco.get_mju_user_warning() is mine
    finally:
        mujoco.set_mju_user_warning(before)


def test_an_old_mujoco_is_refused_with_what_to_do(
    gripper_model: HandModel, cube: ObjectModel, monkeypatch: pytest.MonkeyPatch
):
    engine = sys.modules["gdg_plugins.simulator_mujoco.engine"]
    monkeypatch.setattr(engine, "INTEGRATOR", "mjINT_OF_THE_FUTURE")
    with pytest.raises(GdgError, match="pip install --upgrade mujoco"):
        MujocoWorld(gripper_model.hand, cube, protocol_of("dro-2024"), MujocoOptions())


def test_without_mujoco_the_component_names_the_extra(monkeypatch: pytest.MonkeyPatch):
    record = get_registry().find("simulator", "mujoco")
    monkeypatch.setattr(type(record), "missing_requirements", lambda self: ("mujoco",))
    with pytest.raises(GdgError, match=r"gdg\[mujoco\]"):
        record.load()
