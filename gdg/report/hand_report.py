"""The interactive page of one hand: move its joints, see what was decided and found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gdg.data.atomic import write_text_atomically
from gdg.hands.decisions import Decision
from gdg.hands.describe import drive_text, followers, units_of
from gdg.hands.hand import Hand
from gdg.hands.urdf import Joint
from gdg.kinds.hand_model import HandModel
from gdg.report.hand_scene import HandScene, build_hand_scene
from gdg.report.hand_sheet import legend, summary
from gdg.report.html import packed_mesh, render_page, view_of
from gdg.report.palette import CONTACT_SCALE, HAND, OBJECT_PLAIN, TOUCHING
from gdg.testing.findings import Finding

HAND_PAGE = ("viewer_draw.js", "viewer_page.js", "viewer_tree.js", "viewer_hand.js")
MOTIONS = {"revolute": "turn", "continuous": "turn", "prismatic": "slide"}


def hand_report(
    hand: HandModel,
    path: Path,
    decisions: Sequence[Decision] = (),
    repairs: Sequence[str] = (),
    findings: Sequence[Finding] = (),
) -> None:
    """Writes a self-contained HTML page of a hand, atomically.

    Its joints can be moved; it shows the shapes that gdg computes with, contact regions, palm and
    root frame. The page loads nothing, and its content-security policy forbids it to; all names
    and texts are shown as plain text, whatever they hold.

    Args:
        hand: the hand.
        path: the HTML file.
        decisions: what a program chose for the manifest; the least sure are shown first.
        repairs: what was changed in the files that the hand came from, one sentence each.
        findings: what the checks found.
    """
    payload = hand_payload(hand, decisions, repairs, findings)
    write_text_atomically(path, render_page(payload, HAND_PAGE))


def hand_payload(
    model: HandModel,
    decisions: Sequence[Decision],
    repairs: Sequence[str],
    findings: Sequence[Finding],
) -> dict[str, Any]:
    """What the page shows, as plain values and packed arrays (see ``gdg.report.html.packed``)."""
    hand, scene = model.hand, build_hand_scene(model)
    spec = hand.spec
    return {
        "title": f"{spec.name} · {spec.title}" if spec.title else spec.name,
        "summary": summary(model),
        "contact_scale": [list(color) for color in CONTACT_SCALE],
        "colors": {"hand": HAND, "object": OBJECT_PLAIN, "touching": TOUCHING},
        "floor": float(scene.whole[:, 2].min()),
        "view": view_of(scene.eyes, scene.near),
        "object_mesh": None,
        "link_meshes": [
            {**packed_mesh(item.mesh), "color": item.color, "role": item.role, "link": item.link}
            for item in scene.items
        ],
        "tree": _tree(hand, scene),
        "joints": [_joint(hand, index) for index in range(len(spec.joints))],
        "followers": followers(hand),
        "legend": [{"color": color, "text": text} for color, text in legend(scene)],
        "regions": _regions(model),
        "facts": _facts(hand),
        "decisions": [
            {**asdict(decision), "verdict": decision.verdict}
            for decision in sorted(decisions, key=lambda decision: decision.confidence)
        ],
        "repairs": list(repairs),
        "findings": [_finding(hand, finding) for finding in findings],
    }


def _tree(hand: Hand, scene: HandScene) -> dict[str, Any]:
    """The kinematic tree as the page's script takes it; poses column-major."""
    rows = hand.moving_rows
    return {
        "root": hand.link_names.index(hand.urdf.root),
        "root_pose": _column_major(scene.T_picture_root),
        "joints": [_edge(hand, joint, rows.get(joint.name)) for joint in hand.urdf.joints.values()],
    }


def _edge(hand: Hand, joint: Joint, row: int | None) -> dict[str, Any]:
    matrix, offset = hand.coupling
    actuated = [] if row is None else matrix[row].nonzero()[0]
    return {
        "parent": hand.link_names.index(joint.parent),
        "child": hand.link_names.index(joint.child),
        "pose": _column_major(joint.T_parent_child),
        "axis": [float(value) for value in joint.axis],
        "kind": MOTIONS.get(joint.type, "fixed"),
        "factors": [(int(index), float(matrix[row, index])) for index in actuated],
        "offset": 0.0 if row is None else float(offset[row]),
    }


def _column_major(pose: np.ndarray) -> list[float]:
    return [float(value) for value in pose.T.reshape(-1)]


def _joint(hand: Hand, index: int) -> dict[str, Any]:
    name = hand.spec.joints[index]
    joint, (unit, force) = hand.urdf.joints[name], units_of(hand, name)
    return {
        "name": name,
        "type": joint.type,
        "unit": unit,
        "lower": joint.lower,
        "upper": joint.upper,
        "open": float(hand.posture("open")[index]),
        "closed": float(hand.posture("closed")[index]),
        "drive": drive_text(hand.spec.drives.of(name), unit, force),
    }


def _finding(hand: Hand, finding: Finding) -> dict[str, str]:
    # the folder is told once, among the facts
    place = finding.place.removeprefix(f"{hand.folder}/")
    return {"severity": finding.severity, "place": place, "text": finding.text}


def _regions(model: HandModel) -> list[list[str]]:
    corners = model.regions.corners.double().cpu().numpy()
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    areas = np.linalg.norm(across, axis=-1) / 2
    link = model.regions.link_index.cpu().numpy()
    return [
        [model.link_names[i], str((link == i).sum()), f"{1e6 * areas[link == i].sum():.0f} mm²"]
        for i in dict.fromkeys(link.tolist())
    ]


def _facts(hand: Hand) -> list[list[str]]:
    spec = hand.spec
    vector = " ".join
    return [
        ["folder", str(hand.folder)],
        ["shapes", f"{spec.geometry}, {len(hand.parts)} convex parts"],
        ["root link", hand.urdf.root],
        ["palm link", spec.palm.link],
        ["palm normal", vector(f"{value:.3g}" for value in spec.palm.normal)],
        ["palm centre, mm", vector(f"{1000 * value:.1f}" for value in spec.palm.center)],
        ["mass", f"{sum(link.mass for link in hand.urdf.links.values()):.3g} kg"],
        ["source", spec.provenance.source],
        ["licence", spec.provenance.licence],
    ]
