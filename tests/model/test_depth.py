"""The depth network's loss against torch's Laplace distribution, and what goes in and comes out."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch.distributions import Laplace

from naris.errors import InputError
from naris.model.compact import Compact, CompactConfig
from naris.model.depth import DepthConfig, DepthNetwork, DepthOutput, depth_loss

TINY = DepthConfig(input_px=32, channels=(8, 16), back=(8,))


def _network(seed: int = 0) -> DepthNetwork:
    torch.manual_seed(seed)
    return DepthNetwork(TINY)


def _pictures(n: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(0).integers(0, 256, (n, 32, 32, 3), dtype=np.uint8))


def test_it_tells_a_range_and_its_spread_for_each_patch() -> None:
    output = _network()(_pictures(3), torch.tensor([0.4, 0.8, 1.0]))
    assert output.log_range.shape == output.spread.shape == (3, 8, 8)
    assert (output.spread > 0).all()


def test_the_angle_of_the_lens_is_heard() -> None:
    network = _network().eval()
    torch.nn.init.normal_(network.angle.weight)
    picture = _pictures(1).expand(2, -1, -1, -1)
    narrow, wide = network(picture, torch.tensor([0.4, 0.8])).log_range
    assert not torch.allclose(narrow, wide)


def test_without_edges_the_loss_is_the_likelihood_of_laplace() -> None:
    output = _network()(_pictures(2), torch.tensor([0.5, 0.5]))
    true = torch.randn(2, 8, 8)
    expected = -Laplace(output.log_range, output.spread).log_prob(true).mean() - math.log(2)
    assert depth_loss(output, true, edges=0.0).item() == pytest.approx(expected.item(), rel=1e-5)


def test_what_is_not_known_counts_for_nothing() -> None:
    output = _network()(_pictures(2), torch.tensor([0.5, 0.5]))
    true = torch.randn(2, 8, 8)
    true[0, :3] = torch.nan
    other = DepthOutput(output.log_range.clone(), output.spread.clone())
    other.log_range[0, :3] += 5.0
    assert depth_loss(output, true).item() == pytest.approx(depth_loss(other, true).item(), rel=1e-6)
    assert torch.isfinite(depth_loss(output, true))


def test_differences_do_not_feel_a_factor_on_the_whole() -> None:
    true, spread = torch.randn(1, 8, 8), torch.ones(1, 8, 8)
    shifted, bent = true + 0.3, true + 0.3 * torch.linspace(-1, 1, 8)
    parts = [
        depth_loss(DepthOutput(told, spread), true, edges=1.0) - depth_loss(DepthOutput(told, spread), true, edges=0.0)
        for told in (shifted, bent)
    ]
    assert parts[0].item() == pytest.approx(0.0, abs=1e-5)
    assert parts[1].item() > 0.1


def test_it_can_begin_with_the_encoder_of_a_compact_network() -> None:
    torch.manual_seed(1)
    other = Compact(4, CompactConfig(input_px=32, channels=(8, 16), blocks=(1, 1)))
    network = _network()
    head = network.head.weight.clone()
    network.begin_with(other.state_dict())
    assert torch.equal(network.stem[0].weight, other.stem[0].weight)
    assert torch.equal(network.stages[1].conv2.weight, other.stages[1].conv2.weight)
    assert torch.equal(network.head.weight, head)


@pytest.mark.parametrize("wrong", [{"back": (8, 8)}, {"input_px": 30}, {"input_px": 4}])
def test_stages_that_do_not_meet_are_refused(wrong: dict) -> None:
    with pytest.raises(InputError, match="one stage back fewer"):
        DepthConfig(**({"input_px": 32, "channels": (8, 16), "back": (8,)} | wrong))
