"""What made a result, as one hash: so that a finished one is found again, and never a stale one."""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from glob import escape as glob_escape
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from gdg.cache import content_hash
from gdg.components import Component, config_key
from gdg.config import RunConfig
from gdg.folders import HANDS, OBJECTS
from gdg.pipeline.jobs import PairJob
from gdg.protocols import load_protocol

#: Stages that every planned and tested grasp goes through.
STAGES = ("hand_model", "planner", "simulator")
#: The stages before the test.
PLANNING = ("hand_model", "planner")
#: Job fields that shape grasps; the others say where they go and how the work is shared.
JOB_FIELDS = ("object_scale", "seed", "device", "refine")
#: Those of them that matter to the test alone.
TEST_FIELDS = ("refine",)


def fingerprint(config: RunConfig, *more: str | int) -> str:
    """16 hex digits over everything that shapes the grasps of a config.

    That is the content (not the names) of hand, object, protocol and files named in options, and
    the used components with their versions and options; ``more`` is added to it.

    Raises:
        GdgError: hand, object or protocol can't be found.
    """
    job: PairJob = config.job
    parts: dict[str, Any] = {
        "hand": _content(HANDS.find(job.hand).path),
        "object": _content(OBJECTS.find(job.object).path),
        "protocol": load_protocol(job.protocol).model_dump(mode="json"),
        "job": _shaping(job, JOB_FIELDS),
        "components": {key: _component(config, key) for key in used_components(config)},
        "more": more,
    }
    return content_hash(json.dumps(parts, sort_keys=True))[:16]


def plan_fingerprint(config: RunConfig, *more: str | int) -> str:
    """16 hex digits over everything that shapes the grasps of a config before they are tested.

    Configs that differ in protocol, simulator and refinement alone have the same.

    Raises:
        GdgError: hand or object can't be found.
    """
    job: PairJob = config.job
    fields = [name for name in JOB_FIELDS if name not in TEST_FIELDS]
    parts: dict[str, Any] = {
        "hand": _content(HANDS.find(job.hand).path),
        "object": _content(OBJECTS.find(job.object).path),
        "job": _shaping(job, fields),
        "components": {key: _component(config, key) for key in used_components(config, PLANNING)},
        "more": more,
    }
    return content_hash(json.dumps(parts, sort_keys=True))[:16]


def _shaping(job: PairJob, fields: Sequence[str]) -> dict[str, Any]:
    """Values of job fields; of scenes only a table, since older hashes knew of none."""
    scene = {"scene": job.scene, "scene_pose": job.scene_pose} if job.scene != "free" else {}
    return {**{name: getattr(job, name) for name in fields}, **scene}


def used_components(config: RunConfig, stages: tuple[str, ...] = STAGES) -> list[str]:
    """Config keys of the components that shape grasps, with all that these use in turn."""
    used: list[str] = []
    pending: list[str] = list(stages)
    while pending:
        key = pending.pop()
        if key not in used:
            used.append(key)
            pending += [config_key(kind) for kind in config.components[key].record.uses]
    return sorted(used)


def _component(config: RunConfig, key: str) -> dict[str, Any]:
    choice = config.components[key]
    files = {
        name: _content(Path(value).expanduser())
        for name, value in choice.options.model_dump().items()
        if isinstance(value, str) and Path(value).expanduser().is_file()
    }
    named = getattr(choice.options, "weights", None)
    for path in bundled_weights(choice.record, named) if isinstance(named, str) else ():
        files[path.name] = _content(path)
    origin = [choice.record.provider, choice.record.distribution, choice.record.version]
    return {**choice.as_tree(), "origin": origin, "files": files}


def bundled_weights(record: Component, name: str) -> list[Path]:
    """Files ``NAME.safetensors`` that lie in a component's package; all of them for "".

    Weights that come with a plugin are named, not given by path, and may change while their name
    and the plugin's version stay. Without a name the component chooses among them.
    """
    package = record.target.partition(":")[0].rpartition(".")[0]
    if not package or Path(name).name != name:
        return []
    try:
        spec = find_spec(package)
    except ModuleNotFoundError:  # told when the component is used
        return []
    folders = list(spec.submodule_search_locations or ()) if spec is not None else []
    pattern = f"{glob_escape(name) or '*'}.safetensors"
    return [path for folder in folders for path in sorted(Path(folder).rglob(pattern))]


def _content(path: Path) -> str:
    """Hash of a file, or of all files of a folder with their relative names."""
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    parts: list[str] = []
    for file in files:
        name = file.name if file == path else str(file.relative_to(path))
        stat = file.stat()
        parts += [name, _file_hash(file, stat.st_mtime_ns, stat.st_size)]
    return content_hash(*parts)


@functools.lru_cache(maxsize=16_384)
def _file_hash(file: Path, mtime_ns: int, size: int) -> str:
    """Hash of a file, read once per process as long as its time and size stay the same."""
    return content_hash(file.read_bytes())
