"""Runs checks one by one, so that one failure hides no other; comparisons that they share."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import torch
from torch import Tensor

from gdg.errors import GdgError

Subject = TypeVar("Subject")
#: Gives one sentence per problem of a subject.
Check = Callable[[Subject], Iterable[str]]


def run_checks(checks: Iterable[Check[Subject]], subject: Subject) -> list[str]:
    """All problems that the checks find, each after the name of its check.

    A check that raises is a problem by itself, and the others still run.
    """
    problems = []
    for check in checks:
        name = getattr(check, "__name__", "check").replace("_", " ")
        try:
            problems += [f"{name}: {text}" for text in check(subject)]
        except GdgError as error:  # the same mistake may stop several checks
            problems.append(str(error))
        except Exception as error:  # what is tested is foreign code and may raise anything
            text = " ".join(str(error).split())[:500]
            problems.append(f"{name}: raised {type(error).__name__}: {text}")
    return list(dict.fromkeys(problems))


def differ(a: Tensor, b: Tensor, tolerance: float) -> bool:
    """Whether shapes or values differ by more than a tolerance; NaN differs from everything."""
    return a.shape != b.shape or not bool(((a - b).abs() <= tolerance).all())


def not_rigid(poses: Tensor) -> Tensor:
    """Which of the (…, 4, 4) matrices are no rigid poses, to 1e-4."""
    rotation = poses[..., :3, :3]
    off = (rotation @ rotation.mT - torch.eye(3, device=poses.device)).abs().amax((-1, -2))
    row = (poses[..., 3, :] - torch.eye(4, device=poses.device)[3]).abs().amax(-1)
    fine = (off < 1e-4) & (row < 1e-6) & (torch.linalg.det(rotation) > 0)
    return ~(fine & poses.isfinite().all(-1).all(-1))


def seeded(seed: int = 0) -> torch.Generator:
    """Randomness from a fixed seed."""
    return torch.Generator().manual_seed(seed)
