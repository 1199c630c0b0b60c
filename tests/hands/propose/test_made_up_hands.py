"""What is proposed for made-up hands agrees with the truth about them.

Each hand is proposed once as generated; three are proposed in scrambled frames, too, and all of
them with ``pytest --every-hand``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest
from hard_hands import HARD_HANDS, HardHand, rename, scramble, write_hard_hand
from proposals import (
    closing_signs,
    degrees_between,
    palm_normal_in_root,
    propose_hand,
    region_normals,
)

from gdg.errors import GdgError
from gdg.hands.hand import Hand
from gdg.testing.findings import errors_in
from gdg.testing.hand import inspect

#: Scrambled hands of every run: hand, seed.
SCRAMBLED = (("jaws_mimic", 0), ("three_opposed", 1), ("right_hand", 2))
#: Seeds per hand with ``--every-hand``.
SEEDS = range(3)
#: (check, hand as in the test's name) -> why it fails.
KNOWN_FAILURES: dict[tuple[str, str], str] = {}


@dataclass(frozen=True)
class Made:
    """A made-up hand and what became of it."""

    truth: HardHand
    hand: Hand


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Every check on every hand."""
    if "made" not in metafunc.fixturenames:
        return
    cases: list[tuple[str, int | None]] = [(name, None) for name in HARD_HANDS]
    if metafunc.config.getoption("every_hand"):
        cases += [(name, seed) for name in HARD_HANDS for seed in SEEDS]
    else:
        cases += SCRAMBLED
    check = metafunc.function.__name__
    parameters = []
    for name, seed in cases:
        label = name if seed is None else f"{name}-scrambled{seed}"
        known = KNOWN_FAILURES.get((check, label))
        marks = [] if known is None else [pytest.mark.xfail(reason=known, strict=False)]
        parameters.append(pytest.param((name, seed), id=label, marks=marks))
    metafunc.parametrize("made", parameters, indirect=True, scope="session")


@pytest.fixture(scope="session")
def proposed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, int | None], Made]:
    """Proposes a hand once; a refusal is told to every test that asks for it."""
    found: dict[tuple[str, int | None], Made | GdgError] = {}

    def get(name: str, seed: int | None) -> Made:
        if (name, seed) not in found:
            truth = HARD_HANDS[name]()
            if seed is not None:
                truth = rename(scramble(truth, seed), seed)
            folder = tmp_path_factory.mktemp("made")
            try:
                source = write_hard_hand(truth, folder / "source")
                found[name, seed] = Made(truth, propose_hand(source, folder / name).hand)
            except GdgError as error:
                found[name, seed] = error
        made = found[name, seed]
        if isinstance(made, GdgError):
            pytest.fail(f"refused: {made}")
        return made

    return get


@pytest.fixture(scope="session")
def made(request: pytest.FixtureRequest, proposed: Callable[[str, int | None], Made]) -> Made:
    """One hand, proposed."""
    return proposed(*request.param)


def test_the_palm_is_the_link_that_carries_it(made: Made):
    assert made.hand.spec.palm.link in made.truth.palm_links


def test_the_palm_faces_what_the_hand_grasps(made: Made):
    assert degrees_between(palm_normal_in_root(made.hand), made.truth.palm_normal) < 15


def test_every_joint_closes_the_right_way(made: Made):
    signs = closing_signs(made.hand)
    assert {joint: signs[joint] for joint in made.truth.closing} == made.truth.closing


def test_every_fingertip_has_regions_on_its_inner_side(made: Made):
    for link in made.truth.distal_links:
        normals = region_normals(made.hand, link)
        assert normals, link
        for normal in normals:
            assert degrees_between(normal, made.truth.pads[link]) < 60, link


def test_the_folder_passes_the_conformance_kit(made: Made):
    assert errors_in(inspect(made.hand.folder).findings) == []
