"""How the weights of the tables are trained: each network's settings, and whole commands. Light."""

from __future__ import annotations

from gdg.bench.tables import Method

#: Component -> settings of ``gdg train`` beside data, split and folder.
RECIPES: dict[str, tuple[str, ...]] = {
    "cvae": (
        "precision=bf16-mixed", "batch=64", "learning_rate=1e-3", "points=256", "epochs=36",
    ),
    "flow": (
        "precision=bf16-mixed", "batch=32", "learning_rate=1e-3", "gradient_clip=1",
        "ema_decay=0.998", "points=2048", "epochs=6",
    ),
    "graspcvae": (
        "batch=64", "points=256", "learning_rate=1e-3", "epochs=80", "ema_decay=0.999",
    ),
    "unigrasp": (
        "batch=64", "points=256", "learning_rate=1e-3", "epochs=40", "augment.rotation=full",
        "patience=10",
    ),
}  # fmt: skip
#: The same with a hand held out, where there are fewer grasps: about as many steps in all.
HELD_OUT = {"flow": (*RECIPES["flow"][:-1], "epochs=7")}


def recipe(component: str, held_out: bool = False) -> tuple[str, ...]:
    """The settings that train a component; none where we know of no better than the defaults.

    Args:
        component: name of the generator or planner.
        held_out: whether one of the hands is held out.
    """
    usual = RECIPES.get(component, ())
    return HELD_OUT.get(component, usual) if held_out else usual


def folder_name(method: Method, component: str) -> str:
    """What a row's weights are called in the user's folder: the network, and what it has seen."""
    return f"{component}-{method.hand if method.planner_weights else method.weights}"


def train_command(method: Method, component: str) -> str:
    """The command that trains a row's weights so that ``weights=runs/weights`` finds them.

    Args:
        method: the row.
        component: name of the generator, or of the row's planner where that has the weights.
    """
    if method.planner_weights:
        words = [f"planner={component}", f"hand={method.hand}", "split=paper"]
    else:
        words = [f"generator={component}", f"distance={method.distance}"]
        held_out = method.held_out
        without = [f"split=paper-without-{held_out}", f"exclude_hand={held_out}"]
        words += without if held_out else ["split=paper"]
    settings = recipe(component, bool(method.held_out))
    out = f"out=runs/weights/{folder_name(method, component)}"
    return " ".join(["gdg train data=DATASET", *words, *settings, out])
