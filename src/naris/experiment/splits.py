"""The three splits of the published experiment as a report tells of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from naris.dataset.read import Dataset
from naris.experiment.sets import PUBLISHED, TRAJECTORY, TRAJECTORY_TEXTURE, Sets
from naris.report.data import Line, NearestPair, Split, ViewSet
from naris.report.nearest import nearest_views


class _Words(NamedTuple):
    label: str
    phrase: str
    explanation: str
    leaky: bool


_WORDS = {
    PUBLISHED: _Words(
        "published split",
        "on the published split",
        "As in the publication: the test positions lie on the training trajectories, between training positions 1 mm"
        " to either side. It measures interpolation between near-copies.",
        leaky=True,
    ),
    TRAJECTORY: _Words(
        "unseen trajectories",
        "on unseen trajectories",
        "Test trajectories of their own; no test view has a training view within 2 mm and 15°, and views at will keep"
        " away from them as far. Texture and light are those of the training pictures.",
        leaky=False,
    ),
    TRAJECTORY_TEXTURE: _Words(
        "unseen trajectories, texture and light",
        "on unseen trajectories under unseen texture and light",
        "The poses of the unseen trajectories once more, each picture with a mucosa, light and sensor drawn from"
        " a distribution that no training draws from.",
        leaky=False,
    ),
}


def describe_splits(sets: Sets) -> tuple[Split, ...]:
    """Each split with how near its views are to those of the training, and a typical pair."""
    return tuple(_describe(key, sets.train, test) for key, test in sets.tests.items())


def _describe(key: str, train: Dataset, test: Dataset) -> Split:
    words = _WORDS[key]
    near = nearest_views(train.anatomy_T_camera, test.anatomy_T_camera)
    i = near.typical
    j = int(near.index[i])
    pair = NearestPair(test.images([i])[0], train.images([j])[0], float(near.distance_mm[i]), float(near.angle_deg[i]))
    return Split(
        key,
        words.label,
        words.explanation,
        len(test),
        words.leaky,
        near.distance_mm,
        near.angle_deg,
        pair,
        words.phrase,
    )


def example_views(sets: Sets, per_region: int = 6) -> tuple[ViewSet, ...]:
    """Pictures of each region, evenly spread over its views: from the training, and under the unseen looks."""
    return (
        _views("Training pictures", "The fixed set that some of the networks learn from.", sets.train, per_region),
        _views(
            "Test pictures under unseen texture and light",
            "The same nose along other trajectories, with mucosa, light and sensor drawn anew for every picture.",
            sets.tests[TRAJECTORY_TEXTURE],
            per_region,
        ),
    )


def _views(title: str, caption: str, pictures: Dataset, per_region: int) -> ViewSet:
    chosen = []
    for region in range(len(pictures.regions.names)):
        of_region = np.flatnonzero(pictures.labels == region)
        spread = np.linspace(0, len(of_region) - 1, min(per_region, len(of_region))).astype(int)
        chosen.append(pictures.images(of_region[spread]))
    return ViewSet(title, caption, tuple(chosen))


def trajectory_lines(sets: Sets) -> tuple[Line, ...]:
    """The camera's ways, to be drawn over the anatomy."""
    lines = []
    for role, pictures in (("training", sets.train), ("test", sets.tests[TRAJECTORY])):
        views = pictures.views
        for number in np.unique(views.trajectory):
            on_it = np.flatnonzero(views.trajectory == number)
            first = on_it[np.unique(views.position[on_it], return_index=True)[1]]
            points = views.anatomy_T_camera.position_mm[first]
            lines.append(Line(f"{role} trajectory {number}", role, points))  # type: ignore[arg-type]
    return tuple(lines)
