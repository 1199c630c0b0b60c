"""For all tests: shape checks on, a cache and data directories of their own, common fixtures."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

# as the command line does; before torch is imported
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import pytest
import torch
from hypothesis import settings
from jaxtyping import install_import_hook

# the same examples in every run; imports and first calls take as long as they take
settings.register_profile("gdg", deadline=None, derandomize=True, database=None, max_examples=50)
settings.load_profile("gdg")

# Every annotated function and dataclass of these is checked when it is called. The rest (command
# line, config, registry) handles no arrays, and checking it would add seconds to each run;
# gdg.nearest, gdg.penetration and gdg.placement hold functions compiled by numba, which can't
# compile the checker.
install_import_hook(
    [
        "gdg.contact_maps", "gdg.data", "gdg.force_closure", "gdg.geometry",
        "gdg.hands", "gdg.initial_poses", "gdg.kinds", "gdg.metrics", "gdg.objects",
        "gdg.quality.fingers", "gdg.quality.overlap",
        "gdg.quality.wrench_space", "gdg.rotations", "gdg.starts", "gdg.training", "gdg_plugins",
    ],
    "beartype.beartype",
)  # fmt: skip

from environments import build, link_other_packages  # noqa: E402
from environments import no_network as no_network_variables  # noqa: E402
from gripper import write_gripper  # noqa: E402
from real_hands import assemble, have_assets  # noqa: E402

from gdg.hands.hand import Hand, load_hand  # noqa: E402
from gdg.kinds.hand_model import HandModel  # noqa: E402
from gdg.objects.model import ObjectModel, find_object  # noqa: E402
from gdg.registry import get_registry  # noqa: E402


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds what is too slow for every run."""
    parser.addoption(
        "--every-hand",
        action="store_true",
        help="propose manifests for every made-up hand, in scrambled frames, too (many minutes)",
    )
    parser.addoption(
        "--every-moment",
        action="store_true",
        help="kill workers, drivers and Ray nodes of gdg synth at 20 moments, not 6 (minutes)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Keeps the user's cache, hands, objects and plugins out; the cache outlives the run."""
    assert config.cache is not None
    os.environ["GDG_CACHE"] = str(config.cache.mkdir("gdg"))
    os.environ["XDG_DATA_HOME"] = str(config.cache.mkdir("gdg-user-data"))
    for variable in ("GDG_HANDS_PATH", "GDG_OBJECTS_PATH", "GDG_STRICT_PLUGINS"):
        os.environ.pop(variable, None)
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def real_hands(pytestconfig: pytest.Config) -> Path:
    """A folder with the makers' five hands; skips where the asset folder is missing."""
    if not have_assets():
        pytest.skip("no asset folder (GDG_TEST_ASSETS)")
    assert pytestconfig.cache is not None
    return assemble(pytestconfig.cache.mkdir("real-hands"))


@pytest.fixture(scope="session")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the work tree, which builds would litter."""
    folder = tmp_path_factory.mktemp("copy") / "gdg"
    ignored = ("build", "dist", "*.egg-info", "__pycache__", ".*", "demo", "runs")
    root = Path(__file__).resolve().parents[1]
    shutil.copytree(root, folder, ignore=shutil.ignore_patterns(*ignored))
    return folder


@pytest.fixture(scope="session")
def wheel(copy: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """gdg's wheel, alone in its folder."""
    return build(copy, tmp_path_factory.mktemp("wheel"), "wheel")


@pytest.fixture(scope="session")
def no_network(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables with which a fresh environment finds gdg's wheel and all that gdg needs."""
    others = link_other_packages(tmp_path_factory.mktemp("others") / "site-packages")
    return no_network_variables(wheel.parent, others)


@pytest.fixture(scope="session")
def gripper(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    """The two-jaw gripper that can be predicted by hand."""
    return load_hand(write_gripper(tmp_path_factory.mktemp("hands")))


@pytest.fixture(scope="session")
def gripper_model(gripper: Hand) -> HandModel:
    """The two-jaw gripper as a hand model on the processor."""
    return build_model(gripper)


@pytest.fixture(scope="session")
def cube() -> ObjectModel:
    """The bundled cube of 40 mm."""
    return find_object("cube_small")


def build_model(hand: Hand, points: int = 200) -> HandModel:
    """A hand's model by the built-in kinematics."""
    record = get_registry().find("hand-model", "pytorch-kinematics")
    return record.load()(record.options(surface_points=points), hand, torch.device("cpu"))


@pytest.fixture
def generator() -> torch.Generator:
    """Randomness from a fixed seed."""
    return torch.Generator().manual_seed(0)
