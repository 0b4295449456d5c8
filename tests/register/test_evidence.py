"""What speaks for a pose: the chance that a covariance leaves it, and rivals among all that was tried."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from naris.bench.trials import drawn_trials
from naris.core.pose import CAMERA, Pose, distance
from naris.register import evidence
from naris.register.confidence import features
from naris.register.equations import RANGES, Model
from naris.register.evidence import MOST_MARGIN, chance_within
from naris.register.noise import PointNoise
from naris.register.observation import from_points, together
from naris.register.register import RegisterConfig, register
from naris.register.solve import Solutions
from naris.register.starts import NOTHING, Starts, near


def loose_by(sd_mm: float, sd_deg: float) -> np.ndarray:
    return np.diag([sd_mm**2] * 3 + [np.deg2rad(sd_deg) ** 2] * 3)


@pytest.mark.parametrize(("sd_mm", "sd_deg"), [(0.5, 1.0), (1.0, 1.0), (0.3, 2.5), (1.2, 3.0), (3.0, 1.0)])
def test_the_chance_by_the_covariance_is_that_of_two_chi_squared(sd_mm: float, sd_deg: float) -> None:
    expected = chi2.cdf((2.0 / sd_mm) ** 2, 3) * chi2.cdf((5.0 / sd_deg) ** 2, 3)
    assert chance_within(loose_by(sd_mm, sd_deg)) == pytest.approx(expected, abs=0.05)


def test_a_direction_that_nothing_holds_is_no_error() -> None:
    """As of a bare plane: rounding may give such a direction a variance below 0."""
    axes = np.linalg.qr(np.random.default_rng(0).standard_normal((6, 6)))[0]
    loose = axes @ np.diag([1e9, 1e9, 1e9, 1e-9, 1e-9, -1e-7]) @ axes.T
    assert 0 < chance_within(loose) < 0.01


def test_it_is_never_sure_and_does_not_depend_on_the_axes() -> None:
    assert 0.99 < chance_within(loose_by(0.01, 0.01)) < 1
    assert 0 < chance_within(loose_by(50.0, 90.0)) < 0.01
    one_axis = np.diag([4.0, 0.01, 0.01, 1e-6, 1e-6, 1e-6])
    others = np.diag([0.01, 4.0, 0.01, 1e-6, 1e-6, 1e-6])
    assert chance_within(one_axis) == pytest.approx(chance_within(others), abs=0.05)


def test_rivals_are_sought_among_all_that_was_tried(prepared_nose, monkeypatch) -> None:
    """From nothing there are some; begun beside the truth alone there is none."""
    kept = []
    monkeypatch.setattr("naris.register.register.probability", lambda one: kept.append(one) or 0.5)
    trial = drawn_trials(prepared_nose.anatomy, 1, 5)[0]
    seen = trial.observation("a")
    register(prepared_nose, seen, NOTHING, RegisterConfig(seed=0))
    tight = np.diag([0.01] * 3 + [1e-4] * 3)
    beside = Pose(trial.anatomy_T_camera.matrix[None], prepared_nose.anatomy.frame, CAMERA)
    register(prepared_nose, seen, near(beside, tight[None]), RegisterConfig(starts=6, finalists=2))
    from_nothing, from_truth = kept
    assert 0 < from_nothing.rough_margin < np.inf
    assert from_nothing.margin > 0
    assert from_truth.rough_margin == MOST_MARGIN
    assert (from_nothing.cloud, from_nothing.free) == (False, False)
    assert np.isfinite(features(from_nothing)).all()
    assert np.isfinite(features(from_truth)).all()


def test_neighbours_are_kin_where_walls_are_off_and_not_where_points_are(prepared_nose, trials) -> None:
    """Each point off by itself against all of a side off together, by as much."""
    for trial in trials[:3]:
        points = trial.rays[::3, ::3].reshape(-1, 3) * trial.ranges["a"][::3, ::3].reshape(-1, 1)
        points, rng = points[np.isfinite(points).all(axis=1)], np.random.default_rng(0)
        ways = points / np.linalg.norm(points, axis=1, keepdims=True)
        alone = points + 0.5 * rng.standard_normal(points.shape)
        side = np.where(ways[:, :1] > np.median(ways[:, 0]), 1.0, -1.0)
        seen = {
            "alone": alone,
            "together": points + 0.3 * side * ways + 0.3 * rng.standard_normal(points.shape),
            "dented": alone + 0.8 * side * ways,
        }
        found = {
            name: evidence._fit(prepared_nose, from_points(one, PointNoise(0.5)), trial.anatomy_T_camera.matrix, 1.0)
            for name, one in seen.items()
        }
        assert abs(found["alone"].kinship) < 0.2
        assert found["together"].kinship > found["alone"].kinship + 0.1
        assert found["alone"].spread == pytest.approx(1.0, abs=0.12)
        assert found["dented"].waves > 1.5 * found["alone"].waves
        assert found["dented"].ripples > found["alone"].ripples


def test_what_is_seen_behind_walls_is_counted(prepared_nose, trials) -> None:
    trial = trials[0]
    points = trial.rays[::3, ::3].reshape(-1, 3) * trial.ranges["a"][::3, ::3].reshape(-1, 1)
    points = points[np.isfinite(points).all(axis=1)]
    exact, moved = from_points(points, PointNoise(0.5)), points.copy()
    moved[::5] *= 3.0
    pose = trial.anatomy_T_camera.matrix
    assert evidence._fit(prepared_nose, exact, pose, 1.0).through == pytest.approx(0.0, abs=0.02)
    fit = evidence._fit(prepared_nose, from_points(moved, PointNoise(0.5)), pose, 1.0)
    assert fit.through == pytest.approx(0.2, abs=0.03)
    assert fit.explained == pytest.approx(0.8, abs=0.03)


def test_slow_functions_are_those_of_each_view(prepared_nose, trials) -> None:
    """Of several views each counts as many functions; of depth it is not asked."""
    rng = np.random.default_rng(0)
    points = trials[0].rays[::3, ::3].reshape(-1, 3) * trials[0].ranges["a"][::3, ::3].reshape(-1, 1)
    seen = from_points(points[np.isfinite(points).all(axis=1)], PointNoise(0.5))
    several = together([seen, seen], Pose(np.stack([np.eye(4)] * 2), CAMERA, CAMERA))
    off = rng.standard_normal(len(seen))
    one = evidence._slow_square(seen, off, np.ones(len(seen), bool), 20.0, 12)
    both = evidence._slow_square(several, np.tile(off, 2), np.ones(2 * len(seen), bool), 20.0, 12)
    assert both == pytest.approx(one)
    noise = rng.standard_normal((20, len(seen)))
    mean = np.mean([evidence._slow_square(seen, each, np.ones(len(seen), bool), 20.0, 12) for each in noise])
    assert mean == pytest.approx(1.0, abs=0.3)
    assert evidence._slow_square(seen, 0 * off, np.ones(len(seen), bool), 20.0, 12) == 0.0
    fit = evidence._fit(prepared_nose, trials[0].observation("b"), trials[0].anatomy_T_camera.matrix, 1.0)
    assert (fit.waves, fit.ripples) == (1.0, 1.0)


def test_rays_that_leave_the_anatomy_are_explained_by_nothing(prepared_nose) -> None:
    outside = np.eye(4)
    outside[:3, 3] = prepared_nose.anatomy.bounds_mm[1] + 100.0
    points = np.random.default_rng(0).uniform([-4, -4, 6], [4, 4, 12], (60, 3))
    assert evidence._fit(prepared_nose, from_points(points), outside, 1.0).explained == 0.0


def ended(poses: list[Pose], costs: list[float]) -> Solutions:
    model = Model(RANGES, 0.05, 10.0, 0, 0.0, 0.0, -np.inf, np.inf, 1, 0)
    matrices = np.stack([pose.matrix for pose in poses])
    return Solutions(matrices, np.zeros(len(poses)), np.array(costs), 100, model)


def test_what_ended_elsewhere_counts_by_what_it_costs() -> None:
    best = Pose.identity("LPS", CAMERA)
    aside = best @ Pose.exp(np.array([0.0, 0.0, 0.0, np.deg2rad(10.0), 0.0, 0.0]), CAMERA, CAMERA)
    assert evidence._around(ended([best, best], [1.0, 1.0]), best.matrix, 1.0) == (1.0, 0.0, 0.0, 0.0)
    as_good = evidence._around(ended([aside, aside, best], [1.0, 1.0, 1.0]), best.matrix, 1.0)
    assert as_good.astray == pytest.approx(2.0 * np.sqrt(2 / 3))  # 10° where 5° are asked
    assert as_good.agreement == pytest.approx(1 / 3)
    dearer = evidence._around(ended([aside, aside], [1.2, 1.2]), best.matrix, 1.0)
    assert dearer.scatter == pytest.approx(2.0)
    assert dearer.astray == pytest.approx(2.0 * np.exp(-0.5)) and dearer.dents == pytest.approx(20.0)  # 0.2 of 100 rays
    far = best @ Pose.exp(np.array([900.0, 0.0, 0.0, 0.0, 0.0, 0.0]), CAMERA, CAMERA)
    assert evidence._around(ended([far], [1.0]), best.matrix, 1.0).scatter == pytest.approx(evidence._FARTHEST)
    assert evidence._around(None, best.matrix, 1.0) == evidence._NOT_TRIED


def test_what_began_beside_the_best_may_win(prepared_nose, trials, monkeypatch) -> None:
    """As many as asked, of points half; the only good start is one of them."""
    one, asked = trials[0], []

    def at_truth(solutions: Solutions, frame: str, count: int, rng: np.random.Generator) -> Starts:
        asked.append(count)
        return Starts(np.repeat(one.anatomy_T_camera.matrix[None], count, axis=0), np.zeros(count))

    monkeypatch.setattr("naris.register.register.aside", at_truth)
    far = trials[1].anatomy_T_camera
    belief = near(Pose(far.matrix[None], prepared_nose.anatomy.frame, CAMERA), np.diag([0.01] * 3 + [1e-4] * 3)[None])
    for noise in ("b", "d"):
        found = register(prepared_nose, one.observation(noise), belief, RegisterConfig(starts=2, finalists=1))
        assert distance(found.best, one.anatomy_T_camera)[0] < 1.0
        without = register(
            prepared_nose, one.observation(noise), belief, RegisterConfig(starts=2, finalists=1, aside=0)
        )
        assert distance(without.best, one.anatomy_T_camera)[0] > 2.0
    assert asked == [4, 2]


def test_few_points_are_counted_of_a_single_cloud_and_of_nothing_else(trials) -> None:
    cloud = trials[0].observation("d")
    told = {count: evidence._few(cloud.rows(np.arange(count))) for count in (250, 125, 30)}
    assert told == pytest.approx({250: 0.0, 125: np.log(2.0), 30: np.log(250 / 30)})
    assert evidence._few(trials[0].observation("b").rows(np.arange(64))) == 0.0
    apart = Pose(np.stack([np.eye(4), np.eye(4)]), CAMERA, CAMERA)
    assert evidence._few(together([cloud.rows(np.arange(50)), cloud.rows(np.arange(60))], apart)) == 0.0
