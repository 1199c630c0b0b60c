"""``gdg eval``."""

from __future__ import annotations

from pathlib import Path

import click

from gdg.cli.settings import configs_from, takes_settings
from gdg.pipeline.jobs import DEFAULTS, EvalJob


@click.command()
@takes_settings(EvalJob, DEFAULTS)
def evaluate(settings: tuple[str, ...], files: tuple[Path, ...]) -> None:
    """Plan and test every cell of a grid (commas span it) and sum it up.

    Finished cells are kept in the output folder and never run twice; grasps are planned once
    and tested under each protocol, simulator and refinement. Prints success with its 95 %
    interval, diversity, penetration and time; writes summary.md, .csv, .json and .png, and
    agreement.md where there are several simulators. docs/evaluation.md explains every column.
    """
    configs = configs_from(EvalJob, DEFAULTS, files, settings)
    from gdg.cli.evaluated import cell_bar, print_table
    from gdg.evaluation.agreement import agreement_lines
    from gdg.evaluation.run import run_eval
    from gdg.evaluation.tables import BRIEF, cells, header, measured_on

    with cell_bar() as report:
        done = run_eval(configs, report)
    print_table(header(done.rows, BRIEF), [cells(row, BRIEF) for row in done.rows])
    for sentence in measured_on(done.rows):
        click.echo(sentence)
    for agreement in done.agreements:
        click.echo("\n" + "\n".join(agreement_lines(agreement)))
    click.echo(f"  {done.folder / 'summary.md'}")
