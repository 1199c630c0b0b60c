"""The report's files: complete, self-contained, safe to open, and true to the grasps."""

from __future__ import annotations

import base64
import hashlib
import re
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
import torch
from PIL import Image
from report_pages import EVIL, read_page, unpack

from gdg.errors import GdgError
from gdg.report.contact_sheet import contact_sheet, sheet_size
from gdg.report.html import html_report
from gdg.report.meshes import hand_meshes

VIEW = (160, 120)

JOINT = "<&finger"


# -- the HTML report ----------------------------------------------------------------------------


def test_page_loads_nothing_from_elsewhere(hand, obj, grasps, tmp_path):
    html_report(hand, obj, grasps, tmp_path / "report.html", "hand: paddles")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    page, _ = read_page(tmp_path / "report.html")
    assert "://" not in text
    assert not re.search(r"\b(fetch|XMLHttpRequest|WebSocket|importScripts|import)\s*\(", text)
    assert not [attrs for _, attrs in page.tags if {"src", "href"} & attrs.keys()]
    assert len(text) < 3_000_000


def test_content_security_policy_admits_this_script_only(hand, obj, grasps, tmp_path):
    html_report(hand, obj, grasps, tmp_path / "report.html")
    page, _ = read_page(tmp_path / "report.html")
    (policy,) = [a["content"] for t, a in page.tags if t == "meta" and "http-equiv" in a]
    digest = base64.b64encode(hashlib.sha256(page.scripts[1].encode()).digest()).decode()
    assert policy.startswith("default-src 'none'")
    assert f"script-src 'sha256-{digest}'" in policy


def test_what_the_test_left_out_is_said(hand, obj, grasps, tmp_path):
    verdicts = tuple(replace(v, left_out=("No friction here.",)) for v in grasps.verdicts)
    html_report(hand, obj, replace(grasps, verdicts=verdicts), tmp_path / "report.html")
    _, payload = read_page(tmp_path / "report.html")
    assert payload["summary"].endswith(" · No friction here.")


def test_hostile_names_stay_text(hand, obj, grasps, tmp_path):
    hostile = replace(
        grasps,
        hand=EVIL,
        object_name=EVIL,
        energies={EVIL: torch.zeros(3)},
        verdicts=tuple(replace(v, failure=EVIL, protocol=EVIL) for v in grasps.verdicts),
        provenance={EVIL: EVIL},
    )
    html_report(hand, obj, grasps, tmp_path / "plain.html")
    html_report(hand, obj, hostile, tmp_path / "report.html", EVIL, EVIL + "{{payload}}")
    page, payload = read_page(tmp_path / "report.html")
    plain, _ = read_page(tmp_path / "plain.html")
    assert [tag for tag, _ in page.tags] == [tag for tag, _ in plain.tags]
    assert len(page.scripts) == 2
    assert payload["title"] == EVIL + "{{payload}}"
    assert payload["hand"] == payload["config_text"] == EVIL
    assert payload["joints"][0]["name"] == JOINT


def test_viewer_writes_text_only_as_text():
    scripts = [f for f in resources.files("gdg.report").iterdir() if f.name.endswith(".js")]
    assert len(scripts) == 5
    for file in scripts:
        script = file.read_text(encoding="utf-8")
        assert "</script" not in script
        assert not re.search(r"innerHTML|outerHTML|insertAdjacent|document\.write|\beval\b", script)


def test_payload_matches_the_grasps(hand, obj, grasps, tmp_path):
    html_report(hand, obj, grasps, tmp_path / "report.html")
    _, payload = read_page(tmp_path / "report.html")
    links = list(hand_meshes(hand.hand, 1000))
    expected = hand.link_poses(hand.q_of(grasps))[:, links]
    assert len(payload["grasps"]) == len(grasps)
    assert len(payload["link_meshes"]) == len(links)
    for index, grasp in enumerate(payload["grasps"]):
        column_major = unpack(grasp["link_poses"]).reshape(-1, 4, 4)
        np.testing.assert_allclose(column_major.transpose(0, 2, 1), expected[index], atol=1e-6)
        assert grasp["joints"] == pytest.approx(grasps.joints[index].tolist())
        assert grasp["verdict"]["success"] == grasps.verdicts[index].success
    assert payload["grasps"][2]["energies"]["total"] is None
    assert [joint["unit"] for joint in payload["joints"]] == ["rad", "m"]


