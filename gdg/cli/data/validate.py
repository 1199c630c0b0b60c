"""``gdg data validate``."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from gdg.text import one_line


@click.command("validate")
@click.argument("path", type=click.Path(path_type=Path))
@click.option(
    "--remove",
    is_flag=True,
    help="Move damaged files into PATH/.corrupt; gdg synth makes them anew.",
)
@click.option(
    "--no-assets", is_flag=True, help="Don't compare with the hands and objects found here."
)
def validate(path: Path, remove: bool, no_assets: bool) -> None:
    """Check every file of the dataset in PATH, and tell all mistakes at once.

    Reads all rows: checksums, schema, rigid poses, finite values, joint names and limits, names of
    files and folders, duplicates; and says which hands and objects have changed since. Ends with 2
    if there is any mistake, with 0 if there are none or only warnings.
    """
    from gdg.cli.progress import bars
    from gdg.data.shards import shard_files
    from gdg.data.validate import check_dataset, set_aside
    from gdg.pipeline.data_checks import AssetChecks

    with bars() as progress:
        task = progress.add_task("files", total=None)
        findings = check_dataset(
            path,
            None if no_assets else AssetChecks(),
            lambda done, total: progress.update(task, completed=done, total=total),
        )
    checked = len(shard_files(path))
    for finding in findings:
        click.echo(f"{finding.severity}: {one_line(str(finding))}")
    if remove:
        for moved in set_aside(path, findings):
            click.echo(f"moved: {moved}")
    errors = sum(finding.severity == "error" for finding in findings)
    warnings = len(findings) - errors
    counts = [f"{errors} error(s)"] * bool(errors) + [f"{warnings} warning(s)"] * bool(warnings)
    click.echo(f"{path}: {checked} files, {' and '.join(counts) or 'no mistake found'}")
    if errors:
        if any(finding.damaged for finding in findings) and not remove:
            click.echo(f"Next: gdg data validate {path} --remove, then gdg synth as before")
        sys.exit(2)
