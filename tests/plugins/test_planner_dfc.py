"""Force-closure synthesis: its energy is what can be computed by hand, and it counts rejections."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
import trimesh
from conftest import build_model
from gdg_plugins.planner_dfc.annealed import AnnealedMala
from gdg_plugins.planner_dfc.chains import MAX_PLACE, Chains, ChainSteps
from gdg_plugins.planner_dfc.energy import Contacts, GraspEnergy
from gdg_plugins.planner_dfc.options import DfcOptions
from gdg_plugins.planner_dfc.planner import DfcPlanner
from gdg_plugins.planner_dfc.published import PublishedMala
from gripper import OPEN_M, write_gripper
from torch import Tensor

from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.geometry.sdf_stack import SdfStack
from gdg.hands.hand import find_hand, load_hand
from gdg.initial_poses import above_surface
from gdg.kinds.hand_model import HandModel
from gdg.kinds.planner import Planner
from gdg.objects.batch import ObjectBatch
from gdg.objects.model import ObjectModel, find_object, load_object
from gdg.rotations import q_from_pose

TOUCHING_M = OPEN_M - 0.02
#: One contact in the middle of each jaw.
MIDDLE = Contacts(torch.tensor([[0, 1]]), torch.zeros(1, 2, 2))
#: Thresholds that everything meets.
LENIENT = {
    "max_force_closure": 1e3, "max_distance_m": 1e3, "max_penetration_m": 1e3, "max_self_m": 1e3
}  # fmt: skip


def pose(close: float) -> Tensor:
    """The jaws around the origin; the middle of each contact region is at height 0."""
    T = torch.eye(4)[None].clone()
    T[0, 2, 3] = -0.035
    return q_from_pose(T, torch.tensor([[close]]))


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def planner(**options: object) -> DfcPlanner:
    return DfcPlanner(DfcOptions(**{"contacts": 2, "steps": 3, "batch": 4, **options}))


@pytest.fixture(scope="module")
def energy(gripper_model: HandModel, cube: ObjectModel) -> GraspEnergy:
    return GraspEnergy(gripper_model, ObjectBatch([cube]), DfcOptions(contacts=2))


# -- energy ------------------------------------------------------------------------------------


def test_a_perfect_grasp_has_no_energy(energy: GraspEnergy):
    terms = energy.terms(pose(TOUCHING_M), MIDDLE)
    assert terms.distance.item() < 2e-4
    assert terms.normals.item() < 0.01
    assert terms.force_closure.item() < 0.01
    assert terms.limits.item() == pytest.approx(0, abs=1e-6)
    assert terms.depth.item() < 2e-4
    assert energy.total(terms).item() < 0.1


@pytest.mark.parametrize("gap_m", [0.004, -0.004])
def test_distance_is_the_gap_of_every_contact(energy: GraspEnergy, gap_m: float):
    terms = energy.terms(pose(TOUCHING_M - gap_m), MIDDLE)
    assert terms.distance.item() == pytest.approx(0.008, abs=4e-4)
    torch.testing.assert_close(terms.touch.distances.sum(-1), terms.distance)
    assert (terms.depth.item() > 0.003) == (gap_m < 0)


def test_limits_are_exceeded_by_what_they_are_exceeded(energy: GraspEnergy):
    for close in (0.06, -0.01):
        assert energy.terms(pose(close), MIDDLE).limits.item() == pytest.approx(0.01, abs=1e-5)


def test_contacts_on_one_jaw_do_not_close_the_force(energy: GraspEnergy):
    left = Contacts(torch.tensor([[0, 0]]), torch.zeros(1, 2, 2))
    terms = energy.terms(pose(TOUCHING_M), left)
    assert terms.force_closure.item() == pytest.approx(1, abs=0.01)


def test_offset_contacts_are_a_torque_per_radius(energy: GraspEnergy, cube: ObjectModel):
    # 10 mm up on one jaw and down on the other: a torque of 0.01 m, on average of two contacts
    place = torch.zeros(1, 2, 2)
    share = 0.5 + 0.01 / 0.05
    logit = math.log(share / (1 - share))
    # v runs from z = 10 to 60 mm on the left jaw, and back on the right one
    place[0, :, 1] = logit
    terms = energy.terms(pose(TOUCHING_M), Contacts(torch.tensor([[0, 1]]), place))
    z = terms.touch.points[0, :, 2]
    torch.testing.assert_close(z, torch.tensor([0.01, -0.01]), rtol=0, atol=1e-4)
    assert terms.force_closure.item() == pytest.approx(0.01 / cube.reach, rel=0.05)


def test_pads_turned_away_are_noticed(energy: GraspEnergy):
    # the jaws swapped around the cube: both pads look away from it
    terms = energy.terms(pose(OPEN_M + 0.02), MIDDLE)
    assert terms.distance.item() < 2e-4
    assert terms.normals.item() == pytest.approx(4, abs=0.02)


def test_the_total_is_the_weighted_sum(energy: GraspEnergy):
    terms = energy.terms(pose(0.055), MIDDLE)
    o = energy.options
    expected = (
        o.force_closure_weight * terms.force_closure + o.distance_weight * terms.distance
        + o.normal_weight * terms.normals + o.penetration_weight * terms.penetration
        + o.self_weight * terms.self_penetration + o.limit_weight * terms.limits
    )  # fmt: skip
    torch.testing.assert_close(energy.total(terms), expected)
    assert (terms.penetration > 0.01).all()


@pytest.mark.parametrize("name", ["two_jaws", "barrett"])
def test_contact_points_lie_in_their_regions(
    gripper_model: HandModel, cube: ObjectModel, name: str
):
    hand = gripper_model if name == "two_jaws" else build_model(find_hand(name))
    energy = GraspEnergy(hand, ObjectBatch([cube]), DfcOptions())
    regions = len(hand.regions.corners)
    region = torch.randint(regions, (20, 4), generator=seeded())
    place = MAX_PLACE * (2 * torch.rand(20, 4, 2, generator=seeded()) - 1)
    points, link = energy.contact_points_in_links(Contacts(region, place))
    assert torch.equal(link, hand.regions.link_index[region])
    corners = hand.regions.corners[region]
    assert (points >= corners.amin(-2) - 1e-6).all()
    assert (points <= corners.amax(-2) + 1e-6).all()
    middle, _ = energy.contact_points_in_links(Contacts(region, torch.zeros_like(place)))
    torch.testing.assert_close(middle, corners.mean(-2))
    # the four extremes of the logits are the four corners
    extremes = 30 * torch.tensor([[-1, -1], [1, -1], [1, 1], [-1, 1]]).float()
    found, _ = energy.contact_points_in_links(Contacts(region[:1, :1].expand(1, 4), extremes[None]))
    torch.testing.assert_close(found[0], corners[0, 0], rtol=0, atol=1e-6)


# -- sampling ----------------------------------------------------------------------------------


def chains_of(energy: GraspEnergy, **options: object) -> tuple[AnnealedMala, Chains]:
    made = DfcOptions(**{"contacts": 2, **options})
    mala = AnnealedMala(GraspEnergy(energy.hand, energy.objects, made), made, [seeded()])
    start = above_surface(energy.hand, energy.objects.objects[0], 16, seeded())
    return mala, mala.evaluate(start, mala.random_contacts(16, made.contacts))


def propose(mala: AnnealedMala, chains: Chains, step: int = 0) -> Chains:
    q_scale, place_scale = mala._scales(chains)
    return mala._propose(chains, q_scale.sqrt(), place_scale.sqrt(), step, 1.0)


def warmer(chains: Chains, difference: Tensor | float) -> Chains:
    """The same chains with more (distance) energy."""
    weight = DfcOptions().distance_weight
    terms = replace(chains.terms, distance=chains.terms.distance + difference / weight)
    return replace(chains, terms=terms)


def total(mala: ChainSteps, chains: Chains) -> Tensor:
    return mala.energy.total(chains.terms)


def test_a_cold_chain_takes_only_what_is_better(energy: GraspEnergy):
    mala, chains = chains_of(energy)
    proposal = propose(mala, chains)
    before, after = total(mala, chains), total(mala, proposal)
    better = after < before
    assert 0 < better.sum() < 16
    chosen, accepted = mala.metropolis(chains, proposal, temperature=1e-9)
    assert torch.equal(accepted, better)
    torch.testing.assert_close(total(mala, chosen), torch.minimum(before, after))
    for name in ("q", "q_gradient", "place_gradient"):
        new, old = getattr(proposal, name), getattr(chains, name)
        assert torch.equal(getattr(chosen, name)[better], new[better])
        assert torch.equal(getattr(chosen, name)[~better], old[~better])
    assert torch.equal(chosen.contacts.region[better], proposal.contacts.region[better])
    assert torch.equal(chosen.contacts.place[~better], chains.contacts.place[~better])
    assert torch.equal(chosen.terms.touch.points[better], proposal.terms.touch.points[better])
    assert (int(mala.accepted), mala.proposed) == (int(better.sum()), 16)


def test_a_hot_chain_takes_everything_finite(energy: GraspEnergy):
    mala, chains = chains_of(energy)
    proposal = propose(mala, chains)
    proposal.terms.distance[3] = math.nan
    proposal.terms.distance[4] = math.inf
    proposal.q_gradient[5, 2] = math.nan
    chosen, accepted = mala.metropolis(chains, proposal, temperature=1e9)
    kept = torch.tensor([i in (3, 4, 5) for i in range(16)])
    assert torch.equal(accepted, ~kept)
    assert torch.equal(chosen.q[kept], chains.q[kept])
    assert torch.equal(chosen.q[~kept], proposal.q[~kept])


def test_a_worse_state_is_taken_as_often_as_metropolis_says(energy: GraspEnergy):
    mala, chains = chains_of(energy)
    worse = warmer(chains, 1.0)
    for _ in range(200):
        mala.metropolis(chains, worse, temperature=2.0)
    assert int(mala.accepted) / mala.proposed == pytest.approx(math.exp(-0.5), abs=0.03)


@pytest.mark.parametrize("sampler", [AnnealedMala, PublishedMala])
def test_a_particle_that_is_not_finite_spoils_no_other(energy: GraspEnergy, sampler: type):
    options = DfcOptions(contacts=2, steps=12, batch=16, oversample=1)
    start = above_surface(energy.hand, energy.objects.objects[0], 16, seeded())
    start[5, 0] = math.nan
    found = sampler(energy, options, [seeded()]).run(start, lambda step: None)
    finite = torch.isfinite(found.q).all(-1)
    assert finite.sum() == 15
    assert torch.isfinite(energy.total(found.terms)).sum() == 15


def test_contacts_switch_one_at_a_time_and_settle_at_the_end(energy: GraspEnergy):
    mala, chains = chains_of(energy, contacts=4, switch_probability=1.0, steps=10)
    switched = mala._switch(chains, chains.contacts, 1.0).place != chains.contacts.place
    assert (switched.any(-1).sum(-1) == 1).all()
    for step, moves in ((0, True), (7, False)):
        proposal = propose(mala, chains, step)
        assert (proposal.contacts.region != chains.contacts.region).any().item() == moves


def test_the_cost_of_a_switch_is_the_energy_that_it_changes(energy: GraspEnergy):
    mala, chains = chains_of(energy, contacts=4)
    slot = torch.arange(16) % 4
    tries = mala.random_contacts(16, 3)
    found = mala._cost_of_switching(chains, slot, tries)
    before = found - total(mala, chains)[:, None]
    for k in range(3):
        contacts = Contacts(chains.contacts.region.clone(), chains.contacts.place.clone())
        contacts.region[torch.arange(16), slot] = tries.region[:, k]
        contacts.place[torch.arange(16), slot] = tries.place[:, k]
        after = total(mala, mala.evaluate(chains.q, contacts))
        difference = before[:, k] - (after - total(mala, chains))
        # up to what the other contacts cost, which is the same for every try
        if k == 0:
            constant = difference
        torch.testing.assert_close(difference, constant, rtol=1e-4, atol=1e-3)


def test_the_worst_chains_are_dropped_early(energy: GraspEnergy):
    options = DfcOptions(contacts=2, steps=10, batch=8, oversample=4, cull_at=0.5)
    mala = AnnealedMala(energy, options, [seeded()])
    assert mala.starts == 32
    left = mala.run(
        above_surface(energy.hand, energy.objects.objects[0], 32, seeded()), lambda step: None
    )
    assert len(left) == 8
    assert mala.proposed == 5 * 32 + 5 * 8


def test_penetration_weighs_more_as_the_chains_settle(energy: GraspEnergy):
    mala, _ = chains_of(energy, steps=100, settle_share=0.3, hardening=8)
    assert [mala._hardness(step) for step in (0, 70, 85)] == pytest.approx([1, 1, 4.5])


@pytest.mark.parametrize(
    ("sampler", "steps"), [(AnnealedMala, 20), (PublishedMala, 300)], ids=["annealed", "published"]
)
def test_steps_lower_the_energy(energy: GraspEnergy, sampler: type, steps: int):
    options = DfcOptions(contacts=2, steps=steps, batch=16, oversample=1, hardening=1.0)
    _, chains = chains_of(energy)
    after = sampler(energy, options, [seeded()]).run(chains.q, lambda step: None)
    assert energy.total(after.terms).median() < 0.8 * energy.total(chains.terms).median()


# -- planning ----------------------------------------------------------------------------------


def test_a_tiny_run_gives_grasps_with_their_provenance(gripper_model: HandModel, cube: ObjectModel):
    reported: list[tuple[int, int]] = []
    found = planner(**LENIENT).plan(
        gripper_model, cube, 3, seeded(), lambda done, total: reported.append((done, total))
    )
    assert len(found) == 3
    assert found.provenance["rejected"] == dict.fromkeys(
        ("not finite", "contact off the surface", "penetration", "self-penetration",
         "no force closure"), 0,
    )  # fmt: skip
    assert 0 <= found.provenance["acceptance_rate"] <= 1
    assert found.energies["total"].diff().min() >= 0
    assert reported[0] == (1, 12)
    assert [done for done, _ in reported] == [1, 2, 3]
    assert ((found.joints >= gripper_model.lower) & (found.joints <= gripper_model.upper)).all()
    assert found.joint_names == ("close",)


def test_every_candidate_is_kept_or_counted_once(gripper_model: HandModel, cube: ObjectModel):
    found = planner(max_batches=2, max_distance_m=0.02).plan(gripper_model, cube, 8, seeded())
    assert len(found) + sum(found.provenance["rejected"].values()) == 8


def test_it_finds_a_grasp_of_the_cube(gripper_model: HandModel, cube: ObjectModel):
    found = planner(steps=120, batch=16, max_batches=3, max_penetration_m=0.004).plan(
        gripper_model, cube, 1, seeded()
    )
    assert len(found) == 1
    assert found.energies["force_closure"].item() <= 0.25
    assert found.energies["penetration_depth_mm"].item() <= 4
    assert found.provenance["acceptance_rate"] > 0.05


def test_the_same_seed_gives_the_same_grasps(gripper_model: HandModel, cube: ObjectModel):
    runs = [planner(**LENIENT).plan(gripper_model, cube, 4, seeded(s)) for s in (0, 0, 1)]
    assert torch.equal(runs[0].poses, runs[1].poses)
    assert torch.equal(runs[0].joints, runs[1].joints)
    assert not torch.equal(runs[0].poses, runs[2].poses)


def test_an_object_too_large_gives_no_grasp_but_reasons(gripper_model: HandModel, tmp_path: Path):
    trimesh.creation.box((0.4, 0.4, 0.4)).export(tmp_path / "crate.stl")
    crate = load_object(tmp_path / "crate.stl", "crate")
    found = planner(steps=4, batch=8, max_batches=2).plan(gripper_model, crate, 4, seeded())
    assert len(found) == 0
    assert found.joints.shape == (0, 1)
    assert sum(found.provenance["rejected"].values()) == 16


def test_a_hand_without_contact_regions_is_refused(cube: ObjectModel, tmp_path: Path):
    folder = write_gripper(tmp_path)
    manifest = (folder / "hand.yaml").read_text()
    head, _, tail = manifest.partition("contact_regions:")
    tail = tail[tail.index("drives:") :]
    (folder / "hand.yaml").write_text(f"{head}contact_regions: {{}}\n{tail}")
    hand = build_model(load_hand(folder))
    with pytest.raises(GdgError, match=r"two_jaws.*contact_regions"):
        planner().plan(hand, cube, 1, seeded())


# -- many objects ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def objects(cube: ObjectModel) -> list[ObjectModel]:
    return [cube, find_object("apple"), cube]


def assert_close(found: GraspSet, wanted: GraspSet, tolerance: float) -> None:
    assert found.provenance == wanted.provenance
    assert found.object_name == wanted.object_name
    torch.testing.assert_close(found.poses, wanted.poses, rtol=0, atol=tolerance)
    torch.testing.assert_close(found.joints, wanted.joints, rtol=0, atol=tolerance)
    assert found.energies.keys() == wanted.energies.keys()
    for name, values in found.energies.items():
        torch.testing.assert_close(values, wanted.energies[name], rtol=1e-2, atol=100 * tolerance)


# thresholds that objects meet after different numbers of batches
@pytest.mark.parametrize(("sampler", "threshold"), [("annealed", 0.1), ("published", 0.7)])
def test_an_object_gets_the_same_grasps_alone_and_among_others(
    gripper_model: HandModel, objects: list[ObjectModel], sampler: str, threshold: float
):
    options = {**LENIENT, "max_force_closure": threshold}
    made = planner(sampler=sampler, steps=6, batch=8, max_batches=3, **options)
    seeds = range(len(objects))
    together = made.plan_many(gripper_model, objects, 4, [seeded(s) for s in seeds])
    for seed, obj, found in zip(seeds, objects, together):
        assert_close(found, made.plan(gripper_model, obj, 4, seeded(seed)), 1e-6)
    assert len({found.provenance["candidates"] for found in together}) > 1
    # two of one object differ by their generators
    assert not torch.equal(together[0].poses, together[2].poses)


def test_padded_grids_as_on_a_gpu_give_the_same_grasps(
    gripper_model: HandModel, objects: list[ObjectModel], monkeypatch: pytest.MonkeyPatch
):
    made = planner(steps=3, batch=8, max_batches=1, **LENIENT)
    wanted = made.plan_many(gripper_model, objects, 4, [seeded(s) for s in range(3)])
    padded = classmethod(lambda cls, grids: cls(tuple(grids), len(grids) > 1))
    monkeypatch.setattr(SdfStack, "of", padded)
    found = made.plan_many(gripper_model, objects, 4, [seeded(s) for s in range(3)])
    for one, other in zip(found, wanted):
        assert_close(one, other, 1e-4)


def test_one_after_the_other_is_what_a_planner_does_by_itself(
    gripper_model: HandModel, objects: list[ObjectModel]
):
    made, told = planner(steps=2, batch=8, max_batches=1, **LENIENT), []
    one_by_one = Planner.plan_many(
        made, gripper_model, objects, 2, [seeded()] * 3, lambda done, total: told.append(done)
    )
    assert told == [1, 2, 3, 4, 5, 6]
    assert len(one_by_one) == 3
    assert_close(one_by_one[0], made.plan(gripper_model, objects[0], 2, seeded()), 0.0)
    with pytest.raises(ValueError, match="argument"):
        made.plan_many(gripper_model, objects, 2, [seeded()])


def test_every_object_keeps_its_own_best_chains(
    gripper_model: HandModel, objects: list[ObjectModel]
):
    options = DfcOptions(contacts=2, steps=1)
    mala = AnnealedMala(
        GraspEnergy(gripper_model, ObjectBatch(objects[:2]), options), options, [seeded(), seeded()]
    )
    starts = [above_surface(gripper_model, obj, 8, seeded()) for obj in objects[:2]]
    chains = mala.evaluate(torch.cat(starts), mala.random_contacts(16, 2))
    best = mala._best(chains, 3)
    for part, kept in zip(total(mala, chains).chunk(2), total(mala, best).chunk(2)):
        torch.testing.assert_close(kept, part.sort().values[:3])
    # and scales of its own: those of its chains that are finite
    chains.q_gradient[3] = math.nan
    mean = mala.mean(chains.q_gradient.square())
    others = [0, 1, 2, 4, 5, 6, 7]
    torch.testing.assert_close(mean[0], chains.q_gradient[others].square().mean(0))
    torch.testing.assert_close(mean[1], chains.q_gradient[8:].square().mean(0))
    chains.q_gradient[:8] = math.nan
    assert (mala.mean(chains.q_gradient)[0] == 1).all()