def test_payload_mesh_is_the_object_with_its_contact_map(hand, obj, grasps, tmp_path):
    html_report(hand, obj, grasps, tmp_path / "report.html")
    _, payload = read_page(tmp_path / "report.html")
    mesh = payload["object_mesh"]
    positions = unpack(mesh["positions"]).reshape(-1, 3) / 32767 * mesh["spread"] + mesh["origin"]
    faces = unpack(mesh["faces"]).reshape(-1, 3)
    values = unpack(payload["grasps"][0]["contact_values"]) / 255
    assert len(faces) <= 8000
    assert faces.max() < len(positions) == len(values) == mesh["vertex_count"]
    np.testing.assert_allclose(positions.min(0), obj.mesh.bounds[0], atol=1e-5)
    np.testing.assert_allclose(positions.max(0), obj.mesh.bounds[1], atol=1e-5)
    height = (positions[:, 2] - obj.mesh.bounds[0, 2]) / np.ptp(obj.mesh.bounds[:, 2])
    assert np.abs(values - height).mean() < 0.03


def test_page_without_grasps_shows_the_object(hand, obj, grasps, tmp_path):
    html_report(hand, obj, grasps.select([]), tmp_path / "report.html")
    _, payload = read_page(tmp_path / "report.html")
    assert payload["grasps"] == []
    assert payload["summary"] == "no grasp found"
    assert payload["object_mesh"]["vertex_count"] > 100


def test_page_shows_grasps_that_were_not_simulated(hand, obj, grasps, tmp_path):
    bare = replace(grasps, verdicts=(), contact_values=None)
    html_report(hand, obj, bare, tmp_path / "report.html")
    _, payload = read_page(tmp_path / "report.html")
    assert payload["grasps"][0]["verdict"] is None
    assert payload["grasps"][0]["contact_values"] is None


# -- the contact sheet --------------------------------------------------------------------------


def test_sheet_has_a_picture_in_every_view(hand, obj, grasps, tmp_path):
    contact_sheet(hand, obj, grasps, tmp_path / "sheet.png", columns=2, view_size=VIEW)
    with Image.open(tmp_path / "sheet.png") as picture:
        assert picture.size == sheet_size(3, 2, VIEW)
        pixels = np.asarray(picture.convert("RGB"), float)
    warm = pixels[..., 0] - pixels[..., 2]
    assert (warm > 60).sum() > 500  # the contact map's orange and red
    assert (warm < -25).sum() > 500  # the hand's blue
    assert list(tmp_path.iterdir()) == [tmp_path / "sheet.png"]


def test_sheet_without_contact_map_is_grey_and_blue(hand, obj, grasps, tmp_path):
    bare = replace(grasps, contact_values=None, verdicts=(), status=()).select([0])
    contact_sheet(hand, obj, bare, tmp_path / "sheet.png", view_size=VIEW)
    pixels = np.asarray(Image.open(tmp_path / "sheet.png").convert("RGB"), float)
    assert (pixels[..., 0] - pixels[..., 2] > 60).sum() == 0
    assert pixels.std() > 10


def test_empty_sheet_says_so(hand, obj, grasps, tmp_path):
    contact_sheet(hand, obj, grasps.select([]), tmp_path / "sheet.png")
    with Image.open(tmp_path / "sheet.png") as picture:
        assert picture.size == sheet_size(0, 4)
        middle = np.asarray(picture.convert("L"))[80:-20, 100:-100]
    assert middle.min() < 150 < middle.max()


def test_grasps_of_another_hand_are_refused(hand, obj, grasps, tmp_path):
    with pytest.raises(GdgError, match="Draw them with the hand"):
        html_report(hand, obj, replace(grasps, joint_names=("a", "b")), tmp_path / "r.html")
    maps = replace(grasps, contact_values=torch.zeros(3, 7))
    with pytest.raises(GdgError, match="belong to another object"):
        html_report(hand, obj, maps, tmp_path / "r.html")
    assert not list(tmp_path.iterdir())
