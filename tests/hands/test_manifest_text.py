"""A manifest written for people is read back as the same values, whatever the names are."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from gdg.hands.decisions import Decision
from gdg.hands.manifest_text import manifest_text
from gdg.hands.spec import MANIFEST, Drive, Drives, HandSpec, Palm, Provenance, read_spec
from gdg.yaml_files import parse_yaml

#: Names that YAML would take for something else, or that end a line, a list or a comment.
NASTY = (
    "null", "~", "true", "no", "12", "1e5", ".nan", "0x1f", "2024-10-18", "12:30", "=", "<<",
    "a: b", "a:b", ":a", "a,b", "[a", "a]", "{a", "a}", "[]", "{}", "- a", "-", "? a", "?a", "a?",
    "#a", "a #b", "&a", "*a", "!a", "|", ">", "%a", "@a", "`a", "'a'", '"a"', "a'b", 'a"b', "\\",
    "a\\nb", "a  b", " a", "a ", "ä ö", "指", "🖐", "🖐 " * 40, "word " * 60 + "end", "x" * 900,
    "a'b, \"c\"", "---", "...", "--- a",
)  # fmt: skip
#: Like the names that a URDF may hold.
NAMES = st.text(st.characters(exclude_categories=["C", "Zl", "Zp"]), min_size=1, max_size=60)
NAMES = NAMES.filter(lambda name: name.isprintable() and bool(name.strip()))
#: Free text of a manifest: of the control characters only the line break and the tab.
PLAIN = st.characters(exclude_categories=["Cs", "Cc"], include_characters="\n\t")
PLAIN_TEXTS = st.text(PLAIN, max_size=200)
#: What a decision says may hold anything but halves of characters.
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=200)
#: Values that survive being written with six digits.
VALUES = st.integers(-99_999, 99_999).map(lambda value: value / 10_000)
REGIONS = st.integers(1, 500).map(
    lambda n: ((0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.01, n / 10_000, 0.0), (0.0, n / 10_000, -0.01))
)
DRIVES = st.builds(
    Drive,
    stiffness=st.integers(1, 9999).map(float),
    damping=VALUES.map(abs),
    force_limit=st.integers(1, 9999).map(lambda value: value / 100),
)


def spec_of(
    links: list[str], joints: list[str], numbers: list[float], drives: list[Drive], **more: object
) -> HandSpec:
    """A manifest that mentions every link and every joint in every place."""
    values: dict[str, object] = {
        "name": "acme",
        "urdf": "acme.urdf",
        "root_link": links[0],
        "palm": Palm(link=links[-1], normal=(0.6, 0.0, -0.8), center=(0.001, -0.02, numbers[0])),
        "joints": tuple(joints),
        "open": dict(zip(joints, numbers)),
        "closed": dict(zip(joints, reversed(numbers))),
        "contact_regions": {},
        "allowed_self_contacts": [(a, b) for a, b in zip(links, reversed(links))],
        "drives": Drives(default=drives[0], joints=dict(zip(joints, drives[1:]))),
        "provenance": Provenance(source="a test", licence="none"),
    }
    return HandSpec.model_validate({**values, **more})


def read_back(spec: HandSpec, decisions: list[Decision], folder: Path) -> HandSpec:
    text = manifest_text(spec, decisions)
    # written as bytes: no line end may change
    (folder / MANIFEST).write_bytes(text.encode())
    return read_spec(folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("manifest")


@given(
    links=st.lists(NAMES, min_size=1, max_size=4, unique=True),
    joints=st.lists(NAMES, min_size=1, max_size=4, unique=True),
    numbers=st.lists(VALUES, min_size=4, max_size=4),
    drives=st.lists(DRIVES, min_size=5, max_size=5),
    regions=st.lists(REGIONS, min_size=1, max_size=3),
)
def test_any_names_come_back_as_they_were(
    folder: Path,
    links: list[str],
    joints: list[str],
    numbers: list[float],
    drives: list[Drive],
    regions: list[object],
):
    spec = spec_of(links, joints, numbers, drives, contact_regions=dict.fromkeys(links, regions))
    assert read_back(spec, [], folder) == spec


@pytest.mark.parametrize("name", NASTY)
def test_nasty_names_come_back_as_they_were(name: str, folder: Path):
    region = ((0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.01, 0.01, 0.0), (0.0, 0.01, 0.0))
    spec = spec_of([name, "b"], [name, "c"], [0.1, 0.2], [Drive(), Drive(damping=3.0)])
    spec = spec.model_copy(update={"contact_regions": {name: [region]}})
    told = [Decision(f"joint {name}", name, 0.5, name)]
    assert read_back(spec, told, folder) == spec


@given(title=PLAIN_TEXTS, source=PLAIN_TEXTS, licence=PLAIN_TEXTS)
@example(title="a\nname: b", source="x\u2028licence: mine", licence="\u2029#\n\t- a")
def test_free_text_comes_back_on_one_line(folder: Path, title: str, source: str, licence: str):
    spec = spec_of(
        ["palm"], ["joint"], [0.0], [Drive()],
        title=title, provenance=Provenance(source=source, licence=licence),
    )  # fmt: skip
    read = read_back(spec, [], folder)
    for given_text, found in (
        (title, read.title), (source, read.provenance.source),
        (licence, read.provenance.licence),
    ):  # fmt: skip
        assert found.isprintable()
        printable = "".join(c if c.isprintable() else " " for c in given_text)
        assert found.split() == printable.split()
    plain = {"title": "", "provenance": Provenance(source="", licence="")}
    assert read.model_copy(update=plain) == spec.model_copy(update=plain)


SUBJECTS = (
    "palm.link", "palm.normal", "palm.center", "joint a", "joint b", "closed", "contact_regions",
    "allowed_self_contacts", "drives", "nothing",
)  # fmt: skip


@given(
    decisions=st.lists(
        st.builds(Decision, st.sampled_from(SUBJECTS), TEXTS, st.floats(0, 1), TEXTS), max_size=9
    )
)
@example(decisions=[Decision(s, "\nname: evil\n", 1.0, "\r\nname: evil\n") for s in SUBJECTS])
@example(decisions=[Decision(s, "\u2028a: b", 0.0, "\x85a: b\u2029- c") for s in SUBJECTS])
def test_decisions_never_break_out_of_their_comments(folder: Path, decisions: list[Decision]):
    spec = spec_of(["palm", "tip"], ["a", "b"], [0.5, -0.25], [Drive(), Drive()])
    assert read_back(spec, decisions, folder) == spec
    text = manifest_text(spec, decisions)
    assert yaml.safe_load(text) == yaml.safe_load(manifest_text(spec))
    values = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    plain = manifest_text(spec).splitlines()
    assert values == [line for line in plain if not line.lstrip().startswith("#")]


def test_decisions_stand_at_what_they_are_about():
    spec = spec_of(["palm", "tip"], ["a", "b"], [0.5, -0.25], [Drive(), Drive()])
    lines = manifest_text(
        spec,
        [
            Decision("palm.normal", "[0, 0, 1]", 0.95, "balls rest there"),
            Decision("joint b", "closes", 0.7, "it pushes them"),
            Decision("drives", "15", 0.2, "estimates"),
        ],
    ).splitlines()
    assert lines[lines.index("  # sure: balls rest there") + 1].startswith("  normal: ")
    assert lines[lines.index("  - b") + 1] == "    # closes (likely: it pushes them)"
    assert lines[lines.index("# look at this: estimates") + 1] == "drives:"


def test_every_line_is_short_and_sections_are_explained():
    spec = spec_of(["palm", "tip"], ["a", "b"], [0.5, -0.25], [Drive(), Drive()])
    text = manifest_text(spec)
    assert max(map(len, text.splitlines())) <= 100
    for section in ("palm:", "joints:", "contact_regions:", "drives:"):
        before, _, _ = text.partition(f"\n{section}")
        assert before.splitlines()[-1].startswith("#"), section


def test_a_manifest_without_regions_or_contacts_is_read(folder: Path):
    spec = spec_of(["palm"], ["a"], [0.0], [Drive()], allowed_self_contacts=[])
    assert read_back(spec, [], folder) == spec
    assert "allowed_self_contacts" not in parse_yaml(manifest_text(spec), "text")
