"""``gdg plugins``."""

from __future__ import annotations

import click

from gdg.registry import get_registry


@click.command()
@click.option("--options", is_flag=True, help="List each component's options and defaults too.")
def plugins(options: bool) -> None:
    """List components by kind, and the plugins that failed to load."""
    registry = get_registry()
    kind = ""
    for component in registry.components():
        if component.kind != kind:
            kind = component.kind
            click.secho(kind, bold=True)
        missing = component.missing_requirements()
        note = f"  [needs {', '.join(missing)}]" if missing else ""
        origin = f"{component.distribution} {component.version}"
        click.echo(f"  {component.name:<20} {component.summary}  ({origin}){note}")
        if options:
            for name, field in component.options.model_fields.items():
                click.echo(f"      {name} = {field.default!r}")
    for plugin in registry.plugins:
        if plugin.failure:
            click.secho(f"FAILED {plugin.name} ({plugin.distribution} {plugin.version})", fg="red")
            click.echo(f"  {plugin.failure}")
