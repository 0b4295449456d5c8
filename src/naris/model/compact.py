"""A compact convolutional network of our own: region, camera pose with its uncertainty, and "is this my world?".

A residual network (He et al. 2016) of four stages on pictures of 112×112, small enough to learn from scratch on two
cores. The last map is not averaged away but flattened after a 1×1 convolution, because where a wall appears in
the picture is what tells the pose. The pose comes as a few weighted hypotheses, each with a full covariance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Shaped
from torch import Tensor, nn
from torch.nn import functional

from naris.errors import InputError
from naris.model.residual import PATCH, Block, patches
from naris.model.rotation import matrix_of_six

COMPACT = "compact"
TWIST = 6
_TRIANGLE = TWIST * (TWIST + 1) // 2
_NUMBERS = 1 + 3 + 6 + _TRIANGLE  # of one hypothesis: its weight, position, rotation, covariance factor
_UNIT = (6.0, 6.0, 6.0, 0.3, 0.3, 0.3)  # mm and rad: errors before training, so that it starts with a fair claim


@dataclass(frozen=True)
class CompactConfig:
    """The shape of the network.

    Attributes:
        input_px: edge of the square input, a multiple of 4.
        channels: of each stage; each stage after the first halves the map.
        blocks: residual blocks of each stage.
        reduced: channels of the last map before it is flattened.
        embedding: numbers that describe a picture, from which all heads start.
        hypotheses: camera poses offered for a picture.

    Raises:
        InputError: if the stages disagree or the input is too small.
    """

    input_px: int = 112
    channels: tuple[int, ...] = (32, 64, 128, 192)
    blocks: tuple[int, ...] = (1, 1, 1, 1)
    reduced: int = 64
    embedding: int = 256
    hypotheses: int = 3

    def __post_init__(self) -> None:
        least = 2 * PATCH * 2 ** (len(self.blocks) - 1)
        if len(self.channels) != len(self.blocks) or self.input_px < least or self.input_px % PATCH:
            raise InputError(
                f"as many channels as blocks and an input of at least {least} pixels, a multiple of {PATCH}",
                f"channels {self.channels}, blocks {self.blocks}, {self.input_px} px",
                "correct the network configuration",
            )


class CompactOutput(NamedTuple):
    """What the network says about B pictures; all float32.

    Attributes:
        region_logits: (B, K).
        embedding: (B, E), what the heads start from.
        domain_logit: (B,), positive for a picture like those of the training.
        hypothesis_logits: (B, M).
        position: (B, M, 3) in units of the network's `position_scale_mm` around `position_mean_mm`.
        rotation: (B, M, 3, 3) of `anatomy_T_camera`.
        factor: (B, M, 6, 6) lower triangular L; L Lᵀ is the covariance of the twist (mm, rad) in the camera frame.
    """

    region_logits: Float[Tensor, "b k"]
    embedding: Float[Tensor, "b e"]
    domain_logit: Float[Tensor, "b"]
    hypothesis_logits: Float[Tensor, "b m"]
    position: Float[Tensor, "b m 3"]
    rotation: Float[Tensor, "b m 3 3"]
    factor: Float[Tensor, "b m 6 6"]


class Compact(nn.Module):
    """The network; `position_mean_mm` and `position_scale_mm` are buffers, set from the training poses.

    Args:
        regions: K.
        config: its shape.
    """

    position_mean_mm: Tensor
    position_scale_mm: Tensor

    def __init__(self, regions: int, config: CompactConfig = CompactConfig()) -> None:
        super().__init__()
        self.config = config
        first = config.channels[0]
        self.stem = nn.Sequential(nn.Conv2d(3 * PATCH**2, first, 3, 1, 1, bias=False), nn.BatchNorm2d(first), nn.ReLU())
        stages: list[nn.Module] = []
        inputs, edge = first, config.input_px // PATCH
        for stage, (outputs, count) in enumerate(zip(config.channels, config.blocks, strict=True)):
            for block in range(count):
                stride = 2 if stage and not block else 1
                stages.append(Block(inputs, outputs, stride))
                inputs, edge = outputs, -(-edge // stride)
        self.stages = nn.Sequential(*stages)
        self.reduce = nn.Sequential(
            nn.Conv2d(inputs, config.reduced, 1, bias=False), nn.BatchNorm2d(config.reduced), nn.ReLU()
        )
        self.embed = nn.Sequential(
            nn.Linear(config.reduced * edge * edge, config.embedding, bias=False),
            nn.BatchNorm1d(config.embedding),
            nn.ReLU(),
        )
        self.region = nn.Linear(config.embedding, regions)
        self.domain = nn.Linear(config.embedding, 1)
        self.pose = nn.Sequential(
            nn.Linear(config.embedding, config.embedding),
            nn.ReLU(),
            nn.Linear(config.embedding, config.hypotheses * _NUMBERS),
        )
        self.register_buffer("position_mean_mm", torch.zeros(3))
        self.register_buffer("position_scale_mm", torch.ones(3))

    def inner_weights(self) -> list[Tensor]:
        """The matrices and convolutions between the picture and the embedding."""
        modules = (self.stem, self.stages, self.reduce, self.embed)
        return [weight for module in modules for weight in module.parameters() if weight.ndim > 1]

    def first_layers(self, count: int) -> list[nn.Module]:
        """The stem and the blocks after it, `count` in all."""
        return [self.stem, *self.stages][:count]

    def forward(self, images: Shaped[Tensor, "b h w 3"]) -> CompactOutput:
        """Of RGB pictures (B, input_px, input_px, 3), values 0–255, uint8 or floating point."""
        maps = self.stages(self.stem(patches(images)))
        embedding = self.embed(self.reduce(maps).flatten(1))
        # The heads are small and their numbers matter: float32, whatever the maps were computed in.
        with torch.autocast(images.device.type, enabled=False):
            embedding = embedding.float()
            numbers = self.pose(embedding).unflatten(1, (self.config.hypotheses, _NUMBERS))
            weight, position, six, triangle = numbers.split([1, 3, 6, _TRIANGLE], dim=2)
            return CompactOutput(
                self.region(embedding),
                embedding,
                self.domain(embedding)[:, 0],
                weight[..., 0],
                position,
                matrix_of_six(six),
                _factor(triangle),
            )


def _factor(triangle: Float[Tensor, "b m t"]) -> Float[Tensor, "b m 6 6"]:
    """A lower triangular matrix with a positive diagonal from 21 free numbers; about `_UNIT` wide where they are 0."""
    row, column = torch.tril_indices(TWIST, TWIST)
    diagonal = row == column
    values = torch.where(diagonal, functional.softplus(triangle) / np.log(2), triangle)
    factor = triangle.new_zeros(*triangle.shape[:2], TWIST, TWIST)
    factor[..., row, column] = values * triangle.new_tensor(_UNIT)[row]
    return factor
