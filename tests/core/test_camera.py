"""Intrinsics: there and back through every lens, with OpenCV as the independent oracle."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from naris.core.camera import Brown, Fisheye, Intrinsics, Pinhole, middle_square
from naris.errors import InputError

SMALL = st.floats(-0.05, 0.05)
PINHOLE = Intrinsics.from_vertical_fov(300, 200, 60)
BARREL = Intrinsics(640, 480, 410.0, 405.0, 321.3, 236.9, Brown(k1=-0.28, k2=0.09, p1=1e-3, p2=-2e-3, k3=-0.012))
WIDE = Intrinsics(720, 720, 210.0, 208.0, 361.5, 355.2, Fisheye(k1=-0.03, k2=0.012, k3=-0.004, k4=0.0003))
CAMERAS = [pytest.param(camera, id=camera.lens.kind) for camera in (PINHOLE, BARREL, WIDE)]


def points_in_front(n: int = 500, half_angle_deg: float = 35.0) -> np.ndarray:
    rng = np.random.default_rng(3)
    theta = np.deg2rad(half_angle_deg) * np.sqrt(rng.random(n))
    phi = 2 * np.pi * rng.random(n)
    rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    return rays * rng.uniform(2, 60, size=(n, 1))


def matrix_of(camera: Intrinsics) -> np.ndarray:
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])


@pytest.mark.parametrize("camera", CAMERAS)
def test_every_pixel_comes_back(camera: Intrinsics) -> None:
    """project ∘ unproject is the identity on the whole picture."""
    rays = camera.rays()
    assert rays.shape == (camera.height, camera.width, 3)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1)
    pixels, seen = camera.project(rays * 17.0)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    assert seen.all()
    np.testing.assert_allclose(pixels, np.stack([u, v], axis=-1), atol=1e-4)


@pytest.mark.parametrize("camera", CAMERAS)
def test_every_ray_comes_back(camera: Intrinsics) -> None:
    """unproject ∘ project is the identity on directions."""
    points_mm = points_in_front(half_angle_deg=20)
    rays = points_mm / np.linalg.norm(points_mm, axis=-1, keepdims=True)
    np.testing.assert_allclose(camera.unproject(camera.project(points_mm)[0]), rays, atol=1e-6)


@pytest.mark.parametrize("camera", [PINHOLE, BARREL], ids=["pinhole", "brown"])
def test_projection_agrees_with_opencv(camera: Intrinsics) -> None:
    points_mm = points_in_front()
    lens = camera.lens
    coefficients = np.array([lens.k1, lens.k2, lens.p1, lens.p2, lens.k3] if isinstance(lens, Brown) else [0.0] * 5)
    theirs, _ = cv2.projectPoints(points_mm, np.zeros(3), np.zeros(3), matrix_of(camera), coefficients)
    np.testing.assert_allclose(camera.project(points_mm)[0], theirs[:, 0], atol=1e-8)


def test_fisheye_projection_agrees_with_opencv() -> None:
    points_mm = points_in_front(half_angle_deg=75)
    lens = WIDE.lens
    theirs, _ = cv2.fisheye.projectPoints(
        points_mm[:, None], np.zeros(3), np.zeros(3), matrix_of(WIDE), np.array([lens.k1, lens.k2, lens.k3, lens.k4])
    )
    np.testing.assert_allclose(WIDE.project(points_mm)[0], theirs[:, 0], atol=1e-8)


@given(SMALL, SMALL, st.floats(-0.01, 0.01), st.floats(-0.01, 0.01), SMALL)
def test_any_mild_lens_can_be_undone(k1: float, k2: float, p1: float, p2: float, k3: float) -> None:
    lens = Brown(k1, k2, p1, p2, k3)
    xy = np.stack(np.meshgrid(np.linspace(-0.6, 0.6, 7), np.linspace(-0.6, 0.6, 7)), axis=-1)
    np.testing.assert_allclose(lens.undistort(lens.distort(xy)), xy, atol=1e-6)


@given(SMALL, SMALL, st.floats(-0.01, 0.01), st.floats(-0.001, 0.001))
def test_any_mild_fisheye_can_be_undone(k1: float, k2: float, k3: float, k4: float) -> None:
    lens = Fisheye(k1, k2, k3, k4)
    theta_rad = np.linspace(0, 1.3, 20)
    assume((np.diff(lens.bend(theta_rad)) > 0.01).all())  # one that rises; past its fold no lens can be undone
    np.testing.assert_allclose(lens.unbend(lens.bend(theta_rad)), theta_rad, atol=1e-6)


def test_a_wide_lens_sees_sideways_and_behind() -> None:
    """Beyond 90° from the axis a pinhole sees nothing, a fisheye does."""
    camera = Intrinsics.from_vertical_fov(500, 500, 220, Fisheye())
    behind = np.array([[0.0, 20 * np.sin(np.deg2rad(100)), 20 * np.cos(np.deg2rad(100))]])
    assert behind[0, 2] < 0
    pixels, seen = camera.project(behind)
    assert seen.all()
    np.testing.assert_allclose(camera.unproject(pixels), behind / 20, atol=1e-9)
    assert not PINHOLE.project(behind)[1].any()


def test_beyond_the_fold_of_a_lens_there_is_no_ray() -> None:
    """A strong barrel maps outwards only up to a radius; pixels beyond it must not get an invented ray."""
    camera = Intrinsics(400, 400, 100.0, 100.0, 199.5, 199.5, Brown(k1=-0.3))
    rays = camera.rays()
    assert np.isnan(rays[0, 0]).all()
    assert np.isfinite(rays[190:210, 190:210]).all()
    pixels, _ = camera.project(rays)
    known = np.isfinite(rays).all(axis=-1)
    v, u = np.nonzero(known)
    np.testing.assert_allclose(pixels[known], np.stack([u, v], axis=-1), atol=1e-3)


@pytest.mark.parametrize("lens", [Pinhole(), Brown(k1=-0.1), Fisheye(k1=-0.02)], ids=lambda lens: lens.kind)
@pytest.mark.parametrize("fov_deg", [10.0, 45.0, 80.0])
def test_the_field_of_view_is_what_was_asked_for(lens: Pinhole | Brown | Fisheye, fov_deg: float) -> None:
    camera = Intrinsics.from_vertical_fov(301, 200, fov_deg, lens)
    assert camera.vertical_fov_deg == pytest.approx(fov_deg, abs=1e-6)


def test_the_published_camera() -> None:
    """300×300, 45° from edge to edge: OpenGL's perspective, whose clip planes lie on the outer edges of the pixels."""
    camera = Intrinsics.from_vertical_fov(300, 300, 45)
    half = np.tan(np.deg2rad(22.5))
    corner, _ = camera.project(np.array([[half, -half, 1.0], [-half, half, 1.0]]))
    np.testing.assert_allclose(corner, [[299.5, -0.5], [-0.5, 299.5]], atol=1e-9)


