"""``gdg objects``."""

from __future__ import annotations

import click

from gdg.cli.listing import print_folders
from gdg.folders import OBJECTS, FoundFolder
from gdg.objects.spec import read_object_spec


@click.group()
def objects() -> None:
    """List and show objects."""


@objects.command("list")
def list_objects() -> None:
    """List every object that a name can mean, its split and where it lies."""
    print_folders(OBJECTS, _describe)


def _describe(folder: FoundFolder) -> str:
    if folder.path.is_file():
        return "mesh file"
    spec = read_object_spec(folder.path)
    return f"{spec.split:<5} {spec.title}"


@objects.command("show")
@click.argument("object_name", metavar="OBJECT")
@click.option("--scale", default=1.0, help="Factor from the mesh's unit to metres.")
def show_object(object_name: str, scale: float) -> None:
    """Show size, volume and checks of OBJECT (a name, a folder or a mesh file)."""
    from rich.console import Console

    from gdg.objects.model import find_object

    obj, console = find_object(object_name, scale), Console()
    size = " × ".join(f"{1000 * extent:.0f}" for extent in obj.mesh.extents)
    console.print(f"{obj.name}: {size} mm, {len(obj.mesh.faces)} faces ({obj.path})", markup=False)
    console.print(f"volume {1e6 * obj.volume:.1f} cm³, split {obj.split or 'none'}")
    for note in obj.notes:
        console.print(f"note: {note}", markup=False)
