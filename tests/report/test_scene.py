"""Scenes, meshes, colours and tables of a report."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
from rich.console import Console

from gdg.objects.model import find_object
from gdg.report.meshes import PictureMesh, hand_meshes, object_mesh, vertex_values
from gdg.report.palette import contact_colors
from gdg.report.scene import build_scene
from gdg.report.table import summary_line, verdict_table

# -- scene and meshes ---------------------------------------------------------------------------


def test_visual_shapes_are_drawn_and_lost_ones_replaced(hand):
    meshes = hand_meshes(hand.hand, 10_000)
    paddle, tip = (meshes[hand.link_names.index(name)] for name in ("paddle", "tip"))
    np.testing.assert_allclose(np.ptp(paddle.vertices, axis=0), [0.016, 0.016, 0.06], atol=1e-4)
    np.testing.assert_allclose(np.ptp(tip.vertices, axis=0), [0.02] * 3, atol=1e-4)


def test_values_do_not_leak_through_a_thin_wall():
    cup = find_object("cup")
    points, normals = cup.points.numpy(), cup.normals.numpy()
    outward = (points[:, :2] * normals[:, :2]).sum(-1) > 0
    mesh = object_mesh(cup.mesh, 8000)
    values = vertex_values(mesh, points, normals, outward.astype(float))
    side = np.abs(mesh.normals[:, 2]) < 0.3
    outer = (mesh.vertices[:, :2] * mesh.normals[:, :2]).sum(-1) > 0
    assert values[side & outer].mean() > 0.98
    assert values[side & ~outer].mean() < 0.02


def test_object_mesh_keeps_size_and_budget(obj):
    for budget in (600, 8000, 30_000):
        mesh = object_mesh(obj.mesh, budget)
        assert isinstance(mesh, PictureMesh)
        assert budget / 3 < len(mesh.faces) <= budget
        np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), obj.mesh.extents, atol=2e-3)
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=-1), 1.0, atol=1e-4)


def test_views_turn_around_the_grasp(hand, obj, grasps):
    scene = build_scene(hand, obj, grasps, 2000, 2000)
    np.testing.assert_allclose(np.linalg.norm(scene.eyes, axis=-1), 1.0, atol=1e-6)
    cosines = (scene.eyes[:, 0] * scene.eyes[:, 1]).sum(-1)
    assert (np.degrees(np.arccos(cosines)) >= 65.0 - 1e-3).all()


def test_contact_scale_darkens_steadily():
    rgb = contact_colors(np.linspace(0, 1, 101)) / 255.0
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    lightness = 116 * np.cbrt(linear @ [0.2126, 0.7152, 0.0722]) - 16
    fifths = -np.diff(lightness[::20])
    assert fifths.min() > 9
    assert fifths.max() < 16
    assert np.diff(lightness).max() < 0.1  # 8-bit colours are rounded


# -- the table ----------------------------------------------------------------------------------


def printed(table: object) -> str:
    console = Console(file=io.StringIO(), width=120)
    console.print(table)
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_table_shows_what_was_measured(grasps):
    text = printed(verdict_table(grasps))
    rows = [line for line in text.splitlines() if "pass" in line or "drifted" in line]
    assert len(rows) == 3
    assert all(part in rows[0] for part in ("1.5", "0.80", "1.2", "0.4", "3/3"))
    assert "drifted" in rows[1]
    assert "1/3" in rows[1]


def test_table_takes_no_markup_from_names(grasps):
    verdict = replace(grasps.verdicts[1], failure="[red]odd[/red]")
    assert "[red]odd[/red]" in printed(verdict_table(replace(grasps, verdicts=(verdict,) * 3)))


def test_summary_gives_rate_and_interval(grasps):
    line = summary_line(grasps)
    assert line.startswith("2/3 grasps passed dro-2024-v1 (66.7 %, 95 % interval 20.8 to 93.9 %)")
    assert "median penetration 0.80 mm" in line
    assert summary_line(replace(grasps, verdicts=())) == "3 grasps, not simulated"
