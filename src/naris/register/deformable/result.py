"""What a deformable registration came to, and when it may be used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from naris.core.anatomy import Anatomy
from naris.core.pose import Pose


@dataclass(frozen=True)
class Fit:
    """How far the points that were seen lie from the walls of the deformed anatomy.

    Attributes:
        median_mm, mean_mm, p95_mm: over the rays within 3 standard deviations of their wall.
        explained: the share of rays that are.
        misfit: the median of their residuals over what the stated noise makes of it; 1 where it is as said.
    """

    median_mm: float
    mean_mm: float
    p95_mm: float
    explained: float
    misfit: float


@dataclass(frozen=True, eq=False)
class DeformableRegistration:
    """A pose, a scale and a shape.

    Standard deviations and covariance are those of one basin, from the equations at its bottom, with everything else
    left free; they are right if the patient is one of the shape model's and the noise is as it was said.

    Attributes:
        anatomy_T_camera: the pose of the camera in `deformed`, or None where it was refused.
        best: the most likely pose, whatever was decided: to look into, not to navigate by.
        status: `registered` or `refused`.
        reason: why it was refused, or None.
        scale: mm per unit of the observation.
        scale_sd: standard deviation of its logarithm; 0 where it was known.
        weights: (K,) of the modes, in standard deviations of the population.
        weight_sd: (K,) their standard deviations: 1, as before, for a mode of which nothing was seen.
        stretch: their squared length over what it is on average for patients of the model who are seen as well as
            this; about 1, and far above it for a shape that is bent to fit a wrong place or another kind of patient.
        deformed: the mean at these weights, with its regions, landmarks and passages.
        vertex_sd_mm: (V,) of its vertices, over all directions; without the modes that the model leaves out.
        target_sd_mm: of the walls in view, in the camera: how well it is known which place is seen where; root mean
            square over the rays.
        turn_sd_deg: of those walls as a whole, turned in the camera about their loosest axis.
        covariance: (6, 6) of the twist in the camera (mm, rad), to the frame of the mean. It is looser than the walls
            in view are: what moves all of them alike may be the pose or the shape.
        fit: of the points to the walls.
        margin: how much less of the posterior, in −2 log, the best basin of another pose holds; infinite if there is
            no other.
        iterations: steps from the start that won.
        converged: whether they came to rest.
    """

    anatomy_T_camera: Pose | None
    best: Pose
    status: Literal["registered", "refused"]
    reason: str | None
    scale: float
    scale_sd: float
    weights: Float[np.ndarray, "k"]
    weight_sd: Float[np.ndarray, "k"]
    stretch: float
    deformed: Anatomy
    vertex_sd_mm: Float[np.ndarray, "v"]
    target_sd_mm: float
    turn_sd_deg: float
    covariance: Float[np.ndarray, "6 6"]
    fit: Fit
    margin: float
    iterations: int
    converged: bool


@dataclass(frozen=True)
class Limits:
    """When a deformable registration may be used. They are limits on what it says of itself, not a probability.

    What is asked for is that the walls in view are within 2 mm, vertex by vertex, and turned by no more than 5°. The
    deviations are limited to a quarter of that: of clouds of points they are found half as large as they should be.

    Attributes:
        explained: at least this share of the rays within 3 standard deviations of their wall.
        misfit: at most so much more than the stated noise.
        margin: another place must hold at most exp(−margin / 2) as much of the posterior.
        target_sd_mm, turn_sd_deg: of the walls in view in the camera, at most.
        weight: no mode further out than this, in standard deviations of the population.
        stretch: of all modes together.
    """

    explained: float = 0.8
    misfit: float = 1.5
    margin: float = 12.0
    target_sd_mm: float = 0.5
    turn_sd_deg: float = 1.25
    weight: float = 3.0
    stretch: float = 2.0


def refusal(found: DeformableRegistration, limits: Limits = Limits()) -> str | None:
    """Why a result should not be used, the heaviest reason first; None where it may be."""
    fit, farthest = found.fit, float(np.abs(found.weights).max(initial=0.0))
    if not np.isfinite(fit.median_mm) or fit.explained < limits.explained:
        return (
            f"no shape of the model explains what was seen: {fit.explained:.0%} of the rays fit the best one; "
            "another kind of patient, another scale or other noise than was said"
        )
    if not found.converged:
        return f"pose and shape did not come to rest in {found.iterations} steps: allow more of them"
    if fit.misfit > limits.misfit:
        return f"the walls are {fit.misfit:.1f} times as far off as the stated noise makes them: state it larger"
    if farthest > limits.weight:
        return f"a mode lies {farthest:.1f} standard deviations out: hardly one of the model's patients"
    if found.stretch > limits.stretch:
        return f"the shape is bent {found.stretch:.1f} times as much as is usual: hardly one of the model's patients"
    if found.margin < limits.margin:
        return "several places fit alike: give another view, or more of them"
    if found.target_sd_mm > limits.target_sd_mm or found.turn_sd_deg > limits.turn_sd_deg:
        return (
            f"pose and shape together leave the walls in view loose ({found.target_sd_mm:.1f} mm, "
            f"{found.turn_sd_deg:.1f}°): give a view with more shape"
        )
    return None
