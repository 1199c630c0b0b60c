"""Pictures and the page of a hand by itself: complete, safe to open, and true to its postures."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from report_pages import EVIL, read_page, unpack

from gdg.folders import HANDS
from gdg.hands.decisions import Decision
from gdg.hands.hand import find_hand
from gdg.kinds.hand_model import HandModel
from gdg.report.hand_report import hand_payload, hand_report
from gdg.report.hand_scene import build_hand_scene, finger_chains
from gdg.report.hand_sheet import hand_picture, hand_sheet
from gdg.report.html import script_safe_json
from gdg.report.markers import region_patch
from gdg.report.palette import CHAINS, PALM_REGIONS
from gdg.testing.findings import error, warning
from gdg.testing.fixtures import model_of, two_jaws

SMALL = (200, 160)
DECISIONS = (
    Decision("palm.normal", "[0, 0, 1]", 0.95, "the fingers close over it"),
    Decision("open", EVIL, 0.3, EVIL),
)
BUNDLED = [name for name, found in HANDS.all().items() if found.tier == "bundled"]


@pytest.fixture(scope="module")
def jaws() -> HandModel:
    return model_of(two_jaws())


@pytest.fixture(scope="module")
def barrett() -> HandModel:
    return model_of(find_hand("barrett"))


def has_color(picture: Image.Image, color: tuple[int, int, int]) -> bool:
    """Whether many pixels have a hue near that of a colour, in whatever light."""
    pixels = np.asarray(picture.convert("RGB"), float).reshape(-1, 3)
    unit = pixels / np.maximum(np.linalg.norm(pixels, axis=-1, keepdims=True), 1)
    wanted = np.array(color) / np.linalg.norm(color)
    return int((unit @ wanted > 0.995).sum()) > 20


# -- pictures ------------------------------------------------------------------------------------


def test_sheet_shows_the_regions_of_every_finger(barrett, tmp_path):
    hand_sheet(barrett, tmp_path / "hand.png", SMALL)
    with Image.open(tmp_path / "hand.png") as sheet:
        assert sheet.width > 2 * SMALL[0]
        assert sheet.height > 2 * SMALL[1]
        views = sheet.crop((0, 60, sheet.width, 60 + 2 * SMALL[1]))
        for color in (*CHAINS[:3], PALM_REGIONS):
            assert has_color(views, color)
        assert not has_color(views, CHAINS[4])


def test_picture_is_small_and_shows_no_markers(barrett, tmp_path):
    hand_picture(barrett, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size < 200_000
    with Image.open(tmp_path / "picture.png") as picture:
        assert not has_color(picture, CHAINS[0])


@pytest.mark.parametrize("name", BUNDLED)
def test_every_bundled_hand_has_a_small_picture(name: str):
    path = HANDS.find(name).path / "picture.png"
    assert path.stat().st_size < 200_000
    with Image.open(path) as picture:
        assert picture.width > 400


def test_a_hand_without_regions_or_with_one_finger_can_be_drawn(hand, tmp_path):
    hand_sheet(hand, tmp_path / "hand.png", SMALL)
    assert (tmp_path / "hand.png").is_file()


# -- the scene -----------------------------------------------------------------------------------


def test_chains_are_the_fingers(barrett):
    palm, *fingers = finger_chains(barrett.hand)
    names = barrett.link_names
    assert [names[i] for i in palm.links] == ["palm", "finger_3_base"]
    assert [chain.regions for chain in (palm, *fingers)] == [1, 4, 4, 4]
    assert [names[i] for i in fingers[0].links] == [
        "finger_1_base", "finger_1_proximal", "finger_1_distal"
    ]  # fmt: skip


def test_fingers_point_upward_in_the_picture(barrett):
    scene = build_hand_scene(barrett)
    tip = barrett.link_names.index("finger_1_distal")
    assert scene.postures["open"][tip, 2, 3] > 0.05
    # the palm of the Allegro looks sideways, its fingers up
    allegro = model_of(find_hand("allegro"))
    scene = build_hand_scene(allegro)
    normal = scene.T_picture_root[:3, :3] @ np.array(allegro.hand.spec.palm.normal)
    assert abs(normal[2]) < 1e-6


def test_patches_lie_just_above_their_surface(jaws):
    part = next(part for part in jaws.hand.parts if part.link == "left")
    corners = np.array(jaws.hand.spec.contact_regions["left"][0])
    raised = region_patch(corners, [part]).vertices[:, 1]
    assert raised.min() == raised.max() == pytest.approx(-0.0006, abs=1e-6)
    # a region that is a little inside is lifted out, one far inside is left there to be seen
    inward = np.array([0, 0.002, 0])
    assert region_patch(corners + inward, [part]).vertices[:, 1].max() < 0
    assert region_patch(corners + 2 * inward, [part]).vertices[:, 1].min() > 0.003


# -- the page ------------------------------------------------------------------------------------


def test_page_is_self_contained_and_hostile_texts_stay_text(jaws, tmp_path):
    findings = [error(f"{jaws.hand.folder}/hand.yaml: {EVIL}", EVIL), warning("x", "y")]
    hand_report(jaws, tmp_path / "plain.html")
    hand_report(jaws, tmp_path / "report.html", DECISIONS, [EVIL], findings)
    page, payload = read_page(tmp_path / "report.html")
    plain, _ = read_page(tmp_path / "plain.html")
    assert [tag for tag, _ in page.tags] == [tag for tag, _ in plain.tags]
    assert len(page.scripts) == 2
    assert "://" not in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert payload["repairs"] == [EVIL]
    assert payload["findings"][0] == {
        "severity": "error", "place": f"hand.yaml: {EVIL}", "text": EVIL
    }  # fmt: skip


def test_the_least_sure_decisions_come_first(jaws):
    shown = hand_payload(jaws, DECISIONS, (), ())["decisions"]
    assert [entry["subject"] for entry in shown] == ["open", "palm.normal"]
    assert [entry["verdict"] for entry in shown] == ["look at this", "sure"]


def test_a_confidence_beyond_one_is_refused():
    with pytest.raises(ValueError, match="not between 0 and 1"):
        Decision("palm", "x", 1.1, "y")


def test_payload_lists_joints_followers_and_regions(jaws):
    payload = hand_payload(jaws, (), (), ())
    (joint,) = payload["joints"]
    assert (joint["name"], joint["unit"], joint["open"], joint["closed"]) == ("close", "m", 0, 0.05)
    assert joint["drive"] == "drive 2000 N/m, 100 N s/m, at most 20 N"
    assert payload["followers"] == ["close_right follows close"]
    assert payload["regions"] == [["left", "1", "1500 mm²"], ["right", "1", "1500 mm²"]]
    assert {mesh["role"] for mesh in payload["link_meshes"]} == {"hand", "region", "palm", "root"}
    assert unpack(payload["link_meshes"][0]["faces"]).size > 0


@pytest.mark.skipif(shutil.which("node") is None, reason="no node")
@pytest.mark.parametrize("name", ["barrett", "shadowhand", "two_jaws"])
def test_joints_move_in_the_page_as_in_the_hand_model(name: str, tmp_path: Path):
    model = model_of(two_jaws() if name == "two_jaws" else find_hand(name))
    payload = hand_payload(model, (), (), ())
    share = torch.rand(1, len(model.joint_names), generator=torch.Generator().manual_seed(0))
    joints = model.lower + share * (model.upper - model.lower)
    scripts = [
        resources.files("gdg.report").joinpath(file).read_text(encoding="utf-8")
        for file in ("viewer_draw.js", "viewer_tree.js")
    ]
    (tmp_path / "page.js").write_text(
        "const text = require('fs').readFileSync('payload.json', 'utf8');\n"
        "const document = { getElementById: () => ({ textContent: text }) };\n"
        + "".join(scripts)
        + f"\nconst found = linkPoses(data.tree, {json.dumps(joints[0].tolist())});"
        + "\nconsole.log(JSON.stringify(found.map((pose) => Array.from(pose))));"
    )
    (tmp_path / "payload.json").write_text(script_safe_json(payload))
    done = subprocess.run(["node", "page.js"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = np.array(json.loads(done.stdout)).reshape(-1, 4, 4).transpose(0, 2, 1)
    T_picture_root = build_hand_scene(model).T_picture_root
    expected = T_picture_root @ model.link_poses_in_root(joints)[0].double().numpy()
    np.testing.assert_allclose(found, expected, atol=2e-6)


@pytest.mark.parametrize("factor", [1000.0, 1e20])
def test_a_region_in_the_wrong_unit_is_drawn_all_the_same(factor: float, tmp_path: Path):
    jaws = two_jaws()
    regions = {
        link: [tuple(tuple(factor * v for v in corner) for corner in region) for region in listed]
        for link, listed in jaws.spec.contact_regions.items()
    }
    spec = jaws.spec.model_copy(update={"contact_regions": regions})
    model = model_of(replace(jaws, spec=spec))
    hand_sheet(model, tmp_path / "hand.png", SMALL)
    hand_report(model, tmp_path / "report.html")
    assert read_page(tmp_path / "report.html")[1]["regions"]
