"""Composes a run's config from defaults, YAML files and ``key=value`` overrides.

Rules:
    - ``fitter=adam`` swaps the whole group: nothing of the old component's options survives;
      naming the component that is chosen already changes nothing;
    - ``fitter.particles=64`` sets one option of the component that is chosen in the end, wherever
      in the line the swap stands: no override is ever dropped in silence;
    - a top-level comma makes a sweep: ``distance=aligned,euclidean`` gives two configs, and two
      sweeps give their product; write ``[a, b]`` for a list, and quote text with commas;
    - every mistake is reported at once, by its dotted key, with suggestions.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from gdg.components import KINDS, Component, Options, config_key
from gdg.errors import GdgError, did_you_mean, raise_if_any
from gdg.registry import Registry
from gdg.validation import sentences, validated
from gdg.yaml_files import parse_yaml, read_yaml_mapping

GROUPS = {config_key(kind): kind for kind in KINDS}
KEY = re.compile(r"[^\s.=,]+(\.[^\s.=,]+)*")
Tree = dict[str, Any]


class JobConfig(BaseModel):
    """Base of what a command takes: its own fields; component groups come beside them."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, validate_default=True, allow_inf_nan=False
    )


class ComponentChoice(BaseModel):
    """One chosen component with its validated options.

    Attributes:
        record: the component.
        options: its options.
        name: as the user wrote it, possibly ``provider/name``.
    """

    model_config = ConfigDict(frozen=True, arbitrary_types_allowed=True)
    record: Component
    options: Options
    name: str = ""

    def as_tree(self) -> Tree:
        """``{"name": ..., option: value, ...}``, as it stands in ``config.yaml``."""
        return {"name": self.name or self.record.name, **self.options.model_dump(mode="json")}


class RunConfig(BaseModel):
    """A resolved config: the job's fields and one component per group.

    Attributes:
        job: the command's own fields, validated.
        components: config key of a kind -> choice.
    """

    model_config = ConfigDict(frozen=True, arbitrary_types_allowed=True)
    job: Any
    components: dict[str, ComponentChoice]

    def as_tree(self) -> Tree:
        """The nested mapping that ``gdg … -c config.yaml`` reads back."""
        groups = {key: choice.as_tree() for key, choice in self.components.items()}
        return {**self.job.model_dump(mode="json"), **groups}

    def with_options(self, key: str, **values: Any) -> RunConfig:
        """The same config with some options of a component set.

        Raises:
            GdgError: the options are refused.
        """
        choice = self.components[key]
        given = choice.options.model_dump(exclude_unset=True)
        where = f"{key}={choice.name} with {', '.join(f'{k}={v}' for k, v in values.items())}"
        options = validated(choice.record.options, {**given, **values}, where)
        changed = choice.model_copy(update={"options": options})
        return self.model_copy(update={"components": {**self.components, key: changed}})


def compose(
    job_model: type[JobConfig],
    registry: Registry,
    defaults: Mapping[str, str],
    files: Sequence[Path] = (),
    overrides: Sequence[str] = (),
) -> list[RunConfig]:
    """Gives the configs that files and overrides describe: one, or the product of all sweeps.

    Args:
        job_model: the command's own fields.
        registry: where component names are looked up.
        defaults: config key of a kind -> component name; its keys are the groups allowed here.
        files: YAML files, the later winning.
        overrides: ``key=value`` words, the later winning, applied after all files.

    Raises:
        GdgError: a file that can't be read; otherwise every mistake in one ``GdgErrors``.
    """
    base: Tree = {key: {"name": name} for key, name in defaults.items()}
    for path in files:
        _merge(base, read_yaml_mapping(path))
    mistakes: list[str] = []
    words = filter(None, [_parse_override(word, mistakes) for word in overrides])
    parsed = list(dict(words).items())  # a key given again replaces its earlier sweep, too
    configs = []
    for values in itertools.product(*(alternatives for _, alternatives in parsed)):
        tree = _copy(base)
        # whole groups first; sorting is stable, so otherwise the later word wins
        chosen = zip((key for key, _ in parsed), values, strict=True)
        for key, value in sorted(chosen, key=lambda pair: "." in pair[0]):
            _merge(tree, _nested(key, value))
        configs.append(_validate(tree, job_model, registry, defaults, mistakes))
    raise_if_any(list(dict.fromkeys(mistakes)))
    return [config for config in configs if config is not None]


