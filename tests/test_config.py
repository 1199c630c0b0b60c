"""Files, then overrides; swaps replace groups; every mistake at once."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from gdg.components import Component, Options
from gdg.config import JobConfig, RunConfig, compose
from gdg.errors import GdgError, GdgErrors
from gdg.hookspecs import hookimpl
from gdg.registry import Registry
from gdg.yaml_files import dump_yaml


class Job(JobConfig):
    hand: str
    n: Annotated[int, Field(gt=0)] = 8
    out: Path | None = None
    objects: tuple[str, ...] = ()
    rate: float = 0.5


class AdamOptions(Options):
    steps: int = 100
    particles: Annotated[int, Field(gt=0)] = 32
    rates: tuple[float, ...] = (0.1,)


class MalaOptions(Options):
    steps: int = 6000
    temperature: float = 18.0


def component(kind: str, name: str, options: type[Options] = Options) -> Component:
    return Component(kind=kind, name=name, target="nowhere:Nothing", summary="", options=options)


class Plugin:
    def __init__(self, *records: Component):
        self.records = records

    @hookimpl
    def gdg_components(self) -> tuple[Component, ...]:
        return self.records


REGISTRY = Registry()
REGISTRY.register(
    Plugin(
        component("fitter", "adam", AdamOptions),
        component("fitter", "mala", MalaOptions),
        component("distance", "aligned"),
        component("distance", "euclidean"),
    ),
    "first",
)
REGISTRY.register(Plugin(component("fitter", "mala", MalaOptions)), "second")
DEFAULTS = {"fitter": "adam", "distance": "aligned"}


def run(*overrides: str, files: tuple[Path, ...] = ()) -> list[RunConfig]:
    return compose(Job, REGISTRY, DEFAULTS, files, overrides)


def one(*overrides: str, files: tuple[Path, ...] = ()) -> dict[str, Any]:
    (config,) = run(*overrides, files=files)
    return config.as_tree()


def mistakes(*overrides: str, files: tuple[Path, ...] = ()) -> tuple[str, ...]:
    with pytest.raises(GdgErrors) as caught:
        run(*overrides, files=files)
    return caught.value.messages


def write(folder: Path, text: str, name: str = "config.yaml") -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def test_defaults_fill_what_is_not_given():
    assert one("hand=allegro") == {
        "hand": "allegro",
        "n": 8,
        "out": None,
        "objects": [],
        "rate": 0.5,
        "fitter": {"name": "adam", "steps": 100, "particles": 32, "rates": [0.1]},
        "distance": {"name": "aligned"},
    }


def test_a_swap_replaces_the_whole_group(tmp_path: Path):
    file = write(tmp_path, "hand: a\nfitter: {name: adam, steps: 5, particles: 6}")
    assert one("fitter=first/mala", files=(file,))["fitter"] == {
        "name": "first/mala",
        "steps": 6000,
        "temperature": 18.0,
    }


def test_an_option_of_the_swapped_component_may_stand_before_or_after_the_swap():
    after = one("hand=a", "fitter=first/mala", "fitter.steps=7")
    before = one("hand=a", "fitter.steps=7", "fitter=first/mala")
    assert after == before
    assert after["fitter"]["steps"] == 7


def test_an_option_that_the_swapped_component_lacks_is_never_dropped_in_silence():
    (mistake,) = mistakes("hand=a", "fitter.particles=64", "fitter=first/mala")
    assert mistake.startswith("fitter.particles: there is no such option.")


def test_naming_the_chosen_component_again_keeps_its_options(tmp_path: Path):
    file = write(tmp_path, "hand: a\nfitter: {name: adam, steps: 5}")
    assert one("fitter=adam", files=(file,))["fitter"]["steps"] == 5


def test_a_file_may_set_options_of_the_default_component(tmp_path: Path):
    file = write(tmp_path, "hand: a\nfitter: {steps: 5}\ndistance: euclidean")
    tree = one(files=(file,))
    assert tree["fitter"]["steps"] == 5
    assert tree["fitter"]["particles"] == 32
    assert tree["distance"] == {"name": "euclidean"}


def test_later_files_win_and_overrides_win_over_files(tmp_path: Path):
    first = write(tmp_path, "hand: a\nn: 1\nfitter: {steps: 5, particles: 6}", "1.yaml")
    second = write(tmp_path, "n: 2\nfitter: {steps: 7}", "2.yaml")
    tree = one("fitter.steps=9", files=(first, second))
    assert (tree["n"], tree["fitter"]["steps"], tree["fitter"]["particles"]) == (2, 9, 6)


def test_a_later_override_wins():
    assert one("hand=a", "hand=b", "n=1", "n=2")["n"] == 2


def test_commas_sweep_and_two_sweeps_give_their_product():
    configs = run("hand=a,b", "distance=aligned,euclidean", "n=3")
    chosen = [(c.job.hand, c.components["distance"].record.name) for c in configs]
    assert chosen == [("a", "aligned"), ("a", "euclidean"), ("b", "aligned"), ("b", "euclidean")]


def test_a_key_given_again_replaces_its_earlier_sweep():
    (config,) = run("hand=a,b", "hand=c", "distance=aligned,euclidean", "distance=euclidean")
    assert (config.job.hand, config.components["distance"].record.name) == ("c", "euclidean")


def test_options_and_components_sweep_together():
    configs = run("hand=a", "fitter.steps=1,2", "fitter=adam,first/mala")
    chosen = [(c.components["fitter"].name, c.as_tree()["fitter"]["steps"]) for c in configs]
    assert sorted(chosen) == [("adam", 1), ("adam", 2), ("first/mala", 1), ("first/mala", 2)]


@pytest.mark.parametrize(
    ("override", "field", "value"),
    [
        ("objects=[mug, cup]", "objects", ["mug", "cup"]),
        ("objects=['a, b', c]", "objects", ["a, b", "c"]),
        ("fitter.rates=[1e-3, .5]", "fitter.rates", [1e-3, 0.5]),
        ("hand='a,b'", "hand", "a,b"),
        ('hand="a\\",b"', "hand", 'a",b'),
        ("hand='it''s, so'", "hand", "it's, so"),
        ("hand=o'brien", "hand", "o'brien"),
        ("hand=(1,2)", "hand", "(1,2)"),
        ("hand=a=b", "hand", "a=b"),
        ("out=2024-10-18", "out", "2024-10-18"),
        ("out=on", "out", "on"),
        ("hand=no", "hand", "no"),
        ("out=null", "out", None),
        ("out=", "out", None),
        ("rate=1e-3", "rate", 1e-3),
        ("rate=3", "rate", 3.0),
    ],
)
def test_a_value_is_read_as_it_is_written(override: str, field: str, value: object):
    group, _, option = field.rpartition(".")
    tree = one("hand=a", override)
    assert (tree[group][option] if group else tree[field]) == value


@pytest.mark.parametrize("override", ["hand=o'brien,allegro", "hand='a,b',c", "hand=a),b"])
def test_a_quote_inside_a_word_and_a_stray_bracket_do_not_hide_a_sweep(override: str):
    assert len(run(override)) == 2


def test_every_mistake_is_reported_at_once_by_its_dotted_key():
    found = mistakes(
        "fitter=mala", "distance=alignd,euclidean", "distance.gamma=1", "n=0", "nn=3", "rate=x",
        "nonsense", "out=[", "=3", "fitter.=1", ".steps=1", "a b=1",
    )  # fmt: skip
    text = "\n".join(found)
    for part in (
        "'nonsense': an override is written key=value",
        "'=3': an override",
        "'fitter.=1': an override",
        "'.steps=1': an override",
        "'a b=1': an override",
        "'out=[': is no valid YAML",
        "nn: there is no such option here.",
        "hand: must be given",
        "n: Input should be greater than 0 (given: 0)",
        "rate: Input should be a valid number",
        "fitter: fitter 'mala' is provided by several plugins: write 'first/mala' or 'second/mala'",
        "distance: Unknown distance 'alignd'. Did you mean 'aligned'?",
        "distance.gamma: there is no such option.",
    ):
        assert part in text
    assert len(set(found)) == len(found)


def test_the_mistakes_of_every_alternative_of_a_sweep_are_reported_once():
    found = mistakes("hand=a,b", "fitter.steps=x,y", "n=0")
    assert len(found) == 3


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("fitter.stps=1", "fitter.stps: there is no such option. Did you mean 'steps'?"),
        ("fitter=adm", "fitter: Unknown fitter 'adm'. Did you mean 'adam'?"),
        ("fiter=adam", "fiter: there is no such option here. Did you mean 'fitter'?"),
        ("simulator=sapien", "simulator: there is no such option here."),
        ("fitter=", "fitter: give the name of a component"),
        ("fitter=3", "fitter: give the name of a component"),
        ("fitter=[adam]", "fitter: give the name of a component"),
        ("fitter.name=7", "fitter: give the name of a component"),
        ("fitter.particles=0", "fitter.particles: Input should be greater than 0 (given: 0)."),
        ("fitter.particles=2.5", "fitter.particles: Input should be a valid integer"),
        ("rate=.nan", "rate: Input should be a finite number"),
        ("rate=.inf", "rate: Input should be a finite number"),
        ("fitter.rates=[.inf]", "fitter.rates.0: Input should be a finite number"),
        ("fitter.steps.deep=1", "fitter.steps.deep: there is no such option."),
        ("hand.deep=1", "hand: Input should be a valid string"),
    ],
)  # fmt: skip
def test_a_mistake_says_where_and_what_instead(override: str, message: str):
    assert any(text.startswith(message) for text in mistakes("hand=a", override))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("hand: [", "is no valid YAML: line 1"),
        ("- hand", "must be a mapping"),
        ("hand: a\nhand: b", "the key 'hand' stands twice"),
        ("hand: &a x\nout: *a", "aliases"),
    ],
)
def test_a_bad_file_is_named_with_its_mistake(tmp_path: Path, text: str, reason: str):
    file = write(tmp_path, text)
    with pytest.raises(GdgError) as caught:
        run(files=(file,))
    assert str(file) in str(caught.value)
    assert reason in str(caught.value)


def test_keys_that_are_no_text_are_reported_like_any_other(tmp_path: Path):
    file = write(tmp_path, "hand: a\n1: x\nfitter: {name: adam, 2: y}")
    assert [text.partition(":")[0] for text in mistakes(files=(file,))] == ["1", "fitter.2"]


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(GdgError, match=r"lost\.yaml: cannot be read: No such file"):
        run(files=(tmp_path / "lost.yaml",))


def test_a_long_wrong_value_is_cut_off_in_the_message():
    (mistake,) = mistakes("hand=a", f"n={'x' * 500}")
    assert len(mistake) < 200


def test_the_provider_that_was_chosen_survives_the_round_trip(tmp_path: Path):
    tree = one("hand=a", "fitter=second/mala", "fitter.steps=3")
    file = write(tmp_path, dump_yaml(tree))
    assert one(files=(file,)) == tree
    assert run(files=(file,))[0].components["fitter"].record.provider == "second"


def test_options_set_afterwards_leave_what_was_not_given_unset():
    (config,) = run("hand=a", "fitter.steps=3")
    changed = config.with_options("fitter", particles=5).components["fitter"].options
    assert changed.model_dump(exclude_unset=True) == {"steps": 3, "particles": 5}
    assert config.components["fitter"].options.model_fields_set == {"steps"}
    with pytest.raises(GdgError, match=r"^fitter=\w+ with particles=0: particles: Input should be"):
        config.with_options("fitter", particles=0)


TEXT = st.text(min_size=1, max_size=12)


@given(
    hand=TEXT,
    out=st.none() | TEXT.filter(lambda text: "\0" not in text),
    objects=st.lists(TEXT, max_size=3),
    rate=st.floats(allow_nan=False, allow_infinity=False),
    rates=st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=3),
)
def test_a_written_config_composes_to_the_same(
    tmp_path_factory: pytest.TempPathFactory,
    hand: str,
    out: str | None,
    objects: list[str],
    rate: float,
    rates: list[float],
):
    folder = tmp_path_factory.getbasetemp()
    tree = {"hand": hand, "out": out, "objects": objects, "rate": rate, "fitter": {"rates": rates}}
    first = one(files=(write(folder, dump_yaml(tree), "given.yaml"),))
    assert one(files=(write(folder, dump_yaml(first), "resolved.yaml"),)) == first
    assert (first["hand"], first["rate"], first["fitter"]["rates"]) == (hand, rate, rates)


@given(st.lists(st.text(max_size=30), max_size=4))
def test_any_words_compose_or_fail_with_sentences(words: list[str]):
    with contextlib.suppress(GdgErrors):
        assert run("hand=a", *words)
