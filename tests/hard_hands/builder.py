"""Collects the links and joints of one hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import trimesh

from gdg.hands.urdf import Joint, Link, Mimic, Shape
from hard_hands.hand import HardHand
from hard_hands.parts import at

#: Scale of meshes that are written in millimetres.
MILLIMETRE = 0.001


@dataclass
class Builder:
    """Collects the links and joints of one hand."""

    name: str
    effort: float = 0.0
    links: dict[str, Link] = field(default_factory=dict)
    joints: list[Joint] = field(default_factory=list)
    meshes: dict[str, trimesh.Trimesh] = field(default_factory=dict)
    closing: dict[str, int] = field(default_factory=dict)
    distal: list[str] = field(default_factory=list)
    pads: dict[str, np.ndarray] = field(default_factory=dict)

    def link(self, name: str, *shapes: Shape, visuals: Sequence[Shape] | None = None) -> str:
        """Adds a link; what is seen is what collides unless ``visuals`` says otherwise."""
        seen = shapes if visuals is None else tuple(visuals)
        self.links[name] = Link(name, shapes, seen, None)
        return name

    def fixed(self, parent: str, child: str, pose: np.ndarray | None = None) -> None:
        """Fixes ``child`` to ``parent``."""
        limits = (math.nan, math.nan)
        self.joint(f"{child}_fixed", parent, child, pose, (1, 0, 0), limits, kind="fixed")

    def joint(
        self,
        name: str,
        parent: str,
        child: str,
        pose: np.ndarray | None,
        axis: Sequence[float],
        limits: tuple[float, float],
        *,
        kind: str = "revolute",
        closing: int = 0,
        mimic: Mimic | None = None,
    ) -> None:
        """Adds a joint; ``closing`` 0 leaves it out of the truth."""
        lower, upper = (-math.pi, math.pi) if kind == "continuous" else limits
        joint = Joint(
            name=name,
            type=kind,
            parent=parent,
            child=child,
            T_parent_child=at() if pose is None else pose,
            axis=np.array(axis, float) / np.linalg.norm(axis),
            lower=lower,
            upper=upper,
            effort=self.effort,
            velocity=0.0,
            mimic=mimic,
        )
        self.joints.append(joint)
        if closing:
            self.closing[name] = closing

    def millimetre_mesh(self, file: str, mesh: trimesh.Trimesh) -> Shape:
        """Registers a mesh given in metres to be written in millimetres."""
        mesh = mesh.copy()
        mesh.apply_scale(1 / MILLIMETRE)
        self.meshes[file] = mesh
        return Shape("mesh", (MILLIMETRE,) * 3, at(), file)

    def done(
        self, palm_links: Sequence[str], normal: Sequence[float], center: Sequence[float]
    ) -> HardHand:
        """The finished hand."""
        return HardHand(
            self.name,
            self.links,
            tuple(self.joints),
            self.meshes,
            tuple(palm_links),
            np.array(normal, float),
            np.array(center, float),
            self.closing,
            tuple(self.distal),
            self.pads,
        )
