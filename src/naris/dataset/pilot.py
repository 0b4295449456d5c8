"""Somebody who steers a camera through an anatomy again and again, and keeps some of what is seen in each region."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int
from scipy.spatial import cKDTree

from naris.anatomy.distance import SignedDistance, signed_distance
from naris.anatomy.passages import Route, find_passages
from naris.core.anatomy import Anatomy, Passage, RegionSet
from naris.core.pose import Pose
from naris.errors import InputError, RegionError
from naris.render.keyframes import interpolate
from naris.render.near import neighbours, turned_away
from naris.render.scene import Scene
from naris.render.trajectories import (
    PAPER_STEERING,
    VIEWS_PER_POSITION,
    Jitter,
    OriginalJitter,
    Steering,
    jitter_views,
    measured,
    roomy_parts,
    trajectory_along,
)
from naris.render.viewpoints import FREE, Viewpoints, joined, passages_of, sees_ahead

STEP_MM = 1.0
"""From one position of a pass to the next."""

_PASSES_PER_REGION = 4
_MOST_PASSES = 40
_GLIMPSES = 4
_COVERED_POINTS = 4
_ROOMY_MM = 1.2
_EASE = (1.0, 0.8, 0.6, 0.4)

Accept = Callable[[Viewpoints], Bool[np.ndarray, "n"]]


@dataclass(frozen=True, eq=False)
class Pilot:
    """Somebody who steers through an anatomy.

    Attributes:
        courses: stretches of passages, each with the steering that fits into it.
        reaches: (C, K) whether a course touches a region.
    """

    scene: Scene
    courses: tuple[tuple[Passage, Steering], ...]
    reaches: Bool[np.ndarray, "c k"]
    distance: SignedDistance
    regions: RegionSet
    per_position: int
    jitter: Jitter

    @staticmethod
    def in_(
        scene: Scene,
        regions: RegionSet,
        per_position: int = VIEWS_PER_POSITION,
        steering: Steering | None = None,
        jitter: Jitter = OriginalJitter(),
    ) -> Pilot:
        """Find the courses (a second).

        Args:
            scene: what is steered through, along the passages of its anatomy.
            regions: each of which some course must touch.
            per_position: views of a position.
            steering: how; with +z up, as the published viewer, in the mean nose, else upright, when None. Where a
                region is too narrow for its clearance, less is kept.
            jitter: between the views of a position.

        Raises:
            RegionError: if no passage with room for a camera leads into a region.
        """
        anatomy = scene.anatomy
        steering = steering or (PAPER_STEERING if anatomy.frame == "mean" else Steering())
        distance = signed_distance(anatomy)
        passages = list(passages_of(anatomy, distance))
        missing = np.flatnonzero(~_any(_touched(passages, regions), 0))
        passages += [_passage_to(region, anatomy, distance, regions, passages) for region in missing.tolist()]
        by_grid = [measured(passage, distance) for passage in passages]
        courses: list[tuple[Passage, Steering]] = []
        for ease in _EASE:
            eased = replace(steering, clearance_mm=ease * steering.clearance_mm)
            covered = _any(_touched([passage for passage, _ in courses], regions), 0)
            parts = [part for passage in by_grid for part in roomy_parts(passage, eased.clearance_mm)]
            new = _any(_touched(parts, regions) & ~covered, 1)
            courses += [(part, eased) for part, is_new in zip(parts, new, strict=True) if is_new]
        reaches = _touched([passage for passage, _ in courses], regions)
        unreached = [name for name, reached in zip(regions.names, _any(reaches, 0), strict=True) if not reached]
        if unreached:
            raise RegionError(
                f"a passage with room for a camera into every region of {regions.name!r}",
                f"none into {', '.join(unreached)}",
                "merge such a region with a neighbour",
            )
        return Pilot(scene, tuple(courses), reaches, distance, regions, per_position, jitter)

    def choose(self, region: int, uses: Int[np.ndarray, "c"], rng: np.random.Generator) -> int:
        """A course that touches a region, of those used least."""
        there = np.flatnonzero(self.reaches[:, region])
        return int(rng.choice(there[uses[there] == uses[there].min()]))

    def steer(self, course: int, rng: np.random.Generator) -> Viewpoints:
        """One pass along a course, without the positions where there is nothing to see."""
        passage, steering = self.courses[course]
        track = interpolate(trajectory_along(passage, self.distance, rng, steering), STEP_MM)
        views = jitter_views(track, self.regions, rng, self.per_position, self.jitter)
        worth = sees_ahead(self.scene, track.anatomy_T_camera, steering.median_depth_mm)
        return views[worth[views.position]]

    def collect(
        self,
        total: int,
        accept: Accept,
        rng: np.random.Generator,
        shortest: int = 1,
        longest: int | None = None,
    ) -> Viewpoints:
        """`total` positions of acceptable views, about equally many in each region, from as many passes as it takes.

        Of a pass, runs of `shortest` to `longest` positions are taken in each region; without a limit, as many as it
        takes to be done after four passes.
        """
        k = len(self.regions.names)
        left = np.full(k, total // k)
        left[rng.permutation(k)[: total % k]] += 1
        by_passes = -(-left // _PASSES_PER_REGION)
        limit = np.maximum(shortest, by_passes if longest is None else np.minimum(by_passes, longest))
        passes, found = np.zeros(k, dtype=np.int64), np.zeros(k, dtype=np.int64)
        uses = np.zeros(len(self.courses), dtype=np.int64)
        runs: list[Viewpoints] = []
        while left.any():
            region = int(np.argmax(left))
            if passes[region] == _MOST_PASSES:
                left = _handed_over(left, region, found, passes < _MOST_PASSES, self.regions)
                continue
            passes[region] += 1
            course = self.choose(region, uses, rng)
            uses[course] += 1
            views = self.steer(course, rng)
            usable = accept(views)
            for other in np.flatnonzero(left).tolist():
                most = int(min(limit[other], left[other]))
                run = _run(views, usable & (views.region == other), most, min(shortest, most), rng)
                chosen = views[np.isin(views.position, run)]
                runs.append(replace(chosen, trajectory=np.full(len(chosen), passes.sum())))
                left[other] -= len(run)
                found[other] += len(run)
        return _numbered(runs)

    def glimpses(self, n: int, rng: np.random.Generator, avoid: Pose | None = None) -> Viewpoints:
        """`n` single views from as many passes as it takes, about equally many in each region, a few of each pass.

        Args:
            n: how many.
            rng: of everything random.
            avoid: views that stay unseen: a camera near one of them looks just past it (`naris.render.near`).

        Raises:
            RegionError: if a region shows nothing on many passes.
            InputError: if not one view is asked for.
        """
        if n < 1:
            raise InputError("one view or more", f"{n}", "ask for some")
        k = len(self.regions.names)
        left = np.full(k, n // k)
        left[rng.permutation(k)[: n % k]] += 1
        passes, uses = np.zeros(k, dtype=np.int64), np.zeros(len(self.courses), dtype=np.int64)
        found: list[Viewpoints] = []
        while left.any():
            region = int(rng.choice(np.flatnonzero(left)))
            passes[region] += 1
            if passes[region] > _MOST_PASSES + n:
                raise RegionError(
                    f"trajectories with views in {self.regions.names[region]!r} that are allowed",
                    f"too few on {_MOST_PASSES + n} passes",
                    "merge the region with a neighbour",
                )
            course = self.choose(region, uses, rng)
            uses[course] += 1
            views = self.steer(course, rng)
            views = views[views.region == region]
            if avoid is not None and len(views):
                views = self._past(avoid, views, self.courses[course][1], rng)
            taken = rng.permutation(len(views))[: min(_GLIMPSES, left[region])]
            left[region] -= len(taken)
            found.append(views[np.sort(taken)])
        views = joined([part for part in found if len(part)])
        free = np.full(len(views), FREE)
        return replace(views, trajectory=free, position=free)

    def _past(self, avoid: Pose, views: Viewpoints, steering: Steering, rng: np.random.Generator) -> Viewpoints:
        """The views, those near an unseen one turned away, without those that then show nothing or are near still."""
        poses = turned_away(avoid, views.anatomy_T_camera, rng)
        fits = ~neighbours(avoid, poses) & sees_ahead(self.scene, poses, steering.median_depth_mm)
        return replace(views, anatomy_T_camera=poses)[fits]


def everything(views: Viewpoints) -> Bool[np.ndarray, "n"]:
    """Accepts all of them."""
    return np.ones(len(views), dtype=bool)


def _run(
    views: Viewpoints, usable: Bool[np.ndarray, "n"], most: int, least: int, rng: np.random.Generator
) -> Int[np.ndarray, "m"]:
    """Positions in a row whose views are all usable: at most `most`, none if there are fewer than `least`."""
    there = np.bincount(views.position)
    good = np.flatnonzero((there > 0) & (np.bincount(views.position, usable) == there))
    stretches = [part for part in np.split(good, np.flatnonzero(np.diff(good) > 1) + 1) if len(part) >= max(least, 1)]
    if not stretches:
        return good[:0]
    # Every start equally often, else short stretches, which lie where a way touches a border, would be crowded.
    starts = np.array([max(len(stretch) - most, 0) + 1 for stretch in stretches])
    chosen = int(rng.choice(len(stretches), p=starts / starts.sum()))
    start = int(rng.integers(starts[chosen]))
    return stretches[chosen][start : start + most]


def _handed_over(
    left: Int[np.ndarray, "k"],
    region: int,
    found: Int[np.ndarray, "k"],
    is_open: Bool[np.ndarray, "k"],
    regions: RegionSet,
) -> Int[np.ndarray, "k"]:
    """What is left to find when a region has no more: its share goes to the others, if it has some positions at all."""
    if not found[region] or not is_open.any():
        raise RegionError(
            f"trajectories with views in {regions.names[region]!r} that are allowed in this split",
            f"{found[region]} positions on {_MOST_PASSES} passes",
            "take fewer positions, or merge the region with a neighbour",
        )
    left = left.copy()
    takers = np.flatnonzero(is_open)
    left[takers] += left[region] // len(takers)
    left[takers[: left[region] % len(takers)]] += 1
    left[region] = 0
    return left


def _numbered(runs: Sequence[Viewpoints]) -> Viewpoints:
    """In the order of trajectories and positions, both numbered 0, 1, … without gaps."""
    views = joined([run for run in runs if len(run)])
    views = views[np.lexsort((views.position, views.trajectory))]
    _, trajectory = np.unique(views.trajectory, return_inverse=True)
    pairs = np.stack([views.trajectory, views.position], axis=1)
    _, position = np.unique(pairs, axis=0, return_inverse=True)
    return replace(views, trajectory=trajectory.reshape(-1), position=position.reshape(-1))


def _touched(passages: Sequence[Passage], regions: RegionSet) -> Bool[np.ndarray, "p k"]:
    """Whether each passage has a few points (0.5 mm apart) in each region."""
    touched = np.zeros((len(passages), len(regions.names)), dtype=bool)
    for row, passage in zip(touched, passages, strict=True):
        label = regions.label(passage.points_mm)
        row[:] = np.bincount(label[label >= 0], minlength=len(row)) >= _COVERED_POINTS
    return touched


def _any(touched: Bool[np.ndarray, "p k"], axis: int) -> Bool[np.ndarray, "*n"]:
    return np.asarray(touched.any(axis=axis))


def _passage_to(
    region: int, anatomy: Anatomy, distance: SignedDistance, regions: RegionSet, passages: Sequence[Passage]
) -> Passage:
    """A passage that ends in a roomy place of the region, as far as can be from the other passages."""
    inside = np.argwhere(distance.values_mm > 0)
    places = distance.origin_mm + distance.spacing_mm * inside
    clearance = distance.values_mm[tuple(inside.T)]
    there = np.flatnonzero(regions.label(places) == region)
    if not len(there):
        raise RegionError(
            f"room for a camera in every region of {regions.name!r}", f"none in {regions.names[region]!r}", "merge it"
        )
    there = there[clearance[there] >= min(_ROOMY_MM, 0.8 * float(clearance[there].max()))]
    reach, _ = cKDTree(np.concatenate([passage.points_mm for passage in passages])).query(places[there])
    goal = places[there[np.argmax(reach)]]
    starts = np.unique(np.round([passage.points_mm[0] for passage in passages], 1), axis=0)
    routes = [Route(f"to {regions.names[region]}", start, goal) for start in starts]
    return min(find_passages(anatomy, distance, routes), key=lambda passage: passage.length_mm)
