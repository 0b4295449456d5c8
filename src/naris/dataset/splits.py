"""How training and test views lie to each other: the three splits of the published experiment.

`published`: the test positions lie on the training trajectories, between training positions 1 mm to either side, as in
Sinha et al. 2018; it measures interpolation between near-duplicates. `trajectory`: the test views are on trajectories
of their own and none is a neighbour of a training view. `trajectory+texture`: the very poses of `trajectory` under a
texture and a light that training has not seen, so that the difference between the two is due to the appearance alone.

A test view is a **neighbour** of a training view if their camera centres are less than 2 mm apart **and** the angle
between their viewing directions is less than 15°. (The angle between the full orientations is never smaller, so no pair
within 2 mm and 15° of each other in that sense remains either.)
"""

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
from naris.errors import DatasetError, RegionError
from naris.render.keyframes import interpolate
from naris.render.near import NEIGHBOUR_DEG, NEIGHBOUR_MM, neighbours
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
from naris.render.viewpoints import Viewpoints, joined, passages_of, sees_ahead

_PASSES_PER_REGION = 4
_SHORTEST_RUN = 3
_MOST_PASSES = 40
_STEP_MM = 1.0
_COVERED_POINTS = 4
_ROOMY_MM = 1.2
_EASE = (1.0, 0.8, 0.6, 0.4)

Accept = Callable[[Viewpoints], Bool[np.ndarray, "n"]]


@dataclass(frozen=True)
class SplitSizes:
    """How many positions and views; the defaults are the published ones: 1,270 training and 150 test images.

    Views of one position are right or wrong together, so that many positions with few views tell more than few with
    many. The published test positions lie between two of the training: it takes about two for each of them.
    """

    train_positions: int = 127
    test_positions: int = 15
    per_position: int = VIEWS_PER_POSITION


@dataclass(frozen=True, eq=False)
class Splits:
    """The training views, and the test views of the three splits.

    Trajectories and positions are numbered over all of them: a `published` test view has the trajectory of the training
    views beside it, a `trajectory` test view one that no training view has.
    """

    train: Viewpoints
    published: Viewpoints
    trajectory: Viewpoints

    @property
    def trajectory_texture(self) -> Viewpoints:
        """The poses of `trajectory`, to be rendered under an unseen texture and light."""
        return self.trajectory


def make_splits(
    anatomy: Anatomy,
    regions: RegionSet,
    rng: np.random.Generator,
    sizes: SplitSizes = SplitSizes(),
    steering: Steering | None = None,
    jitter: Jitter = OriginalJitter(),
    scene: Scene | None = None,
) -> Splits:
    """Steer through the passages again and again, and divide what is seen.

    Every region gets its share of positions, as equal as the lumen allows, in runs of positions 1 mm apart; of each
    pass only a part is kept in a region, so that a region is seen on four passes or more. Positions from which there is
    nothing to see (`Steering.median_depth_mm`) are left out.

    The views of `trajectory` are drawn first, as if there were no others, one position a region from every pass, and
    those of the training keep away from them. Drawn the other way round they would lie where the training happens to
    leave gaps, the more so the more training positions there are.

    Args:
        anatomy: to steer through, along its passages.
        regions: whose shares are balanced.
        rng: decides everything.
        sizes: how many.
        steering: how; with +z up, as the published viewer, in the mean nose, else upright, when None. Where a region
            is too narrow for its clearance, less is kept.
        jitter: between the views of a position.
        scene: of the same anatomy, if there is one already.

    Raises:
        RegionError: if no trajectory reaches a region, or the test views leave no room for training in one.
    """
    steering = steering or (PAPER_STEERING if anatomy.frame == "mean" else Steering())
    pilot = _Pilot.in_(scene or Scene(anatomy), regions, steering, sizes.per_position, jitter)
    own = _collect(pilot, sizes.test_positions, _everything, rng, longest=1)

    def no_neighbour(views: Viewpoints) -> Bool[np.ndarray, "n"]:
        return ~neighbours(own.anatomy_T_camera, views.anatomy_T_camera)

    on_way = _collect(pilot, sizes.train_positions + sizes.test_positions, no_neighbour, rng, _SHORTEST_RUN)
    held_out = np.isin(on_way.position, _between(on_way, sizes.test_positions, rng))
    train, published = on_way[~held_out], on_way[held_out]
    own = replace(
        own,
        trajectory=own.trajectory + on_way.trajectory.max() + 1,
        position=own.position + on_way.position.max() + 1,
    )
    check_no_neighbours(train.anatomy_T_camera, own.anatomy_T_camera)
    return Splits(train, published, own)


