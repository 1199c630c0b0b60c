"""What ``gdg bench`` takes. Light: imports nothing heavy."""

from __future__ import annotations

from gdg.pipeline.jobs import Count, EvalJob

#: Settings of ``--quick``, which any that the user gives replace: a look at whether all runs.
QUICK = (
    "n=2", "out=runs/bench-quick", "fitter.particles=8", "fitter.steps=30",
    "hand_model.surface_points=600",
)  # fmt: skip
#: Objects of ``--quick``.
QUICK_OBJECTS = 2
#: What a table sets itself: these, and all options of the planner.
SET_BY_TABLE = ("hand", "planner", "distance", "generator.weights")
#: Settings of which there can be one value only.
NOT_SWEPT = ("n", "out", "engine", "workers", "threads", "ray_address", "cell_timeout_s", "weights")


class BenchJob(EvalJob):
    """What ``gdg bench`` takes; commas in protocol, simulator, refine and the like add rows.

    Attributes:
        hand: set by the table.
        object: by default the ten test objects: the real ones where GDG_TEST_ASSETS names a folder
            that has them, else the bundled ones.
        n: grasps per object and seed; a method that finds fewer by design is asked for those.
        weights: folder with weights that are not bundled: NAME.safetensors, or
            NAME/model.safetensors as gdg train out=FOLDER/NAME writes it; NAME is the network's and
            what it has seen, e.g. cvae-without-barrett.
        out: folder of the tables and of the cells that they share.
    """

    hand: str = ""
    object: str = ""
    n: Count = 32
    protocol: str = "gendexgrasp-2022"
    weights: str = ""
    out: str = "runs/bench"
