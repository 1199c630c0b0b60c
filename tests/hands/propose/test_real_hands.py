"""What is proposed for the makers' bare descriptions agrees with what is known of those hands.

The makers' files aren't ours to ship: skipped without the asset folder (``GDG_TEST_ASSETS``), whose
``hands.json`` and ``README.md`` tell palms, fingers and closing directions.
"""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from proposals import closing_signs, degrees_between, palm_normal_in_root, propose_hand
from real_hands import ASSETS, HANDS, have_assets

from gdg.hands.hand import Hand
from gdg.testing.findings import errors_in
from gdg.testing.hand import inspect

pytestmark = pytest.mark.skipif(
    not have_assets(), reason="no asset folder with the makers' hands (GDG_TEST_ASSETS)"
)
#: Joints that close a hand, and the sign in which they do; spreads, wrists and joints that only
#: place a thumb or a metacarpal are left out.
CLOSING = {
    "ezgripper": (r".*_knuckle_.*", 1),
    "barrett": (r"bh_j.[23]_joint", 1),
    "robotiq_3finger": (r".*_joint_[234]", -1),
    "allegro": (r"joint_(?!(0|4|8|12)\.0).*", 1),
    "shadowhand": (r"(FF|MF|RF|LF)J[123]|THJ[12]", 1),
}
#: (check, hand) -> why it fails.
KNOWN_FAILURES: dict[tuple[str, str], str] = {
    ("test_every_joint_closes_the_documented_way", "allegro"): (
        "the thumb's sideways joint_13.0 is taken to have no part in closing"
    ),
}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Every check on every hand."""
    if "hand" not in metafunc.fixturenames:
        return
    parameters = []
    for name in HANDS:
        known = KNOWN_FAILURES.get((metafunc.function.__name__, name))
        marks = [] if known is None else [pytest.mark.xfail(reason=known, strict=False)]
        parameters.append(pytest.param(name, marks=marks))
    metafunc.parametrize("hand", parameters, indirect=True, scope="session")


@pytest.fixture(scope="session")
def hand(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Hand:
    """A hand proposed from its URDF and its meshes alone."""
    name, folder = request.param, tmp_path_factory.mktemp("real")
    shutil.copytree(ASSETS / "hands" / name / "meshes", folder / "source" / "meshes")
    source = shutil.copy(ASSETS / "hands" / name / f"{name}.urdf", folder / "source")
    return propose_hand(Path(source), folder / name).hand


def known(hand: Hand) -> dict[str, Any]:
    """What the asset folder says about a hand."""
    return json.loads((ASSETS / "hands" / "hands.json").read_text())[hand.name]


def test_the_palm_is_the_documented_link_and_faces_the_documented_way(hand: Hand):
    assert hand.spec.palm.link == known(hand)["palm_link"]
    assert degrees_between(palm_normal_in_root(hand), np.array(known(hand)["palm_direction"])) < 15


def test_every_joint_closes_the_documented_way(hand: Hand):
    pattern, sign = CLOSING[hand.name]
    signs = closing_signs(hand)
    closing = {name: sign for name in signs if re.fullmatch(pattern, name)}
    assert closing
    assert {name: signs[name] for name in closing} == closing


def test_every_finger_has_regions_on_its_last_link(hand: Hand):
    for links in known(hand)["fingers"].values():
        assert hand.spec.contact_regions.get(links[-1]), links[-1]


def test_the_folder_passes_the_conformance_kit(hand: Hand):
    assert errors_in(inspect(hand.folder).findings) == []
