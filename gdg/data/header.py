"""The header of a shard: the JSON in its footer, checked before anything is done with it. Light.

A dataset may come from anyone, so a header may hold anything: names that lead out of the folder,
values of other types, text that no terminal can show.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from gdg.validation import Plain, sentences

#: What is written now, and what was written before and is still read.
SCHEMA, OLD_SCHEMA = "gdg-dataset-2", "gdg-dataset-1"
#: What the key of a shard looks like; it is part of a file name.
KEY = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,63}")


def _as_key(text: str) -> str:
    if not KEY.fullmatch(text):
        raise ValueError(
            "must be 1 to 64 letters, digits, '.', '_' or '-', and not begin with a dot"
        )
    return text


def _as_name(text: str) -> str:
    if text in ("", ".", "..") or set("/\\\n\t") & set(text):
        raise ValueError("must be a name, not a path")
    return text


Key = Annotated[str, AfterValidator(_as_key)]
#: A hand's or an object's name, which names folders and files of other layouts.
Name = Annotated[Plain, AfterValidator(_as_name)]
Count = Annotated[int, Field(ge=0)]


class Figures(BaseModel):
    """What a header sums up of the grasps; see ``ShardInfo``."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    passed: Count | None = None
    measured: dict[str, tuple[Count, float]] = {}


class Header(BaseModel):
    """A header; ``ShardInfo`` tells what the entries mean. Entries without a default are needed."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False, populate_by_name=True)

    version: Literal["gdg-dataset-1", "gdg-dataset-2"] = Field(alias="schema")
    key: Key | None = None
    hand: Name
    object_name: Name = Field(alias="object")
    hand_hash: Plain
    object_hash: Plain
    split: Plain
    joint_names: tuple[Plain, ...]
    root_link: Plain
    scene: dict[str, Any] | None = None
    hand_path: Plain = ""
    object_path: Plain = ""
    object_scale: float = Field(1.0, gt=0)
    reason: Plain = ""
    provenance: dict[str, Any]
    parts: tuple[str, ...] = ()
    content: str = ""
    summary: Figures = Figures()


def parse_header(text: bytes) -> Header:
    """The header of a shard.

    Raises:
        ValueError: it is none, or malformed; says every mistake.
    """
    try:
        return Header.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        if first["type"] == "json_invalid":
            raise ValueError(f"its header can't be read: {first['msg']}") from error
        if any(detail["loc"] in ((), ("schema",)) for detail in error.errors()):
            raise ValueError(f"its schema is not '{SCHEMA}'") from error
        raise ValueError(" ".join(sentences(error, Header))) from error


def check_key(key: str) -> str:
    """The key, if it is one.

    Raises:
        ValueError: it isn't.
    """
    return _as_key(key)