def check_no_neighbours(train: Pose, test: Pose) -> None:
    """See that a split is clean.

    Raises:
        DatasetError: if a test view has a neighbour among the training views.
    """
    near = np.flatnonzero(neighbours(train, test))
    if len(near):
        raise DatasetError(
            f"no test view within {NEIGHBOUR_MM:g} mm and {NEIGHBOUR_DEG:g}° of a training view",
            f"{len(near)} of {len(test)}, the first is number {near[0]}",
            "take the test views from other trajectories",
        )


@dataclass(frozen=True, eq=False)
class _Pilot:
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
    def in_(scene: Scene, regions: RegionSet, steering: Steering, per_position: int, jitter: Jitter) -> _Pilot:
        anatomy = scene.anatomy
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
        return _Pilot(scene, tuple(courses), reaches, distance, regions, per_position, jitter)

    def choose(self, region: int, uses: Int[np.ndarray, "c"], rng: np.random.Generator) -> int:
        """A course that touches a region, of those used least."""
        there = np.flatnonzero(self.reaches[:, region])
        return int(rng.choice(there[uses[there] == uses[there].min()]))

    def steer(self, course: int, rng: np.random.Generator) -> Viewpoints:
        """One pass along a course, without the positions where there is nothing to see."""
        passage, steering = self.courses[course]
        track = interpolate(trajectory_along(passage, self.distance, rng, steering), _STEP_MM)
        views = jitter_views(track, self.regions, rng, self.per_position, self.jitter)
        worth = sees_ahead(self.scene, track.anatomy_T_camera, steering.median_depth_mm)
        return views[worth[views.position]]


def _collect(
    pilot: _Pilot, total: int, accept: Accept, rng: np.random.Generator, shortest: int = 1, longest: int | None = None
) -> Viewpoints:
    """`total` positions of acceptable views, about equally many in each region, from as many passes as it takes.

    Of a pass, runs of `shortest` to `longest` positions are taken in each region; without a limit, as many as it takes
    to be done after four passes.
    """
    k = len(pilot.regions.names)
    left = np.full(k, total // k)
    left[rng.permutation(k)[: total % k]] += 1
    by_passes = -(-left // _PASSES_PER_REGION)
    limit = np.maximum(shortest, by_passes if longest is None else np.minimum(by_passes, longest))
    passes, found = np.zeros(k, dtype=np.int64), np.zeros(k, dtype=np.int64)
    uses = np.zeros(len(pilot.courses), dtype=np.int64)
    runs: list[Viewpoints] = []
    while left.any():
        region = int(np.argmax(left))
        if passes[region] == _MOST_PASSES:
            left = _handed_over(left, region, found, passes < _MOST_PASSES, pilot.regions)
            continue
        passes[region] += 1
        course = pilot.choose(region, uses, rng)
        uses[course] += 1
        views = pilot.steer(course, rng)
        usable = accept(views)
        for other in np.flatnonzero(left).tolist():
            most = int(min(limit[other], left[other]))
            run = _run(views, usable & (views.region == other), most, min(shortest, most), rng)
            chosen = views[np.isin(views.position, run)]
            runs.append(replace(chosen, trajectory=np.full(len(chosen), passes.sum())))
            left[other] -= len(run)
            found[other] += len(run)
    return _numbered(runs)


def _everything(views: Viewpoints) -> Bool[np.ndarray, "n"]:
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


def _between(views: Viewpoints, n: int, rng: np.random.Generator) -> Int[np.ndarray, "{n}"]:
    """`n` positions, about equally many a region, each between two of its trajectory that are not taken."""
    first = np.unique(views.position, return_index=True)[1]
    place, region = views.anatomy_T_camera.position_mm[first], views.region[first]
    same = views.trajectory[first][1:] == views.trajectory[first][:-1]
    linked = np.r_[False, same & (np.linalg.norm(np.diff(place, axis=0), axis=1) < _STEP_MM + 0.01), False]
    free = linked[:-1] & linked[1:]
    taken: list[int] = []
    while len(taken) < n:
        if not free.any():
            raise RegionError(f"{n} positions between two others", f"{len(taken)}", "take more training positions")
        candidates = np.flatnonzero(free)
        count = np.bincount(region[taken], minlength=region.max() + 1)[region[candidates]]
        fewest = candidates[count == count.min()]
        chosen = int(rng.choice(fewest))
        taken.append(chosen)
        free[max(chosen - 1, 0) : chosen + 2] = False
    return np.array(taken)


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
