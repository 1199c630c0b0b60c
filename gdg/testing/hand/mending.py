"""Mends a refused hand in memory, so that its other mistakes can be told at the same time."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gdg.errors import GdgError
from gdg.hands.geometry import link_parts
from gdg.hands.hand import Hand, reference_mistakes
from gdg.hands.spec import MANIFEST, HandSpec
from gdg.hands.urdf import MOVING_TYPES, Urdf, read_urdf
from gdg.testing.checks import Check
from gdg.testing.findings import Finding
from gdg.testing.hand import collisions, joints, manifest, palm, regions
from gdg.testing.hand.case import HandCase
from gdg.yaml_files import read_yaml_mapping

#: Mending one place may uncover another; no manifest needs more rounds.
ROUNDS = 4
OVERLAPS = (collisions.open_posture, collisions.closed_posture)
#: Section -> checks whose verdict hangs on all of it.
CHECKS_ON: Mapping[str, tuple[Check[HandCase, Finding], ...]] = {
    "palm": (palm.palm,),
    "open": (joints.postures, collisions.open_posture),
    "closed": (joints.postures, collisions.closed_posture),
    "joints": (joints.passive_joints, joints.postures, joints.drives, *OVERLAPS),
    "contact_regions": (regions.fingertips,),
    "allowed_self_contacts": OVERLAPS,
    "drives": (joints.drives,),
}
#: The checks that need no shapes: all that is left when it is unknown which shapes are meant.
WITHOUT_SHAPES = (
    *manifest.CHECKS, joints.joint_limits, joints.mimic_joints, joints.passive_joints,
    joints.postures, joints.drives,
)  # fmt: skip


@dataclass(frozen=True)
class Mended:
    """A hand whose manifest had to be changed to be loaded.

    Attributes:
        spec: the changed manifest.
        mistakes: what did not fit the URDF, as ``load_hand`` tells it.
        places: what was changed, e.g. ``palm`` or ``contact_regions.thumb[1]``.
    """

    folder: Path
    spec: HandSpec
    urdf: Urdf
    mistakes: tuple[str, ...]
    places: frozenset[str]

    def load(self) -> Hand:
        """The hand; a ``GdgError`` where its shapes can't be read."""
        parts = link_parts(self.urdf, self.folder, self.spec.geometry)
        return Hand(self.folder, self.spec, self.urdf, parts, content_hash="")

    def may_run(self, check: Check[HandCase, Finding]) -> bool:
        """Whether a check looks at nothing that was changed as a whole."""
        sections = {place.partition(".")[0].partition("[")[0] for place in self.places}
        if "geometry" in sections and check not in WITHOUT_SHAPES:
            return False
        return all(check not in CHECKS_ON.get(section, ()) for section in sections)

    def stands(self, finding: Finding) -> bool:
        """Whether a finding is not about what was changed."""
        place = finding.place.removeprefix(f"{self.folder / MANIFEST}: ")
        # the closed fingers' regions are what the palm's normal is measured by
        if place == "palm.normal" and any(p.startswith("closed") or "[" in p for p in self.places):
            return False
        return not any(f"{place}.".startswith((f"{p}.", f"{p}[")) for p in self.places)


def urdf_of(folder: Path, tree: Mapping[str, Any]) -> Path | None:
    """The URDF that a manifest names; None if there is no such file in the folder."""
    named = tree.get("urdf")
    if not isinstance(named, str) or not named.isprintable():
        return None
    path = Path(os.path.realpath(folder / named))
    return path if path.is_relative_to(folder.resolve()) and os.path.isfile(path) else None


def mend(folder: Path) -> Mended | None:
    """Changes as much of a refused manifest as it takes; None if that is not enough."""
    try:
        tree = read_yaml_mapping(folder / MANIFEST)
        path = urdf_of(folder, tree)
        if path is None:
            return None
        urdf = read_urdf(path)
    except GdgError:
        return None
    places: set[str] = set()
    for _ in range(ROUNDS):
        try:
            spec = HandSpec.model_validate(tree)
        except ValidationError as refusal:
            places |= {_mend_schema(tree, detail["loc"], urdf) for detail in refusal.errors()}
            for detail in refusal.errors():
                if detail["type"] == "extra_forbidden" and len(detail["loc"]) == 1:
                    places |= _meant(
                        str(detail["loc"][0]), HandSpec.model_fields.keys() - tree.keys()
                    )
            continue
        told = tuple(f"{folder / MANIFEST}: {text}" for text in reference_mistakes(spec, urdf))
        places |= set(_mend_references(tree := spec.model_dump(exclude_unset=True), spec, urdf))
        return Mended(folder, HandSpec.model_validate(tree), urdf, told, frozenset(places))
    return None


