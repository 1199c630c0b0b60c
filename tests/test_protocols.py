"""Presets carry the figures of their sources, and mistakes in a user's own are named."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path

import pytest

from gdg.errors import GdgError, GdgErrors
from gdg.protocols import FOLDER, Protocol, load_protocol, protocol_names
from gdg.protocols.describe import markdown_table

#: Presets of our own; they deviate from nothing.
OWN = ("gdg-realistic-1", "tabletop-lift")

#: What these presets dump to goes into the names of dataset shards; see ``sections.Section``.
DUMPS = {
    "gendexgrasp-2022": "fcf5952743ba54d1b315487fc0c1feedb402b225d591abe120a1caa64b7facc3",
    "dro-2024": "56adf855b9fb2f62696a7abc4fee7623b67670d7abba49f74be0a353bf3e51e9",
}
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
    assert (protocol.shifts.count, protocol.shifts.distance_m) == (4, 0.0002)


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


@pytest.mark.parametrize("name", DUMPS)
def test_a_presets_dump_stays_as_it_was_when_the_schema_grows(name: str):
    text = json.dumps(load_protocol(name).model_dump(mode="json"), sort_keys=True)
    assert hashlib.sha256(text.encode()).hexdigest() == DUMPS[name]


@pytest.mark.parametrize("name", protocol_names())
def test_a_dump_reads_back_as_the_same_protocol(name: str):
    protocol = load_protocol(name)
    assert Protocol(**protocol.model_dump(mode="json")) == protocol


#: Per preset: seconds per push, acceleration, density or mass, friction, gains, limits in m and °.
TABLE = {
    "gendexgrasp-paper": (1.0, 0.5, 10_000, 10, (400, 400), 0.02, None),
    "dexgraspnet-2023": (100 / 60, 9.8, 500, 3, (1000, 0), None, None),
    "graspqp-2025": (0.5, 15.0, 0.2, 1.0, None, 0.03, None),
    "dexgraspbench-2025": (2.0, 10.0, 0.1, 0.6, (5, 0.2), 0.05, 15.0),
    "multigrippergrasp-2024": (2.0, 9.81, 500, 0.8, None, 0.3, None),
    "gdg-realistic-1": (0.5, 2.5, 500, 0.8, None, 0.02, 15.0),
}


@pytest.mark.parametrize("name", TABLE)
def test_further_presets_carry_the_figures_of_their_sources(name: str):
    p = load_protocol(name)
    seconds, acceleration, amount, friction, gains, moved, turned = TABLE[name]
    assert p.version == (2 if name in OWN else 1)
    assert p.pushes is not None
    assert p.pushes.steps * p.timestep_ms / 1000 == pytest.approx(seconds)
    assert (p.pushes.acceleration, p.friction) == (acceleration, friction)
    assert (p.body.density or p.body.mass_kg) == amount
    assert (p.drive and (p.drive.stiffness, p.drive.damping)) == gains
    assert p.success.max_displacement_m == moved
    limit = p.success.max_rotation_rad
    assert (limit and math.degrees(limit)) == (turned and pytest.approx(turned))


def test_what_tells_the_further_presets_apart():
    quarter = load_protocol("graspqp-2025")
    assert quarter.pushes is not None
    assert quarter.pushes.rest_steps * quarter.timestep_ms == pytest.approx(250)
    assert quarter.success.share == 0.5
    assert quarter.body.mass_kg is not None
    assert quarter.pushes.acceleration * quarter.body.mass_kg == pytest.approx(3.0)
    assert load_protocol("dexgraspbench-2025").torsional_friction == 0.02
    assert load_protocol("dexgraspnet-2023").success.contact
    gravity = load_protocol("multigrippergrasp-2024").pushes
    assert gravity is not None
    assert gravity.directions == ("-z",)


@pytest.mark.parametrize("name", ["gdg-realistic-1", "tabletop-lift"])
def test_our_own_presets_lift_by_a_hand_with_its_own_drives(name: str):
    p = load_protocol(name)
    assert p.lift is not None
    assert (p.drive, p.shared_motors, p.friction, p.body.density) == (None, True, 0.8, 500)
    assert (p.body.linear_damping, p.body.angular_damping) == (0, 0)
    assert (p.lift.height_m, p.lift.gravity) == (0.1, 9.81)
    assert p.start.max_initial_penetration_m == p.start.max_penetration_m == 0.002
    assert p.start.max_drift_m == 0.02
    assert p.success.contact
    assert p.shifts.count == 4
    assert p.needs_table == (name == "tabletop-lift")
    assert (p.pushes is None) == p.needs_table


@pytest.mark.parametrize("name", [n for n in protocol_names() if n not in OWN])
def test_every_published_preset_says_where_it_differs(name: str):
    assert load_protocol(name).deviations


def test_the_table_in_the_docs_is_that_of_the_presets():
    page = (Path(__file__).resolve().parents[1] / "docs" / "protocols.md").read_text("utf-8")
    assert markdown_table(load_protocol(name) for name in protocol_names()) in page


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


#: A change in a protocol of one's own, and what is said of it.
MISTAKES = {
    "mass and density": (
        ("density: 500.0,", "density: 500.0, mass_kg: 0.2,"),
        "body: give either density (kg/m³) or mass_kg, one of the two",
    ),
    "neither": (
        ("density: 500.0,", ""),
        "body: give either density (kg/m³) or mass_kg, one of the two",
    ),
    "no direction": (
        ("order: sequential", "directions: []"),
        "pushes.directions: must name one or more of +x, -x, +y, -y, +z, -z, each once",
    ),
    "one direction twice": (
        ("order: sequential", "directions: [+x, +x]"),
        "pushes.directions: must name one or more of",
    ),
    "nothing judged": (
        ("max_displacement_m: 0.02, measured: total, contact: true", "measured: total"),
        "success: give max_displacement_m, max_rotation_rad or contact: true",
    ),
    "a share in total": (
        ("contact: true", "share: 0.5"),
        "success: a share of the pushes can only pass if measured is per-push",
    ),
    "no load": (
        ("pushes: {acceleration: 0.5, steps: 100, order: sequential}", ""),
        "own.yaml: give pushes, lift or both: without a load every grasp holds",
    ),
    "a share of no pushes": (
        (
            "pushes: {acceleration: 0.5, steps: 100, order: sequential}\n"
            "success: {max_displacement_m: 0.02, measured: total, contact: true}",
            "lift: {height_m: 0.1, steps: 100}\nsuccess: {contact: true, share: 0.5}",
        ),
        "own.yaml: success.share is one of pushes, and there are none; leave it out",
    ),
    "total of pushes that start anew": (
        ("order: sequential", "order: reset"),
        "own.yaml: success.measured: total needs pushes one after another",
    ),
    "total of a lift": (
        (
            "pushes: {acceleration: 0.5, steps: 100, order: sequential}",
            "lift: {height_m: 0.1, steps: 100}",
        ),
        "own.yaml: success.measured: total needs pushes one after another",
    ),
    "gravity along a table": (
        (
            "friction: 3.0",
            "friction: 3.0\nlift: {height_m: 0.1, steps: 100, support: table, direction: +x}",
        ),
        "lift: on a table gravity acts against its normal; leave direction out",
    ),
    "pushes on a table": (
        ("friction: 3.0", "friction: 3.0\nlift: {height_m: 0.1, steps: 100, support: table}"),
        "own.yaml: an object on a table can't be pushed six ways; leave pushes out",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_of_meaning_are_said_in_one_sentence(tmp_path: Path, mistake: str):
    change, sentence = MISTAKES[mistake]
    with pytest.raises(GdgError) as caught:
        load_protocol(own(tmp_path, change))
    (message,) = str(caught.value).splitlines()
    assert sentence in message
    assert "own.yaml: " in message


def test_directions_come_in_the_order_of_the_six(tmp_path: Path):
    path = own(tmp_path, ("order: sequential", "order: sequential, directions: ['-z', '+x']"))
    pushes = load_protocol(path).pushes
    assert pushes is not None
    assert pushes.directions == ("+x", "-z")
