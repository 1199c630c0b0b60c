"""``gdg grasp``: from a hand and an object to tested grasps in a run folder."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from gdg.config import RunConfig
from gdg.data.atomic import write_text_atomically
from gdg.data.grasps import GraspSet
from gdg.kinds.fitter import Progress
from gdg.kinds.simulator import Simulator
from gdg.pipeline.jobs import GraspJob
from gdg.pipeline.judges import Judges
from gdg.pipeline.pair import Pair, generator_for
from gdg.pipeline.shared_simulator import SharedSimulator
from gdg.pipeline.verified import for_verdicts, verified_grasps
from gdg.yaml_files import dump_yaml

if TYPE_CHECKING:
    from gdg.report.contact_sheet import Views
    from gdg.report.scene import Scene

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


def run_grasp(
    config: RunConfig, stages: Stages | None = None, judges: Judges | None = None
) -> GraspRun:
    """Plans, simulates and reports; every file is complete as soon as it exists.

    ``grasps.json`` is written after planning and again with all verdicts, or whenever further
    grasps are verified, so that an interrupted run keeps these.

    Args:
        config: of a ``GraspJob``.
        stages: told of the progress.
        judges: processes that help with the test.
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

    drawing = _Drawing(pair, stages)
    if job.verified:
        grasps = verified_grasps(config, store, stages.stage("verified grasps"))
        store(grasps)
    else:
        planned = pair.plan(job.n, generator_for(job.seed), stages.stage("planning"))
        grasps = pair.measured(planned)
        store(grasps)
        if job.simulate and len(grasps):
            simulator = None
            if judges:
                own: Simulator = pair.components.get("simulator")
                simulator = SharedSimulator(own, judges, partial(drawing.ahead, grasps))
            grasps = pair.simulate(grasps, stages.stage("simulating"), simulator)
            store(grasps)
    drawing.write(grasps, folder, config_text)
    return GraspRun(grasps, folder)


class _Drawing:
    """The pictures of a run."""

    def __init__(self, pair: Pair, stages: Stages):
        self._pair, self._stages = pair, stages
        self._views: Views | None = None
        self._scene: Scene | None = None
        self._error: Exception | None = None

    def ahead(self, grasps: GraspSet) -> None:
        """Draws what shows no verdict. ``write`` tells what goes wrong, when the test is over."""
        try:
            self._draw(grasps)
        except Exception as error:  # whatever it is, it must not cost the verdicts
            self._error = error

    def _draw(self, grasps: GraspSet) -> None:
        job: GraspJob = self._pair.config.job
        if job.picture and self._views is None:
            from gdg.report.contact_sheet import grasp_views  # heavy: pulls in VTK

            self._stages.stage("drawing")(0, 1)
            self._views = grasp_views(self._pair.hand, self._pair.obj, _pictured(grasps))
        if job.report and self._scene is None:
            from gdg.report.html import report_scene

            self._scene = report_scene(self._pair.hand, self._pair.obj, grasps)

    def write(self, grasps: GraspSet, folder: Path, config_text: str) -> None:
        """Writes what the job asks for; ``grasps`` are those drawn ahead, if any were."""
        if self._error is not None:
            raise self._error
        self._draw(grasps)
        if self._views is not None:
            from gdg.report.contact_sheet import write_sheet

            write_sheet(_pictured(grasps), self._views, folder / "grasps.png")
        if self._scene is not None:
            from gdg.report.html import html_report

            hand, obj, path = self._pair.hand, self._pair.obj, folder / "report.html"
            html_report(hand, obj, grasps, path, config_text, scene=self._scene)


def _pictured(grasps: GraspSet) -> GraspSet:
    return grasps.select(range(min(MAX_PICTURED, len(grasps))))
