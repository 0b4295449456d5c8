"""Points of a reconstruction in a camera, alone or with what other cameras saw: nothing is moved, nothing guessed."""

import numpy as np
import pytest

from naris.core.pose import CAMERA, Pose, distance
from naris.errors import InputError
from naris.register.register import register
from naris.register.sfm.reconstruction import (
    WORLD,
    Reconstruction,
    View,
    noise_of,
    observed,
    unknown_scale,
)
from tests.register.sfm.simulated import SHOT, reconstructed


def two_views(points=60, shared=20):
    """The first sees the first points, the second the last; `shared` of them both."""
    rng = np.random.default_rng(4)
    world = rng.uniform([-4, -4, 6], [4, 4, 12], (points, 3))
    poses = Pose.exp(np.array([[0.0] * 6, [0.5, 0.2, -1.0, 0.1, 0.0, 0.2]]), CAMERA, WORLD)
    middle = points // 2
    seen = [np.arange(middle + shared // 2), np.arange(middle - shared // 2, points)]
    return Reconstruction(tuple(View(name, poses[i], SHOT, seen[i]) for i, name in enumerate("ab")), world)


def test_alone_a_view_has_its_own_points_in_its_camera():
    made = two_views()
    reference = made.views[1]
    points = made.seen_by(reference)
    seen = observed(made, reference, noise_of(points), unknown_scale(points), alone=True)
    assert seen.views == 1 and len(seen) == 40
    back = seen.directions * seen.ranges[:, None]
    np.testing.assert_allclose(np.sort(back, axis=0), np.sort(points, axis=0), atol=1e-12)
    np.testing.assert_allclose(np.sort(back, axis=0), np.sort(reference.camera_T_world.apply(made.points[20:]), axis=0))


def test_the_whole_has_each_point_once_on_the_ray_of_a_camera_that_saw_it():
    made = two_views()
    reference, other = made.views
    points = made.seen_by(reference)
    seen = observed(made, reference, noise_of(points), unknown_scale(points))
    assert seen.views == 2 and len(seen) == 60 and np.bincount(seen.view).tolist() == [40, 20]
    ends = seen.origins + seen.directions * seen.ranges[:, None]
    expected = reference.camera_T_world.apply(made.points)
    np.testing.assert_allclose(np.sort(ends, axis=0), np.sort(expected, axis=0), atol=1e-12)
    stands = (reference.camera_T_world @ other.camera_T_world.inverse()).position_mm
    np.testing.assert_allclose(seen.origins[seen.view == 0], 0)
    np.testing.assert_allclose(seen.origins[seen.view == 1], np.tile(stands, (20, 1)), atol=1e-12)


def test_points_that_few_cameras_add_are_left_out_and_of_many_some_are_kept():
    made = two_views(60, 50)  # the second view would add five
    points = made.seen_by(made.views[0])
    assert observed(made, made.views[0], noise_of(points), unknown_scale(points)).views == 1
    many = two_views(4000, 100)
    points = many.seen_by(many.views[0])
    assert 1000 < len(observed(many, many.views[0], noise_of(points), unknown_scale(points))) <= 1024


def test_an_unknown_unit_changes_nothing_but_the_scale_that_is_sought():
    points = two_views().seen_by(two_views().views[0])
    for unit in (1e-3, 1.0, 250.0):
        scale = unknown_scale(points * unit)
        np.testing.assert_allclose(
            np.array([scale.low, scale.high]) * unit, [unknown_scale(points).low] * np.array([1, 10])
        )
        assert noise_of(points * unit).sd_mm == pytest.approx(unit * noise_of(points).sd_mm)


def test_views_that_saw_nothing_or_do_not_exist_are_refused():
    made = two_views()
    empty = View("c", made.views[0].camera_T_world, SHOT, np.zeros(0, np.int64))
    with pytest.raises(InputError, match="points that c saw, got none"):
        made.seen_by(empty)
    with pytest.raises(InputError, match=r"a view of the reconstruction \(a, b\), got none"):
        made.view(None)


@pytest.mark.slow
@pytest.mark.parametrize("alone", [pytest.param(True, marks=pytest.mark.long), False])
def test_a_reconstruction_of_any_unit_finds_its_place(nose, prepared_nose, trials, alone):
    right, scales = 0, []
    for seed, trial in enumerate(trials):
        made, mm_per_unit = reconstructed(nose, trial.anatomy_T_camera, seed)
        points = made.seen_by(made.views[0])
        seen = observed(made, made.views[0], noise_of(points), unknown_scale(points), alone=alone)
        found = register(prepared_nose, seen)
        off_mm, off_rad = distance(found.best, trial.anatomy_T_camera)
        right += bool(off_mm < 2 and off_rad < np.deg2rad(5))
        scales.append(found.scale / mm_per_unit)
    assert right >= len(trials) - 1
    assert abs(np.median(scales) - 1) < 0.05
