"""A network that tells from one picture how far away the walls are, and how sure that is; it knows no anatomy.

The encoder is that of the compact network, so it can begin with weights that know noses; a decoder with connections
across (Ronneberger et al., MICCAI 2015) leads back to one number a patch of 4×4 pixels. The camera's angle is an input,
for the same picture of a wide lens shows nearer walls. It learns the logarithm of the range with its spread, by the
likelihood of a Laplace distribution (Kendall and Gal, NeurIPS 2017), and the differences between neighbours, which make
edges (Eigen and Fergus, ICCV 2015).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float, Shaped
from torch import Tensor, nn
from torch.nn import functional

from naris.errors import InputError
from naris.model.residual import PATCH, Block, patches

_LEAST_SPREAD = 0.005  # of the logarithm: no claim is finer
_ENCODER = ("stem.", "stages.")


@dataclass(frozen=True)
class DepthConfig:
    """The shape of the network.

    Attributes:
        input_px: edge of the square input, a multiple of 4.
        channels: of each stage of the encoder, of one block each; each stage after the first halves the map.
        back: of each stage of the decoder, which doubles it again; one fewer.

    Raises:
        InputError: if the stages disagree or the input is too small.
    """

    input_px: int = 96
    channels: tuple[int, ...] = (32, 64, 128, 192)
    back: tuple[int, ...] = (96, 64, 48)

    def __post_init__(self) -> None:
        least = PATCH * 2 ** len(self.back)
        if len(self.back) != len(self.channels) - 1 or self.input_px < least or self.input_px % PATCH:
            raise InputError(
                f"one stage back fewer than stages and an input of at least {least} pixels, a multiple of {PATCH}",
                f"{self.channels} and {self.back}, {self.input_px} px",
                "correct the network configuration",
            )

    @property
    def cells(self) -> int:
        """Across the map of ranges."""
        return self.input_px // PATCH


class DepthOutput(NamedTuple):
    """Of B pictures: the logarithm of the range (mm) along the ray through each cell, and the scale of its error."""

    log_range: Float[Tensor, "b i j"]
    spread: Float[Tensor, "b i j"]


class DepthNetwork(nn.Module):
    """The network.

    Args:
        config: its shape.
    """

    def __init__(self, config: DepthConfig = DepthConfig()) -> None:
        super().__init__()
        self.config = config
        first = config.channels[0]
        self.stem = nn.Sequential(nn.Conv2d(3 * PATCH**2, first, 3, 1, 1, bias=False), nn.BatchNorm2d(first), nn.ReLU())
        self.angle = nn.Conv2d(2, first, 1)
        nn.init.zeros_(self.angle.weight)  # so that a stem that knows pictures begins as it was
        inputs, stages = first, []
        for stage, outputs in enumerate(config.channels):
            stages.append(Block(inputs, outputs, 2 if stage else 1))
            inputs = outputs
        self.stages = nn.Sequential(*stages)
        back = []
        for across, outputs in zip(config.channels[-2::-1], config.back, strict=True):
            back.append(Block(inputs + across, outputs, 1))
            inputs = outputs
        self.back = nn.ModuleList(back)
        self.head = nn.Conv2d(inputs, 2, 3, 1, 1)

    def inner_weights(self) -> list[Tensor]:
        """The convolutions between the picture and the head."""
        modules = (self.stem, self.stages, self.back)
        return [weight for module in modules for weight in module.parameters() if weight.ndim > 1]

    def begin_with(self, weights: Mapping[str, Tensor]) -> None:
        """Take stem and stages from those of a compact network of the same channels."""
        self.load_state_dict({n: w for n, w in weights.items() if n.startswith(_ENCODER)}, strict=False)

    def forward(self, images: Shaped[Tensor, "b h w 3"], half_height: Float[Tensor, "b"]) -> DepthOutput:
        """Of RGB pictures (B, input_px, input_px, 3), values 0–255, and the tangents of half their vertical angles."""
        x = self.stem(patches(images)) + self.angle(_ways(half_height, self.config.cells))
        across = []
        for stage in self.stages:
            x = stage(x)
            across.append(x)
        for block, beside in zip(self.back, across[-2::-1], strict=True):
            x = functional.interpolate(x, size=beside.shape[2:], mode="bilinear", align_corners=False)
            x = block(torch.cat([x, beside], dim=1))
        numbers = self.head(x).float()
        return DepthOutput(2.0 + numbers[:, 0], _LEAST_SPREAD + functional.softplus(numbers[:, 1] - 2.0))


def depth_loss(output: DepthOutput, log_range: Float[Tensor, "b i j"], *, edges: float = 1.0) -> Float[Tensor, ""]:
    """−log likelihood of the true ranges, NaN where there is no wall, and `edges` times the error of differences."""
    known = torch.isfinite(log_range)
    off = torch.where(known, output.log_range - log_range.nan_to_num(), 0.0)
    likelihood = torch.where(known, off.abs() / output.spread + output.spread.log(), 0.0).sum() / known.sum().clamp_min(
        1
    )
    slopes = []
    for step in (1, 2, 4):
        for dim in (1, 2):
            size = off.shape[dim] - step
            both = known.narrow(dim, step, size) & known.narrow(dim, 0, size)
            slope = (off.narrow(dim, step, size) - off.narrow(dim, 0, size)).abs()
            slopes.append(torch.where(both, slope, 0.0).sum() / both.sum().clamp_min(1))
    return likelihood + edges * torch.stack(slopes).sum()


def _ways(half_height: Float[Tensor, "b"], cells: int) -> Float[Tensor, "b 2 i j"]:
    """x / z and y / z of the ray through the middle of each cell of a pinhole camera."""
    place = (torch.arange(cells, device=half_height.device) + 0.5) / cells * 2 - 1
    y, x = torch.meshgrid(place, place, indexing="ij")
    return torch.stack([x, y]) * half_height[:, None, None, None]
