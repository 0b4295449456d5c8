"""Clouds to surfaces: exact without noise, the same in every frame, ICP where noise is even, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from naris.anatomy.triangles import index_triangles
from naris.core.pose import Pose
from naris.errors import InputError, PoseError, SurfaceError
from naris.register.likely_point.noise import CloudNoise
from naris.register.likely_point.points import METHODS, register_points
from naris.register.likely_point.solve import PointsConfig
from naris.register.likely_point.surface import surface_from, surface_of
from tests.register.likely_point.bumpy import CLOUD, FRAME, bumpy, covariances, moved, prepared, sampled


def seen(rng, count=150, noise_mm=0.0):
    """A cloud, its normals, and where it lies."""
    truth = moved(rng, 5.0, 1.0)
    points, normals = sampled(count, rng)
    points = points + noise_mm * rng.standard_normal(points.shape)
    return truth.inverse().apply(points), normals @ truth.rotation, truth


@pytest.mark.parametrize("method", METHODS)
def test_without_noise_the_pose_is_exact(method):
    rng = np.random.default_rng(1)
    points, normals, truth = seen(rng)
    start = moved(rng, 1.5, 0.1) @ Pose(truth.matrix, CLOUD, CLOUD)
    noise = CloudNoise.even(0.2, 0.05)
    found = register_points(points, prepared(), start, noise, normals=normals, method=method)
    assert found.converged
    np.testing.assert_allclose(found.surface_T_points.matrix, truth.matrix, atol=1e-4)
    assert found.mean_distance_mm < 1e-4
    assert found.outliers == 0


@pytest.mark.parametrize("average", [False, True])
def test_what_is_moved_with_everything_moves_along(average):
    """The surface moved, and the cloud moved with its noise: the answer follows both."""
    rng = np.random.default_rng(2)
    points, normals, truth = seen(rng, 100, 0.3)
    covariance, axes = covariances(100, rng) + 0.1 * np.eye(3), np.cross(normals, [0.2, 0.5, 0.8])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    start, config = (
        truth @ Pose.exp(np.array([0.4, -0.3, 0.2, 0.03, 0.02, -0.04]), CLOUD, CLOUD),
        PointsConfig(average=average),
    )
    plain = register_points(
        points,
        prepared(),
        start,
        CloudNoise(covariance, 50.0, 0.4, axes),
        normals=normals,
        method="imlop",
        config=config,
    )
    turn, other = Pose.exp(np.array([9.0, -4, 2, 0.5, 1.1, -0.7]), "there", FRAME), moved(rng, 8.0, 1.0)
    other = Pose(other.matrix, "held", CLOUD)
    vertices, faces = bumpy()
    turned = other.rotation @ covariance @ other.rotation.T
    again = register_points(
        other.apply(points),
        surface_from(turn.apply(vertices), faces, "there"),
        turn @ start @ other.inverse(),
        CloudNoise(0.5 * (turned + np.swapaxes(turned, 1, 2)), 50.0, 0.4, axes @ other.rotation.T),
        normals=normals @ other.rotation.T,
        method="imlop",
        config=config,
    )
    expected = turn @ plain.surface_T_points @ other.inverse()
    np.testing.assert_allclose(again.surface_T_points.matrix, expected.matrix, atol=2e-3)
    assert again.cost == pytest.approx(plain.cost, rel=1e-4)


def plain_icp(points, pose, rounds=3000):
    """Besl and McKay 1992, from its description: nearest points, then the rotation by Kabsch."""
    vertices, faces = bumpy()
    index = index_triangles(vertices, faces)
    for _ in range(rounds):
        nearest = index.closest(points @ pose[:3, :3].T + pose[:3, 3]).points_mm
        here, there = points.mean(axis=0), nearest.mean(axis=0)
        u, _, w = np.linalg.svd((nearest - there).T @ (points - here))
        pose = np.eye(4)
        pose[:3, :3] = u @ np.diag([1, 1, np.linalg.det(u @ w)]) @ w
        pose[:3, 3] = there - pose[:3, :3] @ here
    return pose


def test_with_an_even_noise_it_ends_where_icp_stands_still():
    rng = np.random.default_rng(3)
    points, _, truth = seen(rng, 80, 0.4)
    icp = plain_icp(points, truth.matrix.copy())
    config = PointsConfig(anneal=False)
    for method in ("icp", "imlp"):
        found = register_points(
            points, prepared(), Pose(icp, FRAME, CLOUD), CloudNoise.even(0.7), method=method, config=config
        )
        np.testing.assert_allclose(found.surface_T_points.matrix, icp, atol=2e-3)


def test_uneven_noise_is_worth_knowing():
    """Points that are off along one way of their own: the covariance tells which to believe in what."""
    off = {"icp": [], "imlp": []}
    for seed in range(6):
        rng = np.random.default_rng(seed)
        points, _, truth = seen(rng, 120)
        ways = rng.standard_normal((120, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        covariance = 0.05**2 * np.eye(3) + 1.5**2 * np.einsum("ni,nj->nij", ways, ways)
        points = points + 1.5 * rng.standard_normal((120, 1)) * ways + 0.05 * rng.standard_normal((120, 3))
        start = truth @ Pose.exp(0.1 * rng.standard_normal(6), CLOUD, CLOUD)
        for method, errors in off.items():
            found = register_points(points, prepared(), start, CloudNoise(covariance), method=method)
            errors.append(np.linalg.norm(found.surface_T_points.position_mm - truth.position_mm))
    assert np.mean(off["imlp"]) < 0.5 * np.mean(off["icp"])


def test_normals_lead_from_further_away():
    rng = np.random.default_rng(8)
    right = {"imlp": 0, "imlop": 0}
    for _ in range(8):
        points, normals, truth = seen(rng, 100, 0.3)
        start = moved(rng, 3.0, 0.35) @ Pose(truth.matrix, CLOUD, CLOUD)
        for method in right:
            found = register_points(
                points, prepared(), start, CloudNoise.even(0.3, 0.1), normals=normals, method=method
            )
            right[method] += np.linalg.norm(found.surface_T_points.matrix - truth.matrix) < 1.0
    assert right["imlop"] >= right["imlp"]
    assert right["imlop"] >= 6


def test_outliers_count_little_where_a_limit_is_said():
    rng = np.random.default_rng(9)
    points, _, truth = seen(rng, 150, 0.1)
    points[:30] += rng.uniform(3, 8, (30, 3))
    start = truth @ Pose.exp(np.array([0.3, -0.2, 0.3, 0.03, 0.02, 0.02]), CLOUD, CLOUD)
    off = [
        np.linalg.norm(
            register_points(points, prepared(), start, CloudNoise.even(0.1, farthest_sd=limit)).surface_T_points.matrix
            - truth.matrix
        )
        for limit in (np.inf, 4.0)
    ]
    assert off[1] < 0.2 * off[0]
    found = register_points(points, prepared(), start, CloudNoise.even(0.1, farthest_sd=4.0))
    assert 20 <= found.outliers <= 35


def test_the_covariance_is_that_of_many_clouds():
    twists, said = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        points, _, truth = seen(rng, 200, 0.2)
        points += 20.0  # the origin of the cloud far from its middle
        truth = truth @ Pose.of(np.eye(3), np.full(3, -20.0), CLOUD, CLOUD)
        found = register_points(points, prepared(), truth, CloudNoise.even(0.2))
        twists.append((truth.inverse() @ found.surface_T_points).log())
        said.append(found.covariance)
    squared = np.mean([twist @ np.linalg.solve(cov, twist) for twist, cov in zip(twists, said, strict=True)])
    assert 4.0 < squared < 9.0  # six degrees of freedom


def test_too_few_steps_are_told():
    rng = np.random.default_rng(1)
    points, _, truth = seen(rng)
    start = moved(rng, 1.0, 0.1) @ Pose(truth.matrix, CLOUD, CLOUD)
    found = register_points(points, prepared(), start, CloudNoise.even(0.2), config=PointsConfig(steps=2))
    assert not found.converged
    assert found.iterations == 2


def test_an_anatomy_is_a_surface(nose):
    surface = surface_of(nose)
    assert surface.frame == nose.frame
    assert surface_of(nose) is surface


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"points_mm": np.zeros((3, 3))}, "at least 6 finite points"),
        ({"points_mm": np.full((9, 3), np.nan)}, "at least 6 finite points"),
        ({"method": "imlop"}, "normals with the method imlop"),
        ({"method": "imlop", "normals": np.ones((9, 3))}, "normalise them"),
        ({"noise": CloudNoise(np.tile(np.eye(3), (4, 1, 1)))}, "one covariance for each of 9 points"),
        ({"start": Pose.identity("LPS", CLOUD)}, "one pose into bumpy"),
        ({"start": Pose(np.tile(np.eye(4), (2, 1, 1)), FRAME, CLOUD)}, "one pose into bumpy"),
    ],
)
def test_what_does_not_fit_is_refused(changed, message):
    given = {
        "points_mm": sampled(9, np.random.default_rng(0))[0],
        "surface": prepared(),
        "start": Pose.identity(FRAME, CLOUD),
        "noise": CloudNoise.even(1.0),
    }
    with pytest.raises((InputError, PoseError), match=message):
        register_points(**{**given, **changed})


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: CloudNoise(np.zeros((3, 3))), "variances of at least"),
        (lambda: CloudNoise(np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 1]])), "symmetric"),
        (lambda: CloudNoise(np.full((3, 3), np.nan)), "finite covariances"),
        (lambda: CloudNoise(np.eye(3), -1.0), "concentrations above 0"),
        (lambda: CloudNoise(np.eye(3), 1.0, 0.5), "without axes"),
        (lambda: CloudNoise(np.eye(3), farthest_sd=0.0), "a limit above 0"),
        (lambda: CloudNoise.even(1.0, 0.0), "a deviation of the normals"),
    ],
)
def test_noise_that_cannot_be_is_refused(made, message):
    with pytest.raises(InputError, match=message):
        made()


def test_a_surface_needs_triangles_of_its_vertices():
    vertices, faces = bumpy()
    with pytest.raises(SurfaceError, match="triangles of 10 vertices"):
        surface_from(vertices[:10], faces, FRAME)
