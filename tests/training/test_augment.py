"""Augmentation: what belongs together moves together, and a seed decides all of it."""

from __future__ import annotations

import pytest
import torch
from gripper import write_gripper
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from training_samples import component

from gdg.contact_maps import contact_values
from gdg.hands.hand import load_hand
from gdg.objects.model import find_object
from gdg.rotations import q_from_pose, random_rotations
from gdg.training.augment import augmented, seen_from, turned
from gdg.training.batches import GraspBatch, MapBatch
from gdg.training.job import AugmentOptions

NOTHING = {"jitter_m": 0.0}


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def sphere(batch: int = 4, points: int = 2048, center: float = 0.0) -> MapBatch:
    """Points on spheres of 40 mm with a value that tells which point it is."""
    normals = torch.nn.functional.normalize(torch.randn(batch, points, 3, generator=seeded()), -1)
    normals = normals / normals.norm(dim=-1, keepdim=True)
    values = torch.linspace(0, 1, points).expand(batch, -1).contiguous()
    return MapBatch(0.04 * normals + center, values, normals)


def grasps_of(batch: MapBatch) -> GraspBatch:
    poses = torch.eye(4).repeat(len(batch.points), 1, 1)
    poses[:, :3, :3] = random_rotations(len(poses), seeded(1))
    poses[:, :3, 3] = 0.1 * torch.randn(len(poses), 3, generator=seeded(2))
    q = q_from_pose(poses, torch.rand(len(poses), 3, generator=seeded(3)))
    return GraspBatch(batch.points, batch.normals, batch.values, q)


def test_default_is_a_millimetre_of_noise_and_nothing_else() -> None:
    batch = sphere()
    varied = augmented(batch, AugmentOptions(), seeded())
    noise = varied.points - batch.points
    assert noise.std().item() == pytest.approx(0.001, rel=0.02)
    assert abs(noise.mean().item()) < 1e-4
    assert torch.equal(varied.normals, batch.normals)
    assert torch.equal(varied.values, batch.values)
    same = augmented(batch, AugmentOptions(**NOTHING), seeded())
    assert torch.equal(same.points, batch.points)


@settings(max_examples=15, deadline=None)
@given(
    st.floats(0, 0.01),
    st.sampled_from(["none", "yaw", "full"]),
    st.floats(0, 1),
    st.integers(0, 2**62),
)
def test_the_seed_decides(jitter_m: float, rotation: str, partial: float, seed: int) -> None:
    options = AugmentOptions(jitter_m=jitter_m, rotation=rotation, partial=partial, scale=(0.8, 1))
    first, second = (augmented(sphere(2, 200), options, seeded(seed)) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(first, second, strict=True))


def test_yaw_keeps_heights_and_full_does_not() -> None:
    batch = sphere(64, 50)
    yaw = augmented(batch, AugmentOptions(rotation="yaw", **NOTHING), seeded())
    torch.testing.assert_close(yaw.points[..., 2], batch.points[..., 2])
    across = (yaw.points[:, 0, :2] * batch.points[:, 0, :2]).sum(-1)
    assert (across < 0).float().mean().item() == pytest.approx(0.5, abs=0.2), "any angle"
    full = augmented(batch, AugmentOptions(rotation="full", **NOTHING), seeded())
    assert (full.points[..., 2] - batch.points[..., 2]).abs().max() > 0.04
    for varied in (yaw, full):
        torch.testing.assert_close(varied.points, 0.04 * varied.normals)


