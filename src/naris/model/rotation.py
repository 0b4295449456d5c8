"""Rotations as a network gives them: six numbers, two columns that are made orthonormal.

Source: Y. Zhou et al., "On the continuity of rotation representations in neural networks", CVPR 2019: unlike
quaternions or angles, six numbers cover all rotations without a jump that a network would have to learn.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

_SMALL = 1e-6


def matrix_of_six(six: Float[Tensor, "*b 6"]) -> Float[Tensor, "*b 3 3"]:
    """The rotation whose first two columns are nearest in order: Gram–Schmidt of the two given ones."""
    first = functional.normalize(six[..., :3], dim=-1, eps=_SMALL)
    across = six[..., 3:] - (first * six[..., 3:]).sum(-1, keepdim=True) * first
    second = functional.normalize(across, dim=-1, eps=_SMALL)
    return torch.stack([first, second, torch.linalg.cross(first, second, dim=-1)], dim=-1)


def six_of_matrix(rotation: Float[Tensor, "*b 3 3"]) -> Float[Tensor, "*b 6"]:
    """The first two columns, one after the other; `matrix_of_six` gives the rotation back."""
    return torch.cat([rotation[..., 0], rotation[..., 1]], dim=-1)


def angle_between(a: Float[Tensor, "*#b 3 3"], b: Float[Tensor, "*#b 3 3"]) -> Float[Tensor, "*b"]:
    """The geodesic angle in rad, 0…π, with a usable gradient everywhere but at exactly 0.

    From the chord: |A − B|_F = 2√2 sin(angle / 2).
    """
    chord = (a - b).square().sum((-2, -1)).clamp_min(_SMALL**2).sqrt()
    return 2 * torch.asin((chord / 8**0.5).clamp(max=1 - _SMALL))


def rotation_vector(rotation: Float[Tensor, "*#b 3 3"]) -> Float[Tensor, "*b 3"]:
    """Axis times angle in rad; within 1e-3 of half a turn the axis is unreliable (meant for residuals)."""
    vee = torch.stack(
        [
            rotation[..., 2, 1] - rotation[..., 1, 2],
            rotation[..., 0, 2] - rotation[..., 2, 0],
            rotation[..., 1, 0] - rotation[..., 0, 1],
        ],
        dim=-1,
    )
    sine = vee.norm(dim=-1, keepdim=True) / 2
    cosine = (rotation.diagonal(dim1=-2, dim2=-1).sum(-1, keepdim=True) - 1) / 2
    return vee / 2 * torch.where(sine > _SMALL, torch.atan2(sine, cosine) / sine.clamp_min(_SMALL), 1.0)
