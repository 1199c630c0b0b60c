"""The CVAE generator: its network, its weights files and its loss."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from gdg_plugins.generator_cvae import release
from gdg_plugins.generator_cvae.generator import CvaeGenerator
from gdg_plugins.generator_cvae.loss import kl_divergence, kl_weight, reconstruction_loss
from gdg_plugins.generator_cvae.module import CvaeModule
from gdg_plugins.generator_cvae.network import LATENT, PointNetCvae
from gdg_plugins.generator_cvae.options import CvaeOptions
from gdg_plugins.generator_cvae.weights import load_weights, save_weights
from safetensors.torch import save_file

from gdg.errors import GdgError
from gdg.objects.model import ObjectModel, find_object, load_object
from gdg.training.batches import MapBatch

REPOSITORY = Path(__file__).resolve().parents[2]
ASSETS = Path(os.environ.get("GDG_TEST_ASSETS", REPOSITORY.parent / "shared" / "assets"))
RELEASED = sorted((ASSETS / "checkpoints").glob("*.pth"))
needs_released_weights = pytest.mark.skipif(
    not RELEASED, reason="no released checkpoints (GDG_TEST_ASSETS)"
)


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Tensors this small only wait for each other's threads, for long on a busy machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def network() -> PointNetCvae:
    """Random weights and random batch-norm statistics, so that no layer is trivial."""
    network = PointNetCvae()
    network.initialise(seeded())
    for name, buffer in network.named_buffers():
        if name.endswith("running_mean"):
            buffer.copy_(0.1 * torch.randn(buffer.shape, generator=seeded(1)))
        if name.endswith("running_var"):
            buffer.copy_(0.5 + torch.rand(buffer.shape, generator=seeded(2)))
    return network.eval()


@pytest.fixture(scope="module")
def weights_file(network: PointNetCvae, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights") / "model.safetensors"
    save_weights(path, network, {"distance": "aligned/release", "train_objects": ["mug"]})
    return path


def released_state(network: PointNetCvae) -> dict[str, torch.Tensor]:
    """The network's tensors under the release's names and in its layout."""
    state = {}
    for name, tensor in network.state_dict().items():
        convolution = name.endswith("linear.weight")
        state[release.TENSOR_NAMES[name]] = tensor[:, :, None] if convolution else tensor
    return state


@pytest.fixture(scope="module")
def obj() -> ObjectModel:
    return find_object("apple")


# -- network ---------------------------------------------------------------------------------


def test_network_has_the_81_tensors_of_the_release(network: PointNetCvae) -> None:
    state = network.state_dict()
    assert set(release.TENSOR_NAMES) == set(state)
    assert len(set(release.TENSOR_NAMES.values())) == len(state) == 81
    assert sum(tensor.numel() for tensor in state.values()) == 691_280


@torch.no_grad()
def test_network_equals_convolutions_on_the_whole_concatenation(network: PointNetCvae) -> None:
    """The release's form, written out: 1×1 convolutions, batch norms, explicit concatenation."""
    state = released_state(network)
    points, latent = torch.randn(2, 50, 3, generator=seeded()), torch.randn(2, LATENT)

    def layer(group: str, index: int, x: torch.Tensor) -> torch.Tensor:
        kernel = f"decoder.{group}_conv_layers.{index}"
        x = torch.nn.functional.conv1d(x, state[f"{kernel}.weight"], state[f"{kernel}.bias"])
        norm = f"decoder.{group}_bn_layers.{index}"
        names = ("running_mean", "running_var", "weight", "bias")
        return torch.nn.functional.batch_norm(x, *(state[f"{norm}.{name}"] for name in names))

    own = layer("pointwise", 1, layer("pointwise", 0, points.transpose(1, 2)).relu())
    overall = layer("global", 1, layer("global", 0, own).relu()).amax(2)
    shared = torch.cat((overall, latent), 1)[:, :, None].expand(-1, -1, 50)
    x = torch.cat((own, shared), 1)
    for index in range(4):
        x = layer("decoder", index, x if index == 0 else x.relu())
    torch.testing.assert_close(network.decoder(points, latent), x[:, 0].sigmoid())


