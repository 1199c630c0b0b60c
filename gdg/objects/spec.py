"""The manifest of an object folder, ``object.yaml``. Light: imports no geometry library."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from gdg.validation import PathInside, Plain, validated
from gdg.yaml_files import read_yaml_mapping

MANIFEST = "object.yaml"


class ObjectSpec(BaseModel):
    """What ``object.yaml`` says.

    Attributes:
        name: the name users type; lower case.
        title: the name people read.
        mesh: path of the mesh inside the folder; metres.
        split: ``train`` objects may be learned from, ``test`` objects never.
        thin_shell: wall thickness in metres of cups, bowls and the like; None for solids.
        source: where shape and dimensions come from.
        licence: on what terms.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")]
    title: Plain = ""
    mesh: PathInside
    split: Literal["train", "test"]
    thin_shell: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    source: Plain
    licence: Plain


def read_object_spec(folder: Path) -> ObjectSpec:
    """Reads and validates ``object.yaml``; says every mistake at once.

    Raises:
        GdgError: the file is missing, too large, no YAML, or breaks the schema.
    """
    path = folder / MANIFEST
    return validated(ObjectSpec, read_yaml_mapping(path), str(path))
