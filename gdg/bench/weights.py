"""Which weights a row uses, and what to do where they are missing. Light."""

from __future__ import annotations

from pathlib import Path

from gdg.bench.tables import Method
from gdg.config import RunConfig
from gdg.errors import GdgError
from gdg.pipeline.fingerprint import bundled_weights

#: How the sentences begin that components raise without weights.
NO_WEIGHTS = ("has no weights", "there are no bundled weights")


def with_weights(method: Method, config: RunConfig, folder: str) -> RunConfig:
    """A row's config with the row's weights.

    Args:
        method: the row.
        config: of the row, with any weights.
        folder: the user's folder of weights, or "".

    Raises:
        MissingWeights: there are none.
        GdgError: there is no such folder.
    """
    command = train_command(method, config.components["generator"].record.name)
    if method.weights:
        record = config.components["generator"].record
        found = _in_folder(folder, method.weights)
        if found is None and not bundled_weights(record, method.weights):
            raise MissingWeights(command)
        return _with_option(config, "generator", str(found or method.weights))
    if method.planner_weights:
        record = config.components["planner"].record
        found = _in_folder(folder, f"{method.planner}-{method.hand}")
        if found is None and not bundled_weights(record, ""):
            raise MissingWeights(command)
        return config if found is None else _with_option(config, "planner", str(found))
    return config


class MissingWeights(GdgError):
    """The weights of a row do not exist; the message is the command that trains them."""


def train_command(method: Method, generator: str) -> str:
    """The command that trains a row's weights so that ``weights=runs/weights`` finds them."""
    if method.planner_weights:
        name = f"{method.planner}-{method.hand}"
        words = f"planner={method.planner} hand={method.hand} split=paper"
    else:
        name = method.weights
        _, _, unseen = name.partition("without-")
        split = f"split=paper-without-{unseen} exclude_hand={unseen}" if unseen else "split=paper"
        words = f"generator={generator} distance={method.distance} {split}"
    return f"gdg train data=DATASET {words} out=runs/weights/{name}"


def _in_folder(folder: str, name: str) -> Path | None:
    if not folder:
        return None
    root = Path(folder).expanduser()
    if not root.is_dir():
        raise GdgError(f"weights={folder}: there is no such folder.")
    places = (root / f"{name}.safetensors", root / name / "model.safetensors")
    return next((path.resolve() for path in places if path.is_file()), None)


def _with_option(config: RunConfig, key: str, weights: str) -> RunConfig:
    """The config with a component's option ``weights`` set.

    Raises:
        GdgError: the component has no such option.
    """
    choice = config.components[key]
    if "weights" not in choice.record.options.model_fields:
        raise GdgError(
            f"{key}={choice.record.name}: has no option 'weights', which the table sets."
        )
    options = choice.record.options(**{**choice.options.model_dump(), "weights": weights})
    changed = choice.model_copy(update={"options": options})
    return config.model_copy(update={"components": {**config.components, key: changed}})
