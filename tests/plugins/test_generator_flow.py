"""The flow generator: its frames, patches, network, flow, weights files and training."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from gdg_plugins.generator_flow.flow import (
    contact_values,
    draw_times,
    flow_loss,
    integrate,
    on_the_way,
    standardised,
)
from gdg_plugins.generator_flow.frames import draw_frames
from gdg_plugins.generator_flow.generator import FlowGenerator
from gdg_plugins.generator_flow.module import WARM_UP_STEPS, FlowModule, learning_rate_share
from gdg_plugins.generator_flow.network import PATCHES, FlowNetwork
from gdg_plugins.generator_flow.options import FlowOptions
from gdg_plugins.generator_flow.patches import split_into_patches
from gdg_plugins.generator_flow.weights import SCHEMA, load_weights, save_weights
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from training_samples import data_of, same_weights, synthetic_groups, tiny_job

from gdg.errors import GdgError
from gdg.objects.model import ObjectModel, find_object
from gdg.rotations import random_rotations
from gdg.testing import assert_component
from gdg.training.batches import MapBatch
from gdg.training.fit import Fitted, fit
from gdg.weights_files import read_weights, write_weights

SMALL = {"width": 32, "layers": 2, "heads": 2}


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Tensors this small only wait for each other's threads, for long on a busy machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def some_surface(
    objects: int = 1, count: int = 192, seed: int = 0
) -> tuple[torch.Tensor, torch.Tensor]:
    """Points and normals of egg-like things without symmetry, (objects, count, 3)."""
    directions = torch.nn.functional.normalize(
        torch.randn(objects, count, 3, generator=seeded(seed)), dim=-1
    )
    bulge = 1 + 0.4 * directions[..., :1] + 0.2 * directions[..., 1:2]
    return directions * bulge * torch.tensor([0.07, 0.05, 0.03]), directions


@pytest.fixture(scope="module")
def network() -> FlowNetwork:
    """Random weights everywhere, so that no branch is trivial."""
    network = FlowNetwork(**SMALL)
    network.initialise(seeded())
    random = seeded(1)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.1 * torch.randn(parameter.shape, generator=random))
    return network.eval()


@pytest.fixture(scope="module")
def weights_file(network: FlowNetwork, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights") / "model.safetensors"
    save_weights(path, network, {"distance": "aligned/release", "train_objects": ["mug"]})
    return path


@pytest.fixture(scope="module")
def obj() -> ObjectModel:
    """An object without symmetry."""
    return find_object("mouse")


# -- frames ----------------------------------------------------------------------------------


def test_frames_are_rotations_and_follow_a_moved_object() -> None:
    points, _ = some_surface(4)
    center, axes = draw_frames(points, seeded(3))
    torch.testing.assert_close(axes.mT @ axes, torch.eye(3).expand(4, 3, 3), rtol=0, atol=1e-5)
    torch.testing.assert_close(torch.linalg.det(axes), torch.ones(4), rtol=0, atol=1e-5)
    turns = random_rotations(4, seeded(1))
    moved_center, moved_axes = draw_frames(points @ turns.mT + 0.3, seeded(3))
    torch.testing.assert_close(moved_center, center @ turns.mT + 0.3)
    torch.testing.assert_close(moved_axes, turns @ axes, rtol=0, atol=1e-4)


def test_frames_take_all_four_half_turns_and_keep_long_axes() -> None:
    points, _ = some_surface(1, 500)
    points = points * torch.tensor([4.0, 2.0, 1.0])
    axes = torch.cat([draw_frames(points, seeded(seed))[1] for seed in range(40)])
    assert (axes[:, 0, 0].abs() > 0.9).all()
    signs = {(bool(a), bool(b)) for a, b in zip(axes[:, 0, 0] > 0, axes[:, 1, 1] > 0)}
    assert len(signs) == 4


# -- patches ---------------------------------------------------------------------------------


@given(count=st.integers(1, 150), seed=st.integers(0, 5))
def test_patches_cover_every_point_and_give_its_value_back(count: int, seed: int) -> None:
    points, _ = some_surface(2, count, seed)
    patches = split_into_patches(points, 16)
    assert patches.members.shape == (2, 16, math.ceil(count / 16))
    assert all(set(row.flatten().tolist()) == set(range(count)) for row in patches.members)
    assert torch.equal(patches.scatter(patches.gather(points)), points)


def test_patches_are_compact() -> None:
    points, _ = some_surface(1, 2048)
    located = split_into_patches(points, PATCHES).gather(points)
    spread = (located - located.mean(2, keepdim=True)).norm(dim=-1)
    whole = (points - points.mean(1, keepdim=True)).norm(dim=-1)
    assert spread.mean() < 0.2 * whole.mean()


# -- network ---------------------------------------------------------------------------------


@torch.no_grad()
def test_permuted_points_give_permuted_values(network: FlowNetwork) -> None:
    points, normals = some_surface(2)
    noisy, time = torch.randn(2, 3, 192, generator=seeded()), torch.rand(2, 3, generator=seeded(2))
    order = torch.randperm(192, generator=seeded(3))
    out = network(network.surface(points, normals), noisy, time)
    surface = network.surface(points[:, order], normals[:, order])
    permuted = network(surface, noisy[..., order], time)
    torch.testing.assert_close(permuted, out[..., order], rtol=1e-3, atol=1e-4)


@torch.no_grad()
def test_batch_of_one_equals_the_batch(network: FlowNetwork) -> None:
    points, normals = some_surface(3)
    noisy, time = torch.randn(3, 2, 192, generator=seeded()), torch.rand(3, 2, generator=seeded(2))
    whole = network(network.surface(points, normals), noisy, time)
    for item in range(3):
        alone = network.surface(points[item : item + 1], normals[item : item + 1])
        for number in range(2):
            part = noisy[item : item + 1, number : number + 1]
            one = network(alone, part, time[item : item + 1, number : number + 1])
            torch.testing.assert_close(one[0, 0], whole[item, number], rtol=1e-3, atol=1e-4)


@torch.no_grad()
def test_every_part_of_the_input_matters(network: FlowNetwork) -> None:
    points, normals = some_surface()
    noisy, time = torch.randn(1, 1, 192, generator=seeded()), torch.full((1, 1), 0.5)
    out = network(network.surface(points, normals), noisy, time)
    others = (
        network(network.surface(2 * points, normals), noisy, time),
        network(network.surface(points, -normals), noisy, time),
        network(network.surface(points, normals), noisy, time / 2),
    )
    assert all((other - out).abs().mean() > 1e-3 for other in others)
    far = noisy.clone()
    far[0, 0, 0] += 5
    changed = (network(network.surface(points, normals), far, time) - out)[0, 0].abs() > 1e-6
    assert changed.float().mean() > 0.9, "a point's value reaches all patches"


@torch.no_grad()
def test_fresh_network_guesses_the_average_map() -> None:
    network, same, other = (FlowNetwork(**SMALL) for _ in range(3))
    for one, seed in ((network, 0), (same, 0), (other, 1)):
        one.initialise(seeded(seed))
    surface = network.surface(*some_surface())
    out = network(surface, torch.randn(1, 2, 192, generator=seeded()), torch.rand(1, 2))
    assert torch.equal(out, torch.zeros_like(out))
    assert torch.equal(network.value_in.weight, same.value_in.weight)
    assert not torch.equal(network.value_in.weight, other.value_in.weight)


# -- flow ------------------------------------------------------------------------------------


def test_contact_values_survive_the_flows_scale_and_are_cut_to_their_range() -> None:
    values = torch.rand(2, 50, generator=seeded())
    torch.testing.assert_close(contact_values(standardised(values)), values)
    assert contact_values(torch.tensor([-9.0, 9.0])).tolist() == [0.0, 1.0]


def test_path_leads_from_noise_to_the_map() -> None:
    clean, noise = torch.randn(2, 3, 5), torch.randn(2, 3, 5)
    assert torch.equal(on_the_way(clean, noise, torch.zeros(2, 3)), noise)
    assert torch.equal(on_the_way(clean, noise, torch.ones(2, 3)), clean)


def test_loss_is_the_squared_error_of_the_velocity() -> None:
    clean, noise, guess = torch.randn(3, 4, 7, generator=seeded()).unbind()
    time = torch.tensor([0.0, 0.3, 0.6, 0.9])
    velocity = (guess - on_the_way(clean, noise, time)) / (1 - time[:, None])
    expected = (velocity - (clean - noise)).square().mean(-1)
    torch.testing.assert_close(flow_loss(clean, guess, time), expected, rtol=1e-3, atol=1e-4)
    assert flow_loss(clean, guess, torch.ones(4)).isfinite().all()


@pytest.mark.parametrize("steps", [1, 2, 12])
def test_integration_reaches_the_only_map_there_is(steps: int) -> None:
    only = torch.rand(1, 9)
    torch.testing.assert_close(
        integrate(lambda maps, time: only, torch.randn(4, 9), steps)[2:3], only
    )


def test_integration_of_the_exact_flow_gives_its_distribution() -> None:
    """Two maps, −1 and +2, the second twice as frequent: the flow's best guess is known."""
    maps, weights = torch.tensor([-1.0, 2.0]), torch.tensor([1 / 3, 2 / 3])

    def predict(noisy: torch.Tensor, time: float) -> torch.Tensor:
        misses = (noisy[..., None] - time * maps).square() / (2 * (1 - time) ** 2)
        return (torch.softmax(weights.log() - misses, dim=-1) * maps).sum(-1)

    reached = integrate(predict, torch.randn(4000, 1, generator=seeded()), 50)
    near = (reached[..., None] - maps).abs().amin(-1)
    assert (near < 0.05).float().mean() > 0.95
    assert (reached > 0.5).float().mean().item() == pytest.approx(2 / 3, abs=0.05)