def test_a_turned_grasp_makes_the_same_map_on_the_turned_object(tmp_path) -> None:
    """The hand goes where the object goes, by the hand's own kinematics."""
    hand_model, distance = (
        component("hand-model", "pytorch-kinematics"),
        component("distance", "aligned"),
    )
    options = hand_model.options.model_copy(update={"surface_points": 200})
    model = hand_model.record.load()
    hand = model(options, load_hand(write_gripper(tmp_path)), torch.device("cpu"))
    to_hand = distance.record.load()(distance.options)
    cube = find_object("cube_small")
    points, normals = cube.points[None, :300], cube.normals[None, :300]
    q = q_from_pose(torch.eye(4)[None], torch.full((1, 1), 0.02))
    q[:, 2] = -0.035

    def values(points, normals, q):
        return contact_values(hand, points[0], normals[0], q, to_hand)

    batch = GraspBatch(points, normals, values(points, normals, q), q)
    moved = turned(batch, random_rotations(1, seeded(5)))
    assert not torch.allclose(moved.q[:, :9], q[:, :9])
    assert torch.equal(moved.q[:, 9:], q[:, 9:])
    torch.testing.assert_close(
        values(moved.points, moved.normals, moved.q), batch.values, rtol=1e-3, atol=1e-3
    )


def test_scale_is_about_the_origin_within_its_range() -> None:
    options = AugmentOptions(scale=(0.5, 1.5), **NOTHING)
    batch = sphere(200, 20)
    ratio = augmented(batch, options, seeded()).points / batch.points
    torch.testing.assert_close(ratio, ratio[:, :1, :1].expand_as(ratio))
    assert 0.5 <= ratio.min() < 0.55
    assert 1.45 < ratio.max() <= 1.5
    with pytest.raises(AssertionError, match="can't be scaled"):
        augmented(grasps_of(batch), options, seeded())


def test_a_sphere_shows_the_half_that_faces_the_camera() -> None:
    batch = sphere(3)
    directions = torch.eye(3)
    seen = seen_from(batch.points, batch.normals, directions)
    facing = torch.stack([batch.normals[axis, :, axis] > 0 for axis in range(3)])
    assert not (seen & ~facing).any()
    assert (seen & facing).sum() > 0.93 * facing.sum(), "all but some of the rim"


def test_an_object_in_front_hides_the_one_behind() -> None:
    one = sphere(1, 1024)
    points = torch.cat((one.points, one.points + torch.tensor([0.0, 0, -0.3])), dim=1)
    normals = torch.cat((one.normals, one.normals), dim=1)
    seen = seen_from(points, normals, torch.tensor([[0.0, 0, 1]]))[0]
    assert seen[:1024].float().mean() > 0.45
    assert seen[1024:].float().mean() < 0.02
    aside = seen_from(points, normals, torch.tensor([[1.0, 0, 0]]))[0]
    assert aside[1024:].float().mean() > 0.45


def test_partial_clouds_are_of_visible_points_with_their_values() -> None:
    batch = grasps_of(sphere(8, 500))
    varied = augmented(batch, AugmentOptions(partial=1.0, **NOTHING), seeded())
    assert isinstance(varied, GraspBatch)
    assert varied.points.shape == batch.points.shape
    assert torch.equal(varied.q, batch.q)
    index = (varied.values * 499).round().long()
    torch.testing.assert_close(
        varied.points, batch.points.gather(1, index[..., None].expand(-1, -1, 3))
    )
    for row in index:
        times = row.bincount(minlength=500)
        assert 180 < (times > 0).sum() < 320, "about half of a sphere is seen"
        assert times.max() - times[times > 0].min() <= 1, "points come equally often"
    some = augmented(batch, AugmentOptions(partial=0.5, **NOTHING), seeded(3))
    untouched = (some.points == batch.points).flatten(1).all(1).sum().item()
    assert 0 < untouched < 8
    none = augmented(batch, AugmentOptions(**NOTHING), seeded())
    assert torch.equal(none.points, batch.points)


def test_impossible_options_are_refused() -> None:
    for wrong in ({"scale": (1.2, 0.8)}, {"scale": (0, 1)}, {"partial": 1.1}, {"rotate": "yaw"}):
        with pytest.raises(ValidationError):
            AugmentOptions(**wrong)
