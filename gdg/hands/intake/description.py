"""What the readers of foreign formats hand on: a tree with its meshes, not yet written."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import trimesh

from gdg.hands.spec import Drive
from gdg.hands.urdf import Urdf


@dataclass
class Mesh:
    """A mesh of the description.

    Attributes:
        mesh: its surface, in the file's own numbers.
        file: the file to copy; None: ``mesh`` is written as STL.
    """

    mesh: trimesh.Trimesh
    file: Path | None = None


@dataclass
class Description:
    """A hand as described elsewhere; the steps of the intake mend it in place.

    Attributes:
        urdf: the tree; the mesh names of its shapes are keys of ``meshes``.
        source: format, file name and robot name, for provenance.
        meshes: name inside the new folder (``meshes/…``) -> mesh.
        actuated: joints that the description says are driven; None where it doesn't say.
        drives: gains and force limits that it states.
        excluded: pairs of links that it excludes from contact.
        repairs: one sentence per repair made so far.
    """

    urdf: Urdf
    source: str
    meshes: dict[str, Mesh] = field(default_factory=dict)
    actuated: tuple[str, ...] | None = None
    drives: dict[str, Drive] = field(default_factory=dict)
    excluded: tuple[tuple[str, str], ...] = ()
    repairs: list[str] = field(default_factory=list)


def named(links: list[str], what: str = "link") -> str:
    """``Link 'a'``, ``Links 'a', 'b'``, or ``12 links ('a', 'b', 'c', …)``: a sentence's start."""
    quoted = [f"'{name}'" for name in links]
    if len(quoted) == 1:
        return f"{what.capitalize()} {quoted[0]}"
    if len(quoted) <= 4:
        return f"{what.capitalize()}s {', '.join(quoted)}"
    return f"{len(quoted)} {what}s ({', '.join(quoted[:3])}, …)"
