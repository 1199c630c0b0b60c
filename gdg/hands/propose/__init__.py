"""Proposes a manifest for a hand of which only the kinematics and the shapes are known.

``structure`` reads palm and fingers from the tree; ``probe`` lets the hand grip balls; from the
grips ``closing`` takes the joints' signs, ``palm`` the palm's normal, ``postures`` the open and
closed hand; ``pads`` and ``regions`` draw contact regions on the inner sides; ``drives`` gives
gains and force limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from gdg.errors import GdgError
from gdg.hands.decisions import Decision
from gdg.hands.geometry import link_parts
from gdg.hands.hand import Hand
from gdg.hands.intake import Intake
from gdg.hands.propose.closing import Closing, find_closing, inward_of
from gdg.hands.propose.drives import drive_of, plausible
from gdg.hands.propose.linkages import without_linkages
from gdg.hands.propose.pads import find_regions
from gdg.hands.propose.palm import find_palm
from gdg.hands.propose.postures import find_postures
from gdg.hands.propose.probe import Grips, Prober
from gdg.hands.propose.reasons import Found, explain
from gdg.hands.propose.structure import Structure, find_structure
from gdg.hands.spec import Drive, Drives, HandSpec, Palm, Provenance
from gdg.hands.urdf import MOVING_TYPES, Urdf, read_urdf
from gdg.kinds.hand_model import HandModel

#: Mean energy of the grips from which on a hand holds no ball.
NO_GRIP = 6.0
#: More actuated joints than these are no hand's (a human hand on its arm has about 35).
MOST_JOINTS = 60


@dataclass(frozen=True)
class Proposal:
    """A manifest with what stands behind it.

    Attributes:
        spec: the manifest.
        structure: palm, fingers, wrist.
        closings: per actuated joint, which way it closes.
        decisions: what was chosen, how sure it is, and why.
    """

    spec: HandSpec
    structure: Structure
    closings: tuple[Closing, ...]
    decisions: tuple[Decision, ...]


def propose(
    folder: Path, name: str, intake: Intake, build: Callable[[Hand], HandModel], seed: int = 0
) -> Proposal:
    """Everything of ``hand.yaml``, from geometry and kinematics alone.

    Args:
        folder: the new hand's folder, which holds the URDF already.
        name: of the hand.
        intake: what the foreign description said.
        build: makes a hand's model.
        seed: of the search for grips; the same seed gives the same manifest.

    Raises:
        GdgError: nothing moves, or the hand can't hold anything between its links.
    """
    urdf = read_urdf(intake.urdf)
    joints = _actuated(urdf, intake)
    if len(joints) > MOST_JOINTS:
        raise GdgError(
            f"{urdf.path}: {len(joints)} joints move by themselves, more than a hand's. If it is a "
            f"whole robot, name the hand's first link with --root."
        )
    parts = link_parts(urdf, folder, intake.geometry)
    structure = find_structure(urdf, parts)
    draft = HandSpec(
        name=name,
        urdf=intake.urdf.name,
        geometry=intake.geometry,
        root_link=urdf.root,
        palm=Palm(link=structure.palm, normal=(0, 0, 1), center=(0, 0, 0)),
        joints=joints,
        contact_regions={},
        provenance=Provenance(source=intake.source, licence=intake.licence or "unknown"),
    )
    model = build(Hand(folder, draft, urdf, parts, content_hash=""))
    structure = without_linkages(model, structure)
    prober, grips, closings = _probe(model, structure, torch.Generator().manual_seed(seed))
    face = find_palm(prober, grips, closings)
    postures = find_postures(model, grips, closings)
    regions = find_regions(model, structure, face, postures.open, postures.closed)
    drives, stated = _drives(model, intake)
    spec = draft.model_copy(
        update={
            "palm": Palm(link=structure.palm, normal=_row(face.normal), center=_row(face.center)),
            "open": _by_joint(draft.joints, postures.open),
            "closed": _by_joint(draft.joints, postures.closed),
            "contact_regions": regions,
            "allowed_self_contacts": [*sorted({*postures.touching, *intake.excluded})],
            "drives": drives,
        }
    )
    found = Found(structure, closings, grips, face, postures, stated)
    return Proposal(spec, structure, closings, explain(spec, found))


def _actuated(urdf: Urdf, intake: Intake) -> tuple[str, ...]:
    """Moving joints that follow no other one, parents first; only driven ones, if that is said."""
    free = [j.name for j in urdf.joints.values() if j.type in MOVING_TYPES and j.mimic is None]
    driven = [name for name in free if intake.actuated is None or name in intake.actuated]
    return tuple(driven or free)


def _probe(
    model: HandModel, structure: Structure, generator: torch.Generator
) -> tuple[Prober, Grips, tuple[Closing, ...]]:
    """Grips twice: first with either side of the fingers, then with the sides found."""
    free = torch.tensor([name not in structure.wrist for name in model.joint_names])
    rest = torch.zeros(len(model.joint_names)).clamp(model.lower, model.upper)
    prober = Prober(model, structure, free, rest)
    first = find_closing(prober, prober.search(generator))
    prober = Prober(model, structure, free, rest, inward_of(prober, first))
    grips = prober.search(generator)
    if float(grips.energy.min()) > NO_GRIP:
        raise GdgError(
            f"{model.hand.urdf.path}: the links of this description can't hold a ball between "
            f"them. If it has more than a hand, name the hand's first link with --root."
        )
    return prober, grips, find_closing(prober, grips)


def _drives(model: HandModel, intake: Intake) -> tuple[Drives, dict[str, bool]]:
    """Drives as the description states them, else from efforts; the commonest is the default."""
    found: dict[str, Drive] = {}
    stated: dict[str, bool] = {}
    for name in model.joint_names:
        drive, stated[name] = drive_of(model, model.hand.urdf.joints[name])
        given = intake.drives.get(name, Drive())
        told = {field: getattr(given, field) for field in given.model_fields_set}
        if "force_limit" in told and not plausible(model, name, given.force_limit):
            del told["force_limit"]
        stated[name] |= "force_limit" in told
        found[name] = drive.model_copy(update=told)
    common = max(found.values(), key=lambda drive: list(found.values()).count(drive))
    return Drives(default=common, joints={n: d for n, d in found.items() if d != common}), stated


def _row(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 5) + 0.0 for value in vector)
    return x, y, z


def _by_joint(joints: tuple[str, ...], values: np.ndarray) -> dict[str, float]:
    return {name: round(float(value), 4) + 0.0 for name, value in zip(joints, values)}
