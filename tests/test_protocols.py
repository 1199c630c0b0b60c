"""Presets carry the figures of their sources, and mistakes in a user's own are named."""

from __future__ import annotations

from pathlib import Path

import pytest

from gdg.errors import GdgError, GdgErrors
from gdg.protocols import FOLDER, load_protocol, protocol_names

#: Acceleration m/s², steps and milliseconds per push, density, dampings, friction, gains, metres.
PUBLISHED = {
    "gendexgrasp-2022": (0.5, 50, 1000 / 60, 10_000, 10, 100, 10, 400, 400, 0.02, "per-push"),
    "dro-2024": (0.5, 100, 10.0, 500, 0, 0, 3, 1000, 200, 0.02, "total"),
}


@pytest.mark.parametrize("name", protocol_names())
def test_presets_are_valid_and_named_after_their_file(name: str):
    protocol = load_protocol(name)
    assert protocol.name == name
    assert protocol.label == f"{name}-v{protocol.version}"
    assert protocol.source


@pytest.mark.parametrize("name", PUBLISHED)
def test_presets_carry_the_published_figures(name: str):
    p = load_protocol(name)
    assert p.drive is not None
    figures = (
        p.pushes.acceleration, p.pushes.steps, p.timestep_ms, p.body.density,
        p.body.linear_damping, p.body.angular_damping, p.friction, p.drive.stiffness,
        p.drive.damping, p.success.max_displacement_m, p.success.measured,
    )  # fmt: skip
    assert figures == PUBLISHED[name]
    assert p.pushes.order == "sequential"


def test_the_release_settles_for_200_steps():
    assert load_protocol("gendexgrasp-2022").start.settle_steps == 200


@pytest.mark.parametrize("name", PUBLISHED)
def test_what_a_preset_adds_to_its_source_is_said(name: str):
    protocol = load_protocol(name)
    assert protocol.success.contact
    assert protocol.start.max_penetration_m is not None
    assert protocol.start.max_drift_m is not None
    assert protocol.deviations


def test_an_unknown_name_gets_a_suggestion():
    with pytest.raises(GdgError, match=r"Unknown protocol 'dro2024'\. Did you mean 'dro-2024'\?"):
        load_protocol("dro2024")


def test_a_missing_file_is_an_unknown_protocol():
    with pytest.raises(GdgError, match=r"Unknown protocol './lost\.yaml'"):
        load_protocol("./lost.yaml")


def own(folder: Path, *changes: tuple[str, str]) -> str:
    text = (FOLDER / "dro-2024.yaml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "own.yaml").write_text(text, encoding="utf-8")
    return str(folder / "own.yaml")


def test_a_protocol_of_ones_own_is_read_from_a_file(tmp_path: Path):
    assert load_protocol(own(tmp_path, ("friction: 3.0", "friction: 0.8"))).friction == 0.8


def test_every_mistake_in_a_protocol_is_named_at_once(tmp_path: Path):
    changes = ("friction: 3.0", "frictoin: 3.0"), ("density: 500.0", "density: .nan")
    with pytest.raises(GdgErrors) as caught:
        load_protocol(own(tmp_path, *changes, ("steps: 100, order", "steps: 0, ordr")))
    text = "\n".join(caught.value.messages)
    assert "frictoin: there is no such option. Did you mean 'friction'?" in text
    assert "friction: must be given" in text
    assert "body.density: Input should be a finite number" in text
    assert "pushes.steps: Input should be greater than 0" in text
    assert "pushes.ordr: there is no such option. Did you mean 'order'?" in text