def test_outside_the_picture_or_behind_is_not_seen() -> None:
    half_width, half_height = np.tan(np.deg2rad(30)) * 1.5, np.tan(np.deg2rad(30))
    points_mm = np.array(
        [[0, 0, 5], [0, 0, -5], [half_width * 1.01, 0, 1], [half_width * 0.99, 0, 1], [0, half_height * 1.01, 1]]
    )
    np.testing.assert_array_equal(PINHOLE.project(points_mm)[1], [True, False, False, True, False])


@pytest.mark.parametrize("camera", CAMERAS)
def test_resizing_keeps_the_edges(camera: Intrinsics) -> None:
    smaller = camera.resized(camera.width // 2, camera.height // 2)
    edges = np.array([[-0.5, -0.5], [camera.width - 0.5, camera.height - 0.5]])
    np.testing.assert_allclose(smaller.unproject((edges + 0.5) / 2 - 0.5), camera.unproject(edges), atol=1e-6)


@pytest.mark.parametrize("camera", CAMERAS)
def test_cropping_keeps_the_rays(camera: Intrinsics) -> None:
    pixels = np.array([[30.0, 40.0], [60.0, 45.0]])
    part = camera.cropped(20, 10, 50, 60)
    assert (part.width, part.height) == (50, 60)
    np.testing.assert_allclose(part.unproject(pixels - [20, 10]), camera.unproject(pixels), atol=1e-9)
    assert camera.squared().width == camera.squared().height == min(camera.width, camera.height)
    assert camera.squared().squared() == camera.squared()


@pytest.mark.parametrize(("width", "height", "place"), [(7, 4, (1, 0, 4)), (4, 9, (0, 2, 4)), (5, 5, (0, 0, 5))])
def test_the_square_in_the_middle(width: int, height: int, place: tuple[int, int, int]) -> None:
    assert middle_square(width, height) == place


@pytest.mark.parametrize(
    "numbers",
    [(0, 300, 1.0, 1.0, 0.0, 0.0), (300, 300, -1.0, 1.0, 0.0, 0.0), (300, 300, 1.0, float("nan"), 0.0, 0.0)],
)
def test_impossible_intrinsics_are_refused(numbers: tuple) -> None:
    with pytest.raises(InputError, match="positive sizes and focal lengths"):
        Intrinsics(*numbers)


@pytest.mark.parametrize("fov_deg", [0.0, 180.0, -20.0, 400.0])
def test_an_impossible_field_of_view_is_refused(fov_deg: float) -> None:
    with pytest.raises(InputError, match="field of view"):
        Intrinsics.from_vertical_fov(300, 300, fov_deg)