@torch.no_grad()
def test_training_form_equals_evaluation_form_on_the_batch_statistics() -> None:
    network = PointNetCvae()
    network.initialise(seeded())
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm1d):
            module.momentum = 1.0
    points = torch.randn(16, 200, 3, generator=seeded())
    values = torch.rand(16, 200, generator=seeded())
    noise = torch.randn(16, LATENT, generator=seeded())
    trained = network.train()(points, values, noise)
    evaluated = network.eval()(points, values, noise)
    # not equal: running variances are the unbiased ones, 1/3200 larger
    for a, b in zip(trained, evaluated, strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0.02)


@torch.no_grad()
def test_permuted_points_give_permuted_values(network: PointNetCvae) -> None:
    points, values = torch.randn(2, 64, 3, generator=seeded()), torch.rand(2, 64)
    order = torch.randperm(64, generator=seeded())
    noise = torch.randn(2, LATENT, generator=seeded())
    out, mean, _ = network(points, values, noise)
    permuted, permuted_mean, _ = network(points[:, order], values[:, order], noise)
    torch.testing.assert_close(permuted, out[:, order])
    torch.testing.assert_close(permuted_mean, mean)


@torch.no_grad()
def test_batch_of_one_equals_the_batch(network: PointNetCvae) -> None:
    points, latent = torch.randn(3, 64, 3, generator=seeded()), torch.randn(3, LATENT)
    batch = network.decoder(points, latent)
    for index in range(3):
        one = network.decoder(points[index : index + 1], latent[index : index + 1])
        torch.testing.assert_close(one[0], batch[index])
    shared = network.decoder(points[:1], latent)
    torch.testing.assert_close(shared, network.decoder(points[:1].expand(3, -1, -1), latent))


def test_initial_weights_follow_the_seed() -> None:
    first, second, other = PointNetCvae(), PointNetCvae(), PointNetCvae()
    for network, seed in ((first, 0), (second, 0), (other, 1)):
        network.initialise(seeded(seed))
    kernel = first.decoder.layers[0].linear.weight
    assert torch.equal(kernel, second.decoder.layers[0].linear.weight)
    assert not torch.equal(kernel, other.decoder.layers[0].linear.weight)
    assert kernel.std().item() == pytest.approx(math.sqrt(2 / (704 + 512)), rel=0.02)


# -- generate --------------------------------------------------------------------------------


def test_same_seed_gives_same_maps(weights_file: Path, obj: ObjectModel) -> None:
    generator = CvaeGenerator(CvaeOptions(weights=str(weights_file)))
    first, second = (generator.generate(obj, 3, seeded(5)) for _ in range(2))
    assert torch.equal(first.values, second.values)
    assert first.values.shape == (3, len(obj.points))
    assert 0 < first.values.min() <= first.values.max() < 1
    assert not torch.allclose(first.values[0], first.values[1])
    assert not first.values.requires_grad


def test_maps_do_not_depend_on_how_many_are_asked_for(weights_file: Path, obj: ObjectModel) -> None:
    at_once = CvaeGenerator(CvaeOptions(weights=str(weights_file), batch=16))
    in_parts = CvaeGenerator(CvaeOptions(weights=str(weights_file), batch=2))
    many = at_once.generate(obj, 5, seeded()).values
    torch.testing.assert_close(in_parts.generate(obj, 5, seeded()).values, many)
    torch.testing.assert_close(at_once.generate(obj, 2, seeded()).values, many[:2])


def test_zero_temperature_gives_one_map(weights_file: Path, obj: ObjectModel) -> None:
    generator = CvaeGenerator(CvaeOptions(weights=str(weights_file), temperature=0.0))
    values = generator.generate(obj, 2, seeded()).values
    torch.testing.assert_close(values[0], values[1])


