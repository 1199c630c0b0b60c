"""What holds of every simulator; ``simulation/test_presets`` has the controls of each preset."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from weakref import ref

import numpy as np
import pytest
import torch
import trimesh
from conftest import build_model
from engines import ENGINES, Engine
from jaws import grasp_of, protocol_of
from real_hands import HANDS as REAL_HANDS
from table_samples import put

from gdg.data.grasps import GraspSet
from gdg.data.verdict import DIRECTIONS, Verdict
from gdg.hands.hand import Hand, load_hand
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, find_object, load_object
from gdg.protocols import Protocol
from gdg.rotations import random_rotations
from gdg.simulation.simulator import WorldSimulator
from gdg.simulation.trial import TrialStart, run_trial
from gdg.simulation.world import GraspWorld
from gdg.testing import check_component

BUNDLED = Path(__file__).resolve().parents[2] / "hands"
PRESETS = ("dro-2024", "gendexgrasp-2022")

pytestmark = pytest.mark.parametrize("engine", ENGINES, ids=[engine.name for engine in ENGINES])


def start_of(grasps: GraspSet) -> TrialStart:
    targets = grasps.joints if grasps.targets is None else grasps.targets
    return TrialStart(grasps.poses[0].numpy(), grasps.joints[0].numpy(), targets[0].numpy())


def test_conformance_kit_passes(engine: Engine):
    assert check_component("simulator", engine.name) == []


# -- controls ----------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", PRESETS)
def test_a_firm_grasp_hardly_moves_in_any_trial(
    engine: Engine, preset: str, gripper_model: HandModel, cube: ObjectModel
):
    verdict = engine.verdict(gripper_model, cube, grasp_of(cube), protocol_of(preset, shifts=4))
    assert verdict.success
    assert verdict.failure == ""
    assert verdict.shift_successes == (True,) * 5
    assert verdict.contact_kept == (True,) * 6
    assert max(verdict.displacement_m) < 0.001
    assert max(verdict.rotation_rad) < 0.01
    assert verdict.penetration_end_mm < 0.5
    assert verdict.engine.startswith(engine.name)


def test_verdict_turns_with_the_world(engine: Engine, gripper_model: HandModel, tmp_path: Path):
    protocol = protocol_of(
        "dro-2024", friction=0.2, pushes={"order": "reset", "acceleration": 3.0},
        success={"measured": "per-push"},
    )  # fmt: skip
    box = find_object("foam_brick")
    quarter = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    path = tmp_path / "turned.stl"
    box.mesh.copy().apply_transform(quarter).export(path)
    grasps = grasp_of(box)
    turned = replace(grasps, poses=torch.tensor(quarter, dtype=torch.float32) @ grasps.poses)
    before = engine.verdict(gripper_model, box, grasps, protocol)
    after = engine.verdict(gripper_model, load_object(path, "turned"), turned, protocol)
    # a push along +x becomes one along +y, one along +y becomes one along -x
    image = [DIRECTIONS.index(name) for name in ("+y", "-y", "-x", "+x", "+z", "-z")]
    assert after.success == before.success
    assert [after.displacement_m[i] for i in image] == pytest.approx(
        before.displacement_m, abs=2e-4
    )
    assert after.drift_m == pytest.approx(before.drift_m, abs=2e-4)


# -- lifting -----------------------------------------------------------------------------------

LIFTS = ("gdg-realistic-1", "tabletop-lift")


def lifted(
    engine: Engine, preset: str, hand: HandModel, obj: ObjectModel, grasps: GraspSet
) -> Verdict:
    protocol = protocol_of(preset)
    return engine.verdict(hand, put(obj) if protocol.needs_table else obj, grasps, protocol)


@pytest.mark.parametrize("preset", LIFTS)
def test_firm_jaws_lift_the_cube(
    engine: Engine, preset: str, gripper_model: HandModel, cube: ObjectModel
):
    grasps = grasp_of(cube, squeeze=0.004, below=0.05, from_above=True)
    verdict = lifted(engine, preset, gripper_model, cube, grasps)
    assert (verdict.success, verdict.failure, verdict.lift_contact) == (True, "", True)
    assert verdict.lift_displacement_m < 0.001


@pytest.mark.parametrize("preset", LIFTS)
def test_open_jaws_leave_the_cube_behind(
    engine: Engine, preset: str, gripper_model: HandModel, cube: ObjectModel
):
    grasps = grasp_of(cube, gap=0.01, below=0.05, from_above=True)
    verdict = lifted(engine, preset, gripper_model, cube, grasps)
    assert not verdict.success
    assert not verdict.lift_contact
    # with a table it goes no farther than the table does, without it falls
    low, high = (0.09, 0.11) if preset == "tabletop-lift" else (1.0, 10.0)
    assert low < verdict.lift_displacement_m < high


#: Which way gravity comes: as a push, or with the lift.
WEIGHTS = {
    "rotated": {"pushes": {"directions": ["-z"], "acceleration": 9.81}, "lift": None},
    "tilted": {"pushes": None},
}


@pytest.mark.parametrize("failure", WEIGHTS)
def test_a_bar_that_is_held_by_its_end_turns_between_weak_jaws_and_not_between_firm_ones(
    engine: Engine, failure: str, gripper_model: HandModel, tmp_path: Path
):
    trimesh.creation.box((0.2, 0.03, 0.03)).export(tmp_path / "bar.stl")
    bar = load_object(tmp_path / "bar.stl", "bar")
    # it goes far, too, and that would be told first
    protocol = protocol_of(
        "gdg-realistic-1", success={"max_displacement_m": 0.3}, **WEIGHTS[failure]
    )
    weak, firm = (
        engine.verdict(gripper_model, bar, grasp_of(bar, squeeze=s, shift=-0.085), protocol)
        for s in (0.001, 0.002)
    )
    assert (weak.failure, firm.failure) == (failure, "")
    turned, still = (
        v.lift_rotation_rad if failure == "tilted" else v.rotation_rad[DIRECTIONS.index("-z")]
        for v in (weak, firm)
    )
    assert still < 0.02
    assert 0.35 < turned < 1.2


def test_shapes_are_cooked_once_for_all_calls_that_are_alike(
    engine: Engine, gripper_model: HandModel, cube: ObjectModel, monkeypatch: pytest.MonkeyPatch
):
    simulator, cooked = engine.simulator(), []
    build = simulator.build_world

    def counted(hand: Hand, obj: ObjectModel, protocol: Protocol) -> GraspWorld:
        cooked.append(protocol)
        return build(hand, obj, protocol)

    monkeypatch.setattr(simulator, "build_world", counted)
    plain, other = protocol_of("dro-2024", shifts=0), protocol_of("gendexgrasp-2022", shifts=0)
    firm, off = grasp_of(cube), grasp_of(cube, shift=0.005)

    def judged(grasps: GraspSet, protocol: Protocol) -> Verdict:
        return replace(simulator.simulate(gripper_model, cube, grasps, protocol)[0], seconds=0.0)

    first = judged(firm, plain)
    assert judged(off, plain) != first
    assert judged(firm, plain) == first
    assert cooked == [plain]
    judged(firm, other)
    assert judged(firm, plain) == first
    assert cooked == [plain, other, plain]


def test_a_world_that_broke_or_was_interrupted_is_not_used_again(
    engine: Engine, gripper_model: HandModel, cube: ObjectModel, monkeypatch: pytest.MonkeyPatch
):
    simulator, protocol = engine.simulator(), protocol_of("dro-2024", shifts=0)
    worlds: list[GraspWorld] = []
    build = simulator.build_world

    def kept(hand: Hand, obj: ObjectModel, protocol: Protocol) -> GraspWorld:
        worlds.append(build(hand, obj, protocol))
        return worlds[-1]

    monkeypatch.setattr(simulator, "build_world", kept)

    def judged() -> Verdict:
        (verdict,) = simulator.simulate(gripper_model, cube, grasp_of(cube), protocol)
        return verdict

    def interrupted(*args: object) -> None:
        raise KeyboardInterrupt

    assert judged().success
    monkeypatch.setattr(worlds[0], "step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        judged()
    assert judged().success
    assert len(worlds) == 2
    lost = replace(worlds[1].object_state(), center=np.full(3, np.nan))
    monkeypatch.setattr(worlds[1], "object_state", lambda: lost)
    assert judged().failure == "diverged"
    assert judged().success
    assert len(worlds) == 3


def test_a_kept_world_keeps_no_object_alive(engine: Engine, gripper_model: HandModel):
    simulator, obj = engine.simulator(), find_object("cube_small")
    gone = ref(obj)
    simulator.simulate(gripper_model, obj, grasp_of(obj), protocol_of("dro-2024", shifts=0))
    del obj
    assert gone() is None


def test_a_table_carries_the_object_and_follows_it_down(
    engine: Engine, gripper_model: HandModel, cube: ObjectModel
):
    protocol = protocol_of("tabletop-lift")
    world = engine.simulator().build_world(gripper_model.hand, put(cube), protocol)
    away = np.eye(4)
    away[0, 3] = 5.0
    world.reset(away, np.zeros(1), np.zeros(1))
    weight = np.array([0.0, 0.0, -9.81])
    before = world.object_state()
    world.step(50, weight)
    resting = world.object_state()
    assert world.on_table()
    assert not world.touch().touching
    assert resting.displacement_from(before) < 1e-4
    snapshot = world.save()
    for step in range(1, 101):
        world.lower_table(0.0002 * step)
        world.step(1, weight)
    assert world.on_table()
    assert world.object_state().center[2] == pytest.approx(resting.center[2] - 0.02, abs=2e-4)
    world.restore(snapshot)
    world.step(20, weight)
    assert world.on_table()
    assert world.object_state().displacement_from(resting) < 1e-4


# -- figures -----------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", PRESETS)
def test_free_displacement_is_that_of_the_equations_of_motion(
    engine: Engine, preset: str, gripper_model: HandModel, cube: ObjectModel
):
    protocol = protocol_of(preset)
    verdict = engine.verdict(gripper_model, cube, grasp_of(cube), protocol)
    assert protocol.pushes is not None
    substeps = engine.substeps(engine.world(gripper_model.hand, cube, protocol))
    dt, speed, way = protocol.timestep_ms / 1000 / substeps, 0.0, 0.0
    for _ in range(substeps * protocol.pushes.steps):
        speed = (speed + protocol.pushes.acceleration * dt) * (
            1 - protocol.body.linear_damping * dt
        )
        way += speed * dt
    assert verdict.free_displacement_m == pytest.approx(way, rel=1e-3)
    # half a t² without damping; the steps of the simulation add one per cent
    if preset == "dro-2024":
        assert verdict.free_displacement_m == pytest.approx(0.25, rel=0.02)


def test_grip_force_is_stiffness_times_squeeze(
    engine: Engine, gripper_model: HandModel, cube: ObjectModel
):
    protocol = protocol_of("dro-2024")
    assert protocol.drive is not None
    force = grip_force(engine, gripper_model, cube, protocol, squeeze=0.002)
    assert force == pytest.approx(protocol.drive.stiffness * 0.002, rel=0.1)


def test_grip_force_is_bounded_by_the_hand_where_asked(
    engine: Engine, gripper_model: HandModel, cube: ObjectModel
):
    limit = gripper_model.hand.spec.drives.default.force_limit
    own_gains = protocol_of("dro-2024").model_copy(update={"drive": None})
    stiff = protocol_of("dro-2024", drive={"stiffness": 5000.0, "damping": 100.0})
    own = grip_force(engine, gripper_model, cube, own_gains, squeeze=0.02)
    assert own == pytest.approx(limit, rel=0.1)
    bounded = grip_force(engine, gripper_model, cube, stiff, squeeze=0.02, force_limits=True)
    assert bounded == pytest.approx(limit, rel=0.1)
    free = grip_force(engine, gripper_model, cube, stiff, squeeze=0.02, force_limits=False)
    assert free > 2 * limit


def grip_force(
    engine: Engine,
    hand: HandModel,
    obj: ObjectModel,
    protocol: Protocol,
    squeeze: float,
    **options: object,
) -> float:
    """Force of the left jaw on the object after settling, newton."""
    world = engine.world(hand.hand, obj, protocol, **options)
    start = start_of(grasp_of(obj, squeeze=squeeze))
    world.reset(start.T_object_root, start.joints, start.targets)
    world.step(200)
    return engine.forces(world)["left"]


def test_friction_decides_whether_a_weak_grip_holds(
    engine: Engine, gripper_model: HandModel, cube: ObjectModel
):
    pushes = {"order": "reset", "acceleration": 50.0}
    success = {"measured": "per-push", "contact": False}
    smooth = protocol_of("dro-2024", friction=0.1, pushes=pushes, success=success)
    rough = protocol_of("dro-2024", friction=3.0, pushes=pushes, success=success)
    assert engine.verdict(gripper_model, cube, grasp_of(cube), smooth).failure == "moved"
    assert engine.verdict(gripper_model, cube, grasp_of(cube), rough).success


def test_object_has_the_mass_and_inertia_of_its_shape(engine: Engine, gripper_model: HandModel):
    brick = find_object("foam_brick")
    found = engine.inertial(engine.world(gripper_model.hand, brick, protocol_of("dro-2024")))
    expected = 500.0 * brick.inertia.numpy()
    assert found.mass == pytest.approx(500.0 * brick.volume, rel=1e-5)
    np.testing.assert_allclose(found.center, brick.center_of_mass.numpy(), atol=1e-7)
    np.testing.assert_allclose(found.inertia, expected, atol=1e-4 * expected.max())


# -- repeatability -----------------------------------------------------------------------------


@pytest.mark.parametrize("order", ["sequential", "reset"])
def test_reused_world_repeats_a_fresh_one_exactly(
    engine: Engine, order: str, gripper_model: HandModel, cube: ObjectModel
):
    protocol = protocol_of(
        "dro-2024",
        friction=0.2,
        pushes={"order": order, "acceleration": 8.0},
        success={"measured": "per-push"},
    )
    start, other = start_of(grasp_of(cube, shift=0.012)), start_of(grasp_of(cube, gap=-0.004))
    used = engine.world(gripper_model.hand, cube, protocol)
    run_trial(used, protocol, other)
    again = run_trial(used, protocol, start)
    fresh = engine.world(gripper_model.hand, cube, protocol)
    assert again == run_trial(fresh, protocol, start)
    assert again != run_trial(fresh, protocol, other)


def resident_bytes() -> int:
    pages = Path("/proc/self/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads memory from /proc")
def test_a_world_keeps_no_memory_from_trial_to_trial(
    engine: Engine, gripper_model: HandModel, cube: ObjectModel
):
    protocol = protocol_of("dro-2024", pushes={"steps": 1}, start={"settle_steps": 1})
    world = engine.world(gripper_model.hand, cube, protocol)
    start = start_of(grasp_of(cube))
    sizes = []
    for _ in range(3):
        for _ in range(200):
            run_trial(world, protocol, start)
        sizes.append(resident_bytes())
    assert sizes[-1] - sizes[0] < 2**20


def test_a_simulation_that_diverges_says_so_and_leaves_no_file(
    engine: Engine,
    gripper_model: HandModel,
    cube: ObjectModel,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.chdir(tmp_path)
    protocol = protocol_of("dro-2024", shifts=4, pushes={"acceleration": 1e13})
    grasps = grasp_of(cube).select([0, 0])
    simulator = engine.simulator()
    assert isinstance(simulator, WorldSimulator)
    first, second = simulator.simulate(gripper_model, cube, grasps, protocol)
    assert first.failure == "diverged"
    assert second.failure == "diverged"
    firm = engine.verdict(gripper_model, cube, grasp_of(cube), protocol_of("dro-2024"))
    assert firm.success
    assert list(tmp_path.iterdir()) == []


# -- the hand's tree ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(path.parent.name for path in BUNDLED.glob("*/hand.yaml")))
def test_links_are_where_the_hand_model_has_them(engine: Engine, name: str, cube: ObjectModel):
    assert_same_kinematics(engine, build_model(load_hand(BUNDLED / name)), cube)


@pytest.mark.parametrize("name", REAL_HANDS)
def test_links_of_real_hands_are_where_the_hand_model_has_them(
    engine: Engine, name: str, real_hands: Path, cube: ObjectModel
):
    assert_same_kinematics(engine, build_model(load_hand(real_hands / name)), cube)


def test_links_of_a_prismatic_hand_with_mimic_are_where_the_hand_model_has_them(
    engine: Engine, gripper_model: HandModel, cube: ObjectModel
):
    assert_same_kinematics(engine, gripper_model, cube)


def assert_same_kinematics(engine: Engine, model: HandModel, cube: ObjectModel) -> None:
    world = engine.world(model.hand, cube, protocol_of("dro-2024"))
    generator = torch.Generator().manual_seed(0)
    share = torch.rand(len(model.joint_names), generator=generator)
    joints = model.lower + share * (model.upper - model.lower)
    T_world_root = torch.eye(4)
    T_world_root[:3, :3] = random_rotations(1, generator)[0]
    T_world_root[:3, 3] = torch.tensor([1.0, -2.0, 0.5])
    world.reset(T_world_root.numpy(), joints.double().numpy(), joints.double().numpy())
    expected = T_world_root @ model.link_poses_in_root(joints[None])[0]
    for steps in (0, 20):
        world.step(steps)
        placed = engine.link_poses(world)
        found = np.stack([placed[link] for link in model.link_names])
        np.testing.assert_allclose(
            found, expected.numpy(), atol=1e-4, err_msg=f"after {steps} steps"
        )