def test_times_are_between_noise_and_map_and_mostly_noisy() -> None:
    times = draw_times(torch.empty(500, 4), seeded())
    assert ((times > 0) & (times < 1)).all()
    assert 0.1 < times.median() < 0.2


# -- generate --------------------------------------------------------------------------------


def test_it_conforms(weights_file: Path) -> None:
    assert_component("generator", "flow", weights=str(weights_file), steps=2)


def test_same_seed_gives_same_maps(weights_file: Path, obj: ObjectModel) -> None:
    generator = FlowGenerator(FlowOptions(weights=str(weights_file), steps=3))
    first, second = (generator.generate(obj, 3, seeded(5)) for _ in range(2))
    assert torch.equal(first.values, second.values)
    assert first.values.shape == (3, len(obj.points))
    assert 0 <= first.values.min() < first.values.max() <= 1
    assert not torch.allclose(first.values[0], first.values[1])
    assert not first.values.requires_grad


@pytest.mark.parametrize("points", [2048, 101])
def test_maps_do_not_depend_on_how_many_are_asked_for(
    weights_file: Path, obj: ObjectModel, points: int
) -> None:
    part = replace(obj, points=obj.points[:points], normals=obj.normals[:points])
    at_once = FlowGenerator(FlowOptions(weights=str(weights_file), steps=2))
    in_parts = FlowGenerator(FlowOptions(weights=str(weights_file), steps=2, batch=2))
    many = at_once.generate(part, 5, seeded()).values
    assert (in_parts.generate(part, 5, seeded()).values - many).abs().max() < 1e-4
    assert (at_once.generate(part, 2, seeded()).values - many[:2]).abs().max() < 1e-4


