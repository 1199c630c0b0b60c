"""Turns a command's ``key=value`` words into configs, and explains them in ``--help``."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
import yaml
from pydantic import BaseModel

from gdg.components import config_key
from gdg.config import JobConfig, RunConfig, compose
from gdg.errors import GdgError
from gdg.objects.splits import expand_split
from gdg.registry import get_registry


def takes_settings(job: type[JobConfig], defaults: dict[str, str]) -> Callable[..., Any]:
    """Decorator: gives a click command ``SETTINGS…``, ``-c FILE`` and the list of them in help."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        function.__doc__ = f"{inspect.getdoc(function)}\n\n{_settings_help(job, defaults)}"
        function = click.argument("settings", nargs=-1)(function)
        return click.option(
            "-c", "--config", "files", multiple=True, type=click.Path(path_type=Path),
            help="YAML file with settings, e.g. the config.yaml of an earlier run; repeatable.",
        )(function)  # fmt: skip

    return decorate


def configs_from(
    job: type[JobConfig],
    defaults: dict[str, str],
    files: Sequence[Path],
    settings: Sequence[str],
) -> list[RunConfig]:
    """The configs that files and words describe; ``object=train`` and ``test`` name splits."""
    words = [expand_split(word) for word in settings]
    return compose(job, get_registry(), defaults, files, words)


def single(configs: list[RunConfig]) -> RunConfig:
    """The only config.

    Raises:
        GdgError: the settings sweep.
    """
    if len(configs) > 1:
        raise GdgError(
            f"this command runs one setting, but commas gave {len(configs)}; write [a, b] for a "
            f"list, or sweep with gdg eval."
        )
    return configs[0]


def _settings_help(job: type[JobConfig], defaults: dict[str, str]) -> str:
    lines = ["\b", "Settings (key=value):"]
    for name, field in job.model_fields.items():
        if isinstance(field.default, BaseModel):
            lines += _nested_help(name, field.default)
            continue
        given = "" if field.is_required() else yaml.safe_dump(field.default).splitlines()[0]
        default = given or "required"
        lines.append(f"  {name:<14} {_explained(job, name)} [{default}]")
    lines += ["", "\b", "Components (component=name, component.option=value; see gdg plugins):"]
    lines += [f"  {config_key(key):<14} [{name}]" for key, name in defaults.items()]
    return "\n".join(lines)


def _nested_help(name: str, options: BaseModel) -> list[str]:
    """A line for each of a job's nested options, ``name.option``."""
    return [
        f"  {name}.{option} {_explained(type(options), option)} "
        f"[{yaml.safe_dump(value).splitlines()[0]}]"
        for option, value in options.model_dump(mode="json").items()
    ]


def _explained(job: type[BaseModel], name: str) -> str:
    """The field's line in the docstring of the model that declares it."""
    for model in job.__mro__:
        lines = (model.__doc__ or "").splitlines()
        for index, line in enumerate(lines):
            if line.strip().startswith(f"{name}: "):
                text = line.strip().removeprefix(f"{name}: ")
                for more in lines[index + 1 :]:
                    if not more.startswith(" " * 12):
                        break
                    text += " " + more.strip()
                return text.replace("``", "")
    return ""
