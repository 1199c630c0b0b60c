"""GraspCVAE: its network, its losses, what it learns in seconds, and its adaptation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from conftest import build_model
from gdg_plugins.distance_aligned.distance import AlignedDistance
from gdg_plugins.distance_aligned.options import AlignedOptions
from gdg_plugins.distance_euclidean.distance import EuclideanDistance
from gdg_plugins.planner_graspcvae import loss
from gdg_plugins.planner_graspcvae.adapt import Agreement
from gdg_plugins.planner_graspcvae.network import (
    LATENT,
    UNIT_M,
    ContactNet,
    GraspNetworks,
    center_of,
    thinned,
)
from gdg_plugins.planner_graspcvae.options import GraspCvaeOptions
from gdg_plugins.planner_graspcvae.planner import GraspCvaePlanner
from planner_samples import jaw_batch, jaw_poses, trained

from gdg.components import NoOptions
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.pads import contact_pads
from gdg.rotations import q_from_pose, rotation_from_rot6d
from gdg.testing import check_component
from gdg.testing.fixtures import small_cube
from gdg.weights_files import write_weights

STEPS = 120


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def training(
    gripper_model: HandModel, cube: ObjectModel, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[dict[str, float]]]:
    """Weights that were trained for the gripper on the cube, and the log."""
    path = tmp_path_factory.mktemp("graspcvae") / "two_jaws.safetensors"
    return path, trained("graspcvae", gripper_model, cube, path, STEPS)


@pytest.fixture(scope="module")
def weights(training: tuple[Path, list[dict[str, float]]]) -> str:
    return str(training[0])


@pytest.fixture(scope="module")
def networks(gripper_model: HandModel) -> GraspNetworks:
    made = GraspNetworks(gripper_model)
    made.initialise(seeded())
    return made.eval()


def planner(weights: str, **options: object) -> GraspCvaePlanner:
    return GraspCvaePlanner(
        GraspCvaeOptions.model_validate({"weights": weights, **options}),
        distance=AlignedDistance(AlignedOptions()),
    )


# -- networks ----------------------------------------------------------------------------------


@torch.no_grad()
def test_moving_the_object_moves_the_hand_with_it(networks: GraspNetworks):
    points, latent = 0.03 * torch.randn(3, 50, 3, generator=seeded()), torch.zeros(3, LATENT)
    shift = torch.tensor([0.2, -0.1, 0.05])

    def decoded(points: torch.Tensor) -> torch.Tensor:
        return networks.cvae.decode(networks.cvae.condition(points), center_of(points), latent)

    moved, still = decoded(points + shift), decoded(points)
    torch.testing.assert_close(moved[:, :3], still[:, :3] + shift, rtol=0, atol=1e-5)
    torch.testing.assert_close(moved[:, 3:], still[:, 3:], rtol=0, atol=1e-4)


@torch.no_grad()
def test_decoded_rotations_are_rotations(networks: GraspNetworks):
    points = 0.03 * torch.randn(5, 50, 3, generator=seeded())
    latent = torch.randn(5, LATENT, generator=seeded(1))
    condition = networks.cvae.condition(points)
    q = networks.cvae.decode(condition, center_of(points), latent)
    torch.testing.assert_close(rotation_from_rot6d(q[:, 3:9])[:, :2].flatten(1), q[:, 3:9])
    assert ((q[:, :3] - points.mean(1)).norm(dim=-1) < 10 * UNIT_M).all()


@torch.no_grad()
def test_turning_a_decoded_hand_leaves_its_grip_in_place():
    hand = build_model(find_hand("shadowhand"))
    made, points = GraspNetworks(hand).eval(), 0.03 * torch.randn(2, 50, 3, generator=seeded())
    made.initialise(seeded())
    last = made.cvae.decoder[-1]
    assert isinstance(last, torch.nn.Linear)
    last.weight.zero_()
    pads, half = contact_pads(hand), (hand.open_posture + hand.closed_posture) / 2
    placed = []
    for column in (3, 5):  # the x axis as it is, then turned to z
        last.bias.zero_()
        last.bias[column], last.bias[7], last.bias[0] = 1.0, 1.0, 0.5
        condition, center = made.cvae.condition(points), center_of(points)
        q = made.cvae.decode(condition, center, torch.zeros(2, LATENT))
        q[:, 9:] = half[None]
        at = hand.place(hand.link_poses(q), pads.points, pads.link_index)
        shift = torch.tensor([0.5 * UNIT_M, 0.0, 0.0])
        torch.testing.assert_close(at.mean(1), center[:, 0] + shift, rtol=0, atol=1e-5)
        placed.append(q)
    assert not torch.allclose(placed[0][:, :3], placed[1][:, :3], atol=0.01)


@torch.no_grad()
def test_one_object_serves_many_hands(networks: GraspNetworks):
    points = 0.03 * torch.randn(1, 40, 3, generator=seeded())
    hands = 0.05 * torch.randn(4, 200, 3, generator=seeded(1))
    together = networks.contact(points, hands)
    assert together.shape == (4, 40)
    torch.testing.assert_close(together, networks.contact(points.expand(4, -1, -1), hands))
    assert not torch.allclose(together[0], together[1])


@pytest.mark.parametrize(("given", "kept"), [(150, 150), (200, 200), (1600, 200)])
def test_hand_points_are_thinned_to_what_a_pose_needs(given: int, kept: int):
    assert thinned(torch.zeros(2, given, 3)).shape == (2, kept, 3)


# -- losses ------------------------------------------------------------------------------------


def test_proximity_is_the_papers_contact_value():
    # D in centimetres: 1 − 2 (sigmoid(2 D) − ½)
    values = loss.proximity(torch.tensor([0.0, 0.005, 0.02]))
    torch.testing.assert_close(values, torch.tensor([1.0, 0.537883, 0.035972]), rtol=0, atol=1e-5)


def test_identical_hands_lose_nothing(gripper_model: HandModel, cube: ObjectModel):
    batch = jaw_batch(cube, 4)
    hand = gripper_model.surface_points(batch.q)
    index = torch.cdist(hand, batch.points).argmin(1)
    assert loss.surface_loss(hand, hand).item() == 0
    assert loss.parameter_loss(batch.q, batch.q, torch.ones(1), torch.ones(3)).item() == 0
    assert loss.consistency_loss(batch.points, hand, hand, index, index).item() == 0


def test_a_shift_of_a_centimetre_costs_a_square_centimetre():
    hand = torch.randn(2, 30, 3, generator=seeded())
    shifted = hand + torch.tensor([0.0, 0.01, 0.0])
    assert loss.surface_loss(hand, shifted).item() == pytest.approx(1, rel=1e-3)


def test_turning_a_hand_about_its_grip_costs_the_turn_alone():
    grip = torch.tensor([0.0, 0.0, 0.3])
    still, turned = torch.eye(4)[None], torch.eye(4)[None]
    turned[0, :3, :3] = rotation_from_rot6d(torch.tensor([[0.8, 0.0, -0.6, 0.0, 1.0, 0.0]]))[0]
    turned[0, :3, 3] = grip - turned[0, :3, :3] @ grip
    q, predicted = (q_from_pose(pose, torch.zeros(1, 2)) for pose in (still, turned))
    found = loss.parameter_loss(q, predicted, torch.ones(2), grip)
    assert found.item() == pytest.approx(0.2**2 + 0.6**2, rel=1e-4)
    shifted = q.clone()
    shifted[:, 0] += 0.2  # 2 dm
    assert loss.parameter_loss(q, shifted, torch.ones(2), grip).item() == pytest.approx(4, rel=1e-4)


def test_only_points_behind_the_surface_penetrate():
    points = torch.tensor([[[0.0, 0.0, 0.0]]])
    normals = torch.tensor([[[0.0, 0.0, 1.0]]])
    hand = torch.tensor([[[0.0, 0.0, -0.01], [0.0, 0.0, 0.02]]])
    index = torch.zeros(1, 2, dtype=torch.long)
    found = loss.penetration_loss(hand, points, normals, index)
    assert found.item() == pytest.approx(0.5, rel=1e-4)  # 1 cm and nothing


def test_far_pads_are_not_drawn_to_the_object():
    points, pads = torch.zeros(1, 1, 3), torch.tensor([[[0.01, 0.0, 0.0], [0.03, 0.0, 0.0]]])
    found = loss.touch_loss(pads, points, torch.zeros(1, 2, dtype=torch.long))
    assert found.item() == pytest.approx(0.5, rel=1e-4)


def test_kl_divergence_of_a_standard_normal_is_zero():
    assert loss.kl_divergence(torch.zeros(2, 4), torch.zeros(2, 4)).item() == 0
    assert loss.kl_divergence(torch.ones(2, 4), torch.zeros(2, 4)).item() == pytest.approx(2)


# -- training ----------------------------------------------------------------------------------


def test_training_lowers_every_reconstruction(training: tuple[Path, list[dict[str, float]]]):
    _, log = training
    for name in ("loss", "points_cm2", "parameters", "map"):
        first, last = log[0][f"train_{name}"], log[-1][f"train_{name}"]
        assert last < 0.5 * first, f"{name}: {first} to {last}"


def test_the_same_seed_trains_the_same_weights(
    gripper_model: HandModel, cube: ObjectModel, tmp_path: Path
):
    paths = [tmp_path / f"{number}.safetensors" for number in range(2)]
    for path in paths:
        trained("graspcvae", gripper_model, cube, path, 2)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_weights_of_a_hand_with_many_joints_are_small(tmp_path: Path):
    hand = build_model(find_hand("shadowhand"))
    module = GraspCvaePlanner.trainable(GraspCvaeOptions(), 1e-3, 0, hand)
    GraspCvaePlanner.export(module, tmp_path / "m.safetensors", {"distance": "aligned/release"})
    assert (tmp_path / "m.safetensors").stat().st_size < 3e6


def with_spec(hand: HandModel, **changed: object) -> HandModel:
    """The same body with another manifest."""
    return build_model(replace(hand.hand, spec=hand.hand.spec.model_copy(update=changed)))


def test_weights_bring_the_grip_that_they_were_trained_with(
    weights: str, gripper_model: HandModel, cube: ObjectModel
):
    spec = gripper_model.hand.spec
    moved = {
        link: [[[x, y, z - 0.01] for x, y, z in corners] for corners in regions]
        for link, regions in spec.contact_regions.items()
    }
    edited = with_spec(gripper_model, contact_regions=moved, open=spec.closed)
    fresh = GraspNetworks(edited)
    assert (fresh.cvae.grip - GraspNetworks(gripper_model).cvae.grip).norm() > 0.005
    before = planner(weights).plan(gripper_model, cube, 4, seeded())
    after = planner(weights).plan(edited, cube, 4, seeded())
    for pose in before.poses:
        assert (after.poses - pose).abs().amax((1, 2)).amin() < 1e-5
    taught = planner(weights).loaded(gripper_model)[1].contact(cube.points[None], hand_points())
    again = planner(weights).loaded(edited)[1].contact(cube.points[None], hand_points())
    torch.testing.assert_close(again, taught)


def test_weights_without_their_grip_are_refused(
    weights: str, gripper_model: HandModel, tmp_path: Path
):
    stored = planner(weights).loaded(gripper_model)[0]
    state = {name: tensor for name, tensor in stored.state.items() if name != "cvae.grip"}
    for schema, message in (("gdg-graspcvae-2", "cvae.grip"), ("gdg-graspcvae-1", "schema is")):
        path = tmp_path / f"{schema}.safetensors"
        write_weights(path, state, schema, stored.metadata)
        with pytest.raises(GdgError, match=message):
            planner(str(path)).loaded(gripper_model)


def hand_points() -> torch.Tensor:
    return 0.05 * torch.randn(1, 200, 3, generator=seeded(1))


def test_training_needs_a_hand():
    with pytest.raises(GdgError, match="hand="):
        GraspCvaePlanner.trainable(GraspCvaeOptions(), 1e-3, 0)


# -- planning ----------------------------------------------------------------------------------


def mean_error_m(hand: HandModel, grasps: GraspSet) -> float:
    """Mean distance of the hand's points from those of the nearest grasp trained on."""
    taught = hand.surface_points(jaw_poses(64, seed=99))
    found = hand.surface_points(hand.q_of(grasps))
    apart = (found[:, None] - taught[None]).norm(dim=-1).mean(-1)
    return float(apart.amin(-1).mean())


