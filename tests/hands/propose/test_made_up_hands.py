"""What is proposed for made-up hands agrees with the truth about them.

One proposal takes seconds, so every run tries some hands, one of them in scrambled frames with
names that say nothing; ``pytest --every-hand`` tries all, each in scrambled frames, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from hard_hands import HARD_HANDS, HardHand, rename, scramble, write_hard_hand
from proposals import (
    closing_motions,
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

#: Hands of every run with a seed, or as generated: what differs most.
USUAL: tuple[tuple[str, int | None], ...] = (
    ("jaws_mimic", None), ("jaw_and_fixed_jaw", None), ("four_bar", None),
    ("three_opposed", None), ("left_hand", None), ("split_palm", None), ("right_hand", 2),
)  # fmt: skip
#: Each hand's with ``--every-hand``; None is the hand as generated.
SEEDS = (None, 0, 1, 2)
#: (check, hand as in the test's name) -> why it fails.
KNOWN_FAILURES: dict[tuple[str, str], str] = {}
#: What closing moves a fingertip by at least, metres.
LEAST_MOTION_M = 0.015


@dataclass(frozen=True)
class Made:
    """A made-up hand and what became of it."""

    truth: HardHand
    hand: Hand

    @property
    def fixed_tips(self) -> set[str]:
        """Fingertips that belong to the palm's body, as a fixed jaw does."""
        body = dict(zip(self.hand.link_names, self.hand.bodies))
        palm = body[self.truth.palm_links[0]]
        return {link for link in self.truth.distal_links if body[link] == palm}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Every check on every hand."""
    if "made" not in metafunc.fixturenames:
        return
    every = tuple((name, seed) for name in HARD_HANDS for seed in SEEDS)
    cases = every if metafunc.config.getoption("every_hand") else USUAL
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
                found[name, seed] = Made(truth, propose_hand(source, folder / "made" / name).hand)
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


def test_closing_moves_every_fingertip(made: Made):
    motions = closing_motions(made.hand, made.truth.distal_links)
    # a fixed jaw is a fingertip, too
    moving = {link: motion for link, motion in motions.items() if link not in made.fixed_tips}
    assert moving
    assert min(moving.values()) > LEAST_MOTION_M, moving


def test_every_fingertip_has_regions_on_its_inner_side(made: Made):
    for link in made.truth.distal_links:
        normals = region_normals(made.hand, link)
        assert normals, link
        for normal in normals:
            assert degrees_between(normal, made.truth.pads[link]) < 60, link


def test_the_folder_passes_the_conformance_kit(made: Made):
    assert errors_in(inspect(made.hand.folder).findings) == []


def test_the_same_seed_gives_the_same_folder(
    proposed: Callable[[str, int | None], Made], tmp_path: Path
):
    first = proposed("jaws_mimic", None)
    torch.manual_seed(99)
    before = torch.get_rng_state()
    source = write_hard_hand(first.truth, tmp_path / "source")
    again = propose_hand(source, tmp_path / "jaws_mimic").hand
    for file in ("hand.yaml", "jaws_mimic.urdf", "README.md"):
        assert (again.folder / file).read_bytes() == (first.hand.folder / file).read_bytes()
    assert torch.equal(torch.get_rng_state(), before), "the global random stream was used"
