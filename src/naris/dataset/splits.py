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

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int

from naris.core.anatomy import Anatomy, RegionSet
from naris.core.pose import Pose
from naris.dataset.pilot import STEP_MM, Pilot, everything
from naris.errors import DatasetError, RegionError
from naris.render.near import NEIGHBOUR_DEG, NEIGHBOUR_MM, neighbours
from naris.render.scene import Scene
from naris.render.trajectories import VIEWS_PER_POSITION, Jitter, OriginalJitter, Steering
from naris.render.viewpoints import Viewpoints

_SHORTEST_RUN = 3


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
    pilot = Pilot.in_(scene or Scene(anatomy), regions, sizes.per_position, steering, jitter)
    own = pilot.collect(sizes.test_positions, everything, rng, longest=1)

    def no_neighbour(views: Viewpoints) -> Bool[np.ndarray, "n"]:
        return ~neighbours(own.anatomy_T_camera, views.anatomy_T_camera)

    on_way = pilot.collect(sizes.train_positions + sizes.test_positions, no_neighbour, rng, _SHORTEST_RUN)
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


def _between(views: Viewpoints, n: int, rng: np.random.Generator) -> Int[np.ndarray, "{n}"]:
    """`n` positions, about equally many a region, each between two of its trajectory that are not taken."""
    first = np.unique(views.position, return_index=True)[1]
    place, region = views.anatomy_T_camera.position_mm[first], views.region[first]
    same = views.trajectory[first][1:] == views.trajectory[first][:-1]
    linked = np.r_[False, same & (np.linalg.norm(np.diff(place, axis=0), axis=1) < STEP_MM + 0.01), False]
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
