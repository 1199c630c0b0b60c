"""Runs checks one by one, so that one failure hides no other; comparisons that they share."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from gdg.errors import GdgError

Subject = TypeVar("Subject")
Found = TypeVar("Found")
#: Gives one sentence or finding per problem of a subject.
Check = Callable[[Subject], Iterable[Found]]


def run_checks(checks: Iterable[Check[Subject, str]], subject: Subject) -> list[str]:
    """All problems that the checks find, each after the name of its check."""
    found = [text for check in checks for text in run_check(check, subject)]
    return list(dict.fromkeys(found))  # the same mistake may stop several checks


def run_check(check: Check[Subject, str], subject: Subject) -> list[str]:
    """The problems that one check finds, each after its name."""

    def named(subject: Subject) -> Iterable[str]:
        return (f"{check_name(check)}: {text}" for text in check(subject))

    named.__name__ = check_name(check)
    return attempt(named, subject, str)


def attempt(
    check: Check[Subject, Found], subject: Subject, raised: Callable[[str], Found]
) -> list[Found]:
    """What a check finds; if it raises, one finding that ``raised`` makes of the reason."""
    try:
        return list(check(subject))
    except GdgError as error:
        return [raised(str(error))]
    except Exception as error:  # what is tested is foreign code and may raise anything
        text = " ".join(str(error).split())[:500]
        return [raised(f"{check_name(check)}: raised {type(error).__name__}: {text}")]


def check_name(check: Check[Subject, Found]) -> str:
    """A check's name as words."""
    return getattr(check, "__name__", "check").replace("_", " ")


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


def moved_global_state(run: Callable[[], object]) -> Iterator[str]:
    """Which libraries' global random streams a call draws from or seeds, one sentence each.

    Python's own stream is left out: type checkers draw from it.
    """
    torch.rand(1)  # so that a seed that was set before shows when it is set again
    np.random.random()  # noqa: NPY002
    before = _global_states()
    run()
    for name, state in _global_states().items():
        if state != before[name]:
            yield f"the global random state of {name} changed: use the generator passed in alone."


def _global_states() -> dict[str, bytes]:
    return {
        "torch": torch.get_rng_state().numpy().tobytes(),
        "numpy": pickle.dumps(np.random.get_state()),  # noqa: NPY002
    }


def seeded(seed: int = 0) -> torch.Generator:
    """Randomness from a fixed seed."""
    return torch.Generator().manual_seed(seed)