def _meant(key: str, absent: set[str]) -> set[str]:
    """The absent section that an unknown key may stand for; all of them if none is like it."""
    return set(get_close_matches(key, absent, n=1)) or absent


def _mend_schema(tree: dict[str, Any], loc: tuple[int | str, ...], urdf: Urdf) -> str:
    """Replaces or drops what one complaint of the schema is about; tells the place of it."""
    section, given = str(loc[0]), tree.get(str(loc[0]))
    if section == "palm":
        link = given.get("link") if isinstance(given, dict) else None
        link = link if isinstance(link, str) else urdf.root
        tree["palm"] = {"link": link, "normal": [0, 0, 1], "center": [0, 0, 0]}
    elif section == "joints":
        names = given if isinstance(given, list) else []
        free = [name for name in _driven(urdf) if name not in names]
        names = [name if isinstance(name, str) else (free or [""]).pop(0) for name in names]
        tree["joints"] = [name for name in names if name] or free
    elif section in ("name", "root_link"):
        tree[section] = urdf.root if section == "root_link" else "hand"
    elif section == "contact_regions" and len(loc) > 2 and isinstance(loc[2], int):
        # a stand-in, not a gap: the numbers of the others must stay
        tree[section][loc[1]][loc[2]] = [[0, 0, 0], [0.01, 0, 0], [0.01, 0.01, 0], [0, 0.01, 0]]
        return f"{section}.{loc[1]}[{loc[2]}]"
    else:
        return _drop(tree, loc)
    return section


def _drop(tree: dict[str, Any], loc: tuple[int | str, ...]) -> str:
    """Drops what a complaint names, or the innermost entry of a mapping that holds it."""
    node: dict[Any, Any] = tree
    path = [part for part in loc if part != "[key]"]
    for depth, part in enumerate(path[:-1], 1):
        if not isinstance(node.get(part), dict):
            path = path[:depth]
            break
        node = node[part]
    node.pop(path[-1], None)
    if path[0] == "provenance":
        given = tree.get("provenance")
        tree["provenance"] = {"source": "-", "licence": "-"} | (given or {})
    elif path == ["contact_regions"]:
        tree["contact_regions"] = {}
    return ".".join(map(str, path))


def _mend_references(tree: dict[str, Any], spec: HandSpec, urdf: Urdf) -> Iterator[str]:
    """Replaces or drops what does not fit the URDF; tells the places of it."""
    if spec.root_link != urdf.root:
        tree["root_link"] = urdf.root
        yield "root_link"
    if spec.palm.link not in urdf.links:
        tree["palm"]["link"] = urdf.root
        yield "palm"
    for link in spec.contact_regions.keys() - urdf.links.keys():
        del tree["contact_regions"][link]
        yield f"contact_regions.{link}"
    pairs = [pair for pair in spec.allowed_self_contacts if set(pair) <= urdf.links.keys()]
    if pairs != spec.allowed_self_contacts:
        tree["allowed_self_contacts"] = pairs
        yield "allowed_self_contacts"
    names = _fitting(spec, urdf)
    if names != list(spec.joints):
        tree["joints"] = names
        yield "joints"
    for section in ("open", "closed"):
        for joint, value in getattr(spec, section).items():
            limits = urdf.joints.get(joint)
            low, high = (limits.lower, limits.upper) if limits else (0.0, 0.0)
            if joint not in names or not low - 1e-3 <= value <= high + 1e-3:
                del tree[section][joint]
                yield f"{section}.{joint}"
    for joint in spec.drives.joints.keys() - set(_driven(urdf)):
        del tree["drives"]["joints"][joint]
        yield f"drives.joints.{joint}"


def _fitting(spec: HandSpec, urdf: Urdf) -> list[str]:
    """The listed joints that can be driven; each unknown one makes room for one in a posture."""
    driven = _driven(urdf)
    listed = [name for name in dict.fromkeys(spec.joints) if name in driven]
    posed = sorted(driven, key=lambda name: name not in spec.open and name not in spec.closed)
    missing = len([name for name in dict.fromkeys(spec.joints) if name not in urdf.joints])
    return listed + [name for name in posed if name not in listed][: missing or not listed]


def _driven(urdf: Urdf) -> list[str]:
    """The joints that may have a value of their own."""
    joints = urdf.joints.values()
    return [joint.name for joint in joints if joint.type in MOVING_TYPES and joint.mimic is None]