def test_maps_say_where_they_come_from(weights_file: Path, obj: ObjectModel) -> None:
    maps = CvaeGenerator(CvaeOptions(weights=str(weights_file))).generate(obj, 1, seeded())
    assert maps.object_name == "apple"
    assert maps.distance == "aligned/release"
    assert maps.provenance["training"] == {"train_objects": ["mug"]}
    assert len(maps.provenance["weights_sha256"]) == 64


# -- weights files ---------------------------------------------------------------------------


def test_released_layout_is_read_into_ours(network: PointNetCvae, tmp_path: Path) -> None:
    torch.save(released_state(network), tmp_path / "released.pth")
    weights = load_weights(str(tmp_path / "released.pth"))
    assert weights.distance == "aligned/release"
    assert weights.provenance["source"] == "unknown"
    for name, tensor in weights.network().state_dict().items():
        assert torch.equal(tensor, network.state_dict()[name])


def test_wrong_shape_is_named(network: PointNetCvae, tmp_path: Path) -> None:
    state = released_state(network)
    state["decoder.decoder_conv_layers.0.weight"] = torch.zeros(512, 700, 1)
    torch.save(state, tmp_path / "other.pth")
    with pytest.raises(GdgError, match=r"other\.pth: .*decoder\.layers\.0\.linear\.weight.*700"):
        load_weights(str(tmp_path / "other.pth")).network()


def test_missing_superfluous_and_infinite_tensors_are_named(
    network: PointNetCvae, tmp_path: Path
) -> None:
    path = tmp_path / "other.pth"
    state = released_state(network)
    torch.save({**state, "discriminator.weight": torch.zeros(1)}, path)
    with pytest.raises(GdgError, match=r"has no tensor 'discriminator\.weight'"):
        load_weights(str(path)).network()
    torch.save({**state, "encoder_z_means.bias": torch.full((128,), math.nan)}, path)
    with pytest.raises(GdgError, match=r"encoder\.mean\.bias.*not finite"):
        load_weights(str(path)).network()
    del state["encoder_z_means.bias"]
    torch.save(state, path)
    with pytest.raises(GdgError, match=r"'encoder_z_means\.bias'\) is missing"):
        load_weights(str(path)).network()


class Malicious:
    def __init__(self, target: Path):
        self.target = target

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.target),)


def test_pickle_that_runs_code_is_refused_and_not_run(tmp_path: Path) -> None:
    torch.save({"weight": Malicious(tmp_path / "executed")}, tmp_path / "evil.pth")
    with pytest.raises(GdgError, match=r"evil\.pth: refused, .*more than plain tensors"):
        load_weights(str(tmp_path / "evil.pth"))
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize("content", [b"", b"garbage", b"PK\x03\x04 cut off"])
@pytest.mark.parametrize("suffix", [".pth", ".safetensors"])
def test_broken_file_is_named(tmp_path: Path, content: bytes, suffix: str) -> None:
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(content)
    with pytest.raises(GdgError, match=rf"broken\{suffix}: "):
        load_weights(str(path))


def test_safetensors_without_distance_or_of_other_schema_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "bare.safetensors"
    save_file({"a": torch.zeros(1)}, path)
    with pytest.raises(GdgError, match="doesn't say which distance"):
        load_weights(str(path))
    header = json.dumps({"schema": "other-1", "distance": "aligned/release"})
    save_file({"a": torch.zeros(1)}, path, metadata={"gdg": header})
    with pytest.raises(GdgError, match="schema is 'other-1'"):
        load_weights(str(path))


def test_unknown_weights_are_refused() -> None:
    with pytest.raises(GdgError, match="no bundled weights 'no-such'"):
        load_weights("no-such")
    with pytest.raises(GdgError, match=r"no file 'no/such\.pth'"):
        load_weights("no/such.pth")


