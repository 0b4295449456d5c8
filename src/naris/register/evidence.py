"""What speaks for and against the best pose of a registration: its own solutions, and how the rays fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from naris.register.map import RegistrationMap
from naris.register.observation import Observation
from naris.register.predictive import surprise
from naris.register.rays import cast_rays, memory_for, prepared, ranges_met
from naris.register.smooth import smooth_error
from naris.register.solve import BASIN_MM, BASIN_RAD, Solutions, alike, apart

MOST_MARGIN = 60.0
_EXPLAINED_SD, _TRUNCATED = 3.0, 0.9866  # the latter: of a normal error within the former, its deviation
_NEIGHBOURS = (1, 2)
_WAVE_DEG, _WAVES, _RIPPLE_DEG, _RIPPLES = 20.0, 12, 9.0, 48  # how far they reach and how many, in a view
_POINTS_A_WAVE = 4  # at least, or functions follow any noise
_ENOUGH, _FEWEST = 250, 2.2  # points of a view; of fewer than some thirty it is no worse
_SAME_MM, _SAME_RAD = 1.0, 0.09
_LEAST_COSINE = 0.05
_WITHIN_MM, _WITHIN_RAD = 2.0, np.deg2rad(5.0)
_FARTHEST, _DEAR = 4.0, 20.0
_SEED = 0  # of what is drawn: the same evidence for the same answer
_DRAWS = 512


class Found(NamedTuple):
    """What a registration came to: the coarse `rough`, the fine `solutions`, and which of these began `again`.

    The latter began beside the best finalist; None where that was not asked for.
    """

    rough: Solutions
    solutions: Solutions
    again: Solutions | None


@dataclass(frozen=True)
class Evidence:
    """What speaks for and against the best pose.

    Attributes:
        margin: in −2 log likelihood, to the best pose of another basin among those that were solved finely.
        rough_margin: the same among all that went through both coarse stages, where the rivals are more and the noise
            is cruder; negative where the best pose was not the best then, and 0 where no start came near it.
        sd_mm, sd_deg: the largest standard deviations of position and rotation, if the basin is right, by the
            equations alone.
        within: the chance of 2 mm and 5° by the covariance alone.
        explained: the share of rays within 3 standard deviations of the wall, the smooth error counted as noise.
        misfit: the median of their absolute residuals over what it should be; 1 where the noise is as said.
        spread: the same of the root of their mean square.
        kinship: the correlation of the residuals of neighbours, 0 where each ray is off by itself: walls that are not
            the patient's are off together.
        excess: how much more the pose costs a ray, with the smooth error estimated, than noise as said would.
        through: the share of rays whose wall was seen 3 standard deviations behind that of the anatomy.
        waves, ripples: the mean square of what the standardised residuals of points have of functions that vary over
            20° and 9° of a view: 1 to 3 where each is off by itself as said, for edges pull points to one side; more
            where walls are another patient's, and 0 where points are far better than said. 1 for depth. Of few points
            fewer functions are followed.
        again: whether anything was begun beside the best finalist; if not, the next four are as of right poses.
        agreement: the share of what was begun beside the best finalist that ended at the best pose.
        scatter: how far they ended from it, in what is asked (2 mm or 5°).
        astray: the same, those that are dearer counting less.
        dents: how much dearer they ended, in −2 log likelihood: costs are rough where walls are another patient's.
        surprise: how much dearer points are than points drawn at the best pose; 0 for depth.
        cloud: whether points were seen, which are off in every direction.
        views: how many.
        plain: whether depth was said to have no smooth error: what neighbours share then is walls of another patient.
        few: how many fewer points than 250 a single view has, as the logarithm of the ratio; else 0.
        free: whether the scale was free.
        clearance_mm: of the camera.
    """

    margin: float
    rough_margin: float
    sd_mm: float
    sd_deg: float
    within: float
    explained: float
    misfit: float
    spread: float
    kinship: float
    excess: float
    through: float
    waves: float
    ripples: float
    again: bool
    agreement: float
    scatter: float
    astray: float
    dents: float
    surprise: float
    cloud: bool
    views: int
    plain: bool
    few: float
    free: bool
    clearance_mm: float

    @staticmethod
    def of(
        at: RegistrationMap,
        observation: Observation,
        found: Found,
        basins: Int[np.ndarray, "m"],
        covariance: Float[np.ndarray, "6 6"],
    ) -> Evidence:
        """The evidence for the first of the basins.

        Args:
            at, observation: what was registered.
            found: the solutions, the best first.
            basins: those of them that are no better one's neighbours.
            covariance: of the best.
        """
        solutions = found.solutions
        above = (solutions.costs[basins] - solutions.costs[0]) * solutions.rays
        pose, scale = solutions.poses[0], float(np.exp(solutions.log_scales[0]))
        fit = _fit(at, observation, pose, scale)
        around = _around(found.again, pose, float(solutions.costs[0]))
        rng = np.random.default_rng(_SEED)
        return Evidence(
            margin=float(above[1]) if len(above) > 1 else float("inf"),
            rough_margin=_rough_margin(found.rough, pose),
            sd_mm=_largest(covariance[:3, :3]),
            sd_deg=float(np.rad2deg(_largest(covariance[3:, 3:]))),
            within=chance_within(covariance),
            explained=fit.explained,
            misfit=fit.misfit,
            spread=fit.spread,
            kinship=fit.kinship,
            excess=float(solutions.costs[0]) - fit.expected,
            through=fit.through,
            waves=fit.waves,
            ripples=fit.ripples,
            again=found.again is not None,
            agreement=around.agreement,
            scatter=around.scatter,
            astray=around.astray,
            dents=around.dents,
            surprise=surprise(at, observation, solutions, rng) if observation.is_cloud else 0.0,
            cloud=observation.is_cloud,
            views=observation.views,
            plain=not observation.is_cloud and observation.smooth == 0.0,
            few=_few(observation),
            free=observation.scale.free,
            clearance_mm=float(at.distance(pose[:3, 3])),
        )


def chance_within(covariance: Float[np.ndarray, "6 6"]) -> float:
    """Of 2 mm and 5° where twists (mm, rad) are normal with that covariance; never quite 0 or 1."""
    variance, axes = np.linalg.eigh((covariance + covariance.T) / 2)
    twists = np.random.default_rng(0).standard_normal((_DRAWS, 6)) * np.sqrt(np.maximum(variance, 0.0)) @ axes.T
    is_within = (np.linalg.norm(twists[:, :3], axis=1) <= _WITHIN_MM) & (
        np.linalg.norm(twists[:, 3:], axis=1) <= _WITHIN_RAD
    )
    return float((is_within.sum() + 0.5) / (_DRAWS + 1))


def _few(observation: Observation) -> float:
    is_single_cloud = observation.is_cloud and observation.views == 1
    return float(np.clip(np.log(_ENOUGH / len(observation)), 0.0, _FEWEST)) if is_single_cloud else 0.0


class _Around(NamedTuple):
    """See `Evidence`."""

    agreement: float
    scatter: float
    astray: float
    dents: float


_NOT_TRIED = _Around(0.9, 0.2, 0.06, 3.0)
"""Near what it is of right poses in the trials; that it was not tried is told beside it (`Evidence.again`)."""


def _around(again: Solutions | None, pose: Float[np.ndarray, "4 4"], cost: float) -> _Around:
    """Of those that began beside the best; the roots of the mean square of how far they ended from it."""
    if again is None:
        return _NOT_TRIED
    off_mm, off_rad = apart(again.poses, pose)
    off = np.maximum(off_mm / _WITHIN_MM, off_rad / _WITHIN_RAD)
    dearer = (again.costs - cost) * again.rays
    square = np.square(np.minimum(off, _FARTHEST))
    return _Around(
        float(alike(again.poses, pose, _SAME_MM, _SAME_RAD).mean()),
        float(np.sqrt(square.mean())),
        float(np.sqrt((square * np.exp(-dearer / _DEAR)).mean())),
        float(max(np.median(dearer), 0.0)),
    )


def _rough_margin(rough: Solutions, pose: Float[np.ndarray, "4 4"]) -> float:
    here = alike(rough.poses, pose, BASIN_MM, BASIN_RAD)
    if not here.any():
        return 0.0
    if here.all():
        return MOST_MARGIN
    return float(rough.costs[~here].min() - rough.costs[here].min()) * rough.rays


class _Fit(NamedTuple):
    """See `Evidence`; `expected` is what a ray would cost if all were as said."""

    explained: float
    misfit: float
    spread: float
    kinship: float
    through: float
    waves: float
    ripples: float
    expected: float


def _fit(at: RegistrationMap, observation: Observation, pose: Float[np.ndarray, "4 4"], scale: float) -> _Fit:
    """How well a pose explains the rays, each by itself."""
    rays = prepared(at, observation, fine=False).rays
    memory = memory_for(rays)
    cast_rays(at.embree, rays, pose, scale, memory)
    real = rays.valid != 0
    wall = ranges_met(rays, memory)
    met = np.isfinite(wall)
    # A ray that leaves the anatomy is explained by no wall.
    cosine = np.where(met, np.maximum(-(memory.normal * memory.ray).sum(axis=0)[real], _LEAST_COSINE), 1.0)
    even = rays.isotropic[real] / cosine
    off = np.where(met, (rays.range[real] * scale - wall) / (scale * np.hypot(rays.radial[real], even)), np.inf)
    fits = np.abs(off) < _EXPLAINED_SD
    along = np.hypot(observation.radial, even)  # rays keep the order of the observation
    expected = 1 + np.log(2 * np.pi) + 2 * float(np.log(along).mean())
    if not fits.any():
        return _Fit(0.0, np.inf, np.inf, 0.0, 0.0, 1.0, 1.0, expected)
    misfit = float(np.median(np.abs(off[fits]))) / 0.6745
    square = float(np.square(off[fits]).mean())
    # Neighbours along the Morton curve, of one view.
    both = [(off[k:] * off[:-k])[fits[k:] & fits[:-k] & _same_view(observation, k)] for k in _NEIGHBOURS]
    product = np.concatenate(both)
    kinship = float(product.mean() / square) if len(product) and square > 0 else 0.0
    through = float((met & (off >= _EXPLAINED_SD)).mean())
    waves, ripples = 1.0, 1.0
    if observation.is_cloud:
        waves = _slow_square(observation, off, fits, _WAVE_DEG, _WAVES)
        ripples = _slow_square(observation, off, fits, _RIPPLE_DEG, _RIPPLES)
    spread = np.sqrt(square) / _TRUNCATED
    return _Fit(float(fits.mean()), misfit, spread, kinship, through, waves, ripples, expected)


def _slow_square(
    observation: Observation, off: Float[np.ndarray, "n"], fits: Bool[np.ndarray, "n"], reach_deg: float, most: int
) -> float:
    """The mean square, a function, of what slow functions of a view can follow of standardised residuals that fit."""
    energy, functions = 0.0, 0
    for view in range(observation.views):
        here = fits & (observation.view == view)
        count = min(most, int(here.sum()) // _POINTS_A_WAVE)
        if count:
            waves = smooth_error(observation.directions[here], 1.0, reach_deg, count).functions
            slow = np.column_stack([np.ones(len(waves)), waves])
            followed, _, rank, _ = np.linalg.lstsq(slow, off[here], rcond=1e-6)
            energy += float(np.square(slow @ followed).sum())
            functions += int(rank)
    return energy / functions if functions else 1.0


def _same_view(observation: Observation, apart: int) -> Bool[np.ndarray, "m"]:
    return np.asarray(observation.view[apart:] == observation.view[:-apart])


def _largest(block: Float[np.ndarray, "3 3"]) -> float:
    return float(np.sqrt(max(np.linalg.eigvalsh(block)[-1], 0.0)))
