"""The convolution of small maps: torch's own is the oracle, for values and for gradients."""

from __future__ import annotations

import pytest
import torch
from torch.nn import functional

from naris.model.small_maps import conv3x3


@pytest.mark.parametrize("stride", [1, 2, 3])
@pytest.mark.parametrize("shape", [(1, 1), (3, 3), (4, 7), (6, 5)])
@pytest.mark.parametrize("layout", [torch.contiguous_format, torch.channels_last])
def test_values_and_gradients_are_torchs(stride: int, shape: tuple[int, int], layout: torch.memory_format) -> None:
    torch.manual_seed(0)
    x = torch.randn(2, 5, *shape, dtype=torch.float64).to(memory_format=layout).requires_grad_()
    weight = torch.randn(4, 5, 3, 3, dtype=torch.float64).to(memory_format=layout).requires_grad_()
    ours, theirs = conv3x3(x, weight, stride), functional.conv2d(x, weight, stride=stride, padding=1)
    assert ours.shape == theirs.shape
    assert torch.allclose(ours, theirs)
    pull = torch.randn_like(theirs)
    for a, b in zip(
        torch.autograd.grad(ours, (x, weight), pull), torch.autograd.grad(theirs, (x, weight), pull), strict=True
    ):
        assert torch.allclose(a, b)


def test_autocast_computes_in_bfloat16_and_gives_gradients_as_precise_as_the_weights() -> None:
    torch.manual_seed(1)
    x, weight = torch.randn(3, 8, 4, 4), torch.randn(6, 8, 3, 3, requires_grad=True)
    with torch.autocast("cpu", torch.bfloat16):
        result = conv3x3(x, weight)
    assert result.dtype == torch.bfloat16
    assert torch.allclose(result.float(), functional.conv2d(x, weight, padding=1), atol=0.2, rtol=0.02)
    result.float().sum().backward()
    assert weight.grad is not None and weight.grad.dtype == torch.float32
    other = weight.detach().clone().requires_grad_()
    functional.conv2d(x, other, padding=1).sum().backward()
    assert other.grad is not None
    assert torch.allclose(weight.grad, other.grad, atol=0.3, rtol=0.02)


def test_a_picture_that_needs_no_gradient_gets_none() -> None:
    x, weight = torch.randn(2, 3, 3, 3), torch.randn(4, 3, 3, 3, requires_grad=True)
    conv3x3(x, weight).sum().backward()
    assert x.grad is None and weight.grad is not None
