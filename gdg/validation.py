"""Turns pydantic's complaints about user input into sentences with dotted places."""

from __future__ import annotations

import typing
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ValidationError

from gdg.errors import did_you_mean, raise_if_any

Model = TypeVar("Model", bound=BaseModel)
#: Longer values are cut off in messages.
MAX_SHOWN = 60


def _inside_folder(name: str) -> str:
    if Path(name).is_absolute() or ".." in Path(name).parts or not name.isprintable():
        raise ValueError("must be a path inside the folder")
    return name


#: A path, relative to the folder of the file that names it, that doesn't leave that folder.
PathInside = Annotated[str, AfterValidator(_inside_folder)]


def _without_controls(text: str) -> str:
    if any(unicodedata.category(c) == "Cc" and c not in "\n\t" for c in text):
        raise ValueError("must not hold control characters")
    return text


#: Text that may be shown: terminals would obey the control characters that it doesn't hold.
Plain = Annotated[str, AfterValidator(_without_controls)]


def validated(model: type[Model], values: Mapping[str, Any], where: str) -> Model:
    """The model with the given values.

    Raises:
        GdgError: every mistake at once, each sentence beginning with ``where``.
    """
    try:
        return model(**values)
    except ValidationError as error:
        raise_if_any([f"{where}: {sentence}" for sentence in sentences(error, model)])
        raise


def sentences(error: ValidationError, model: type[BaseModel], prefix: str = "") -> list[str]:
    """One sentence per mistake: ``prefix`` and dotted place, what is wrong, what was given."""
    return [_sentence(detail, model, prefix) for detail in error.errors()]


def _sentence(detail: Any, model: type[BaseModel], prefix: str) -> str:
    place = prefix + ".".join(str(part) for part in detail["loc"])
    if detail["type"] == "missing":
        return f"{place}: must be given."
    if detail["type"] == "extra_forbidden":
        hint = did_you_mean(str(detail["loc"][-1]), _model_at(model, detail["loc"]).model_fields)
        return f"{place}: there is no such option.{hint}"
    reason = detail["msg"].removeprefix("Value error, ").removesuffix(".")
    if not detail["loc"]:  # said of the whole, which would be too long to show
        return f"{prefix.removesuffix('.')}: {reason}." if prefix else f"{reason}."
    return f"{place}: {reason} (given: {shown(detail['input'])})."


def shown(value: object) -> str:
    """``repr``, cut off where it is long."""
    text = repr(value)
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 1] + "…"


def _model_at(model: type[BaseModel], loc: Sequence[Any]) -> type[BaseModel]:
    """The nested model whose field the last part of a place names."""
    for part in loc[:-1]:
        field = model.model_fields.get(part) if isinstance(part, str) else None
        if field is not None:
            model = next(_models_in(field.annotation), model)
    return model


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in typing.get_args(annotation):
        yield from _models_in(argument)
