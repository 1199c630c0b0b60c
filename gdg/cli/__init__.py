"""The ``gdg`` command. Light: each subcommand's module is imported when it is used."""

from __future__ import annotations

import os
import sys

import click

import gdg
from gdg.cli.lazy import LazyCommands
from gdg.errors import GdgError
from gdg.garbage import look_rarely
from gdg.text import one_line

#: Subcommand -> "module:command", in the order of ``gdg --help``.
COMMANDS = {
    "grasp": ("gdg.cli.grasp:grasp", "Plan and test grasps of one object with one hand."),
    "eval": ("gdg.cli.evaluate:evaluate", "Test a grid of hands, objects and settings."),
    "bench": ("gdg.cli.bench:bench", "Repeat a table of the paper beside its numbers."),
    "synth": ("gdg.cli.synth:synth", "Synthesise a dataset of force-closure grasps."),
    "train": ("gdg.cli.train:train", "Train a contact-map generator on a dataset."),
    "data": ("gdg.cli.data:data", "Inspect, check, merge and split datasets."),
    "hands": ("gdg.cli.hands:hands", "List, show and check hands."),
    "objects": ("gdg.cli.objects:objects", "List and show objects."),
    "plugins": ("gdg.cli.plugins:plugins", "List components, plugins and what is broken."),
}


@click.group(
    cls=LazyCommands, targets=COMMANDS, context_settings={"help_option_names": ["-h", "--help"]}
)
@click.version_option(gdg.__version__, prog_name="gdg")
def cli() -> None:
    """Generalizable dexterous grasping: any robot hand, any object.

    Settings are written key=value: component=name swaps a component, component.option=value sets
    one of its options, and commas sweep. For example:

    \b
      gdg grasp hand=allegro object=mug n=16
      gdg grasp hand=./my_hand object=part.stl fitter.particles=64
      gdg eval hand=allegro,barrett object=test distance=aligned,euclidean
    """


def main() -> None:
    """Entry point: a user's mistake is one clear message on stderr and exit code 2."""
    # Threads that spin while they wait for each other slow torch down a hundredfold on a busy
    # machine; this must be said before torch is imported, and workers inherit it.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    look_rarely()
    try:
        cli(standalone_mode=False)
    except GdgError as error:
        for line in str(error).splitlines():
            click.echo(f"Error: {one_line(line)}", err=True)
        sys.exit(2)
    except click.ClickException as error:
        error.show()
        sys.exit(2)
    except OSError as error:
        click.echo(f"Error: {error.filename or 'file system'}: {error.strerror or error}", err=True)
        sys.exit(2)
    except (KeyboardInterrupt, click.Abort):
        click.echo("Interrupted: what was finished before is kept.", err=True)
        sys.exit(130)
