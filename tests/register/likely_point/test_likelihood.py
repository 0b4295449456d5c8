"""The derivatives of both likelihoods against differences, and the average against a sum by hand."""

from __future__ import annotations

import numpy as np
import pytest

from naris.core.pose import Pose
from naris.errors import InputError
from naris.register.likely_point.averaged import averaged, nodes_for
from naris.register.likely_point.likelihood import ALIGNED, Cloud, Misalignment, likelihood
from naris.register.likely_point.noise import CloudNoise, axes_of
from tests.register.likely_point.bumpy import covariances, moved, prepared, sampled

STEP = 1e-4


def a_cloud(rng, kind):
    points, normals = sampled(50, rng)
    points = points + 0.8 * rng.standard_normal(points.shape)
    covariance = covariances(len(points), rng) + 0.2 * np.eye(3)
    if kind == "places":
        return Cloud(points, axes_of(CloudNoise(covariance), len(points), None), np.inf)
    first = np.cross(normals, [0.1, 0.9, 0.4])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    noise = CloudNoise(covariance, 30.0, 0.6, first)
    return Cloud(points, axes_of(noise, len(points), normals), 3.0 if kind == "outliers" else np.inf)


@pytest.mark.parametrize("kind", ["places", "normals", "outliers"])
@pytest.mark.parametrize("average", [False, True])
def test_the_gradient_is_the_slope_of_the_cost(kind, average):
    rng = np.random.default_rng(11)
    surface, cloud, pose = prepared(), a_cloud(rng, kind), moved(rng, 0.3, 0.05)
    rows, off = np.zeros(50, np.int64), ALIGNED if average else Misalignment(0.3, 0.01)
    nodes = nodes_for(surface.tree, cloud)

    def at(twist):
        matrix = pose.matrix @ Pose.exp(twist, "", "").matrix
        if average:
            return averaged(surface.tree, nodes, cloud, matrix, rows)
        return likelihood(surface.tree, cloud, matrix, off, rows)

    gradient = at(np.zeros(6)).gradient
    for k, unit in enumerate(np.eye(6)):
        slope = (at(STEP * unit).cost - at(-STEP * unit).cost) / (2 * STEP)
        assert gradient[k] == pytest.approx(slope, rel=2e-3, abs=2e-3 * np.abs(gradient).max()), k


def test_the_curvature_of_the_average_is_that_of_the_cost():
    """Where normals and outliers, whose second derivatives are kept positive, do not count."""
    rng = np.random.default_rng(12)
    surface, cloud = prepared(), a_cloud(rng, "places")
    nodes, rows = nodes_for(surface.tree, cloud), np.zeros(50, np.int64)

    def at(twist):
        return averaged(surface.tree, nodes, cloud, Pose.exp(twist, "", "").matrix, rows)

    matrix, h = at(np.zeros(6)).matrix, 1e-3
    for k, unit in enumerate(np.eye(6)[:3]):  # those of rotation differ by the curvature of the step itself
        slope = (at(h * unit).gradient - at(-h * unit).gradient) / (2 * h)
        assert matrix[k, k] == pytest.approx(slope[k], rel=0.02)


def test_a_flat_wall_costs_what_its_plane_costs():
    """Everything that a wall without end is off by, sideways, drops out of the integral."""
    from naris.register.likely_point.surface import surface_from

    ticks = np.linspace(-20, 20, 41)
    x, y = (each.ravel() for each in np.meshgrid(ticks, ticks, indexing="ij"))
    k = np.arange(41 * 41).reshape(41, 41)
    a, b, c, d = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]).astype(np.int32)
    wall = surface_from(np.column_stack([x, y, np.zeros_like(x)]), faces, "wall")
    points = np.array([[0.2, 0.3, 1.3], [1.0, -0.4, -0.5], [-2.0, 0.1, 0.0]])
    cloud = Cloud(points, axes_of(CloudNoise(np.eye(3)), 3, None), np.inf)
    rows = np.zeros(3, np.int64)
    found = averaged(wall.tree, nodes_for(wall.tree, cloud), cloud, np.eye(4), rows)
    assert found.cost == pytest.approx(0.5 * np.square(points[:, 2]).sum(), abs=2e-3)
    assert found.cost == pytest.approx(likelihood(wall.tree, cloud, np.eye(4), ALIGNED, rows).cost, abs=2e-3)


def test_triangles_much_larger_than_the_noise_are_refused():
    surface, points = prepared(60.0), sampled(20, np.random.default_rng(0))[0]
    cloud = Cloud(points, axes_of(CloudNoise.even(0.05), 20, None), np.inf)
    with pytest.raises(InputError, match="cut the surface into smaller triangles"):
        nodes_for(surface.tree, cloud)
