"""``gdg grasp``."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import click

from gdg.cli.settings import configs_from, single, takes_settings
from gdg.config import RunConfig
from gdg.pipeline.jobs import DEFAULTS, GraspJob
from gdg.pipeline.judges import Judges


@click.command()
@takes_settings(GraspJob, DEFAULTS)
def grasp(settings: tuple[str, ...], files: tuple[Path, ...]) -> None:
    """Plan grasps of one object with one hand, test them in simulation, draw them.

    With verified=true it goes on until n grasps pass the test, and gives these alone. More is
    proposed in the same time then: each grasp is fitted to one contact map, and trials that cannot
    change a verdict are left out, unless settings say otherwise.

    Writes grasps.json (named joints, 4x4 poses, verdicts), config.yaml, grasps.png and
    report.html into the run folder.
    """
    config = single(configs_from(GraspJob, DEFAULTS, files, settings))
    with Judges.of_job(config) as judges:
        _grasp(config, judges)


def _grasp(config: RunConfig, judges: Judges) -> None:
    from rich.console import Console

    from gdg.cli.progress import BarStages, bars
    from gdg.data.verdict import left_out_of
    from gdg.pipeline.grasp import OUTPUTS, run_grasp
    from gdg.report.table import summary_line, verdict_table

    with bars() as progress:
        run = run_grasp(config, BarStages(progress), judges)
    console = Console()
    if len(run.grasps) == 0:
        told = run.grasps.provenance
        reasons = Counter(told.get("rejected", {})) + Counter(told.get("yield", {}).get("failed"))
        counted = ", ".join(f"{n} × {why}" for why, n in reasons.items() if n) or "no candidates"
        console.print(f"No grasp found ({counted}).", markup=False)
    else:
        console.print(verdict_table(run.grasps))
        console.print(summary_line(run.grasps), markup=False)
    for sentence in left_out_of(run.grasps.verdicts):
        console.print(f"Note on the test: {sentence}", markup=False)
    for note in run.grasps.provenance.get("object_notes", ()):
        console.print(f"Note on {run.grasps.object_name}: {note}.", markup=False)
    if 0 < len(run.grasps) < config.job.n:
        console.print(f"{len(run.grasps)} of the {config.job.n} grasps asked for were found.")
    for name in OUTPUTS:
        if (run.folder / name).exists():
            console.print(f"  {run.folder / name}", markup=False, soft_wrap=True)
