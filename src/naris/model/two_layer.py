"""The network of Sinha et al. 2018: two convolutions, three linear layers, raw pixels.

Source: A. Sinha et al., "Automatic initialization of camera pose for endoscopic navigation" (2018), as published
in its code. `TwoLayer` computes the same function in two ways: the plain torch modules, which are the readable
reference, and a fused kernel (`naris.model.fused`) that trains several times faster and is tested against them.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn
from torch.nn import functional

from naris.errors import ImageError
from naris.model.fused import conv_relu_pool

TWO_LAYER = "two-layer"
INPUT_PX = 300
_KERNEL_PX = 5
_SMALLEST_PX = 16


def pooled_px(size_px: int) -> int:
    """The edge of the second pooled map for a square picture: 72 for 300."""
    return ((size_px - _KERNEL_PX + 1) // 2 - _KERNEL_PX + 1) // 2


@dataclass(frozen=True)
class TwoLayerConfig:
    """The size of the input is the only thing to choose.

    Attributes:
        input_px: edge of the square input; 300 in the paper, which makes the first linear layer 82,944 → 120.

    Raises:
        ImageError: if the input is too small for two 5×5 convolutions with pooling.
    """

    input_px: int = INPUT_PX

    def __post_init__(self) -> None:
        if self.input_px < _SMALLEST_PX:
            raise ImageError(
                f"an input of at least {_SMALLEST_PX} pixels", f"{self.input_px}", "train on larger pictures"
            )


class TwoLayer(nn.Module):
    """conv 3→6 (5×5), ReLU, max-pool 2, conv 6→16 (5×5), ReLU, max-pool 2, then 120, 84 and K outputs.

    The input is not normalised: float32 values 0–255. Weights start as torch's default (as in the original).

    Args:
        regions: K.
        config: size of the input.
        fused: compute with the fused kernel; false gives plain torch, the same up to float32 rounding.
    """

    def __init__(self, regions: int, config: TwoLayerConfig = TwoLayerConfig(), fused: bool = True) -> None:
        super().__init__()
        self.config = config
        self.fused = fused
        self.conv1 = nn.Conv2d(3, 6, _KERNEL_PX)
        self.conv2 = nn.Conv2d(6, 16, _KERNEL_PX)
        self.fc1 = nn.Linear(16 * pooled_px(config.input_px) ** 2, 120)
        self.fc2 = nn.Linear(120, 84)
        self.fc3 = nn.Linear(84, regions)

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b k"]:
        """Region logits of RGB pictures (B, 3, input_px, input_px), float32, 0–255."""
        logits: Tensor = self.fc3(self.embedding(images))
        return logits

    def embedding(self, images: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 84"]:
        """What the last layer starts from."""
        x = self._layer(images, self.conv1)
        x = self._layer(x, self.conv2).flatten(1)
        x = functional.relu(self.fc1(x))
        return functional.relu(self.fc2(x))

    def _layer(self, x: Float[Tensor, "b c h w"], conv: nn.Conv2d) -> Float[Tensor, "b o p q"]:
        if self.fused and conv.bias is not None:
            return conv_relu_pool(x, conv.weight, conv.bias)
        return functional.max_pool2d(functional.relu(conv(x)), 2)


def to_input(images: UInt8[Tensor, "b h w 3"]) -> Float[Tensor, "b 3 h w"]:
    """uint8 pictures (B, H, W, 3) as float32 (B, 3, H, W), values 0–255."""
    return images.permute(0, 3, 1, 2).to(torch.float32).contiguous()
