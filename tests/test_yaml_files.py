"""YAML from users: plain values, one sentence per mistake, and nothing that explodes."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gdg.errors import GdgError
from gdg.yaml_files import MAX_YAML_BYTES, dump_yaml, parse_yaml, read_yaml_mapping

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@pytest.mark.parametrize("text", ["on", "no", "12:30", "2024-10-18", "010", "0x1f", "1_000", "="])
def test_only_true_and_false_are_booleans_and_only_decimals_are_numbers(text: str):
    assert parse_yaml(text, "here") == text


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-3", 1e-3), ("-.5", -0.5), ("7", 7), ("1.", 1.0), (".inf", float("inf")), ("true", True),
     ("~", None), ("", None), ("'1'", "1"), ("[1, a]", [1, "a"]), ("{a: {b: 1}}", {"a": {"b": 1}})],
)  # fmt: skip
def test_plain_values_are_what_they_look_like(text: str, value: object):
    assert parse_yaml(text, "here") == value


@given(PLAIN)
def test_what_is_dumped_comes_back(value: object):
    assert parse_yaml(dump_yaml(value), "here") == value


@given(st.sampled_from(["1e-3", "yes", "12:30", "2024-01-01", "010", "0b_", ".5", "null", "~"]))
def test_text_that_looks_like_something_else_comes_back_as_text(value: str):
    assert parse_yaml(dump_yaml([value]), "here") == [value]


@given(st.text())
def test_any_text_gives_values_or_one_error(text: str):
    with contextlib.suppress(GdgError):
        parse_yaml(text, "here")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[" * 100_000, "nested too deeply"),
        ("9" * 5000, "no valid YAML"),
        ("a: &x [1]\nb: *x", "line 2: aliases"),
        ("a: 1\nb: 2\na: 3", "line 3: the key 'a' stands twice"),
        ("!!python/object/apply:os.system [echo]", "line 1: could not determine a constructor"),
        ("!!timestamp x", "no valid YAML"),
        ("!!int x", "no valid YAML"),
        ("!!float ''", "no valid YAML"),
        ("\0", "no valid YAML"),
        ("a: [1", "line 1: "),
        ("a: b: c", "line 1: "),
        ("? [a]\n: b", "line 1: "),
    ],
)
def test_hostile_text_gives_one_clear_error(text: str, reason: str):
    with pytest.raises(GdgError) as caught:
        parse_yaml(text, "here")
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_aliases_cannot_blow_up_a_small_file(tmp_path: Path):
    levels = [f"l{i + 1}: &l{i + 1} [{', '.join([f'*l{i}'] * 9)}]" for i in range(9)]
    path = tmp_path / "bomb.yaml"
    path.write_text("\n".join(["l0: &l0 lol", *levels]))
    with pytest.raises(GdgError, match="aliases"):
        read_yaml_mapping(path)


def test_keys_become_text(tmp_path: Path):
    path = tmp_path / "keys.yaml"
    path.write_text("1: a\n2.5: b\n")
    assert read_yaml_mapping(path) == {"1": "a", "2.5": "b"}


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "must be a mapping"),
        (b"- a", "must be a mapping"),
        (b"\xff\xfe\x00", "not UTF-8"),
        (b"#" * (MAX_YAML_BYTES + 1), "larger than"),
    ],
)
def test_unfit_files_are_named(tmp_path: Path, content: bytes, reason: str):
    path = tmp_path / "unfit.yaml"
    path.write_bytes(content)
    with pytest.raises(GdgError) as caught:
        read_yaml_mapping(path)
    assert str(caught.value).startswith(str(path))
    assert reason in str(caught.value)


def test_missing_files_and_folders_are_named(tmp_path: Path):
    with pytest.raises(GdgError, match="No such file"):
        read_yaml_mapping(tmp_path / "lost.yaml")
    with pytest.raises(GdgError, match="directory"):
        read_yaml_mapping(tmp_path)
