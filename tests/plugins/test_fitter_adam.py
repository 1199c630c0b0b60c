"""A hand fitted to its own contact map comes back to it, outside the object and within limits."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from gdg_plugins.distance_aligned.distance import AlignedDistance
from gdg_plugins.distance_aligned.options import AlignedOptions
from gdg_plugins.distance_euclidean.distance import EuclideanDistance
from gdg_plugins.fitter_adam.fitter import AdamFitter
from gdg_plugins.fitter_adam.options import AdamOptions
from gripper import OPEN_M
from torch import Tensor

from gdg.components import NoOptions
from gdg.contact_maps import contact_map_of, in_distance
from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.rotations import ROOT_DIM, q_from_pose

RELEASE = AlignedDistance(AlignedOptions())
PAPER = AlignedDistance(AlignedOptions(preset="paper"))
TRUE_CLOSE_M = OPEN_M - 0.0205
#: One particle of the first map.
FIRST = torch.zeros(1, dtype=torch.long)


def fitter(**options: object) -> AdamFitter:
    chosen = {"particles": 6, "steps": 60, "keep": 1, "sharpen": False, "extra_weight": 1.0}
    return AdamFitter(AdamOptions(**{**chosen, **options}), distance=RELEASE)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def truth(gripper_model: HandModel) -> Tensor:
    """q of both jaws half a millimetre off the cube's sides."""
    T = torch.eye(4)[None].clone()
    T[0, 2, 3] = -0.035
    return q_from_pose(T, torch.tensor([[TRUE_CLOSE_M]]))


@pytest.fixture(scope="module")
def maps(gripper_model: HandModel, cube: ObjectModel, truth: Tensor) -> ContactMap:
    return contact_map_of(gripper_model, cube, truth, RELEASE)


@pytest.fixture(scope="module")
def all_fitted(gripper_model: HandModel, cube: ObjectModel, maps: ContactMap) -> GraspSet:
    """Every particle of a fit from the paper's starts."""
    run = fitter(particles=6, steps=80, keep=1000)
    return run.fit(gripper_model, cube, maps, seeded(1))


# -- the oracle round trip ---------------------------------------------------------------------


def test_a_disturbed_hand_finds_back_to_its_map(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, truth: Tensor,
    monkeypatch: pytest.MonkeyPatch,
):  # fmt: skip
    def disturbed(self, hand, obj, count: int, generator: torch.Generator) -> Tensor:
        scale = torch.tensor([0.004] * 3 + [0.03] * 6 + [0.003])
        return truth + scale * torch.randn(count, len(scale), generator=generator)

    monkeypatch.setattr(AdamFitter, "_start", disturbed)
    found = fitter(particles=4, learning_rate=2e-3).fit(gripper_model, cube, maps, seeded())
    assert found.contact_values is not None
    assert (found.contact_values - maps.values).abs().mean() < 0.02
    assert found.joints.item() == pytest.approx(TRUE_CLOSE_M, abs=0.002)
    # the gripper's own symmetry leaves it free to slide along its jaws
    assert found.poses[0, 1, 3].abs() < 0.002
    assert found.energies["penetration_depth_mm"].item() < 1


def test_from_the_papers_starts_the_map_is_approached(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, all_fitted: GraspSet
):
    run = fitter()
    start = run._start(gripper_model, cube, 6, seeded(1))
    energy = run.energy(gripper_model, cube, maps)
    before = energy.terms(start, torch.zeros(6, dtype=torch.long)).contact
    after = all_fitted.energies["contact"]
    best = int(all_fitted.energies["total"].argmin())
    assert after[best] < 0.65 * before.min()
    assert after[best] < 0.1
    assert (after < before).float().mean() > 0.8


def test_fitted_hands_hardly_penetrate(all_fitted: GraspSet):
    best = int(all_fitted.energies["total"].argmin())
    assert all_fitted.energies["penetration_depth_mm"][best] < 2


