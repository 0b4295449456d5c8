"""What our residual networks are built of: pictures as patches, and blocks of two convolutions (He et al. 2016)."""

from __future__ import annotations

import torch
from jaxtyping import Float, Shaped
from torch import Tensor, nn
from torch.nn import functional

from naris.model.small_maps import conv3x3

PATCH = 4
"""Edge of the patches of pixels that the first convolution sees as one."""

_SMALL = 4  # pixels across, up to which `conv3x3` is quicker than torch
_DARKEST = 4.0  # grey levels added to the contrast, so that a black picture is not blown up to noise


class Conv(nn.Conv2d):
    """A 3×3 convolution that takes the way that is quicker for its map; the weights are torch's."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__(inputs, outputs, 3, stride, 1, bias=False)

    def forward(self, input: Tensor) -> Tensor:
        across = -(-input.shape[-1] // self.stride[0])
        if self.training and across <= _SMALL:
            return conv3x3(input, self.weight, self.stride[0])
        return super().forward(input)


class Block(nn.Module):
    """Two 3×3 convolutions and a way around them."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = Conv(inputs, outputs, stride)
        self.norm1 = nn.BatchNorm2d(outputs)
        self.conv2 = Conv(outputs, outputs)
        self.norm2 = nn.BatchNorm2d(outputs)
        nn.init.zeros_(self.norm2.weight)  # a block starts as the identity: deeper nets start as easily as shallow ones
        self.around: nn.Module = nn.Identity()
        if stride != 1 or inputs != outputs:
            shrink = nn.AvgPool2d(stride, ceil_mode=True) if stride != 1 else nn.Identity()
            self.around = nn.Sequential(shrink, nn.Conv2d(inputs, outputs, 1, bias=False), nn.BatchNorm2d(outputs))

    def forward(self, x: Tensor) -> Tensor:
        through = self.norm2(self.conv2(functional.relu(self.norm1(self.conv1(x)))))
        return functional.relu(through + self.around(x))


def patches(images: Shaped[Tensor, "b h w 3"]) -> Float[Tensor, "b 48 i j"]:
    """The standardised 4×4 pixels of each patch side by side as channels, in the order (row, column, colour).

    Each colour of each picture has mean 0 and deviation about 1: what gain and tint were, the network cannot see. A
    convolution over a map of a quarter of the edge with many channels costs a fifth of one over pixels.
    """
    batch, height, width, colours = images.shape
    rows, across = height // PATCH, width // PATCH
    cut = images.reshape(batch, rows, PATCH, across, PATCH, colours).transpose(2, 3)
    flat = cut.reshape(batch, rows * across, PATCH**2 * colours).to(torch.float32)
    # Long rows first, colours last: sums and products over three numbers at a time are slow.
    mean = flat.mean(dim=1).view(batch, -1, colours).mean(dim=1)
    square = flat.square().mean(dim=1).view(batch, -1, colours).mean(dim=1)
    scale = 1 / ((square - mean * mean).clamp_min(0).sqrt() + _DARKEST)
    scale, shift = (row.repeat(1, PATCH**2)[:, None] for row in (scale, -mean * scale))
    return torch.addcmul(shift, flat, scale).view(batch, rows, across, -1).permute(0, 3, 1, 2)
