"""Differentiable force closure (Liu et al. 2021; GenDexGrasp, Section III-A)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def net_wrench(
    points: Float[Tensor, "batch contact 3"],
    normals: Float[Tensor, "batch contact 3"],
    length: float | Float[Tensor, "#batch 1"] = 1.0,
) -> Float[Tensor, "batch 6"]:
    """G c: the wrench of unit forces along the normals, per number of contacts.

    G = [I … I; ⌊x₁⌋× … ⌊xₙ⌋×] is the grasp map and c the stacked normals. Dividing by n keeps the
    value comparable between numbers of contacts; the source does not.

    Args:
        points: contact points relative to the object's centre of mass, metres.
        normals: unit normals of the object's surface at the points.
        length: torques are divided by this, metres, which makes them comparable to forces; 1
            gives the source's raw sum. The object's radius is a natural choice; one per batch
            element where they hold several objects.
    """
    force = normals.mean(1)
    torque = torch.linalg.cross(points, normals).mean(1) / length
    return torch.cat((force, torque), dim=-1)


def force_closure_error(
    points: Float[Tensor, "batch contact 3"],
    normals: Float[Tensor, "batch contact 3"],
    length: float | Float[Tensor, "#batch 1"] = 1.0,
) -> Float[Tensor, "batch"]:
    """‖G c‖: zero when equal frictionless forces at the contacts balance; see ``net_wrench``.

    The source calls that differentiable force closure. It is not the classical one: two opposite
    contacts have 0, yet resist no torque about their line (their ε, ``gdg.quality.wrench_space``,
    is 0, too).
    """
    return (net_wrench(points, normals, length).square().sum(-1) + 1e-12).sqrt()
