"""Matches against brute force: never a dearer one, whatever the noise."""

from __future__ import annotations

import numpy as np
import pytest

from naris.register.likely_point.likelihood import ALIGNED, Cloud, likelihood, whitening
from naris.register.likely_point.noise import CloudNoise, axes_of
from tests.register.likely_point.bumpy import covariances, moved, prepared, sampled


def kent(noise, n, m, axes):
    """What a normal of the surface costs, from the density as it is written."""
    kappa, beta = noise.concentration, 0.5 * noise.eccentricity * noise.concentration
    major, minor = (axis @ m for axis in axes)
    return kappa * (1 - n @ m) - beta * (major**2 - minor**2)


@pytest.mark.parametrize("eccentricity", [None, 0.0, 0.8])
def test_no_place_of_the_surface_is_more_likely_than_the_match(eccentricity):
    rng = np.random.default_rng(3)
    surface, pose = prepared(15.0), moved(rng, 2.0, 0.2)
    points, normals = sampled(40, rng, 15.0)
    points = pose.inverse().apply(points) + rng.standard_normal(points.shape)
    normals = normals @ pose.rotation
    covariance = covariances(len(points), rng)
    if eccentricity:
        first = np.cross(normals, [0.3, -0.2, 0.9])
        noise = CloudNoise(covariance, 20.0, eccentricity, first / np.linalg.norm(first, axis=1, keepdims=True))
    else:
        noise = CloudNoise(covariance, 20.0)
    axes = axes_of(noise, len(points), None if eccentricity is None else normals)
    cloud = Cloud(points, axes, np.inf)
    found = likelihood(surface.tree, cloud, pose.matrix, ALIGNED, np.zeros(len(points), np.int64))
    # Every triangle by a lattice of its places, in the frame of the surface and straight from the formulas.
    grid = np.array([(i, j) for i in range(25) for j in range(25 - i)]) / 24
    weights = np.column_stack([1 - grid.sum(axis=1), grid])
    places = np.einsum("gc,fck->fgk", weights, surface.tree.corners)
    for k in range(len(points)):
        turned = pose.rotation @ covariance[k] @ pose.rotation.T
        off = places - pose.apply(points[k])
        cost = 0.5 * np.einsum("fgi,ij,fgj->fg", off, np.linalg.inv(turned), off).min(axis=1)
        if eccentricity is not None:
            n, pair = pose.rotation @ normals[k], [pose.rotation @ axes.major[k], pose.rotation @ axes.minor[k]]
            cost += [kent(noise, n, m, pair) for m in surface.tree.normals]
        assert found.found.costs[k] <= cost.min() + 1e-9
        assert found.found.costs[k] == pytest.approx(cost.min(), abs=0.3)
        assert found.found.costs[k] >= 0


def test_a_match_costs_what_its_place_and_triangle_cost():
    rng = np.random.default_rng(4)
    surface, pose = prepared(), moved(rng, 1.0, 0.1)
    points = rng.uniform(-12, 12, (60, 3))
    covariance = covariances(len(points), rng)
    cloud = Cloud(points, axes_of(CloudNoise(covariance), len(points), None), np.inf)
    found = likelihood(surface.tree, cloud, pose.matrix, ALIGNED, np.zeros(len(points), np.int64))
    off = (found.places - pose.position_mm) @ pose.rotation - points
    expected = 0.5 * np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
    np.testing.assert_allclose(found.found.costs, expected, rtol=1e-6)
    assert found.cost == pytest.approx(expected.sum())


def test_where_the_search_begins_does_not_matter():
    rng = np.random.default_rng(5)
    surface, points = prepared(), rng.uniform(-12, 12, (50, 3))
    cloud = Cloud(points, axes_of(CloudNoise(covariances(50, rng)), 50, None), np.inf)
    one = likelihood(surface.tree, cloud, np.eye(4), ALIGNED, np.zeros(50, np.int64))
    other = likelihood(surface.tree, cloud, np.eye(4), ALIGNED, rng.integers(len(surface.face_ids), size=50))
    np.testing.assert_allclose(one.places, other.places, atol=1e-9)


def test_whitening_makes_errors_white():
    rng = np.random.default_rng(6)
    covariance = covariances(5, rng)
    root = whitening(axes_of(CloudNoise(covariance), 5, None), ALIGNED).root
    np.testing.assert_allclose(root @ covariance @ np.swapaxes(root, 1, 2), np.tile(np.eye(3), (5, 1, 1)), atol=1e-9)
