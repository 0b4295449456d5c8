"""Muon against a singular value decomposition, and the optimisers as one."""

import numpy as np
import pytest
import torch

from naris.model.compact import Compact, CompactConfig
from naris.train import COMPACT_AT_WILL, Adam, Muon
from naris.train.config import TrainConfig
from naris.train.optimiser import Optimiser, orthogonal

TINY = CompactConfig(input_px=16, channels=(4, 8), blocks=(1, 1), reduced=4, embedding=16)
CONFIG = COMPACT_AT_WILL.lasting(steps=10).with_(network=TINY, muon=Muon(learning_rate=0.1, weight_decay=0.0))


def _network(seed: int = 0) -> Compact:
    torch.manual_seed(seed)
    return Compact(4, TINY).to(memory_format=torch.channels_last)


def _learn(network: Compact, optimiser: Optimiser, seed: int, share: float = 1.0) -> None:
    torch.manual_seed(seed)
    output = network(torch.rand(48, 16, 16, 3) * 255)
    (output.region_logits.square().sum() + output.position.square().sum()).backward()
    optimiser.step(share)


@pytest.mark.parametrize("shape", [(8, 30), (30, 8), (16, 16), (1, 9)])
def test_orthogonal_keeps_the_singular_vectors_and_evens_the_values(shape: tuple[int, int]) -> None:
    torch.manual_seed(sum(shape))
    left, _, right = torch.linalg.svd(torch.randn(shape, dtype=torch.float64), full_matrices=False)
    values = torch.linspace(1.0, 0.05, min(shape), dtype=torch.float64)
    found = orthogonal(left @ torch.diag(values) @ right)
    inside = left.mT @ found @ right.mT
    assert torch.allclose(inside, torch.diag(inside.diagonal()), atol=1e-9)
    assert inside.diagonal().min() > 0.6
    assert inside.diagonal().max() < 1.25


def test_muon_moves_inner_weights_evenly_and_adam_the_others() -> None:
    network = _network()
    inner = {id(weight) for weight in network.inner_weights()}
    before = {name: weight.detach().clone() for name, weight in network.named_parameters()}
    _learn(network, Optimiser(network, CONFIG, "float32"), 1)
    for name, weight in network.named_parameters():
        moved = weight.detach() - before[name]
        if id(weight) not in inner:
            # Adam's first step is the learning rate for every number whose gradient is not 0.
            assert moved.abs().max() <= CONFIG.adam.learning_rate * 1.2
            continue
        if not moved.any():
            continue  # behind a norm that starts at 0 there is no gradient yet
        matrix = moved.movedim(1, -1).flatten(1).double()
        values = torch.linalg.svdvals(matrix / (0.1 * 0.2 * max(matrix.shape) ** 0.5))
        assert values.max() < 1.25
        assert (values > 0.5).sum() >= min(matrix.shape) / 2


def test_a_convolution_moves_as_its_matrix_does_whatever_its_layout() -> None:
    one, other = _network(), _network().to(memory_format=torch.contiguous_format)
    for network in (one, other):
        _learn(network, Optimiser(network, CONFIG, "float32"), 1)
    for a, b in zip(one.parameters(), other.parameters(), strict=True):
        assert torch.allclose(a, b, atol=1e-3)


@pytest.mark.parametrize("config", [CONFIG, CONFIG.with_(muon=None, adam=Adam())])
def test_restored_optimisers_go_on_alike(config: TrainConfig) -> None:
    whole = _network()
    optimiser = Optimiser(whole, config, "float32")
    for seed in range(3):
        _learn(whole, optimiser, seed, 0.1 * (seed + 1))
    state = {name: value.copy() for name, value in optimiser.state().items()}
    second = _network()
    second.load_state_dict(whole.state_dict())
    again = Optimiser(second, config, "float32")
    again.restore(state)
    for network, which in ((whole, optimiser), (second, again)):
        _learn(network, which, 9)
    assert all(torch.equal(a, b) for a, b in zip(whole.parameters(), second.parameters(), strict=True))
    assert len({name.split(".")[0] for name in state}) == (1 if config.muon is None else 2)


def test_another_optimisers_state_is_refused() -> None:
    network = _network()
    optimiser = Optimiser(network, CONFIG, "float32")
    with pytest.raises((KeyError, IndexError, ValueError, RuntimeError)):
        optimiser.restore({"2.0.momentum": np.zeros(3, np.float32)})
