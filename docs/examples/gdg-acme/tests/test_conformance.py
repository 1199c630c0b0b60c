"""The hand and the components keep every rule that gdg relies on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gdg_acme
import pytest

from gdg.testing import assert_component, assert_hand

HANDS = Path(gdg_acme.__file__).parent / "hands"


@pytest.mark.parametrize("folder", sorted(HANDS.iterdir()), ids=lambda folder: folder.name)
def test_hand(folder: Path):
    assert_hand(folder)


@pytest.mark.parametrize("options", [{}, {"gamma": 0}, {"knee": 0.003, "reach": 0.02, "gamma": 2}])
def test_distance(options: dict[str, Any]):
    assert_component("distance", "huber", **options)


@pytest.mark.parametrize("start", ["sphere", "surface"])
@pytest.mark.parametrize("distance", ["aligned", "huber"])
def test_fitter(start: str, distance: str):
    quick = {"population": 6, "generations": 5, "start": start}
    assert_component("fitter", "evolution", uses={"distance": distance}, **quick)
