"""Where registrations begin: places and views that fit what was seen, or poses that somebody believes in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from naris.core.anatomy import NOWHERE, RegionSet
from naris.core.pose import CAMERA, Pose
from naris.core.results import Prediction
from naris.errors import InputError, PoseError, RegionError
from naris.register.compare import Fits, Search, compare
from naris.register.directions import rotations, texels
from naris.register.map import TEXELS, RegistrationMap, factor_of, quantised, steps_of
from naris.register.observation import Observation
from naris.register.rays import cast_rays, memory_for, ranges_met, rays_of
from naris.register.threads import spread
from naris.render.sources import OF_PACKETS, sources_of

_LOOKED_AT = 100
_FEW = 3
_PRIOR_SD = 2.0  # how far a scale may begin from its prior
_ASKED = 3000  # starts of the first view that the other views are asked about
_NONE, _LATER = 2**30, 2**24  # instead of a sum of differences: there is no start; above all of those who were asked
_TINY = 1e-9  # mm² or rad² that a variance may lie below 0
_CAP = 24  # steps of `quantised`: a factor of 1.8


@dataclass(frozen=True)
class Orientation:
    """How a camera may be turned, where nothing else is known.

    Attributes:
        tilt_deg: it looks within this angle of the way inwards.
        roll_deg: it is rolled by at most so much from upright; 180 for any roll.
        apart_deg: between the directions that are tried.
    """

    tilt_deg: float = 90.0
    roll_deg: float = 40.0
    apart_deg: float = 13.0

    def __post_init__(self) -> None:
        if not (0 < self.tilt_deg <= 180 and 0 <= self.roll_deg <= 180 and 3 <= self.apart_deg <= 45):
            raise InputError(
                "a tilt and a roll up to 180° and directions 3 to 45° apart", f"{self}", "correct the orientation"
            )


@dataclass(frozen=True, eq=False)
class Belief:
    """What is believed of the pose before the observation is compared.

    Attributes:
        regions: a region set of the anatomy; None if nothing is known of the region.
        chances: by region name, summing to 1.
        poses: `anatomy_T_camera` (M,) to begin from as well.
        covariance: (M, 6, 6) of their twists in the camera (mm, rad).
        orientation: how the camera may be turned, for starts that are no poses.
        only_poses: begin from the poses alone, and then a little beside the best that they led to.

    Raises:
        PoseError: if the poses are not of a camera, or not one after the other.
        InputError: if there are none to begin from alone, or the covariances are not of them.
    """

    regions: RegionSet | None = None
    chances: Mapping[str, float] = field(default_factory=dict)
    poses: Pose | None = None
    covariance: Float[np.ndarray, "..."] | None = None
    orientation: Orientation = Orientation()
    only_poses: bool = False

    def __post_init__(self) -> None:
        count = 0
        if self.poses is not None:
            if self.poses.source != CAMERA or len(self.poses.shape) != 1:
                got = f"{self.poses.shape} {self.poses.target}_T_{self.poses.source}"
                raise PoseError("poses anatomy_T_camera (M,)", got, "convert them first")
            count = len(self.poses)
        if self.only_poses and not count:
            raise InputError("poses to begin from alone", "none", "give some, or begin from nothing")
        if self.covariance is not None:
            if np.shape(self.covariance) != (count, 6, 6):
                got = f"{np.shape(self.covariance)}"
                raise InputError(f"a covariance (6, 6) for each of {count} poses", got, "give one for each")
            alike = np.allclose(self.covariance, np.swapaxes(self.covariance, -1, -2))  # NaN is not like itself
            if not alike or not (np.linalg.eigvalsh(self.covariance) >= -0.5 * _TINY).all():
                raise InputError("symmetric covariances without a negative variance", "others", "correct them")

    def chance(self, places_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Of the region of each place; 1 where nothing is known, 0 in no region."""
        if self.regions is None:
            return np.ones(len(places_mm))
        label = self.regions.label(places_mm)
        by_label = np.array([*(self.chances.get(name, 0.0) for name in self.regions.names), 0.0])
        return by_label[np.where(label == NOWHERE, len(by_label) - 1, label)]


NOTHING = Belief()


def in_region(regions: RegionSet, name: str, orientation: Orientation = Orientation()) -> Belief:
    """The camera is in that region, somebody says.

    Raises:
        RegionError: if there is none of that name.
    """
    if name not in regions.names:
        raise RegionError(f"one of the regions {list(regions.names)}", repr(name), "name one of those")
    return Belief(regions, {name: 1.0}, orientation=orientation)


