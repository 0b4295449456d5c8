"""The fused kernel against plain torch, and the two-layer network against the paper's numbers."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.nn import functional

from naris.errors import ImageError
from naris.model.fused import conv_relu_pool
from naris.model.two_layer import TwoLayer, TwoLayerConfig, pooled_px, to_input

TOLERANCE = 1e-4


def _relative(a: torch.Tensor, b: torch.Tensor) -> float:
    return float((a - b).abs().max() / b.abs().max())


@pytest.mark.parametrize(("channels", "outputs", "height", "width"), [(3, 6, 36, 36), (6, 16, 20, 31), (1, 2, 9, 8)])
@pytest.mark.parametrize("threads", [1, 2])
def test_conv_relu_pool_agrees_with_torch(channels: int, outputs: int, height: int, width: int, threads: int) -> None:
    generator = torch.Generator().manual_seed(channels)
    x = torch.randn(5, channels, height, width, generator=generator, requires_grad=True)
    weight = torch.randn(outputs, channels, 5, 5, generator=generator, requires_grad=True)
    bias = torch.randn(outputs, generator=generator, requires_grad=True)
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        fused = conv_relu_pool(x, weight, bias)
        plain = functional.max_pool2d(functional.relu(functional.conv2d(x, weight, bias)), 2)
        pull = torch.randn(plain.shape, generator=generator)
        of_fused = torch.autograd.grad(fused, (x, weight, bias), pull)
        of_plain = torch.autograd.grad(plain, (x, weight, bias), pull)
    finally:
        torch.set_num_threads(before)
    assert _relative(fused, plain) < TOLERANCE
    for ours, theirs in zip(of_fused, of_plain, strict=True):
        assert ours.shape == theirs.shape
        assert _relative(ours, theirs) < TOLERANCE


def test_two_layer_gives_torchs_loss_and_gradients() -> None:
    torch.manual_seed(0)
    network = TwoLayer(4, TwoLayerConfig(44))
    images = torch.randint(0, 256, (6, 44, 44, 3), dtype=torch.uint8)
    regions = torch.tensor([0, 1, 2, 3, 0, 1])
    gradients = []
    for fused in (True, False):
        network.fused = fused
        network.zero_grad()
        functional.cross_entropy(network(to_input(images)), regions).backward()
        gradients.append([parameter.grad.clone() for parameter in network.parameters()])
    for ours, theirs in zip(*gradients, strict=True):
        assert _relative(ours, theirs) < TOLERANCE


def test_two_layer_has_the_shapes_of_the_paper() -> None:
    assert pooled_px(300) == 72
    shapes = {name: tuple(p.shape) for name, p in TwoLayer(4).named_parameters() if name.endswith("weight")}
    assert shapes == {
        "conv1.weight": (6, 3, 5, 5),
        "conv2.weight": (16, 6, 5, 5),
        "fc1.weight": (120, 82_944),
        "fc2.weight": (84, 120),
        "fc3.weight": (4, 84),
    }


def test_input_is_raw() -> None:
    image = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(1, 2, 3, 3)
    x = to_input(torch.from_numpy(image))
    assert x.dtype == torch.float32
    assert np.array_equal(x.numpy().transpose(0, 2, 3, 1), image.astype(np.float32))


def test_too_small_input_is_refused() -> None:
    with pytest.raises(ImageError, match="at least 16 pixels"):
        TwoLayerConfig(12)