def _validate(
    tree: Tree,
    job_model: type[JobConfig],
    registry: Registry,
    defaults: Mapping[str, str],
    mistakes: list[str],
) -> RunConfig | None:
    """The resolved config, or None with one sentence per mistake appended."""
    before = len(mistakes)
    fields = {key: value for key, value in tree.items() if key not in defaults}
    known = [*job_model.model_fields, *defaults]
    for key in [key for key in fields if key not in job_model.model_fields]:
        mistakes.append(f"{key}: there is no such option here.{did_you_mean(key, known)}")
        del fields[key]
    job = _checked(job_model, fields, "", mistakes)
    components = {}
    for key in defaults:
        choice = _choose(key, tree[key], registry, mistakes)
        if choice is not None:
            components[key] = choice
    return None if len(mistakes) > before else RunConfig(job=job, components=components)


def _choose(
    key: str, group: Any, registry: Registry, mistakes: list[str]
) -> ComponentChoice | None:
    if not isinstance(group, dict) or not isinstance(group.get("name"), str):
        mistakes.append(f"{key}: give the name of a component, e.g. {key}=…")
        return None
    try:
        record = registry.find(GROUPS[key], group["name"])
    except GdgError as error:
        mistakes.append(f"{key}: {error}")
        return None
    given = {str(option): value for option, value in group.items() if option != "name"}
    options = _checked(record.options, given, f"{key}.", mistakes)
    if options is None:
        return None
    return ComponentChoice(name=group["name"], record=record, options=options)


def _checked(model: type[BaseModel], values: Tree, prefix: str, mistakes: list[str]) -> Any:
    """The validated model, or None with one sentence per mistake appended."""
    try:
        return model(**values)
    except ValidationError as error:
        mistakes += sentences(error, model, prefix)
        return None


def _merge(tree: Tree, changes: Tree) -> None:
    for key, value in changes.items():
        old = tree.get(key)
        if key in GROUPS:
            tree[key] = _merge_group(old, value)
        elif isinstance(old, dict) and isinstance(value, dict):
            tree[key] = {**old, **value}  # a job's nested options, set one by one
        else:
            tree[key] = value


def _merge_group(old: Any, new: Any) -> Tree:
    """A new name swaps the whole group; without one the options are set in the old group."""
    if isinstance(new, str):
        new = {"name": new}
    if not isinstance(new, dict):
        return {"name": new}
    if not isinstance(old, dict) or new.get("name", old.get("name")) != old.get("name"):
        return dict(new)
    return {**old, **new}


def _nested(key: str, value: Any) -> Tree:
    head, _, rest = key.partition(".")
    return {head: {rest: value} if rest else value}


def _parse_override(word: str, mistakes: list[str]) -> tuple[str, list[Any]] | None:
    """Key and alternative values, or None with a sentence appended."""
    key, equals, text = word.partition("=")
    if not equals or not KEY.fullmatch(key.strip()):
        mistakes.append(f"'{word}': an override is written key=value, e.g. hand=allegro.")
        return None
    try:
        return key.strip(), [parse_yaml(part, f"'{word}'") for part in _split_commas(text)]
    except GdgError as error:
        mistakes.append(str(error))
        return None


def _split_commas(text: str) -> list[str]:
    """Cuts at commas that stand in no brackets and no quotes (a quote opens where YAML's may)."""
    parts, depth, quote, skip = [""], 0, "", False
    for char in text:
        before = parts[-1].rstrip()[-1:]
        parts[-1] += char
        if skip:
            skip = False
        elif quote:
            skip = char == "\\" and quote == '"'
            quote = "" if char == quote else quote
        elif char in "'\"" and before in ("", char, *"[{(,:"):
            quote = char
        elif char in "[{(":
            depth += 1
        elif char in "]})":
            depth = max(0, depth - 1)
        elif char == "," and depth == 0:
            parts[-1] = parts[-1][:-1]
            parts.append("")
    return parts


def _copy(tree: Tree) -> Tree:
    return {key: dict(value) if isinstance(value, dict) else value for key, value in tree.items()}
