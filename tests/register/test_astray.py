"""A pose that a picture moved into a wall, or out of the regions that were named, is no answer."""

from __future__ import annotations

import numpy as np
import pytest

from naris.core.anatomy import Anatomy
from naris.core.pose import CAMERA, Pose
from naris.core.results import Registration
from naris.register.astray import astray, unless_astray
from naris.register.map import RegistrationMap
from naris.register.starts import NOTHING, in_region


def registered(pose: Pose) -> Registration:
    alternatives = pose.reshape(1)
    return Registration(pose, pose, "registered", None, 0.9, 1.0, 0.0, 1.0, np.eye(6), alternatives)


@pytest.fixture(scope="module")
def inside(prepared_nose: RegistrationMap) -> Pose:
    deepest = np.argmax(prepared_nose.distance(prepared_nose.places_mm))
    return Pose.of(np.eye(3), prepared_nose.places_mm[deepest], "LPS", CAMERA)


def test_a_pose_in_the_air_stays(prepared_nose: RegistrationMap, inside: Pose) -> None:
    assert astray(prepared_nose, NOTHING, inside) is None
    found = registered(inside)
    assert unless_astray(found, prepared_nose, NOTHING, "--contours") is found


def test_a_pose_in_a_wall_is_refused_and_says_what_moved_it(
    prepared_nose: RegistrationMap, nose: Anatomy, inside: Pose
) -> None:
    wall = Pose.of(np.eye(3), nose.vertices_mm[0], "LPS", CAMERA)
    found = unless_astray(registered(wall), prepared_nose, NOTHING, "--shading")
    assert (found.anatomy_T_camera, found.status) == (None, "refused")
    assert found.best is wall
    assert found.reason == (
        "--shading moved the pose to where it is in a wall: see that frame and depth are of one moment, or go without"
    )


def test_a_pose_outside_the_named_region_is_refused(
    prepared_nose: RegistrationMap, nose: Anatomy, inside: Pose
) -> None:
    regions = nose.region_set()
    here = regions.names[int(regions.label(inside.position_mm))]
    there = next(name for name in regions.names if name != here)
    assert astray(prepared_nose, in_region(regions, here), inside) is None
    assert astray(prepared_nose, in_region(regions, there), inside) == "in none of the regions that were named"


def test_what_was_refused_stays_as_it_was_refused(prepared_nose: RegistrationMap, nose: Anatomy) -> None:
    wall = Pose.of(np.eye(3), nose.vertices_mm[0], "LPS", CAMERA)
    before = Registration(None, wall, "refused", "why", 0.1, 1.0, 0.0, 1.0, np.eye(6), wall.reshape(1))
    assert unless_astray(before, prepared_nose, NOTHING, "--shading") is before
