"""Composes a run's config from defaults, YAML files and ``key=value`` overrides.

Rules:
    - ``fitter=adam`` swaps the whole group: nothing of the old component's options survives;
    - ``fitter.particles=64`` sets one option;
    - a top-level comma makes a sweep: ``distance=aligned,euclidean`` gives two configs, and two
      sweeps give their product; write ``[a, b]`` for a list, and quote text with commas;
    - every mistake is reported at once, by its dotted key, with suggestions.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from gdg.components import KINDS, Component, Options, config_key
from gdg.errors import GdgError, did_you_mean, raise_if_any
from gdg.registry import Registry

GROUPS = {config_key(kind): kind for kind in KINDS}
Tree = dict[str, Any]


class JobConfig(BaseModel):
    """Base of what a command takes: its own fields; component groups come beside them."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


class ComponentChoice(BaseModel):
    """One chosen component with its validated options."""

    model_config = ConfigDict(frozen=True, arbitrary_types_allowed=True)
    record: Component
    options: Options

    def as_tree(self) -> Tree:
        """``{"name": ..., option: value, ...}``, as it stands in ``config.yaml``."""
        return {"name": self.record.name, **self.options.model_dump(mode="json")}


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
        _merge(base, _read_yaml(path))
    parsed = [_parse_override(word) for word in overrides]
    configs = []
    for values in itertools.product(*(alternatives for _, alternatives in parsed)):
        tree = _copy(base)
        for (key, _), value in zip(parsed, values, strict=True):
            _merge(tree, _nested(key, value))
        configs.append(_validate(tree, job_model, registry, defaults))
    return configs


def _validate(
    tree: Tree, job_model: type[JobConfig], registry: Registry, defaults: Mapping[str, str]
) -> RunConfig:
    mistakes: list[str] = []
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
    raise_if_any(mistakes)
    return RunConfig(job=job, components=components)


def _choose(key: str, group: Any, registry: Registry, mistakes: list[str]) -> Any:
    if not isinstance(group, dict) or not isinstance(group.get("name"), str):
        mistakes.append(f"{key}: give the name of a component, e.g. {key}=…")
        return None
    try:
        record = registry.find(GROUPS[key], group["name"])
    except GdgError as error:
        mistakes.append(f"{key}: {error}")
        return None
    given = {option: value for option, value in group.items() if option != "name"}
    options = _checked(record.options, given, f"{key}.", mistakes)
    return None if options is None else ComponentChoice(record=record, options=options)


def _checked(model: type[BaseModel], values: Tree, prefix: str, mistakes: list[str]) -> Any:
    """The validated model, or None with one sentence per mistake appended."""
    try:
        return model(**values)
    except ValidationError as error:
        for detail in error.errors():
            dotted = prefix + ".".join(str(part) for part in detail["loc"])
            if detail["type"] == "extra_forbidden":
                hint = did_you_mean(str(detail["loc"][-1]), model.model_fields)
                mistakes.append(f"{dotted}: there is no such option.{hint}")
            elif detail["type"] == "missing":
                mistakes.append(f"{dotted}: must be given, e.g. {dotted}=…")
            else:
                reason = detail["msg"].removeprefix("Value error, ")
                mistakes.append(f"{dotted}: {reason} (given: {detail['input']!r})")
        return None


def _merge(tree: Tree, changes: Tree) -> None:
    for key, value in changes.items():
        if key in GROUPS:
            tree[key] = _merge_group(tree.get(key), value)
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


def _parse_override(word: str) -> tuple[str, list[Any]]:
    key, equals, text = word.partition("=")
    if not equals or not key:
        raise GdgError(f"'{word}': an override is written key=value, e.g. hand=allegro.")
    return key.strip(), [_parse_value(word, part) for part in _split_commas(text)]


def _parse_value(word: str, text: str) -> Any:
    try:
        return yaml.safe_load(text) if text.strip() else None
    except yaml.YAMLError as error:
        raise GdgError(f"'{word}': the value is no valid YAML: {_one_line(error)}") from error


def _split_commas(text: str) -> list[str]:
    parts, depth, quote = [""], 0, ""
    for char in text:
        if quote:
            quote = "" if char == quote else quote
        elif char in "'\"":
            quote = char
        depth += (not quote) * ((char in "[{(") - (char in "]})"))
        if char == "," and not quote and depth == 0:
            parts.append("")
        else:
            parts[-1] += char
    return parts


def _read_yaml(path: Path) -> Tree:
    try:
        tree = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise GdgError(f"{path}: cannot be read: {error}") from error
    except yaml.YAMLError as error:
        raise GdgError(f"{path}: is no valid YAML: {_one_line(error)}") from error
    if not isinstance(tree, dict):
        raise GdgError(f"{path}: must be a mapping of options.")
    return tree


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _copy(tree: Tree) -> Tree:
    return {key: dict(value) if isinstance(value, dict) else value for key, value in tree.items()}