def test_planned_grasps_are_like_those_trained_on(
    weights: str, gripper_model: HandModel, cube: ObjectModel
):
    grasps = planner(weights).plan(gripper_model, cube, 8, seeded())
    assert len(grasps) == 8
    assert mean_error_m(gripper_model, grasps) < 0.012
    assert grasps.provenance["rejected"] == {"not finite": 0}
    assert grasps.provenance["training"]["train_objects"] == ["cube_small"]
    assert (grasps.energies["total"].diff() >= 0).all()


def test_adaptation_lowers_the_energy(weights: str, gripper_model: HandModel, cube: ObjectModel):
    plain = planner(weights).plan(gripper_model, cube, 4, seeded())
    adapted = planner(weights, adapt=True, adapt_steps=40).plan(gripper_model, cube, 4, seeded())
    assert adapted.energies["total"].mean() < 0.9 * plain.energies["total"].mean()
    assert set(adapted.status) == {"hit_limit"}


def test_adaptation_pulls_a_hand_out_of_the_object(
    weights: str, gripper_model: HandModel, cube: ObjectModel
):
    made = planner(weights)
    _, networks = made.loaded(gripper_model)
    options = GraspCvaeOptions(adapt_steps=60)
    distance = EuclideanDistance(NoOptions())
    agreement = Agreement(
        gripper_model, cube, networks.contact, "aligned/release", distance, options
    )
    inside = jaw_poses(2)
    inside[:, -1] += 0.008
    steps: list[int] = []
    outside = agreement.adapted(inside, steps.append)
    assert steps == list(range(1, 61))
    targets = agreement.targets(inside)
    before, after = agreement.terms(inside, targets), agreement.terms(outside, targets)
    assert (before.depth > 0.007).all()
    assert (after.depth < 0.5 * before.depth).all()


