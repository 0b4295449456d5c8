"""What may be observed, what is refused and why, and that nothing of it is moved."""

import numpy as np
import pytest

from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.errors import InputError, PoseError
from naris.register.noise import ENDOSCOPIC_MM, UNKNOWN, DepthNoise, PointNoise, Scale, any_scale
from naris.register.observation import MOST_POINTS, from_depth, from_points, from_sightings, together

CAMERA_OF_TESTS = Intrinsics.from_vertical_fov(64, 48, 60.0)


def cloud(n=50, seed=0):
    return np.random.default_rng(seed).uniform([-4, -4, 6], [4, 4, 12], (n, 3))


def test_a_plane_across_is_seen_at_its_depth():
    seen = from_depth(np.full((48, 64), 7.0), CAMERA_OF_TESTS, DepthNoise(pixel_mm=0.2))
    np.testing.assert_allclose(seen.ranges * seen.directions[:, 2], 7.0, rtol=2e-3)
    assert len(seen) == 32 * 24
    np.testing.assert_allclose(np.linalg.norm(seen.directions, axis=1), 1.0)


def test_a_depth_image_without_error_is_no_cloud():
    """Its rays are known, however sure the distances along them are."""
    exact = from_depth(np.full((48, 64), 9.0), CAMERA_OF_TESTS, DepthNoise(smooth=0.0, pixel_mm=1e-3))
    assert not exact.is_cloud
    assert from_points(exact.directions * exact.ranges[:, None]).is_cloud


def test_the_mean_of_a_block_has_less_noise_and_an_edge_is_not_blurred():
    depth = np.full((48, 64), 5.0)
    depth[:, 33:] = 20.0  # within a block: pixels 32 and 33 share it
    seen = from_depth(depth, CAMERA_OF_TESTS, DepthNoise(smooth=0.0, pixel_mm=0.2))
    z = seen.ranges * seen.directions[:, 2]
    assert np.minimum(np.abs(z - 5), np.abs(z - 20)).max() < 0.05
    assert np.isclose(seen.radial, 0.1).sum() > 600 and np.isclose(seen.radial, 0.2).sum() == 24


def test_the_same_deviation_for_each_pixel_is_that_of_all():
    depth = np.random.default_rng(0).uniform(6, 7, (48, 64))
    depth[:, 33:] += 20.0
    z = CAMERA_OF_TESTS.rays()[..., 2]
    of_all = from_depth(depth, CAMERA_OF_TESTS, DepthNoise(pixel_mm=0.2))
    of_each = from_depth(depth, CAMERA_OF_TESTS, sd=0.2 * z)
    for name in ("ranges", "directions", "radial", "isotropic"):
        np.testing.assert_allclose(getattr(of_each, name), getattr(of_all, name), rtol=1e-9)


def test_a_pixel_has_the_deviation_that_it_is_said_to_have_and_none_without_one():
    sd = np.full((48, 64), 0.1)
    sd[:, 32:] = 0.4
    sd[:24, :10], sd[24:, :10] = 0.0, np.nan
    seen = from_depth(np.full((48, 64), 7.0), CAMERA_OF_TESTS, DepthNoise(smooth=0.0), sd=sd)
    right = seen.directions[:, 0] > 0
    assert len(seen) == 24 * 27
    along = seen.radial * seen.directions[:, 2]  # of z-depth, in blocks of four pixels
    np.testing.assert_allclose(along, np.where(right, 0.2, 0.05), rtol=0.02)
    with pytest.raises(InputError, match="deviations of as many pixels, 48 × 64, got 64 × 48"):
        from_depth(np.full((48, 64), 7.0), CAMERA_OF_TESTS, sd=sd.T)


def test_pixels_without_depth_are_left_out():
    depth = np.full((48, 64), 7.0)
    depth[:24], depth[:, :10] = 0.0, np.nan
    seen = from_depth(depth, CAMERA_OF_TESTS)
    assert len(seen) == 12 * 27
    assert (seen.directions[:, 1] > 0).all()


def test_points_are_kept_in_another_order():
    points = cloud()
    seen = from_points(points)
    back = seen.directions * seen.ranges[:, None]
    np.testing.assert_allclose(back[np.lexsort(back.T)], points[np.lexsort(points.T)], atol=1e-12)
    few = seen.some(20)
    assert len(few) == 20 and set(few.ranges) <= set(seen.ranges)


