"""All measures together, on grasps whose values are known and on real hands."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from measured_grasps import around_the_cube, closed_on

from gdg.hands.hand import find_hand
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, find_object
from gdg.quality import METRICS, measure
from gdg.quality.fingers import fingers_of_links


def test_a_gripper_that_holds_a_cube(gripper_model: HandModel, cube: ObjectModel):
    grasps = measure(gripper_model, cube, around_the_cube(gripper_model, cube, [0.0, -2.0, 10.0]))
    metrics = grasps.metrics
    assert tuple(metrics) == METRICS
    assert metrics["penetration_mm"].tolist() == pytest.approx([0.0, 2.0, 0.0], abs=1e-3)
    assert metrics["contacts"].tolist() == [8, 8, 0]
    assert metrics["contact_links"].tolist() == [2, 2, 0]
    assert metrics["contact_fingers"].tolist() == [2, 2, 0]
    assert (metrics["epsilon"][:2] > 0.1).all()
    assert (metrics["wrench_volume"][:2] > 0).all()
    assert metrics["wrench_residual"][:2].tolist() == pytest.approx([0.0, 0.0], abs=1e-6)
    assert (metrics["epsilon"][2], metrics["wrench_volume"][2]) == (0, 0)
    assert metrics["wrench_residual"][2].isnan()
    assert grasps.contacts is not None
    assert grasps.contacts.counts.tolist() == [8, 8, 0]


def test_what_the_grasps_had_is_kept(gripper_model: HandModel, cube: ObjectModel):
    grasps = around_the_cube(gripper_model, cube, [0.5])
    grasps = replace(
        grasps,
        metrics={"mine": torch.ones(1), "epsilon": torch.full((1,), 9.0)},
        energies={"total": torch.zeros(1)},
    )
    measured = measure(gripper_model, cube, grasps)
    assert measured.metrics["mine"].item() == 1.0
    assert measured.metrics["epsilon"].item() < 1.0
    assert measured.energies == grasps.energies
    assert measured.poses is grasps.poses
    assert all(values.dtype == torch.float32 for values in measured.metrics.values())


def test_more_friction_holds_better(gripper_model: HandModel, cube: ObjectModel):
    grasps = around_the_cube(gripper_model, cube, [0.5])
    epsilon = [
        measure(gripper_model, cube, grasps, friction).metrics["epsilon"].item()
        for friction in (0.0, 0.3, 0.6)
    ]
    assert epsilon[0] == 0.0 < epsilon[1] < epsilon[2]


def test_measured_grasps_come_back_from_their_file(
    gripper_model: HandModel, cube: ObjectModel, tmp_path
):
    from gdg.data.grasps import load_grasps

    grasps = measure(gripper_model, cube, around_the_cube(gripper_model, cube, [0.5, 10.0]))
    grasps.save(tmp_path / "grasps.json")
    loaded = load_grasps(tmp_path / "grasps.json")
    for name, values in grasps.metrics.items():
        torch.testing.assert_close(loaded.metrics[name], values, equal_nan=True)
    assert loaded.contacts is not None
    assert grasps.contacts is not None
    assert loaded.contacts.links == grasps.contacts.links


def test_an_empty_set_has_empty_measures(gripper_model: HandModel, cube: ObjectModel):
    measured = measure(gripper_model, cube, around_the_cube(gripper_model, cube, [0.5]).select([]))
    assert [len(values) for values in measured.metrics.values()] == [0] * len(METRICS)


@pytest.mark.parametrize("name", ["allegro", "shadowhand", "barrett"])
def test_measures_of_real_hands_are_plausible(name: str):
    obj = find_object("mug")
    hand, grasps = closed_on(name, obj, 12)
    metrics = measure(hand, obj, grasps).metrics
    assert all(values.isfinite().all() for key, values in metrics.items() if "residual" not in key)
    assert (metrics["contacts"] >= metrics["contact_links"]).all()
    assert (metrics["contact_links"] >= metrics["contact_fingers"]).all()
    assert metrics["contact_fingers"].max() >= 3
    assert ((metrics["epsilon"] >= 0) & (metrics["epsilon"] < 1)).all()
    # force closure needs balance
    assert (metrics["wrench_residual"][metrics["epsilon"] > 0] < 1e-6).all()
    assert (metrics["epsilon"] > 0).any()


@pytest.mark.parametrize(
    ("name", "count", "trunk"),
    [
        ("allegro", 4, {"palm"}),
        ("shadowhand", 5, {"forearm", "wrist", "palm"}),
        ("barrett", 3, {"palm"}),
        ("robotiq_3finger", 3, {"palm"}),
        ("ezgripper", 2, {"palm"}),
    ],
)
def test_bundled_hands_have_their_number_of_fingers(name: str, count: int, trunk: set[str]):
    fingers = fingers_of_links(find_hand(name))
    assert len(set(fingers.values()) - {None}) == count
    assert {link for link, finger in fingers.items() if finger is None} >= trunk


def test_links_of_a_finger_share_it(gripper_model: HandModel):
    fingers = fingers_of_links(gripper_model.hand)
    assert fingers == {"base": None, "palm": None, "left": "left", "right": "right"}
    shadow = fingers_of_links(find_hand("shadowhand"))
    assert shadow["lfdistal"] == shadow["lfmetacarpal"] != shadow["rfdistal"]