def test_targets_reach_one_and_are_written_in_the_planners_distance(
    weights: str, gripper_model: HandModel, cube: ObjectModel
):
    _, networks = planner(weights).loaded(gripper_model)
    assert isinstance(networks.contact, ContactNet)
    of = {}
    for distance in (AlignedDistance(AlignedOptions()), EuclideanDistance(NoOptions())):
        agreement = Agreement(
            gripper_model, cube, networks.contact, "aligned/release", distance, GraspCvaeOptions()
        )
        of[distance.label] = agreement.targets(jaw_poses(2))
    for values in of.values():
        torch.testing.assert_close(values.amax(-1), torch.ones(2), rtol=0, atol=1e-3)
    aligned, euclidean = of.values()
    assert not torch.allclose(aligned, euclidean)


def test_the_first_latents_of_many_are_those_of_few(
    weights: str, gripper_model: HandModel, cube: ObjectModel
):
    many = planner(weights).plan(gripper_model, cube, 6, seeded())
    few = planner(weights).plan(gripper_model, cube, 2, seeded())
    for pose in few.poses:
        assert (many.poses - pose).abs().amax((1, 2)).amin() < 1e-5


def test_no_grasps_can_be_asked_for(weights: str, gripper_model: HandModel, cube: ObjectModel):
    for options in ({}, {"adapt": True, "adapt_steps": 2, "close": True}):
        assert len(planner(weights, **options).plan(gripper_model, cube, 0, seeded())) == 0


def test_closed_fingers_touch(weights: str, gripper_model: HandModel, cube: ObjectModel):
    made = planner(weights, close=True).plan(gripper_model, cube, 4, seeded())
    touching = gripper_model.surface_points(gripper_model.q_of(made))
    assert (cube.sdf.distance(touching).amin(-1) < 0.002).all()


def test_a_hand_without_weights_is_told_the_command(gripper_model: HandModel, cube: ObjectModel):
    with pytest.raises(GdgError, match="gdg train planner=graspcvae hand=two_jaws"):
        planner("").plan(gripper_model, cube, 1, seeded())


@pytest.mark.parametrize("adapt", [False, True])
def test_it_conforms(weights: str, adapt: bool):
    problems = check_component("planner", "graspcvae", weights=weights, adapt=adapt, adapt_steps=10)
    assert problems == []


def test_an_object_of_fewer_points_is_planned_for(weights: str, gripper_model: HandModel):
    grasps = planner(weights).plan(gripper_model, small_cube(100), 2, seeded())
    assert len(grasps) == 2