def test_of_a_cloud_each_view_has_as_much_to_say_as_one_can_have():
    sizes, rng = (5000, 200, 1500, 30), np.random.default_rng(3)
    poses = Pose.exp(0.1 * rng.standard_normal((4, 6)), CAMERA, CAMERA)
    seen = together([from_points(cloud(size, number)) for number, size in enumerate(sizes)], poses)
    assert np.bincount(seen.used().view).tolist() == [MOST_POINTS, 200, MOST_POINTS, 30]
    one = from_points(cloud(5000))
    assert (one.used().ranges == one.some(MOST_POINTS).ranges).all()
    for whole in (
        from_points(cloud(MOST_POINTS)),
        from_depth(np.full((96, 128), 7.0), CAMERA_OF_TESTS.resized(128, 96)),
    ):
        assert whole.used() is whole


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 3)), "expected points"),
        (np.zeros((30, 2)), "shape"),
        (np.where(np.arange(90).reshape(30, 3) == 4, np.nan, cloud(30)), "1 of 30 with NaN"),
        (np.linspace(1, 2, 40)[:, None] * [1.0, 1.0, 9.0], "one line"),
        (cloud(40) * [1.0, 1e-4, 1.0], "one plane"),
        (cloud(8), "at least 12 points"),
        (cloud() / 1000, "multiply by 1000"),
        (cloud() * 1000, "check the unit"),
    ],
)
def test_clouds_that_tell_no_pose_are_refused(points, message):
    with pytest.raises(InputError, match=message):
        from_points(points)


def test_of_an_unknown_scale_any_size_will_do():
    assert from_points(cloud() / 1000, PointNoise(1e-4), UNKNOWN).scale.free


def test_depth_images_of_another_size_or_without_depth_are_refused():
    with pytest.raises(InputError, match=r"48 × 64 pixels"):
        from_depth(np.ones((64, 48)), CAMERA_OF_TESTS)
    with pytest.raises(InputError, match="none above 0"):
        from_depth(np.zeros((48, 64)), CAMERA_OF_TESTS)


@pytest.mark.parametrize(
    "wrong",
    [
        {"kind": "guess"},
        {"kind": "prior"},
        {"kind": "prior", "sd_log": np.inf},
        {"sd_log": 0.1},
        {"low": 3.0},
        {"factor": -1.0},
        {"factor": 2.0},
    ],
)
def test_scales_that_cannot_be_are_refused(wrong):
    with pytest.raises(InputError):
        Scale(**wrong)


@pytest.mark.parametrize("wrong", [{"smooth": -1.0}, {"pixel_mm": np.nan}, {"outliers": 0.0}, {"reach_deg": 0.0}])
def test_noise_that_cannot_be_is_refused(wrong):
    with pytest.raises(InputError):
        DepthNoise(**wrong)


def test_views_together_lie_where_their_cameras_stand():
    one, other = from_points(cloud()), from_points(cloud(40, 1))
    relative = Pose.exp(np.array([[0.0] * 6, [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]]), CAMERA, CAMERA)
    both = together([one, other], relative)
    assert both.views == 2 and len(both) == 90
    expected = relative[1].apply(other.directions * other.ranges[:, None])
    back = both.origins[50:] + both.directions[50:] * both.ranges[50:, None]
    np.testing.assert_allclose(back, expected, atol=1e-9)


def test_views_of_different_scale_or_without_poses_are_refused():
    one, other = from_points(cloud()), from_points(cloud(), scale=UNKNOWN)
    poses = Pose(np.tile(np.eye(4), (2, 1, 1)), CAMERA, CAMERA)
    with pytest.raises(InputError, match="one scale"):
        together([one, other], poses)
    with pytest.raises(PoseError, match="one pose"):
        together([one], poses)


@pytest.mark.parametrize("factor", [0.1, 10.0, 1000.0])
def test_another_unit_is_the_same_observation(factor):
    """Of a depth image and of a cloud, with noise in that unit: everything is as in mm, but for the unit."""
    prior = Scale("prior", factor, 0.1)
    depth = 7.0 + np.linspace(-2, 2, 64) + np.linspace(-1, 1, 48)[:, None]
    mm = from_depth(depth, CAMERA_OF_TESTS, DepthNoise(pixel_mm=0.3), Scale("prior", 1.0, 0.1))
    other = from_depth(depth / factor, CAMERA_OF_TESTS, DepthNoise(pixel_mm=0.3 / factor), prior)
    points = cloud()
    pairs = [
        (mm, other),
        (from_points(points, PointNoise(0.5)), from_points(points / factor, PointNoise(0.5 / factor), prior)),
    ]
    for one, same in pairs:
        for name in ("ranges", "radial", "isotropic"):
            np.testing.assert_allclose(factor * getattr(same, name), getattr(one, name), rtol=1e-9, err_msg=name)


def test_of_any_scale_the_median_lies_as_far_away_as_in_a_nose():
    scale = any_scale(0.5)
    assert (0.5 * scale.low, 0.5 * scale.high) == pytest.approx(ENDOSCOPIC_MM)
    with pytest.raises(InputError, match="above 0"):
        any_scale(0.0)


def test_points_in_the_camera_and_cameras_that_saw_none_are_refused():
    with pytest.raises(InputError, match="1 of 50 in its centre"):
        from_points(np.where(np.arange(50)[:, None] == 7, 0.0, cloud()))
    stands, seen_from = np.zeros((3, 3)), np.repeat([0, 2], 25)
    with pytest.raises(InputError, match="none of camera 1"):
        from_sightings(cloud(), stands, seen_from)


def test_points_behind_the_camera_are_told_from_those_before_any_search():
    with pytest.raises(InputError, match=r"100% of them behind it.*turn y and z"):
        from_points(cloud() * [1, -1, -1])
