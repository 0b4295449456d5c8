"""Temperature and strangeness, on data whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import log_softmax as scipys_log_softmax

from naris.model.calibration import Calibration, Scale, fit_pool, fit_temperature, fit_usual, log_softmax


def test_log_softmax_agrees_with_scipy() -> None:
    logits = np.random.default_rng(0).normal(size=(50, 7)) * 300
    assert np.allclose(log_softmax(logits), scipys_log_softmax(logits, axis=1))


@pytest.mark.parametrize("temperature", [0.5, 1.0, 3.0])
def test_the_temperature_that_made_the_labels_is_found(temperature: float) -> None:
    rng = np.random.default_rng(0)
    logits = (rng.normal(size=(20_000, 4)) * 3).astype(np.float32)
    p = np.exp(log_softmax(logits.astype(np.float64) / temperature))
    labels = (p.cumsum(axis=1) < rng.random((len(p), 1))).sum(axis=1)
    assert fit_temperature(logits, labels) == pytest.approx(temperature, rel=0.05)


def test_the_pool_that_made_the_labels_is_found() -> None:
    rng = np.random.default_rng(0)
    logits = (rng.normal(size=(40_000, 4)) * 3).astype(np.float32)
    shares = rng.dirichlet(np.full(4, 0.5), size=len(logits)) * 0.99 + 0.0025
    p = np.exp(log_softmax(logits / 2.0 + 0.6 * np.log(shares)))
    labels = (p.cumsum(axis=1) < rng.random((len(p), 1))).sum(axis=1)
    temperature, power = fit_pool(logits, shares, labels)
    assert (temperature, power) == pytest.approx((2.0, 0.6), rel=0.05)
    pooled = Calibration(temperature, len(labels), None, power)
    rows = np.arange(len(labels))
    gain = pooled.log_probabilities(logits, shares) - Calibration(fit_temperature(logits, labels)).log_probabilities(
        logits
    )
    assert gain[rows, labels].mean() > 0.1


def test_poses_that_know_nothing_do_not_count() -> None:
    rng = np.random.default_rng(1)
    logits = (rng.normal(size=(40_000, 4)) * 3).astype(np.float32)
    labels = (np.exp(log_softmax(logits)).cumsum(axis=1) < rng.random((len(logits), 1))).sum(axis=1)
    temperature, power = fit_pool(logits, rng.dirichlet(np.ones(4), size=len(logits)) * 0.99 + 0.0025, labels)
    assert power < 0.02
    assert temperature == pytest.approx(fit_temperature(logits, labels), rel=0.02)


@pytest.mark.parametrize("know", ["nothing at all", "nothing but noise"])
def test_poses_that_know_nothing_do_not_soften_the_head(know: str) -> None:
    """On as few pictures as there are: the temperature stays that of the head alone."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        logits = (rng.normal(size=(512, 4)) * 3).astype(np.float32)
        labels = (np.exp(log_softmax(logits)).cumsum(axis=1) < rng.random((512, 1))).sum(axis=1)
        shares = np.full((512, 4), 0.25) if "all" in know else rng.dirichlet(np.full(4, 5.0), size=512)
        temperature, _ = fit_pool(logits, shares, labels)
        assert temperature == pytest.approx(fit_temperature(logits, labels), rel=0.08)


def test_of_pools_that_are_as_good_the_one_that_leans_on_the_poses_is_taken() -> None:
    """A head and poses that say the same: any mixture is as good, and that of the poses alone is taken."""
    rng = np.random.default_rng(4)
    shares = rng.dirichlet(np.full(4, 0.5), size=500) * 0.99 + 0.0025
    labels = (shares.cumsum(axis=1) < rng.random((500, 1))).sum(axis=1)
    temperature, power = fit_pool(np.log(shares).astype(np.float32), shares, labels)
    assert temperature == pytest.approx(100)
    assert power == pytest.approx(1, abs=0.15)


def test_without_shares_the_head_stands_alone() -> None:
    logits = np.random.default_rng(2).normal(size=(5, 3)).astype(np.float32)
    assert np.array_equal(
        Calibration(1.3, 9, None, 0.7).log_probabilities(logits), Calibration(1.3).log_probabilities(logits)
    )


def test_distances_agree_with_the_definition_and_strangers_score_high() -> None:
    rng = np.random.default_rng(1)
    shape = rng.normal(size=(5, 5))
    means = rng.normal(size=(3, 5)) * 10

    def usual_ones(n: int) -> tuple[np.ndarray, np.ndarray]:
        label = rng.integers(0, 3, n)
        return (means[label] + rng.normal(size=(n, 5)) @ shape.T).astype(np.float32), label

    embedding, label = usual_ones(4000)
    kept, _ = usual_ones(4000)
    usual = fit_usual(embedding, label, kept)
    covariance = np.linalg.inv(usual.whitening.astype(np.float64) @ usual.whitening.T.astype(np.float64))
    inverse = np.linalg.inv(covariance)
    off = kept[:10, None].astype(np.float64) - usual.mean[None]
    mahalanobis = np.sqrt(np.einsum("nki,ij,nkj->nk", off, inverse, off)).min(axis=1)
    assert np.allclose(usual.distances(kept[:10]), mahalanobis, rtol=1e-3)
    fresh, _ = usual_ones(4000)
    score = usual.out_of_domain(fresh, None)
    assert (score == 0).mean() == pytest.approx(0.95, abs=0.02)
    assert (score > 0.5).mean() == pytest.approx(0.005, abs=0.004)
    assert (usual.out_of_domain((rng.normal(size=(50, 5)) * 200).astype(np.float32), None) == 1).mean() > 0.9


def test_the_scale_is_flat_then_rises_then_stays() -> None:
    scale = Scale(2.0, 4.0)
    assert scale.score(np.array([-9.0, 2.0, 4.0, 6.0, 99.0])).tolist() == [0.0, 0.0, 0.5, 1.0, 1.0]


def test_a_region_without_pictures_is_left_out() -> None:
    embedding = np.random.default_rng(0).normal(size=(60, 4)).astype(np.float32)
    usual = fit_usual(embedding, np.arange(60) % 2 * 2, embedding)
    assert usual.mean.shape == (2, 4)
    assert Calibration(1.0, 0, usual).to_json()["scales"].keys() == {"distance"}