def near(poses: Pose, covariance: Float[np.ndarray, "..."]) -> Belief:
    """The camera is at one of those poses, give or take, and nowhere else. All of them are begun from.

    Args:
        poses: `anatomy_T_camera` (M,), or one.
        covariance: (M, 6, 6) of their twists in the camera (mm, rad).

    Raises:
        PoseError, InputError: as `Belief`.
    """
    return Belief(poses=poses.reshape(-1), covariance=covariance, only_poses=True)


def of_prediction(prediction: Prediction, regions: RegionSet, softness: float = 0.1) -> Belief:
    """What a localizer believes, softened: no region gets less than its share of `softness`.

    A hard choice of region costs as many registrations as the choice is wrong.

    Raises:
        RegionError: if the prediction is of other regions.
    """
    if tuple(prediction.region_names) != tuple(regions.names):
        raise RegionError(
            f"a prediction of the regions {list(regions.names)}",
            f"one of {list(prediction.region_names)}",
            "use a model made for this region set",
        )
    soft = (1 - softness) * prediction.probabilities + softness / len(regions.names)
    chances = {name: float(p) for name, p in zip(regions.names, soft / soft.sum(), strict=True)}
    return Belief(regions, chances, prediction.hypotheses, prediction.covariance)


@dataclass(frozen=True, eq=False)
class Starts:
    """Poses (N, 4, 4) `anatomy_T_rig`, and the logarithm of the scale at each."""

    poses: Float[np.ndarray, "n 4 4"]
    log_scales: Float[np.ndarray, "n"]