def test_a_growing_penetration_weight_keeps_hands_out(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    depths = []
    for weight in (0.0, 0.1):
        options = {"steps": 25, "particles": 4, "penetration_weight": weight, "keep": 1000}
        found = fitter(**options).fit(gripper_model, cube, maps, seeded())
        depths.append(found.energies["penetration_depth_mm"].median().item())
    assert depths[1] < 0.5 * depths[0]


def test_the_releases_penetration_can_be_chosen(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, truth: Tensor
):
    deep = truth.clone()
    deep[:, -1] += 0.005
    energy = fitter(penetration="nearest").energy(gripper_model, cube, maps)
    assert energy.terms(deep, FIRST).penetration.item() > 0.01
    clear = energy.terms(truth, FIRST)
    assert clear.penetration.item() == 0


# -- energies ----------------------------------------------------------------------------------


def test_the_total_is_the_weighted_sum_of_its_terms(all_fitted: GraspSet):
    e, o = all_fitted.energies, AdamOptions()
    expected = (
        e["contact"]
        + o.penetration_weight * o.penetration_ramp * e["penetration"]
        + o.limit_weight * e["limits"]
        + o.self_weight * e["self_penetration"]
    )
    torch.testing.assert_close(e["total"], expected)


def test_the_contact_energy_is_the_mean_difference_of_the_maps(
    all_fitted: GraspSet, maps: ContactMap
):
    assert all_fitted.contact_values is not None
    expected = (all_fitted.contact_values - maps.values).abs().mean(-1)
    torch.testing.assert_close(all_fitted.energies["contact"], expected)


@pytest.mark.parametrize("weight", [0.0, 0.3])
def test_contact_beyond_the_map_may_cost_less_than_missing_contact(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, truth: Tensor, weight: float
):
    nothing, everything = (replace(maps, values=maps.values * 0 + value) for value in (0.0, 1.0))
    run = fitter(extra_weight=weight)
    beyond = run.energy(gripper_model, cube, nothing).terms(truth, FIRST).contact
    torch.testing.assert_close(beyond, weight * maps.values.mean(-1))
    missing = run.energy(gripper_model, cube, everything).terms(truth, FIRST).contact
    torch.testing.assert_close(missing, 1 - maps.values.mean(-1))


def test_sharpened_targets_are_pursued(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    found = fitter(sharpen=True, steps=1).fit(gripper_model, cube, maps, seeded())
    assert found.contact_values is not None
    sharp = RELEASE.sharpen(maps.values)
    expected = (found.contact_values - sharp).abs().mean(-1)
    torch.testing.assert_close(found.energies["contact"], expected)


def test_joints_end_within_their_limits(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, all_fitted: GraspSet
):
    wild = fitter(steps=20, learning_rate=0.05, limit_weight=0.0, keep=1000)
    for grasps in (all_fitted, wild.fit(gripper_model, cube, maps, seeded())):
        assert (grasps.joints >= gripper_model.lower).all()
        assert (grasps.joints <= gripper_model.upper).all()


# -- batches and particles ---------------------------------------------------------------------


def test_one_grasp_per_map_in_order(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, truth: Tensor
):
    other = truth.clone()
    other[0, -1] = 0.0
    two = contact_map_of(gripper_model, cube, torch.cat((truth, other)), RELEASE)
    found = fitter(particles=3, steps=5).fit(gripper_model, cube, two, seeded())
    assert len(found) == 2
    assert found.status == ("hit_limit",) * 2
    assert found.contact_values is not None
    for row in range(2):
        against = (found.contact_values[row] - two.values[row]).abs().mean()
        torch.testing.assert_close(found.energies["contact"][row], against)


def test_the_best_particle_is_chosen_and_all_can_be_had(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    both = replace(maps, values=maps.values.repeat(2, 1))
    best = fitter(particles=4, steps=5).fit(gripper_model, cube, both, seeded())
    every = fitter(particles=4, steps=5, keep=1000).fit(gripper_model, cube, both, seeded())
    assert (len(best), len(every)) == (2, 8)
    lowest = every.energies["total"].reshape(2, 4).amin(-1)
    torch.testing.assert_close(best.energies["total"], lowest)


def test_splitting_the_maps_into_batches_keeps_their_order(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    particle_mb = 1e-6 * fitter().energy(gripper_model, cube, maps).particle_bytes
    values = torch.cat((maps.values, torch.zeros_like(maps.values), torch.ones_like(maps.values)))
    reported: list[tuple[int, int]] = []
    found = fitter(particles=2, steps=3, max_memory_mb=5 * particle_mb).fit(
        gripper_model, cube, replace(maps, values=values), seeded(),
        lambda done, total: reported.append((done, total)),
    )  # fmt: skip
    assert found.contact_values is not None
    expected = (found.contact_values - values).abs().mean(-1)
    torch.testing.assert_close(found.energies["contact"], expected)
    assert reported == [(step, 6) for step in range(1, 7)]


def test_the_same_seed_gives_the_same_grasps(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    runs = [fitter(steps=5).fit(gripper_model, cube, maps, seeded(s)) for s in (3, 3, 4)]
    assert torch.equal(runs[0].joints, runs[1].joints)
    assert torch.equal(runs[0].poses, runs[1].poses)
    assert not torch.equal(runs[0].poses, runs[2].poses)


@pytest.mark.parametrize("start", ["sphere", "surface"])
def test_both_kinds_of_starts_are_used(gripper_model: HandModel, cube: ObjectModel, start: str):
    q = fitter(start=start, start_factor=1.5)._start(gripper_model, cube, 50, seeded())
    away = gripper_model.palm(q)[0].norm(dim=-1)
    assert ((away - 1.5 * cube.radius).abs() < 1e-5).all() == (start == "sphere")


# -- trouble -----------------------------------------------------------------------------------


def with_nan(monkeypatch: pytest.MonkeyPatch, rows: list[int]) -> None:
    """Spoils some starts of the first map."""
    original, spoil = AdamFitter._start, [rows]

    def spoiled(self, hand, obj, count: int, generator: torch.Generator) -> Tensor:
        q = original(self, hand, obj, count, generator)
        q[spoil.pop() if spoil else []] = math.nan
        return q

    monkeypatch.setattr(AdamFitter, "_start", spoiled)


def test_a_particle_that_is_not_finite_leaves_the_others_alone(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, monkeypatch: pytest.MonkeyPatch
):
    run = fitter(particles=4, steps=8, keep=1000)
    sane = run.fit(gripper_model, cube, maps, seeded())
    with_nan(monkeypatch, [1])
    spoiled = run.fit(gripper_model, cube, maps, seeded())
    # sorted by energy, so the spoiled one is last, and missing from the order of the others
    assert spoiled.status == ("hit_limit",) * 3 + ("diverged",)
    apart = torch.cdist(spoiled.joints[:3], sane.joints)
    others = apart.argmin(-1)
    assert others.tolist() == sorted(set(others.tolist()))
    torch.testing.assert_close(spoiled.joints[:3], sane.joints[others])
    torch.testing.assert_close(spoiled.poses[:3], sane.poses[others], rtol=1e-4, atol=1e-5)


def test_an_infinite_energy_is_told_from_a_large_one(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, monkeypatch: pytest.MonkeyPatch
):
    def far(hand: HandModel, q: Tensor) -> Tensor:
        return torch.full((len(q),), math.inf)

    monkeypatch.setattr(type(gripper_model), "limit_violation", far)
    found = fitter(particles=2, steps=1).fit(gripper_model, cube, maps, seeded())
    assert found.status == ("diverged",)


def test_a_diverged_particle_is_never_the_best(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, monkeypatch: pytest.MonkeyPatch
):
    with_nan(monkeypatch, [0, 1, 2])
    found = fitter(particles=4, steps=3).fit(gripper_model, cube, maps, seeded())
    assert found.status == ("hit_limit",)
    assert found.joints.isfinite().all()


def test_a_map_whose_particles_all_diverged_says_so(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, monkeypatch: pytest.MonkeyPatch
):
    both = replace(maps, values=maps.values.repeat(2, 1))
    with_nan(monkeypatch, [0, 1])
    found = fitter(particles=2, steps=3).fit(gripper_model, cube, both, seeded())
    assert found.status == ("diverged", "hit_limit")


# -- maps of other distances -------------------------------------------------------------------


def test_maps_of_the_same_distance_are_taken_as_they_are(maps: ContactMap):
    assert in_distance(maps, RELEASE) is maps.values


def test_maps_of_another_distance_are_rewritten():
    gaps = torch.tensor([[0.001, 0.005, 0.02]])
    for source in (PAPER, EuclideanDistance(NoOptions())):
        other = ContactMap("cube_small", source.contact_value(source.of_gap(gaps)), source.label)
        expected = RELEASE.contact_value(RELEASE.of_gap(gaps))
        torch.testing.assert_close(in_distance(other, RELEASE), expected, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("gamma", [0.5, 2.0, 1e-5])
def test_maps_of_another_gamma_are_rewritten(gamma: float):
    soft = AlignedDistance(AlignedOptions(gamma=gamma))
    gaps = torch.tensor([[0.001, 0.005, 0.02]])
    other = ContactMap("cube_small", soft.contact_value(soft.of_gap(gaps)), soft.label)
    torch.testing.assert_close(in_distance(other, RELEASE), other.values, rtol=1e-3, atol=1e-4)


def test_the_fitter_pursues_rewritten_maps(
    gripper_model: HandModel, cube: ObjectModel, truth: Tensor
):
    paper = contact_map_of(gripper_model, cube, truth, PAPER)
    found = fitter(steps=2).fit(gripper_model, cube, paper, seeded())
    assert found.contact_values is not None
    expected = (found.contact_values - in_distance(paper, RELEASE)).abs().mean(-1)
    torch.testing.assert_close(found.energies["contact"], expected)
    assert found.provenance["distance"] == "aligned/release"


def test_maps_of_an_unknown_distance_are_refused(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    for label in ("alignd/release", "aligned/releese", "aligned/release-gamna0.5"):
        with pytest.raises(GdgError, match=label.split("/")[0]):
            fitter().fit(gripper_model, cube, replace(maps, distance=label), seeded())


def test_the_gradient_of_the_energy_equals_finite_differences(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, truth: Tensor
):
    fit = fitter().energy(gripper_model, cube, maps)
    q = truth + torch.tensor([0.002, 0.003, 0.001, 0.02, 0.01, -0.02, 0.01, 0.0, 0.01, 0.002])

    def energy(at: Tensor) -> Tensor:
        return fit.total(fit.terms(at, FIRST)).double().sum()

    moved = q.clone().requires_grad_(True)
    (gradient,) = torch.autograd.grad(energy(moved), moved)
    for axis in (0, 1, ROOT_DIM):
        step = torch.zeros_like(q)
        step[0, axis] = 1e-4
        numeric = (energy(q + step) - energy(q - step)) / 2e-4
        assert gradient[0, axis].item() == pytest.approx(numeric.item(), rel=0.1, abs=0.1)