def test_moved_object_gets_the_same_maps(weights_file: Path, obj: ObjectModel) -> None:
    generator = FlowGenerator(FlowOptions(weights=str(weights_file), steps=3))
    turn = random_rotations(1, seeded(4))[0]
    moved = replace(obj, points=obj.points @ turn.T + 0.1, normals=obj.normals @ turn.T)
    before, after = (generator.generate(one, 4, seeded()).values for one in (obj, moved))
    # points at the edge of a patch may change it by rounding
    assert (before - after).abs().mean() < 0.01 * (before[0] - before[1]).abs().mean()


def test_maps_say_where_they_come_from(weights_file: Path, obj: ObjectModel) -> None:
    maps = FlowGenerator(FlowOptions(weights=str(weights_file), steps=1)).generate(obj, 1, seeded())
    assert maps.object_name == "mouse"
    assert maps.distance == "aligned/release"
    assert maps.provenance["training"] == {"train_objects": ["mug"]}
    assert len(maps.provenance["weights_sha256"]) == 64


# -- weights files ---------------------------------------------------------------------------


def test_weights_come_back_in_half_precision(network: FlowNetwork, weights_file: Path) -> None:
    weights = load_weights(str(weights_file))
    assert (weights.size, weights.provenance) == (SMALL, {"train_objects": ["mug"]})
    for name, tensor in weights.network().state_dict().items():
        torch.testing.assert_close(tensor, network.state_dict()[name], rtol=1e-3, atol=1e-6)


def test_foreign_weights_are_refused(network: FlowNetwork, tmp_path: Path) -> None:
    path = tmp_path / "other.safetensors"
    known = {"distance": "aligned/release", "network": SMALL}

    def reading(schema: str = SCHEMA, drop: str = "", **metadata: object) -> FlowNetwork:
        state = {name: value for name, value in network.state_dict().items() if name != drop}
        write_weights(path, state, schema, {**known, **metadata})
        return load_weights(str(path)).network()

    assert reading().size == SMALL
    with pytest.raises(GdgError, match="schema is 'gdg-cvae-1', expected 'gdg-flow-1'"):
        reading(schema="gdg-cvae-1")
    with pytest.raises(GdgError, match="doesn't say which distance"):
        reading(distance=None)
    with pytest.raises(GdgError, match=r"'value_in\.weight' is missing"):
        reading(drop="value_in.weight")
    with pytest.raises(GdgError, match="has shape"):
        reading(network={**SMALL, "width": 64})
    for size in (None, {"width": 32}, {**SMALL, "width": 10**9}, {**SMALL, "heads": 3}):
        with pytest.raises(GdgError, match="how large the network is"):
            reading(network=size)
    with pytest.raises(GdgError, match="no bundled weights 'no-such'"):
        load_weights("no-such")


