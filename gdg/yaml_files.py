"""Reads YAML that users write, as untrusted data: plain values only, every mistake in one sentence.

Differences from plain YAML 1.1: no aliases (a small file can't grow into a large one), no key
twice in one mapping, and only ``true`` and ``false`` are booleans; ``on``, ``no``, ``12:30`` and
``2024-10-18`` are text.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import ComposerError
from yaml.constructor import ConstructorError

from gdg.errors import GdgError

#: A file larger than this is refused unread (the largest of ours has 20 kB).
MAX_YAML_BYTES = 1_000_000


class _PlainLoader(yaml.SafeLoader):
    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.events.AliasEvent):
            mark = self.peek_event().start_mark
            raise ComposerError(
                None, None, "aliases (*name) are not allowed; write the value out", mark
            )
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    raise ConstructorError(
                        None, None, f"the key '{key.value}' stands twice", key.start_mark
                    )
                seen.add(key.value)
        return super().construct_mapping(node, deep)


class _PlainDumper(yaml.SafeDumper):
    """Quotes text that either YAML 1.1 or the loader above would take for something else."""

    def represent_text(self, text: str) -> yaml.ScalarNode:
        # in other quotes, these line breaks would come back as spaces
        style = '"' if any(char in text for char in "\x85\u2028\u2029") else None
        return self.represent_scalar("tag:yaml.org,2002:str", text, style)


_PlainDumper.add_representer(str, _PlainDumper.represent_text)


_PlainLoader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?(0|[1-9][0-9]*)", list("-+0123456789")),
    ("float", r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?", list("-+.0123456789")),
    ("float", r"[-+]?[0-9]+[eE][-+]?[0-9]+", list("-+0123456789")),
    ("float", r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", list("-+.")),
):
    for _class in (_PlainLoader, _PlainDumper):
        _class.add_implicit_resolver(
            f"tag:yaml.org,2002:{_tag}", re.compile(f"(?:{_pattern})$"), _first
        )


def parse_yaml(text: str, where: str) -> Any:
    """The plain values that a YAML text holds.

    Raises:
        GdgError: no YAML, beginning with ``where``.
    """
    try:
        return yaml.load(text, Loader=_PlainLoader)  # derived from SafeLoader
    except RecursionError as error:
        raise GdgError(f"{where}: is nested too deeply.") from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f"line {mark.line + 1}: " if mark else ""
        raise GdgError(f"{where}: is no valid YAML: {line}{error.problem}.") from error
    except (yaml.YAMLError, ValueError, ArithmeticError, LookupError, AttributeError) as error:
        raise GdgError(f"{where}: is no valid YAML: {' '.join(str(error).split())}") from error


def read_yaml_mapping(path: Path) -> dict[str, Any]:
    """The mapping that a YAML file holds; keys become text.

    Raises:
        GdgError: the file is missing, too large, no YAML, or holds something else.
    """
    try:
        if path.stat().st_size > MAX_YAML_BYTES:
            raise GdgError(f"{path}: larger than {MAX_YAML_BYTES:,} bytes.")
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise GdgError(f"{path}: cannot be read: it is not UTF-8 text.") from error
    except OSError as error:
        raise GdgError(f"{path}: cannot be read: {error.strerror or error}.") from error
    tree = parse_yaml(text, str(path))
    if not isinstance(tree, dict):
        raise GdgError(f"{path}: must be a mapping (key: value).")
    return {str(key): value for key, value in tree.items()}


def dump_yaml(tree: Any) -> str:
    """The YAML text that ``parse_yaml`` reads back as the same values, in the given order."""
    return yaml.dump(tree, Dumper=_PlainDumper, sort_keys=False, allow_unicode=True)
