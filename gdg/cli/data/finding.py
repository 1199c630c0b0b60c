"""Options by which ``gdg data import`` and ``export`` find hands and objects. Light."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from gdg.data.layouts.lookup import Lookup


def finds_hands_and_objects(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: gives a command ``--hand``, ``--object`` and ``--meshes``."""
    for option in (
        click.option(
            "--meshes", default="", metavar="PATTERN",
            help="Where the meshes lie, e.g. 'meshdata/{object}/coacd/decomposed.obj'; {object} "
            "stands for the name, and of a name such as ycb+pear {dataset} for ycb and {name} for "
            "pear, e.g. 'data/object/{dataset}/{name}/{name}.stl'.",
        ),
        click.option(
            "--object", "objects", multiple=True, metavar="NAME=PATH",
            help="The object of that name in the files: a name, a folder or a mesh; repeatable. "
            "By default gdg's catalogue and GDG_OBJECTS_PATH are searched for the name.",
        ),
        click.option(
            "--hand", "hands", multiple=True, metavar="[NAME=]FOLDER",
            help="The hand of that name in the files (without NAME: of all files): a name or a "
            "folder; repeatable. By default gdg's catalogue and GDG_HANDS_PATH are searched.",
        ),
    ):  # fmt: skip
        function = option(function)
    return function


def lookup_of(hands: tuple[str, ...], objects: tuple[str, ...], meshes: str) -> Lookup:
    """The lookup that the options describe."""
    from gdg.data.layouts.lookup import NAME, OBJECT, Lookup, words_by_name
    from gdg.errors import GdgError

    if meshes and OBJECT not in meshes and NAME not in meshes:
        raise GdgError(f"--meshes {meshes}: the pattern has no {OBJECT} and no {NAME}.")
    return Lookup(
        words_by_name(hands, "--hand", lone=True), words_by_name(objects, "--object"), meshes
    )


def layouts_help() -> str:
    """One paragraph per layout, for ``--help``."""
    from gdg.data.layouts import LAYOUTS

    return "\n\n".join(f"{name}: {text}" for name, text in LAYOUTS.items())
