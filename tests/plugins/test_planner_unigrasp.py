"""UniGrasp: fingers, candidate sets, inverse kinematics, and what it learns in seconds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from conftest import build_model
from gdg_plugins.planner_unigrasp.candidates import (
    balancing_forces,
    candidates,
    set_force_closure,
)
from gdg_plugins.planner_unigrasp.fingers import Fingers, _opposing_order, fingers_of, touched
from gdg_plugins.planner_unigrasp.module import cross_entropy
from gdg_plugins.planner_unigrasp.network import ContactSelection
from gdg_plugins.planner_unigrasp.options import UniGraspOptions
from gdg_plugins.planner_unigrasp.planner import UniGraspPlanner
from gdg_plugins.planner_unigrasp.reach import Reach, put_to
from hypothesis import given
from hypothesis import strategies as st
from planner_samples import jaw_batch, jaw_poses, trained

from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.initial_poses import random_joints
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, load_object
from gdg.rotations import random_rotations, root_pose
from gdg.testing import check_component
from gdg.weights_files import write_weights

QUICK = {"width": 24, "branch": 8, "starts": 4, "steps": 30, "top": 4}
#: Sets all over the cube, whatever the network says.
WIDE = {"width": 64, "branch": 64, "top": 16}


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def training(
    gripper_model: HandModel, cube: ObjectModel, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[dict[str, float]]]:
    """Weights that were trained for the gripper on the cube, and the log."""
    path = tmp_path_factory.mktemp("unigrasp") / "two_jaws.safetensors"
    return path, trained("unigrasp", gripper_model, cube, path, 120)


@pytest.fixture(scope="module")
def weights(training: tuple[Path, list[dict[str, float]]]) -> str:
    return str(training[0])


@pytest.fixture(scope="module")
def jaws(gripper_model: HandModel) -> Fingers:
    return fingers_of(gripper_model)


def planner(weights: str, **options: object) -> UniGraspPlanner:
    return UniGraspPlanner(UniGraspOptions.model_validate({"weights": weights, **QUICK, **options}))


def nearest_point(cube: ObjectModel, place: list[float]) -> int:
    return int((cube.points - torch.tensor(place)).norm(dim=-1).argmin())


# -- fingers -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "count"),
    [("two_jaws", 2), ("barrett", 3), ("robotiq_3finger", 3), ("allegro", 4), ("shadowhand", 5)],
)
def test_every_finger_is_a_stage(gripper_model: HandModel, name: str, count: int):
    hand = gripper_model if name == "two_jaws" else build_model(find_hand(name))
    fingers = fingers_of(hand)
    assert len(fingers) == len(set(fingers.names)) == count
    assert set(fingers.finger.tolist()) == set(range(count))
    for number in range(count):
        assert fingers.tip[fingers.finger == number].any()


@pytest.mark.parametrize(
    ("name", "beginnings"),
    [
        ("allegro", ["thumb", "middle", "index", "ring"]),
        ("shadowhand", ["th", "ff", "mf", "rf", "lf"]),
        ("barrett", ["finger_3", "finger_1", "finger_2"]),
    ],
)
def test_the_thumb_comes_first_then_what_is_nearest_to_it(name: str, beginnings: list[str]):
    names = fingers_of(build_model(find_hand(name))).names
    assert all(name.startswith(start) for name, start in zip(names, beginnings, strict=True))


def test_fingers_beside_the_first_come_after_those_that_oppose_it():
    normals = torch.tensor([[0.0, 1, 0], [0, 1, 0], [0, -1, 0], [0, -1, 0]])
    tips = torch.tensor([[0.0, 0, 0], [0.02, 0, 0], [0.03, 0.05, 0], [0, 0.05, 0]])
    assert _opposing_order(normals, tips) == [0, 3, 2, 1]


def test_the_first_fingers_are_a_part_of_all(jaws: Fingers):
    first = jaws.first(1)
    assert first.names == jaws.names[:1]
    assert len(first.pads.points) == int((jaws.finger == 0).sum())


def test_touched_points_are_where_the_fingers_are(
    gripper_model: HandModel, cube: ObjectModel, jaws: Fingers
):
    q = jaw_poses(3)
    poses = gripper_model.link_poses(q)
    pads = gripper_model.place(poses, jaws.pads.points, jaws.pads.link_index)
    found = touched(jaws, pads, cube.points.expand(3, -1, -1))
    places = cube.points[found.index]
    side = {"left": 1.0, "right": -1.0}
    for number, name in enumerate(jaws.names):
        assert (places[:, number, 1] * side[name] > 0.019).all()
    assert (found.gap < 0.004).all()


def test_a_hand_with_one_finger_is_refused(gripper_model: HandModel):
    spec = gripper_model.hand.spec
    one = spec.model_copy(update={"contact_regions": {"left": spec.contact_regions["left"]}})
    with pytest.raises(GdgError, match="at least two fingers"):
        fingers_of(build_model(replace(gripper_model.hand, spec=one)))


# -- candidate sets ----------------------------------------------------------------------------


@given(st.integers(2, 5), st.integers(0, 10_000))
def test_balancing_forces_are_shares_and_better_than_equal_ones(contacts: int, seed: int):
    random = seeded(seed)
    points = 0.05 * torch.randn(4, contacts, 3, generator=random)
    normals = torch.nn.functional.normalize(torch.randn(4, contacts, 3, generator=random), dim=-1)
    share = balancing_forces(points, normals, 0.05)
    assert (share >= 0).all()
    torch.testing.assert_close(share.sum(-1), torch.ones(4))

    def error(share: torch.Tensor) -> torch.Tensor:
        wrench = torch.cat((normals, torch.linalg.cross(points, normals) / 0.05), -1)
        return (share[..., None] * wrench).sum(1).norm(dim=-1)

    equal = torch.full_like(share, 1 / contacts)
    assert (error(share) <= error(equal) + 1e-3).all()


def test_a_thumb_against_two_fingers_balances():
    normals = torch.tensor([[[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, -1.0, 0.0]]])
    points = torch.tensor([[[0.0, 0.02, 0.0], [0.01, -0.02, 0.0], [-0.01, -0.02, 0.0]]])
    share = balancing_forces(points, normals, 0.04)
    torch.testing.assert_close(share, torch.tensor([[0.5, 0.25, 0.25]]), rtol=0, atol=1e-3)


def test_opposite_faces_close_and_one_face_does_not(cube: ObjectModel):
    left, right = nearest_point(cube, [0, 0.02, 0]), nearest_point(cube, [0, -0.02, 0])
    other = nearest_point(cube, [0.01, 0.02, 0])
    error = set_force_closure(cube, torch.tensor([[left, right], [left, other]]))
    assert error[0] < 0.1
    assert error[1] > 0.9


def test_sets_are_ranked_far_apart_and_in_force_closure(cube: ObjectModel):
    network = ContactSelection(2)
    network.initialise(seeded())
    options = UniGraspOptions.model_validate(WIDE)
    found = candidates(network.eval(), cube, 2, options)
    assert 0 < len(found.index) <= 16
    assert (found.cost.diff() >= 0).all()
    assert (found.force_closure <= options.max_force_closure).all()
    apart = (cube.points[found.index[:, 0]] - cube.points[found.index[:, 1]]).norm(dim=-1)
    assert (apart >= options.spacing_m).all()
    assert found.rejected > 0
    again = candidates(network, cube, 2, options)
    assert torch.equal(again.index, found.index)


@torch.no_grad()
def test_a_beam_scores_as_the_stages_do(cube: ObjectModel):
    network = ContactSelection(2)
    network.initialise(seeded())
    network.eval()
    options = UniGraspOptions.model_validate({**WIDE, "force_closure_weight": 0})
    found = candidates(network, cube, 2, options)
    scene = network.scene(cube.points[None], cube.normals[None])
    first, second = found.index[0]
    one = network.stages[0](scene, torch.zeros(1, 0, dtype=torch.long)).log_softmax(-1)[0, first]
    scores = network.stages[1](scene, first.reshape(1, 1))
    near = torch.cdist(cube.points[first][None], cube.points)[0] < options.spacing_m
    two = scores.log_softmax(-1)[0, second]
    assert not near[second]
    assert found.cost[0].item() == pytest.approx(-(one + two).item() / 2, abs=1e-4)


@torch.no_grad()
def test_scores_follow_the_order_of_the_points(cube: ObjectModel):
    network = ContactSelection(2)
    network.initialise(seeded())
    network.eval()
    order = torch.randperm(len(cube.points), generator=seeded())
    chosen = torch.tensor([[5]])
    scene = network.scene(cube.points[None], cube.normals[None])
    shuffled = network.scene(cube.points[order][None], cube.normals[order][None])
    where = (order == 5).nonzero().reshape(1, 1)
    scores = network.stages[1](shuffled, where)[0]
    torch.testing.assert_close(
        scores, network.stages[1](scene, chosen)[0, order], rtol=1e-4, atol=1e-4
    )


# -- inverse kinematics ------------------------------------------------------------------------


@given(st.integers(2, 5), st.integers(0, 10_000))
def test_a_hand_that_fits_is_put_exactly(fingers: int, seed: int):
    random = seeded(seed)
    points = 0.05 * torch.randn(3, fingers, 3, generator=random)
    normals = torch.nn.functional.normalize(torch.randn(3, fingers, 3, generator=random), dim=-1)
    rotations = random_rotations(3, random)
    shift = torch.randn(3, 1, 3, generator=random)
    wanted = points @ rotations.mT + shift
    facing = -normals @ rotations.mT
    # the free rotation is a soft prior: the true one must win where everything fits
    q = put_to(points, normals, wanted, facing, rotations, torch.zeros(3, 1))
    pose = root_pose(q)
    found = points @ pose[:, :3, :3].mT + pose[:, None, :3, 3]
    torch.testing.assert_close(found, wanted, rtol=0, atol=1e-4)
    assert (torch.linalg.det(pose[:, :3, :3]) > 0).all()


def test_reach_puts_both_jaws_on_their_points(
    gripper_model: HandModel, cube: ObjectModel, jaws: Fingers
):
    place = {"left": [0.0, 0.02, 0.0], "right": [0.0, -0.02, 0.0]}
    index = torch.tensor([[nearest_point(cube, place[name]) for name in jaws.names]])
    reach = Reach(gripper_model, cube, jaws, UniGraspOptions(starts=6, steps=60))
    steps: list[int] = []
    q = reach.solve(index, seeded(), steps.append)
    assert steps == list(range(1, 121))
    terms = reach.terms(q, index)
    assert terms.distances.amax() < 0.006
    assert terms.depth.amax() < 0.003
    assert terms.normals.item() < 0.1


def test_points_out_of_reach_are_rejected_with_the_reason(
    weights: str, gripper_model: HandModel, cube: ObjectModel
):
    # 100 mm between the open jaws
    wide = load_object(cube.path, "wide", scale=4.0)
    assert wide.mesh.extents.min() > 0.15
    grasps = planner(weights, **{**WIDE, "top": 4, "starts": 2}).plan(
        gripper_model, wide, 4, seeded()
    )
    assert len(grasps) == 0
    assert grasps.provenance["rejected"]["contact out of reach"] > 0


# -- training and planning ---------------------------------------------------------------------


def test_cross_entropy_is_least_for_the_blurred_truth(cube: ObjectModel):
    points, index = cube.points[None, :200], torch.tensor([7])
    apart = (points[0] - points[0, 7]).square().sum(-1)
    best = -apart / (2 * 0.005**2)
    least = cross_entropy(best[None], points, index)
    assert least < cross_entropy(torch.zeros(1, 200), points, index)
    assert least < cross_entropy(1.2 * best[None], points, index)


def test_training_lowers_the_cross_entropy_of_every_stage(
    training: tuple[Path, list[dict[str, float]]],
):
    _, log = training
    for name in ("train_loss", "train_stage1", "train_stage2"):
        assert log[-1][name] < log[0][name] - 0.5


def test_it_learns_where_the_jaws_touch(weights: str, gripper_model: HandModel, cube: ObjectModel):
    made = planner(weights, top=1)
    grasps = made.plan(gripper_model, cube, 4, seeded())
    assert len(grasps) == 1
    poses = gripper_model.link_poses(gripper_model.q_of(grasps))
    jaws = fingers_of(gripper_model)
    pads = gripper_model.place(poses, jaws.pads.points, jaws.pads.link_index)
    found = touched(jaws, pads, cube.points[None])
    # both faces across y, as taught; the cube's other faces would do as well for force closure
    assert (cube.points[found.index[0], 1].abs() > 0.015).all()
    assert grasps.energies["penetration_depth_mm"].item() < 5


@pytest.mark.parametrize("top", [1, 4])
def test_no_more_grasps_than_sets(
    weights: str, gripper_model: HandModel, cube: ObjectModel, top: int
):
    grasps = planner(weights, top=top).plan(gripper_model, cube, 8, seeded())
    assert 0 < len(grasps) <= top
    assert (grasps.energies["total"].diff() >= 0).all()
    rejected = grasps.provenance["rejected"]
    assert len(grasps) + sum(rejected.values()) - rejected["no force closure"] <= top


def test_no_grasps_can_be_asked_for(weights: str, gripper_model: HandModel, cube: ObjectModel):
    assert len(planner(weights).plan(gripper_model, cube, 0, seeded())) == 0


def test_nothing_in_force_closure_gives_no_grasps(
    weights: str, gripper_model: HandModel, cube: ObjectModel
):
    grasps = planner(weights, max_force_closure=1e-9).plan(gripper_model, cube, 4, seeded())
    assert len(grasps) == 0
    assert grasps.provenance["rejected"]["no force closure"] > 0


def test_a_hand_without_weights_is_told_the_command(gripper_model: HandModel, cube: ObjectModel):
    with pytest.raises(GdgError, match="gdg train planner=unigrasp hand=two_jaws"):
        planner("").plan(gripper_model, cube, 1, seeded())


def test_weights_know_the_finger_of_each_stage(
    weights: str, gripper_model: HandModel, cube: ObjectModel, jaws: Fingers, tmp_path: Path
):
    stored = planner(weights).loaded(gripper_model)[0]
    assert stored.metadata["fingers"] == list(jaws.names)
    for known in (list(jaws.names)[::-1], None):
        path = tmp_path / "other.safetensors"
        metadata = {**stored.metadata, "fingers": known}
        write_weights(path, stored.state, "gdg-unigrasp-2", metadata)
        with pytest.raises(GdgError, match=r"for the fingers .* 'gdg train planner=unigrasp"):
            planner(str(path)).plan(gripper_model, cube, 1, seeded())


def test_weights_of_an_older_schema_are_refused(
    weights: str, gripper_model: HandModel, tmp_path: Path
):
    stored = planner(weights).loaded(gripper_model)[0]
    path = tmp_path / "old.safetensors"
    write_weights(path, stored.state, "gdg-unigrasp-1", stored.metadata)
    with pytest.raises(GdgError, match="schema is 'gdg-unigrasp-1'"):
        planner(str(path)).loaded(gripper_model)


def test_training_needs_a_hand():
    with pytest.raises(GdgError, match="hand="):
        UniGraspPlanner.trainable(UniGraspOptions(), 1e-3, 0)


def test_training_items_of_any_hand_have_contacts(cube: ObjectModel):
    hand = build_model(find_hand("barrett"))
    module = UniGraspPlanner.trainable(UniGraspOptions(), 1e-3, 0, hand)
    q = torch.zeros(2, 9 + len(hand.joint_names))
    q[:, 3], q[:, 7] = 1, 1
    q[:, 9:] = random_joints(hand, 2, seeded())
    batch = jaw_batch(cube, 2)._replace(q=q)
    values: dict[str, float] = {}
    module.log_dict = lambda logged, **_: values.update(logged)  # type: ignore[method-assign]
    module.eval()
    module.validation_step(batch, 0)
    assert values["val_recon"] > 0


def test_it_conforms(weights: str):
    assert check_component("planner", "unigrasp", weights=weights, **QUICK) == []
