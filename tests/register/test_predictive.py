"""Points drawn again at a pose: as the noise says there, and dearer only where the walls are not those."""

from __future__ import annotations

import numpy as np
import pytest

from naris.core.pose import CAMERA, Pose
from naris.register.noise import PointNoise, Scale
from naris.register.observation import from_points
from naris.register.predictive import drawn_again, surprise
from naris.register.solve import judged
from naris.register.starts import Starts

SD_MM = 0.4


def points_of(trial, seed: int, count: int = 400, dent_mm: float = 0.0) -> np.ndarray:
    """Places on the wall that a camera sees, those to the right further away by a dent, with noise."""
    rng = np.random.default_rng(seed)
    seen = np.flatnonzero(np.isfinite(trial.ranges["a"]))
    chosen = rng.choice(seen, count)
    ways, ranges = trial.rays.reshape(-1, 3)[chosen], trial.ranges["a"].ravel()[chosen]
    ranges = ranges + np.where(ways[:, 0] > 0, dent_mm, 0.0)
    return ways * ranges[:, None] + SD_MM * rng.standard_normal((count, 3))


def at_truth(trial, log_scale: float = 0.0) -> Starts:
    return Starts(trial.anatomy_T_camera.matrix[None].copy(), np.array([log_scale]))


def test_points_that_are_as_said_are_no_surprise_and_a_dent_is(prepared_nose, trials) -> None:
    noise = PointNoise(SD_MM, outliers=1e-9)
    as_said, dented = (
        [
            surprise(prepared_nose, seen, judged(prepared_nose, seen, at_truth(trial)), np.random.default_rng(0))
            for k, trial in enumerate(trials)
            for seen in [from_points(points_of(trial, k, dent_mm=dent), noise)]
        ]
        for dent in (0.0, 0.8)
    )
    assert np.abs(np.median(as_said)) < 3
    assert max(as_said) < 8
    assert np.median(dented) > 10


def test_it_is_the_same_in_any_unit(prepared_nose, trials) -> None:
    points = points_of(trials[0], 1)
    one = from_points(points, PointNoise(SD_MM))
    other = from_points(points / 2.0, PointNoise(SD_MM / 2.0), Scale("unknown"))
    told = [
        surprise(
            prepared_nose,
            seen,
            judged(prepared_nose, seen, at_truth(trials[0], log_scale)),
            np.random.default_rng(0),
        )
        for seen, log_scale in ((one, 0.0), (other, np.log(2.0)))
    ]
    assert told[0] == pytest.approx(told[1], abs=0.5)


def test_drawn_points_have_the_noise_and_the_outliers_that_were_said(prepared_nose, trials) -> None:
    trial = trials[0]
    ways = np.repeat(trial.rays[::4, ::4].reshape(-1, 3), 20, axis=0)
    ranges = np.repeat(trial.ranges["a"][::4, ::4].ravel(), 20)
    rng = np.random.default_rng(0)
    clean = from_points(ways * ranges[:, None], PointNoise(SD_MM, outliers=1e-9))
    again = drawn_again(prepared_nose, clean, at_truth(trial), rng)
    off = again.directions * again.ranges[:, None] - clean.directions * clean.ranges[:, None]
    assert np.median(off, axis=0) == pytest.approx(np.zeros(3), abs=0.02)
    assert 1.4826 * np.median(np.abs(off)) == pytest.approx(SD_MM, rel=0.03)
    some = from_points(ways * ranges[:, None], PointNoise(SD_MM, outliers=0.3))
    again = drawn_again(prepared_nose, some, at_truth(trial), rng)
    aside = np.linalg.norm(np.cross(again.directions, some.directions), axis=1)
    assert (aside < 1e-9).mean() == pytest.approx(0.3, abs=0.02)  # outliers stay on the ray they were seen along


def test_a_ray_that_meets_no_wall_is_drawn_as_an_outlier(prepared_nose, trials) -> None:
    outside = Pose(np.eye(4), prepared_nose.anatomy.frame, CAMERA).matrix.copy()
    outside[:3, 3] = prepared_nose.anatomy.bounds_mm[1] + 100.0
    seen = from_points(points_of(trials[0], 2), PointNoise(SD_MM, outliers=1e-9))
    again = drawn_again(prepared_nose, seen, Starts(outside[None], np.zeros(1)), np.random.default_rng(0))
    assert np.isfinite(again.directions).all()
    assert np.linalg.norm(np.cross(again.directions, seen.directions), axis=1).max() < 1e-9
