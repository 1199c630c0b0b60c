"""Pad points cover the contact regions, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from conftest import build_model
from hypothesis import given
from hypothesis import strategies as st

from gdg.errors import GdgError
from gdg.hands.hand import Hand, find_hand
from gdg.kinds.hand_model import HandModel
from gdg.pads import contact_pads


@given(st.floats(0.002, 0.02))
def test_pads_lie_in_their_regions_at_most_a_spacing_from_its_edge(spacing: float):
    hand = _gripper()
    pads = contact_pads(hand, spacing)
    for region, link in enumerate(hand.regions.link_index):
        own = pads.points[pads.link_index == link]
        corners = hand.regions.corners[region]
        low, high = corners.amin(0), corners.amax(0)
        assert (own >= low - 1e-6).all()
        assert (own <= high + 1e-6).all()
        assert (own.amin(0) - low <= spacing).all()
        assert (high - own.amax(0) <= spacing).all()


def test_cells_are_of_the_asked_size(gripper_model: HandModel):
    # each jaw's region is 30 × 50 mm
    assert len(contact_pads(gripper_model, 0.01).points) == 2 * 3 * 5


def test_normals_are_those_of_the_regions(gripper_model: HandModel):
    pads = contact_pads(gripper_model)
    names = [gripper_model.link_names[link] for link in pads.link_index]
    inward = {"left": [0.0, -1.0, 0.0], "right": [0.0, 1.0, 0.0]}
    expected = torch.tensor([inward[name] for name in names])
    torch.testing.assert_close(pads.normals, expected)


def test_a_hand_without_regions_is_refused(gripper: Hand):
    spec = gripper.spec.model_copy(update={"contact_regions": {}})
    with pytest.raises(GdgError, match="contact_regions"):
        contact_pads(build_model(replace(gripper, spec=spec)))


@pytest.mark.parametrize("name", ["barrett", "shadowhand"])
def test_pads_are_near_the_surface(name: str):
    hand = build_model(find_hand(name), 1600)
    pads, poses = contact_pads(hand), hand.link_poses_in_root(hand.open_posture[None])
    placed = hand.place(poses, pads.points, pads.link_index)[0]
    nearest = torch.cdist(placed, hand.place_surface(poses)[0]).amin(-1)
    assert nearest.quantile(0.9) < 0.01


def _gripper() -> HandModel:
    from gdg.testing.fixtures import model_of, two_jaws

    if "hand" not in _KEPT:
        _KEPT["hand"] = model_of(two_jaws())
    return _KEPT["hand"]


_KEPT: dict[str, HandModel] = {}