def test_full_network_is_small_enough_to_bundle(tmp_path: Path) -> None:
    options = FlowOptions()
    network = FlowNetwork(options.width, options.layers, options.heads)
    save_weights(tmp_path / "a.safetensors", network, {"distance": "aligned/release"})
    assert (tmp_path / "a.safetensors").stat().st_size < 4e6
    read = read_weights(tmp_path / "a.safetensors", SCHEMA, {})
    assert {tensor.dtype for tensor in read.state.values()} == {torch.float16}


def test_heads_must_divide_the_width() -> None:
    with pytest.raises(ValidationError, match="heads=3 doesn't divide width=128"):
        FlowOptions(heads=3)


# -- training --------------------------------------------------------------------------------


def a_batch(seed: int = 0) -> MapBatch:
    """Contact at one end or the other of each thing."""
    points, normals = some_surface(4, 128, seed)
    sides = torch.tensor([1.0, -1.0, 1.0, -1.0])[:, None]
    return MapBatch(points, torch.sigmoid(60 * sides * points[..., 0] - 1), normals)


def logging_module(seed: int = 0) -> tuple[FlowModule, dict[str, torch.Tensor]]:
    module = FlowModule(FlowOptions(**SMALL, draws=2), learning_rate=1e-3, seed=seed)
    logged: dict[str, torch.Tensor] = {}
    module.log_dict = lambda values, **how: logged.update(values)  # type: ignore[method-assign]
    return module, logged


def test_training_lowers_both_losses() -> None:
    module, logged = logging_module()
    optimizer = torch.optim.Adam(module.parameters(), lr=3e-3)
    module.validation_step(a_batch(), 0)
    before, losses = logged["val_recon"].item(), []
    for index in range(60):
        optimizer.zero_grad()
        loss = module.training_step(a_batch(), index)
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    module.validation_step(a_batch(), 0)
    assert losses[-1] < 0.7 * losses[0]
    assert logged["val_recon"].item() < 0.8 * before


def test_steps_follow_the_seed_and_validation_does_not() -> None:
    (module, logged), (same, _), (other, others) = (logging_module(seed) for seed in (0, 0, 1))
    for one in (module, same, other):
        torch.nn.init.ones_(one.network.value_out.weight)
    losses = [one.training_step(a_batch(), 7).item() for one in (module, same, other)]
    assert losses[0] == losses[1] != losses[2]
    assert module.training_step(a_batch(), 8).item() != losses[0]
    other.load_state_dict(module.state_dict())
    module.validation_step(a_batch(), 0)
    first = dict(logged)
    other.validation_step(a_batch(), 0)
    assert first == others | {"train_loss": first["train_loss"]}


class Stopped(Exception):
    pass


class StoppingModule(FlowModule):
    """Is stopped in the middle of its second epoch."""

    def training_step(self, batch: MapBatch, batch_index: int) -> torch.Tensor:
        if self.global_step == 4:
            raise Stopped
        return super().training_step(batch, batch_index)


def test_resumed_run_equals_an_uninterrupted_one_and_is_exported(tmp_path: Path) -> None:
    options, groups = FlowOptions(**SMALL, draws=1), synthetic_groups(24)
    settings = {"batch": 8, "keep": "best", "ema_decay": 0.9, "checkpoint_steps": 1}

    def run(folder: str, module: type[FlowModule], resume: bool = False) -> Fitted:
        job = tiny_job(**settings, resume=resume)
        data = data_of(job, groups, groups)
        return fit(module(options, learning_rate=1e-3, seed=0), data, job, tmp_path / folder)

    whole = run("whole", FlowModule)
    with pytest.raises(Stopped):
        run("parts", StoppingModule)
    resumed = run("parts", FlowModule, resume=True)
    assert same_weights(whole.module.state_dict(), resumed.module.state_dict())
    assert whole.val_recon is not None
    assert math.isfinite(whole.val_recon)
    path = tmp_path / "model.safetensors"
    FlowGenerator.export(whole.module, path, {"distance": "aligned/release", "hands": ["a"]})
    weights = load_weights(str(path))
    assert (weights.size, weights.provenance) == (SMALL, {"hands": ["a"]})
    exported, trained = weights.network().state_dict(), whole.module.network.state_dict()
    torch.testing.assert_close(exported, trained, rtol=1e-3, atol=1e-6)


def test_learning_rate_rises_then_falls() -> None:
    rising = [learning_rate_share(step, 0, 10) for step in range(WARM_UP_STEPS)]
    assert rising == sorted(rising)
    assert rising[-1] == 1
    falling = [learning_rate_share(10**4, epoch, 10) for epoch in range(10)]
    assert falling == sorted(falling, reverse=True)
    assert 0 < falling[-1] < 0.1
