"""The Python API: what the command line does, without files. Light; imports on call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gdg.config import JobConfig, RunConfig, compose
from gdg.errors import GdgError
from gdg.objects.splits import expand_split
from gdg.pipeline.jobs import DEFAULTS, EvalJob, GraspJob, PairJob
from gdg.registry import get_registry
from gdg.yaml_files import dump_yaml

if TYPE_CHECKING:
    from gdg.data.grasps import GraspSet
    from gdg.evaluation.rows import Row


def grasp(
    hand: str,
    object: str,  # the word that users of the command line write
    n: int = 8,
    *,
    settings: Sequence[str] = (),
    simulate: bool = True,
    verified: bool = False,
    **job: Any,
) -> GraspSet:
    """Plans ``n`` grasps of one object with one hand, and tests them in simulation.

    With ``verified`` in several processes: a script needs ``if __name__ == "__main__":`` around
    what calls it, as Python's multiprocessing does, or ``workers=1``.

    Args:
        hand: name or folder of the hand.
        object: name, folder or mesh file of the object (metres).
        n: how many grasps.
        settings: ``key=value`` words as on the command line, e.g. ``["fitter.particles=64"]``.
        simulate: test the grasps; without it they carry no verdicts.
        verified: go on until ``n`` grasps pass the test, and give these alone.
        **job: further fields of ``gdg.pipeline.jobs.PairJob``: seed, device, protocol, …; with
            ``verified`` of ``GraspJob``: workers, most_proposed.

    Returns:
        At most ``n`` grasps, best first, with metrics and contacts (``gdg.quality``); poses in the
        object's frame, joints by name.

    Raises:
        GdgError: anything given that is missing, malformed or unknown.
    """
    model, tested = PairJob, {}
    if verified:
        model, tested = GraspJob, {"verified": True, "simulate": simulate}
    configs = _configs(model, {"hand": hand, "object": object, "n": n, **tested, **job}, settings)
    if len(configs) > 1:
        raise GdgError("grasp() runs one setting, but commas gave several; use evaluate().")
    if verified:
        from gdg.pipeline.verified import verified_grasps

        return verified_grasps(configs[0])
    from gdg.pipeline.pair import Pair, generator_for

    pair = Pair.load(configs[0])
    grasps = pair.measured(pair.plan(pair.job.n, generator_for(pair.job.seed)))
    return pair.simulate(grasps) if simulate and len(grasps) else grasps


def evaluate(
    hand: str, object: str, n: int = 8, *, settings: Sequence[str] = (), **job: Any
) -> list[Row]:
    """Plans and tests a grid; commas in ``hand``, ``object`` and ``settings`` span it.

    Finished cells are kept in ``out`` (default ``runs/eval``) and never run twice.

    Args:
        hand: names or folders, separated by commas.
        object: names, folders or mesh files, separated by commas.
        n: grasps per cell.
        settings: ``key=value`` words as on the command line.
        **job: further fields of ``gdg.pipeline.jobs.EvalJob``: out, workers, protocol, ….

    Raises:
        GdgError: anything given that is missing, malformed or unknown.
    """
    words = [f"hand={hand}", f"object={object}", *settings]
    configs = _configs(EvalJob, {"n": n, **job}, words)
    from gdg.evaluation.run import run_eval

    return run_eval(configs).rows


def _configs(model: type[JobConfig], job: dict[str, Any], words: Sequence[str]) -> list[RunConfig]:
    given = [f"{key}={dump_yaml([value]).strip()[2:]}" for key, value in job.items()]
    return compose(model, get_registry(), DEFAULTS, (), [*given, *map(expand_split, words)])
