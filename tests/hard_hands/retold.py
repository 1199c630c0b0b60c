"""The same hand, told differently."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh

from gdg.hands.urdf import Joint, Link, Mimic, Shape
from hard_hands.hand import HardHand


def scramble(hand: HardHand, seed: int) -> HardHand:
    """The same hand with other link frames and joint directions; the truth is changed along.

    Every link's frame (the root's too) is turned at random and its origin moved as far as a URDF
    allows: along the axis of the joint that carries it. Half of the joints are turned round: axis,
    limits, couplings and closing sign negated.
    """
    rng = np.random.default_rng(seed)
    carriers = {joint.child: joint for joint in hand.joints}
    Ts_old_new = {name: _random_frame(rng, carriers.get(name)) for name in hand.links}
    signs = {joint.name: int(rng.choice((-1, 1))) for joint in hand.joints}
    T_new_root = np.linalg.inv(Ts_old_new[hand.root])
    return replace(
        hand,
        links={n: _moved(link, np.linalg.inv(Ts_old_new[n])) for n, link in hand.links.items()},
        joints=tuple(_turned(joint, Ts_old_new, signs) for joint in hand.joints),
        palm_normal=T_new_root[:3, :3] @ hand.palm_normal,
        palm_center=T_new_root[:3, :3] @ hand.palm_center + T_new_root[:3, 3],
        closing={name: signs[name] * sign for name, sign in hand.closing.items()},
        pads={name: Ts_old_new[name][:3, :3].T @ pad for name, pad in hand.pads.items()},
    )


def _random_frame(rng: np.random.Generator, carrier: Joint | None) -> np.ndarray:
    pose = trimesh.transformations.random_rotation_matrix(rng.random(3))
    if carrier is None or carrier.type in ("fixed", "prismatic"):
        pose[:3, 3] = rng.uniform(-0.03, 0.03, 3)
    else:
        pose[:3, 3] = rng.uniform(-0.03, 0.03) * carrier.axis
    return pose


def _moved(link: Link, T_new_old: np.ndarray) -> Link:
    def moved(shapes: Sequence[Shape]) -> tuple[Shape, ...]:
        return tuple(replace(s, T_link_shape=T_new_old @ s.T_link_shape) for s in shapes)

    inertial = link.inertial
    if inertial is not None:
        inertial = replace(inertial, T_link_center=T_new_old @ inertial.T_link_center)
    return Link(link.name, moved(link.collisions), moved(link.visuals), inertial)


def _turned(joint: Joint, Ts_old_new: dict[str, np.ndarray], signs: dict[str, int]) -> Joint:
    T_old_new, sign, mimic = Ts_old_new[joint.child], signs[joint.name], joint.mimic
    if mimic is not None:
        multiplier = float(sign * signs[mimic.joint]) * mimic.multiplier
        mimic = Mimic(mimic.joint, multiplier, sign * mimic.offset)
    lower, upper = (joint.lower, joint.upper) if sign > 0 else (-joint.upper, -joint.lower)
    return replace(
        joint,
        T_parent_child=np.linalg.inv(Ts_old_new[joint.parent]) @ joint.T_parent_child @ T_old_new,
        axis=sign * T_old_new[:3, :3].T @ joint.axis,
        lower=lower,
        upper=upper,
        mimic=mimic,
    )


def rename(hand: HardHand, seed: int) -> HardHand:
    """The same hand, links and joints named ``link_7`` and ``joint_3`` in random order."""
    rng = np.random.default_rng(seed)
    link = _numbered("link", list(hand.links), rng)
    joint = _numbered("joint", [j.name for j in hand.joints], rng)
    joints = [_renamed(j, link, joint) for j in hand.joints]
    return replace(
        hand,
        links={link[name]: replace(value, name=link[name]) for name, value in hand.links.items()},
        joints=tuple(joints),
        palm_links=tuple(link[name] for name in hand.palm_links),
        closing={joint[name]: sign for name, sign in hand.closing.items()},
        distal_links=tuple(link[name] for name in hand.distal_links),
        pads={link[name]: pad for name, pad in hand.pads.items()},
    )


def _numbered(word: str, names: list[str], rng: np.random.Generator) -> dict[str, str]:
    return {name: f"{word}_{n}" for name, n in zip(names, rng.permutation(len(names)), strict=True)}


def _renamed(value: Joint, link: dict[str, str], joint: dict[str, str]) -> Joint:
    mimic = value.mimic
    if mimic is not None:
        mimic = replace(mimic, joint=joint[mimic.joint])
    return replace(
        value,
        name=joint[value.name],
        parent=link[value.parent],
        child=link[value.child],
        mimic=mimic,
    )
