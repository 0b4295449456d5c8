"""From starts to poses: many at once coarsely, those that differ and promise most finely."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from naris.core.pose import Pose
from naris.register.equations import MOST_UNKNOWNS, Model
from naris.register.map import RegistrationMap
from naris.register.observation import Observation
from naris.register.rays import Prepared, prepared, sight
from naris.register.starts import Starts
from naris.register.steps import Schedule, States, judge, solve
from naris.register.threads import spread

COARSE_RAYS, _WIDE_RAYS = 256, 128
WIDE, COARSE = (Schedule(np.array([width]), np.array([6]), 0) for width in (4.0, 1.0))
"""First with the noise said to be four times as wide, which lets a start slip over what is small."""
FINE = Schedule(np.array([1.0]), np.array([15]), 2)
AS_THEY_ARE = Schedule(np.array([1.0]), np.array([0]), 60)
"""To the end, for nothing mends later what is left of the smooth error. Where steps follow, more rounds than two found
no more poses."""
BASIN_MM, BASIN_RAD = 2.0, 0.15
"""Poses further apart than either of these are different answers."""
_COARSE_OUTLIERS = 0.1
_PROMISING, _PROMISING_POINTS, _FEW = 0.6, 0.8, 8  # the share of starts worth a second stage, or so many if more
_ONE_MM, _ONE_RAD, _ONE_LOG = 0.15, 0.02, 0.02  # what begins there again ends where the other does
_FEW_STARTS = 16  # of so few none can be spared
_SAME_MM, _SAME_RAD = 0.5, 0.07
_BEHIND = 100.0  # in −2 log likelihood of the coarse rays: of 70 views each none was best that was so far behind
_RIG = "rig"
_ASIDE_MM, _ASIDE_RAD = 0.4, np.deg2rad(5.0)


@dataclass(frozen=True, eq=False)
class Solutions:
    """Where registrations ended, best first.

    Attributes:
        poses: (N, 4, 4) `anatomy_T_rig`.
        log_scales: (N,).
        costs: (N,) −2 log likelihood a ray, prior of the smooth error included.
        rays: how many rays a cost is the mean of.
        matrices: (N, U, U) of the normal equations; None where they were not asked for.
        model: what was estimated.
    """

    poses: Float[np.ndarray, "n 4 4"]
    log_scales: Float[np.ndarray, "n"]
    costs: Float[np.ndarray, "n"]
    rays: int
    model: Model
    matrices: Float[np.ndarray, "n u u"] | None = None

    def __len__(self) -> int:
        return len(self.costs)

    def first(self, count: int) -> Solutions:
        """The best of them."""
        matrices = None if self.matrices is None else self.matrices[:count]
        return replace(
            self, poses=self.poses[:count], log_scales=self.log_scales[:count], costs=self.costs[:count],
            matrices=matrices,
        )  # fmt: skip


def coarse(
    at: RegistrationMap,
    observation: Observation,
    starts: Starts,
    *,
    most_rays: int = COARSE_RAYS,
    every: bool = False,
) -> Solutions:
    """From all starts on some of the rays, the smooth error counted as noise.

    With the wide noise half of those rays are enough where there are many starts. Those that are far behind then are
    dropped, of points fewer: they tell places apart less; and so are all but one of those that came to the same place
    at the same scale.
    With `every` none is, and all those rays are used throughout.
    """
    few = most_rays if every or len(starts.poses) <= _FEW_STARTS else min(most_rays, _WIDE_RAYS)
    wide = _solved(at, _coarsely(at, observation, few), starts, WIDE, scattered=True)
    if every:
        left = Starts(wide.poses, wide.log_scales)
        return _solved(at, _coarsely(at, observation, most_rays), left, COARSE, scattered=True)
    share = _PROMISING_POINTS if observation.is_cloud else _PROMISING
    most = max(round(share * len(wide)), min(_FEW, len(wide)))
    kept = different(wide.first(most), most, _ONE_MM, _ONE_RAD, _ONE_LOG)
    left = Starts(wide.poses[kept], wide.log_scales[kept])
    return _solved(at, _coarsely(at, observation, most_rays), left, COARSE, scattered=True)


def _coarsely(at: RegistrationMap, observation: Observation, rays: int) -> Prepared:
    seen = prepared(at, observation.some(rays), fine=False)
    return replace(seen, model=seen.model._replace(outliers=max(seen.model.outliers, _COARSE_OUTLIERS)))


def fine(at: RegistrationMap, observation: Observation, starts: Starts) -> Solutions:
    """On all rays with the smooth error, or on all points with what is seen around them."""
    return _solved(at, prepared(at, observation, fine=True), starts, FINE, want_matrices=True)


def judged(at: RegistrationMap, observation: Observation, starts: Starts) -> Solutions:
    """What poses that somebody else solved cost on all rays, the smooth error fitted to each."""
    return _solved(at, prepared(at, observation, fine=True), starts, AS_THEY_ARE, want_matrices=True)


def _solved(
    at: RegistrationMap,
    seen: Prepared,
    starts: Starts,
    schedule: Schedule,
    *,
    want_matrices: bool = False,
    scattered: bool = False,
) -> Solutions:
    n, model = len(starts.poses), seen.model
    states = States(
        starts.poses.copy(), starts.log_scales.astype(np.float64), np.zeros((n, MOST_UNKNOWNS)), np.zeros(n)
    )
    unknowns = 6 + model.free + model.smooth
    matrices = np.zeros((n, unknowns, unknowns)) if want_matrices else None

    def work(first: int, last: int) -> None:
        looking = sight(at, seen, scattered=scattered)
        solve(looking, states, schedule, first, last)
        if matrices is not None:
            judge(looking, states, first, last, matrices)

    spread(work, n, pieces=n if want_matrices else None)
    order = np.argsort(states.costs, kind="stable")
    return Solutions(
        states.poses[order],
        states.log_scales[order],
        states.costs[order],
        seen.count,
        model,
        None if matrices is None else matrices[order],
    )


def promising(rough: Solutions, most: int) -> Starts:
    """The best of the coarse solutions that differ, as starts of the fine one, without those that are far behind."""
    kept = different(rough, most)
    kept = kept[(rough.costs[kept] - rough.costs[0]) * rough.rays < _BEHIND]
    return Starts(rough.poses[kept], rough.log_scales[kept])


def aside(solutions: Solutions, frame: str, count: int, rng: np.random.Generator) -> Starts:
    """Starts a little beside the best solution, in the frame of the anatomy.

    What a ray meets jumps where a wall hides another, so that a solution may rest in a dent of the costs; what begins
    beside it finds a deeper one there, or comes back.
    """
    twists = rng.standard_normal((count, 6)) * np.repeat([_ASIDE_MM, _ASIDE_RAD], 3)
    moved = Pose(solutions.poses[0], frame, _RIG) @ Pose.exp(twists, _RIG, _RIG)
    return Starts(np.array(moved.matrix), np.full(count, solutions.log_scales[0]))


def merged(first: Solutions, second: Solutions) -> Solutions:
    """Those of both, best first."""
    costs = np.concatenate([first.costs, second.costs])
    order = np.argsort(costs, kind="stable")
    matrices = None
    if first.matrices is not None and second.matrices is not None:
        matrices = np.concatenate([first.matrices, second.matrices])[order]
    return Solutions(
        np.concatenate([first.poses, second.poses])[order],
        np.concatenate([first.log_scales, second.log_scales])[order],
        costs[order],
        first.rays,
        first.model,
        matrices,
    )


def different(
    solutions: Solutions,
    most: int,
    apart_mm: float = _SAME_MM,
    apart_rad: float = _SAME_RAD,
    apart_log: float = np.inf,
) -> Int[np.ndarray, "m"]:
    """The best, none of which is within both distances and `apart_log`, that of scales, of a better one."""
    chosen: list[int] = []
    for k in range(len(solutions)):
        near = alike(solutions.poses[chosen], solutions.poses[k], apart_mm, apart_rad)
        scaled = np.abs(solutions.log_scales[chosen] - solutions.log_scales[k])
        if not (near & (scaled <= apart_log)).any():
            chosen.append(k)
        if len(chosen) == most:
            break
    return np.array(chosen, dtype=np.int64)


def alike(
    poses: Float[np.ndarray, "n 4 4"], pose: Float[np.ndarray, "4 4"], apart_mm: float, apart_rad: float
) -> Bool[np.ndarray, "n"]:
    """Which of them are within both distances of a pose."""
    off_mm, off_rad = apart(poses, pose)
    return np.asarray((off_mm <= apart_mm) & (off_rad <= apart_rad))


def apart(
    poses: Float[np.ndarray, "n 4 4"], pose: Float[np.ndarray, "4 4"]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """How far each of them lies from a pose (mm), and by how much it is turned (rad)."""
    off_mm = np.linalg.norm(poses[:, :3, 3] - pose[:3, 3], axis=1)
    cosine = (np.einsum("nij,ij->n", poses[:, :3, :3], pose[:3, :3]) - 1) / 2
    return off_mm, np.arccos(np.clip(cosine, -1, 1))
