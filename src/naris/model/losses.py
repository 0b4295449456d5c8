"""What the networks are trained to make small.

- Regions: cross-entropy (the published network), with softened labels for the compact one.
- Poses: the best of a few hypotheses is pulled to the truth and the others only a little, so that they may cover a
  second possible answer instead of meeting in a useless middle (relaxed winner-takes-all: C. Rupprecht et al.,
  "Learning in an uncertain world", ICCV 2017). A hypothesis is scored by its distance, not by its own claim of
  certainty, so an over-confident one gains nothing; covariances are then fitted to the errors that remain
  (negative log-likelihood of a Gaussian, with the error held fixed: M. Seitzer et al., ICLR 2022, show why a
  likelihood alone trains the mean badly).
- World: whether the picture is one of those that the network was trained on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from naris.model.compact import CompactOutput
from naris.model.rotation import angle_between, rotation_vector

_LEAST_MM, _LEAST_RAD = 0.05, 0.002  # a claimed deviation below these is beyond what a picture can tell


@dataclass(frozen=True)
class LossWeights:
    """How the parts of the compact network's loss are added.

    Attributes:
        label_smoothing: share of the target that goes to all regions alike.
        pose: of the distance of the hypotheses, in units of `position_mm` and `rotation_rad`.
        covariance: of the log-likelihood of the remaining errors.
        choice: of choosing the best hypothesis.
        domain: of telling the training's world from other pictures.
        position_mm, rotation_rad: the errors that count as one unit.
        losers: share of the pull that goes to hypotheses that are not the best.
    """

    label_smoothing: float = 0.05
    pose: float = 0.5
    covariance: float = 0.02
    choice: float = 0.1
    domain: float = 0.1
    position_mm: float = 8.0
    rotation_rad: float = 0.35
    losers: float = 0.05


COMPACT_LOSS = LossWeights()


class Targets(NamedTuple):
    """The truth of B pictures.

    Attributes:
        region: (B,) label.
        position_mm: (B, 3) of the camera.
        rotation: (B, 3, 3) of `anatomy_T_camera`.
        in_domain: (B,) false for a picture of something else; its other targets do not count.
    """

    region: Int[Tensor, "b"]
    position_mm: Float[Tensor, "b 3"]
    rotation: Float[Tensor, "b 3 3"]
    in_domain: Bool[Tensor, "b"]


class Losses(NamedTuple):
    """The parts of the loss, each a mean over the pictures it concerns, and their weighted sum."""

    total: Float[Tensor, ""]
    region: Float[Tensor, ""]
    pose: Float[Tensor, ""]
    covariance: Float[Tensor, ""]
    choice: Float[Tensor, ""]
    domain: Float[Tensor, ""]


def compact_loss(
    output: CompactOutput,
    targets: Targets,
    position_mean_mm: Float[Tensor, "3"],
    position_scale_mm: Float[Tensor, "3"],
    weights: LossWeights = COMPACT_LOSS,
) -> Losses:
    """The loss of the compact network over a batch with at least one picture of its world."""
    mine = targets.in_domain
    domain = functional.binary_cross_entropy_with_logits(output.domain_logit, mine.to(output.domain_logit.dtype))
    region = functional.cross_entropy(
        output.region_logits[mine], targets.region[mine], label_smoothing=weights.label_smoothing
    )
    position_mm = output.position[mine] * position_scale_mm + position_mean_mm
    rotation, logits = output.rotation[mine], output.hypothesis_logits[mine]
    true_mm, true_rotation = targets.position_mm[mine, None], targets.rotation[mine, None]
    off = functional.smooth_l1_loss(position_mm, true_mm.expand_as(position_mm), reduction="none", beta=1.0).sum(-1)
    distance = off / weights.position_mm + angle_between(rotation, true_rotation) / weights.rotation_rad
    best = distance.detach().argmin(dim=1)
    pull = torch.full_like(distance, weights.losers / max(distance.shape[1] - 1, 1))
    pull.scatter_(1, best[:, None], 1 - weights.losers if distance.shape[1] > 1 else 1.0)
    pose = (pull * distance).sum(dim=1).mean()
    choice = functional.cross_entropy(logits, best)
    error = twist_to(position_mm, rotation, true_mm, true_rotation).detach()
    covariance = (pull * gaussian_nll(error, output.factor[mine])).sum(dim=1).mean()
    total = (
        region
        + weights.pose * pose
        + weights.covariance * covariance
        + weights.choice * choice
        + weights.domain * domain
    )
    return Losses(total, region, pose, covariance, choice, domain)


def twist_to(
    position_mm: Float[Tensor, "b m 3"],
    rotation: Float[Tensor, "b m 3 3"],
    true_mm: Float[Tensor, "b #m 3"],
    true_rotation: Float[Tensor, "b #m 3 3"],
) -> Float[Tensor, "b m 6"]:
    """From each predicted camera to the true one, seen in the predicted camera: mm, then the rotation vector in rad.

    To first order the logarithm of `predicted⁻¹ · true`.
    """
    back = rotation.transpose(-1, -2)
    shift = (back @ (true_mm - position_mm)[..., None])[..., 0]
    return torch.cat([shift, rotation_vector(back @ true_rotation)], dim=-1)


def gaussian_nll(error: Float[Tensor, "b m 6"], factor: Float[Tensor, "b m 6 6"]) -> Float[Tensor, "b m"]:
    """−log N(error; 0, L Lᵀ) without its constant."""
    floor = error.new_tensor([_LEAST_MM] * 3 + [_LEAST_RAD] * 3)
    factor = factor + torch.diag_embed(floor).expand_as(factor)
    white = torch.linalg.solve_triangular(factor, error[..., None], upper=False)[..., 0]
    return factor.diagonal(dim1=-2, dim2=-1).log().sum(-1) + white.square().sum(-1) / 2


def covariance_of(factor: Float[Tensor, "b m 6 6"]) -> Float[Tensor, "b m 6 6"]:
    """The covariance that `gaussian_nll` judged: mm², mm·rad and rad²."""
    floor = factor.new_tensor([_LEAST_MM] * 3 + [_LEAST_RAD] * 3)
    factor = factor + torch.diag_embed(floor).expand_as(factor)
    return factor @ factor.transpose(-1, -2)