def find_starts(
    at: RegistrationMap, observation: Observation, belief: Belief, count: int, rng: np.random.Generator
) -> Starts:
    """The `count` most promising starts: the poses that are believed in with some beside them, then what fits.

    Raises:
        PoseError: if the believed poses are in another frame.
        RegionError: if no place of the anatomy lies in a region of some chance.
    """
    many = 0 if belief.poses is None else len(belief.poses)
    given = _beside(at, belief, observation, max(count, many) if belief.only_poses else count // 3, rng)
    if belief.only_poses:
        return given
    found = _that_fit(at, observation, belief, count - len(given.poses))
    return Starts(np.concatenate([given.poses, found.poses]), np.concatenate([given.log_scales, found.log_scales]))


def _beside(
    at: RegistrationMap, belief: Belief, observation: Observation, count: int, rng: np.random.Generator
) -> Starts:
    """The believed poses, then draws from their covariance, as many of each."""
    poses = belief.poses
    if poses is None or not count:
        return Starts(np.zeros((0, 4, 4)), np.zeros(0))
    if poses.target != at.anatomy.frame:
        raise PoseError(f"poses into the frame {at.anatomy.frame}", f"into {poses.target}", "convert them first")
    m = len(poses)
    numbers = np.arange(count) % m
    spread_by = np.tile(np.diag([1.0, 1.0, 1.0, 0.01, 0.01, 0.01]), (m, 1, 1))
    roots = np.linalg.cholesky((spread_by if belief.covariance is None else belief.covariance) + _TINY * np.eye(6))
    twists = np.einsum("nij,nj->ni", roots[numbers], rng.standard_normal((count, 6)))
    twists[:m] = 0.0
    moved = np.array((poses[numbers] @ Pose.exp(twists, poses.source, poses.source)).matrix)
    return Starts(moved, _scales_at(at, observation, moved))


def _scales_at(
    at: RegistrationMap, observation: Observation, poses: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, "n"]:
    """The logarithm of the scale at which the first view's ranges are those of the walls, in the median."""
    scale = observation.scale
    logs = np.full(len(poses), np.log(scale.middle))
    if not scale.free:
        return logs
    few = observation.rows(observation.view == 0).some(_LOOKED_AT)
    n, ones = len(few), np.ones(len(few))
    rays = rays_of(np.zeros((n, 3)), few.directions, ones, ones, ones)
    memory = memory_for(rays)
    reach = (
        (np.log(scale.low), np.log(scale.high))
        if scale.kind == "unknown"
        else logs[0] + _PRIOR_SD * np.array([-scale.sd_log, scale.sd_log])
    )
    for k, pose in enumerate(poses):
        cast_rays(at.embree, rays, pose, 1.0, memory)
        wall = ranges_met(rays, memory)
        met = np.isfinite(wall)
        if met.any():
            ratio = np.log(wall[met] / few.ranges[met])
            logs[k] = np.clip(np.median(ratio), *reach)
    return logs


def _that_fit(at: RegistrationMap, observation: Observation, belief: Belief, count: int) -> Starts:
    """Every place of a region that has a chance, turned every way: what differs least from the observation."""
    chance = belief.chance(at.places_mm)
    chosen = np.flatnonzero(chance > 0)
    if not len(chosen):
        raise RegionError(
            f"room for a camera in one of the regions {sorted(belief.chances)}", "none", "name another region"
        )
    few = observation.rows(observation.view == 0).some(_LOOKED_AT)
    turns = _rotations(tuple(at.inward.tolist()), belief.orientation)
    where = texels((turns @ few.directions.T).transpose(0, 2, 1), TEXELS).astype(np.int32)
    scale = observation.scale
    ranges = few.ranges * scale.middle
    best = np.full((len(chosen), _FEW), _NONE, np.int32)
    fits = Fits(best, np.zeros_like(best), np.zeros_like(best))
    seen = quantised(ranges).astype(np.int32)
    search = Search(at.panoramas[chosen], seen, where, int(scale.free), _CAP, _shifts(observation), _sources())

    def work(first: int, last: int) -> None:
        compare(search, first, last, fits)

    spread(work, len(chosen))
    if observation.views > 1:
        best = _with_other_views(at, observation, fits, at.places_mm[chosen], turns)
    region = np.zeros(len(chosen)) if belief.regions is None else belief.regions.label(at.places_mm[chosen])
    order = _stratified(best, chance[chosen], region, count)
    place, k = order // _FEW, order % _FEW
    poses = np.tile(np.eye(4), (len(order), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = turns[fits.turn[place, k]], at.places_mm[chosen[place]]
    log_scales = -factor_of(fits.shift[place, k]) if scale.free else np.zeros(len(order))
    return Starts(poses, log_scales + np.log(scale.middle))


def _with_other_views(
    at: RegistrationMap,
    observation: Observation,
    fits: Fits,
    places_mm: Float[np.ndarray, "p 3"],
    turns: Float[np.ndarray, "r 3 3"],
) -> Int[np.ndarray, "p f"]:
    """The differences of the most promising with those of the other views added; the rest come after them.

    What another view saw is compared with what is seen from the place nearest to where it would stand, as if the points
    that it saw were seen from there.
    """
    flat = fits.best.ravel()
    order = np.argsort(flat, kind="stable")[:_ASKED]
    order = order[flat[order] < _NONE]
    place, k = order // fits.best.shape[1], order % fits.best.shape[1]
    rotation, scale = turns[fits.turn[place, k]], observation.scale.middle * np.exp(-factor_of(fits.shift[place, k]))
    total = flat[order].astype(np.int64)
    tree = cKDTree(at.places_mm)
    for view in range(1, observation.views):
        few = observation.rows(observation.view == view).some(_LOOKED_AT)
        stands = places_mm[place] + scale[:, None] * (rotation @ few.origins[0])
        nearest = tree.query(stands)[1]
        ways = few.directions @ rotation.transpose(0, 2, 1)
        points = (stands - at.places_mm[nearest])[:, None] + (scale[:, None] * few.ranges)[..., None] * ways
        seen = quantised(np.linalg.norm(points, axis=2)).astype(np.int64)
        off = np.abs(seen - np.take_along_axis(at.panoramas[nearest], texels(points, TEXELS), axis=1))
        total += np.minimum(off, _CAP).sum(axis=1)
    summed = np.where(flat < _NONE, flat.astype(np.int64) + _LATER, _NONE)
    summed[order] = total
    return summed.reshape(fits.best.shape)


def _shifts(observation: Observation) -> tuple[int, int]:
    """The range about its middle that the scale is sought in, in steps; ranges fall as the factor rises."""
    scale = observation.scale
    if scale.kind == "unknown":
        return -steps_of(scale.high / scale.middle), -steps_of(scale.low / scale.middle)
    reach = max(steps_of(float(np.exp(2 * scale.sd_log))), 1)
    return -reach, reach


def _stratified(
    best: Int[np.ndarray, "p f"], chance: Float[np.ndarray, "p"], region: np.ndarray, count: int
) -> Int[np.ndarray, "m"]:
    """Half of them the best of all, for a belief may be wrong; half for each region as many as its chance is worth."""
    flat, of = best.ravel(), np.repeat(region, best.shape[1])
    order = np.argsort(flat, kind="stable")
    order = order[flat[order] < _NONE]
    regions, first = np.unique(region, return_index=True)
    if len(regions) == 1:
        return order[:count]
    half, chances = count // 2, chance[first]
    rest, total = order[half:], np.sort(chances).sum()
    share = ((k, max(round(half * chances[k] / total), 1)) for k in np.argsort(-chances, kind="stable"))
    return np.concatenate([order[:half], *(rest[of[rest] == regions[k]][:most] for k, most in share)])


@lru_cache(maxsize=1)
def _sources() -> np.ndarray:
    return sources_of("naris.register.compare", *OF_PACKETS)


@lru_cache(maxsize=8)
def _rotations(inward: tuple[float, float, float], orientation: Orientation) -> Float[np.ndarray, "r 3 3"]:
    return rotations(np.array(inward), orientation.tilt_deg, orientation.roll_deg, orientation.apart_deg)
