"""Regions by pose hypotheses, against the normal distribution's own formula."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from naris.core.anatomy import GridRegions, SlabRegions
from naris.model.standing import region_shares

BORDERS = (-6.0, 0.0, 5.0)
SLABS = SlabRegions("slabs", ("a", "b", "c", "d"), "mean", 1, BORDERS)


def _hypotheses(n: int = 60, m: int = 3, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    poses = np.zeros((n, m, 4, 4))
    poses[..., :3, :3] = Rotation.random(n * m, random_state=seed).as_matrix().reshape(n, m, 3, 3)
    poses[..., :3, 3] = rng.uniform(-9, 9, (n, m, 3))
    poses[..., 3, 3] = 1
    factor = rng.normal(size=(n, m, 6, 6))
    return poses, rng.dirichlet(np.ones(m), size=n), factor @ factor.swapaxes(-1, -2) + 0.1 * np.eye(6)


def test_shares_of_slabs_are_those_of_the_normal_distribution() -> None:
    poses, weights, covariance = _hypotheses()
    axes = poses[..., :3, :3]
    deviation = np.sqrt((axes @ covariance[..., :3, :3] @ axes.swapaxes(-1, -2))[..., 1, 1])
    below = norm.cdf((np.array(BORDERS) - poses[..., 1, 3, None]) / deviation[..., None])
    edges = np.concatenate([np.zeros_like(below[..., :1]), below, np.ones_like(below[..., :1])], axis=-1)
    expected = (np.diff(edges, axis=-1) * weights[..., None]).sum(axis=1)
    found = region_shares(SLABS, poses, weights, covariance)
    assert np.abs(found - expected).max() < 0.02
    assert found.sum(axis=1) == pytest.approx(1.0)
    assert found.min() > 0


def test_shares_move_with_the_hypotheses() -> None:
    poses, weights, covariance = _hypotheses()
    moved = poses.copy()
    moved[..., 1, 3] += 40
    later = SlabRegions("slabs", SLABS.names, "mean", 1, tuple(border + 40 for border in BORDERS))
    assert np.allclose(
        region_shares(SLABS, poses, weights, covariance), region_shares(later, moved, weights, covariance)
    )


def test_what_lies_in_no_region_does_not_count() -> None:
    labels = np.full((3, 1, 1), -1, dtype=np.int8)
    labels[0], labels[1] = 0, 1
    grid = GridRegions("grid", ("a", "b"), "mean", labels, np.zeros(3), 2.0)
    poses = np.tile(np.eye(4), (3, 1, 1, 1))
    poses[:, 0, 0, 3] = 0.0, 2.9, 50.0
    covariance = np.tile(np.eye(6) * 0.04, (3, 1, 1, 1))
    shares = region_shares(grid, poses, np.ones((3, 1)), covariance)
    assert shares[0, 0] > 0.99
    assert shares[1, 1] > 0.99
    assert shares[2] == pytest.approx([0.5, 0.5])
