"""Scores of runs: calibration bins, the cluster bootstrap."""

from __future__ import annotations

import numpy as np

from naris.experiment.score import _interval, reliability


def test_bins_hold_every_picture_once_and_their_means() -> None:
    rng = np.random.default_rng(3)
    confidence, right = rng.uniform(0.25, 1.0, 500), rng.random(500) < 0.7
    found = reliability(confidence, right)
    assert found.count.sum() == 500
    assert np.isclose((found.confidence * found.count).sum(), confidence.sum())
    assert np.isclose((found.accuracy * found.count).sum(), right.sum())


def test_a_perfectly_honest_network_has_no_calibration_error() -> None:
    confidence = np.repeat([0.55, 0.95], 200)
    right = np.concatenate([np.arange(200) < 110, np.arange(200) < 190])
    assert np.isclose(reliability(confidence, right).ece, 0.0)


def test_near_copies_do_not_narrow_the_interval() -> None:
    rng = np.random.default_rng(0)
    hits = rng.random((1, 30)) < 0.6
    once = _interval(hits, np.arange(30), np.random.default_rng(1))
    tenfold = _interval(np.repeat(hits, 10, axis=1), np.repeat(np.arange(30), 10), np.random.default_rng(1))
    assert np.allclose(once, tenfold)


def test_the_interval_covers_the_truth_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(60):
        hits = rng.random((1, 60)) < 0.7
        low, high = _interval(hits, np.arange(60), rng)
        covered += low <= 0.7 <= high
    assert covered >= 50
