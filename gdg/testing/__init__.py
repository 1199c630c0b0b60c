"""Conformance checks that you run on your own hands and components.

Put two lines into your tests, and every rule that gdg relies on is checked::

    from gdg.testing import assert_component, assert_hand

    def test_my_hand():
        assert_hand("hands/acme")

    def test_my_distance():
        assert_component("distance", "my-distance", scale=2.0)

``check_hand`` and ``check_component`` give the problems as a list instead of raising;
``inspect_hand`` also gives what is merely doubtful. pytest does it without a line of code::

    pytest --gdg-hand hands/acme --gdg-component distance/my-distance
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gdg.errors import raise_if_any
from gdg.testing.findings import Finding, errors_in

__all__ = [
    "Finding", "assert_component", "assert_hand", "check_component", "check_hand", "inspect_hand",
]  # fmt: skip

#: A component that another one uses: its name, or ``{"name": ..., option: value, ...}``.
Use = str | Mapping[str, Any]

# The checks import torch and trimesh, so they are imported where they are needed.


def inspect_hand(folder: str | os.PathLike[str]) -> list[Finding]:
    """Every error and every warning on a hand folder, errors first; each names file and field.

    Beyond what ``gdg.hands.hand.load_hand`` refuses: names, limits, kinematics, drives, postures
    and self-collision in them, palm, contact regions, surface, masses, provenance.
    """
    from gdg.testing.hand import inspect

    return inspect(Path(folder)).findings


def check_hand(folder: str | os.PathLike[str]) -> list[str]:
    """Every error of a hand folder, one sentence each; empty when the hand can be used."""
    return [str(finding) for finding in errors_in(inspect_hand(folder))]


def assert_hand(folder: str | os.PathLike[str]) -> None:
    """Raises ``gdg.errors.GdgErrors`` with every error of a hand folder."""
    raise_if_any(check_hand(folder))


def check_component(
    kind: str, name: str, /, *, uses: Mapping[str, Use] | None = None, **options: Any
) -> list[str]:
    """Every breach of a kind's interface by a registered component; empty when there is none.

    Give options that make the component quick: each check runs it a few times on a cube of 40 mm
    and a two-jaw gripper.

    Args:
        kind: as in ``gdg.components.KINDS``.
        name: the component's name, or ``provider/name``.
        uses: kind -> the component that it is handed, by name or as ``{"name": …, option: …}``;
            by default those of the command line, and for a generator a stand-in that needs no
            weights.
        options: the component's options.
    """
    from gdg.testing.component import component_problems

    return component_problems(kind, name, uses or {}, options)


def assert_component(
    kind: str, name: str, /, *, uses: Mapping[str, Use] | None = None, **options: Any
) -> None:
    """Raises ``gdg.errors.GdgErrors`` with every breach that ``check_component`` finds."""
    problems = check_component(kind, name, uses=uses, **options)
    raise_if_any([f"{kind} '{name}': {text}" for text in problems])
