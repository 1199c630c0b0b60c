"""``gdg grasp``: from a hand and an object to tested grasps in a run folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gdg.config import RunConfig
from gdg.data.atomic import write_text_atomically
from gdg.data.grasps import GraspSet
from gdg.kinds.fitter import Progress
from gdg.pipeline.jobs import GraspJob
from gdg.pipeline.pair import Pair, generator_for
from gdg.pipeline.verified import for_verdicts, verified_grasps
from gdg.yaml_files import dump_yaml

PICTURES = ("grasps.png", "report.html")
#: What a run writes into its folder, in this order.
OUTPUTS = ("grasps.json", "config.yaml", *PICTURES)
#: The picture shows the best grasps only, since each takes about half a second to draw; the
#: interactive report has all of them.
MAX_PICTURED = 16


@dataclass(frozen=True)
class GraspRun:
    """What a run gave.

    Attributes:
        grasps: with verdicts unless ``simulate=false``.
        folder: where ``grasps.json``, ``config.yaml`` and the pictures lie.
    """

    grasps: GraspSet
    folder: Path


class Stages:
    """Receives the progress of each stage; this one ignores it. See ``gdg.cli.progress``."""

    def stage(self, name: str) -> Progress:
        """Starts a stage and gives the callback that reports on it."""
        return lambda done, total: None


def run_grasp(config: RunConfig, stages: Stages | None = None) -> GraspRun:
    """Plans, simulates and reports; every file is complete as soon as it exists.

    ``grasps.json`` is written after planning and again with the verdicts, or whenever further
    grasps are verified, so that an interrupted run keeps what it had.
    """
    stages = stages or Stages()
    job: GraspJob = config.job
    if job.verified:
        config = for_verdicts(config)
    pair = Pair.load(config)
    folder = Path(job.out or f"runs/grasp/{pair.hand.hand.name}-{pair.obj.name}-seed{job.seed}")
    folder.mkdir(parents=True, exist_ok=True)
    config_text = dump_yaml(config.as_tree())

    def store(grasps: GraspSet) -> None:
        for name in PICTURES:  # those of an earlier run must not pass for this one's
            (folder / name).unlink(missing_ok=True)
        grasps.save(folder / "grasps.json")
        write_text_atomically(folder / "config.yaml", config_text)

    if job.verified:
        grasps = verified_grasps(config, store, stages.stage("verified grasps"))
        store(grasps)
    else:
        planned = pair.plan(job.n, generator_for(job.seed), stages.stage("planning"))
        grasps = pair.measured(planned)
        store(grasps)
        if job.simulate and len(grasps):
            grasps = pair.simulate(grasps, stages.stage("simulating"))
            store(grasps)
    _draw(pair, grasps, folder, config_text, stages)
    return GraspRun(grasps, folder)


def _draw(pair: Pair, grasps: GraspSet, folder: Path, config_text: str, stages: Stages) -> None:
    job: GraspJob = pair.config.job
    if job.picture:
        from gdg.report.contact_sheet import contact_sheet  # heavy: pulls in VTK

        stages.stage("drawing")(0, 1)
        shown = grasps.select(range(min(MAX_PICTURED, len(grasps))))
        contact_sheet(pair.hand, pair.obj, shown, folder / "grasps.png")
    if job.report:
        from gdg.report.html import html_report

        html_report(pair.hand, pair.obj, grasps, folder / "report.html", config_text)
