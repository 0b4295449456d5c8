"""A picture alone: registered or refused, by depth and shading; a probability that was fitted on this solver."""

from __future__ import annotations

import json
from importlib import resources

import numpy as np
import pytest

from naris.bench.pictures import PICTURE_SOLVER
from naris.bench.register import search_digest
from naris.bench.trials import CAMERA_OF_TRIALS, FRAME_PX, Trial, frames
from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, distance
from naris.core.provenance import file_digest
from naris.core.results import DepthEstimate, Registration
from naris.errors import InputError
from naris.locate.depth import DEPTH_WEIGHTS, open_depth
from naris.register import picture
from naris.register.map import RegistrationMap
from naris.register.observation import from_estimate
from naris.register.picture import PictureConfig, register_picture
from naris.register.register import register
from naris.register.starts import Belief, in_region, near
from naris.render.scene import Scene

EYE = CAMERA_OF_TRIALS.resized(FRAME_PX, FRAME_PX)
CELLS = Intrinsics.from_vertical_fov(24, 24, CAMERA_OF_TRIALS.vertical_fov_deg)


@pytest.fixture(scope="module")
def scene(nose: Anatomy) -> Scene:
    return Scene(nose)


def exact(trial: Trial) -> DepthEstimate:
    """As a network would say that is right but for a factor."""
    pixels, _ = CAMERA_OF_TRIALS.project(CELLS.rays())
    row, column = np.rint(pixels[..., 1]).astype(int), np.rint(pixels[..., 0]).astype(int)
    ranges = 1.2 * trial.ranges["a"][row, column]
    return DepthEstimate(CELLS.rays(), ranges, np.full(ranges.shape, 0.05), 0.1, 20.0, 0.25)


def found(
    at: RegistrationMap, scene: Scene, trial: Trial, image: np.ndarray, belief: Belief | None = None
) -> Registration:
    seen = image, EYE, exact(trial)
    return register_picture(at, scene, seen, belief) if belief else register_picture(at, scene, seen)


def test_with_depth_that_is_right_poses_are_found_and_the_scale_with_them(
    prepared_nose: RegistrationMap, scene: Scene, trials: list[Trial]
) -> None:
    off = []
    for trial, image in zip(trials, frames(scene.anatomy, trials, 3), strict=True):
        made = found(prepared_nose, scene, trial, image)
        off_mm, off_rad = distance(made.best, trial.anatomy_T_camera)
        off.append(max(off_mm / 2.0, np.rad2deg(off_rad) / 5.0))
        if off[-1] < 1.0:
            assert made.scale == pytest.approx(1 / 1.2, rel=0.3)
        assert (made.anatomy_T_camera is None) == (made.status == "refused") == (made.reason is not None)
        assert np.linalg.eigvalsh(made.covariance).min() > 0
    assert np.median(off) < 1.2, off


def test_the_same_picture_gives_the_same_answer(
    prepared_nose: RegistrationMap, scene: Scene, trials: list[Trial]
) -> None:
    image = frames(scene.anatomy, trials[:1], 3)[0]
    first, second = (found(prepared_nose, scene, trials[0], image) for _ in range(2))
    np.testing.assert_array_equal(first.best.matrix, second.best.matrix)
    assert first.probability == second.probability


def test_a_believed_pose_is_begun_from(prepared_nose: RegistrationMap, scene: Scene, trials: list[Trial]) -> None:
    truth, image = trials[1].anatomy_T_camera, frames(scene.anatomy, trials[1:2], 3)[0]
    beside = near(truth.reshape(1), np.diag([0.5**2] * 3 + [0.05**2] * 3)[None])
    made = found(prepared_nose, scene, trials[1], image, beside)
    off_mm, off_rad = distance(made.best, truth)
    assert off_mm < 2.0
    assert np.rad2deg(off_rad) < 6.0


def test_a_region_that_was_named_holds(prepared_nose: RegistrationMap, scene: Scene, trials: list[Trial]) -> None:
    """Whatever is registered is in it; where shading has left it, nothing is."""
    regions, trial = scene.anatomy.region_set(), trials[0]
    image = frames(scene.anatomy, trials[:1], 3)[0]
    for name in regions.names:
        made = found(prepared_nose, scene, trial, image, in_region(regions, name))
        if made.anatomy_T_camera is not None:
            assert regions.names[int(regions.label(made.anatomy_T_camera.position_mm))] == name
        inside = regions.names[int(regions.label(made.best.position_mm))] == name
        assert inside or "in none of the regions" in (made.reason or "")


def test_what_a_network_told_is_not_taken_for_depth(prepared_nose: RegistrationMap, trials: list[Trial]) -> None:
    with pytest.raises(InputError, match="register_picture"):
        register(prepared_nose, from_estimate(exact(trials[0])))


def test_something_else_is_refused(prepared_nose: RegistrationMap, scene: Scene) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (FRAME_PX, FRAME_PX, 3), dtype=np.uint8)
    plain = np.full((FRAME_PX, FRAME_PX, 3), 130, np.uint8)
    for image in (noise, plain):
        estimate = open_depth().estimate(image, EYE)
        made = register_picture(prepared_nose, scene, (image, EYE, estimate), config=PictureConfig(places=3))
        assert made.status == "refused"
        assert made.anatomy_T_camera is None


def test_the_probability_is_that_of_the_solver_and_the_network_as_they_are() -> None:
    fitted = json.loads(resources.files("naris.register").joinpath(picture.FITTED).read_text(encoding="utf-8"))
    assert fitted["solver"] == search_digest(PICTURE_SOLVER), "run docs/make_picture_confidence.py"
    assert fitted["depth_network"] == file_digest(DEPTH_WEIGHTS)
    assert fitted["covariance"] > 0


def test_poses_are_of_the_frame_of_the_anatomy(
    prepared_nose: RegistrationMap, scene: Scene, trials: list[Trial]
) -> None:
    made = found(prepared_nose, scene, trials[2], frames(scene.anatomy, trials[2:3], 3)[0])
    assert (made.best.target, made.best.source) == (scene.anatomy.frame, CAMERA)
    assert made.alternatives.target == scene.anatomy.frame
