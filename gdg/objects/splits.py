"""Names that stand for all objects of a split. Light."""

from __future__ import annotations

from gdg.errors import GdgError
from gdg.folders import OBJECTS
from gdg.objects.spec import MANIFEST, read_object_spec


def expand_split(word: str) -> str:
    """``object=train`` or ``test`` written out as the names of that split; other words as is."""
    key, _, value = word.partition("=")
    if key != "object":
        return word
    names: list[str] = []
    for name in value.split(","):
        names += _names_of_split(name) if name in ("train", "test") else [name]
    return f"object={','.join(names)}"


def _names_of_split(split: str) -> list[str]:
    found = [folder for folder in OBJECTS.all().values() if (folder.path / MANIFEST).is_file()]
    names = [folder.name for folder in found if read_object_spec(folder.path).split == split]
    if not names:
        raise GdgError(f"object={split}: no object that gdg finds belongs to that split.")
    return names
