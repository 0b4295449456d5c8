"""Scores follow from the counts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from naris.core.anatomy import SlabRegions
from naris.core.pose import Pose
from naris.errors import InputError
from naris.report import Calibration, PoseErrors, RunScore, TestResult, nearest_views

counts = st.lists(st.integers(0, 30), min_size=16, max_size=16).map(lambda n: np.array(n).reshape(4, 4))
SLABS = SlabRegions("s", ("a", "b", "c", "d"), "mean", 1, (0.0, 1.0, 2.0))


@given(counts.filter(lambda n: n.sum() > 0))
def test_shares_follow_from_single_answers(confusion: np.ndarray) -> None:
    pairs = [(i, j) for i in range(4) for j in range(4) for _ in range(confusion[i, j])]
    score = RunScore(0, confusion)
    assert score.accuracy == pytest.approx(np.mean([i == j for i, j in pairs]))
    wrong = [abs(i - j) > 1 for i, j in pairs if i != j]
    assert score.wrong == len(wrong)
    if wrong:
        assert score.nonneighbour_error(SLABS.neighbours) == pytest.approx(np.mean(wrong))
    assert score.chance == pytest.approx(max(sum(i == k for i, _ in pairs) for k in range(4)) / len(pairs))


def test_empty_scores_are_refused() -> None:
    with pytest.raises(InputError, match="at least one picture"):
        RunScore(0, np.zeros((4, 4), dtype=int))
    with pytest.raises(InputError, match="at least one run"):
        TestResult("published", ())


def test_no_wrong_answers_have_no_share() -> None:
    """0 would say that there were some, all of them near."""
    right, near = RunScore(0, np.diag([3, 4, 5, 6])), RunScore(1, np.diag([3, 4, 5, 6]) + np.eye(4, k=1, dtype=int))
    assert right.nonneighbour_error(SLABS.neighbours) is None
    assert near.nonneighbour_error(SLABS.neighbours) == 0.0
    assert TestResult("published", (right,)).nonneighbour_error(SLABS.neighbours) is None
    both = TestResult("published", (right, near))
    assert (both.wrong, both.nonneighbour_error(SLABS.neighbours)) == (3, 0.0)


def test_one_run_has_no_spread() -> None:
    run = RunScore(0, np.diag([3, 4, 5, 6]))
    assert TestResult("published", (run,)).std is None
    assert TestResult("published", (run, run)).std == 0.0


@given(st.lists(st.tuples(st.floats(0.25, 1), st.floats(0, 1), st.integers(0, 50)), min_size=5, max_size=5))
def test_pooled_calibration_is_that_of_all_pictures(bins: list[tuple[float, float, int]]) -> None:
    confidence, accuracy, count = (np.array(column) for column in zip(*bins, strict=True))
    one = Calibration(confidence, accuracy, count)
    run = RunScore(0, np.eye(4, dtype=int), one)
    pooled = TestResult("published", (run, run, run)).calibration
    assert pooled is not None
    assert pooled.ece == pytest.approx(one.ece)
    assert pooled.count.sum() == 3 * count.sum()
    each = np.repeat(np.abs(confidence - accuracy), count)
    assert one.ece == pytest.approx(each.mean() if len(each) else 0.0)


def test_calibration_needs_every_run() -> None:
    known = Calibration(np.array([0.5]), np.array([0.5]), np.array([4]))
    runs = (RunScore(0, np.eye(4, dtype=int), known), RunScore(1, np.eye(4, dtype=int)))
    assert TestResult("published", runs).calibration is None
    assert TestResult("published", runs).pose is None


def test_pose_shares_need_both_bounds() -> None:
    errors = PoseErrors(np.array([1.0, 1.0, 9.0, 9.0]), np.array([5.0, 50.0, 5.0, 50.0]))
    assert errors.share_within(4, 15) == 0.25
    assert errors.share_within(10, 60) == 1.0


def random_views(rng: np.random.Generator, n: int) -> Pose:
    return Pose.look(rng.normal(0, 2, (n, 3)), rng.normal(0, 1, (n, 3)) + [0, 4, 0], np.array([0, 0, 1.0]), "mean")


@given(st.integers(0, 10_000))
def test_nearest_view_is_a_neighbour_exactly_if_there_is_one(seed: int) -> None:
    from naris.dataset.splits import neighbours

    rng = np.random.default_rng(seed)
    train, test = random_views(rng, 12), random_views(rng, 9)
    nearest = nearest_views(train, test)
    inside = (nearest.distance_mm < 2) & (nearest.angle_deg < 15)
    assert (inside == neighbours(train, test)).all()
    chosen = train[nearest.index]
    assert nearest.distance_mm == pytest.approx(np.linalg.norm(chosen.position_mm - test.position_mm, axis=1))
    assert 0 <= nearest.typical < 9