@needs_released_weights
@pytest.mark.parametrize("path", RELEASED, ids=lambda path: path.stem)
def test_released_weights_give_distinct_contact_regions(path: Path) -> None:
    apple = load_object(ASSETS / "objects" / "contactdb" / "apple.stl", "contactdb+apple")
    generator = CvaeGenerator(CvaeOptions(weights=str(path)))
    maps = generator.generate(apple, 16, seeded())
    assert maps.provenance["training"]["checkpoint"] == path.stem
    assert ((maps.values > 0) & (maps.values < 1)).all()
    highest = maps.values.amax(1)
    assert (highest > 0.5).float().mean() > 0.8, "most maps have a contact region"
    assert ((maps.values > 0.5).float().mean(1) < 0.6).all(), "which is not the whole object"
    assert maps.values.std(0).mean() > 0.05, "and differs from map to map"


@needs_released_weights
@torch.no_grad()
def test_released_weights_reconstruct_an_encoded_map() -> None:
    apple = load_object(ASSETS / "objects" / "contactdb" / "apple.stl", "contactdb+apple")
    network = load_weights(str(RELEASED[0])).network()
    points = apple.points[None]
    ends = apple.points[apple.points[:, 1].argmax()], apple.points[apple.points[:, 1].argmin()]
    gap = torch.stack([(apple.points - end).norm(dim=-1) for end in ends]).amin(0)
    values = 2 * torch.sigmoid(-10 * (0.002 + torch.relu(gap - 0.02)).sqrt())[None]
    mean, _ = network.encoder(points, values)
    encoded = reconstruction_loss(values, network.decoder(points, mean))
    drawn = network.decoder(points, torch.randn(16, LATENT, generator=seeded()))
    assert encoded < 0.75 * reconstruction_loss(values.expand(16, -1), drawn)


# -- loss and training -----------------------------------------------------------------------


def test_reconstruction_loss_weights_contacts() -> None:
    values, reconstructed = torch.tensor([[1.0, 0.0]]), torch.tensor([[0.5, 0.1]])
    weight = math.exp(3.0)
    expected = math.sqrt((weight * 0.25 + 0.01) / (weight + 1))
    assert reconstruction_loss(values, reconstructed).item() == pytest.approx(expected)
    assert expected == pytest.approx(0.488485, abs=1e-6)


def test_kl_divergence_is_summed_over_the_latent_and_averaged_over_the_batch() -> None:
    assert kl_divergence(torch.zeros(2, 4), torch.zeros(2, 4)).item() == 0
    mean, log_variance = torch.tensor([[1.0, 0.0], [0.0, 0.0]]), torch.tensor([[0.0, 1.0], [0, 0]])
    expected = (0.5 * 1 + 0.5 * (math.e - 2)) / 2
    assert kl_divergence(mean, log_variance).item() == pytest.approx(expected)


def test_kl_weight_grows_by_half_every_two_epochs() -> None:
    found = [kl_weight(epoch) for epoch in range(6)]
    assert found == pytest.approx([0.05, 0.05, 0.075, 0.075, 0.1125, 0.1125])
    assert kl_weight(35) == pytest.approx(0.05 * 1.5**17)


def test_training_steps_lower_the_loss() -> None:
    module = CvaeModule(learning_rate=1e-3, seed=0)
    module.log_dict = lambda *args, **kwargs: None  # type: ignore[method-assign]
    optimiser = module.configure_optimizers()
    points = 0.05 * torch.randn(4, 64, 3, generator=seeded())
    batch = MapBatch(points, torch.sigmoid(40 * points[..., 0]), torch.zeros_like(points))
    module.train()
    losses = []
    for _ in range(15):
        optimiser.zero_grad()
        losses.append(module.training_step(batch, 0))
        losses[-1].backward()
        optimiser.step()
    assert losses[-1] < 0.8 * losses[0]
