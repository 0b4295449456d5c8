"""A pose moved by the shading of a frame: nearer to the truth, whatever the mucosa; not at all by what is no wall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.bench.trials import CAMERA_OF_TRIALS, FRAME_PX, Trial, frames
from naris.core.anatomy import Anatomy
from naris.core.pose import CAMERA, Pose, distance
from naris.core.results import Registration
from naris.errors import ImageError
from naris.register.shading import BARE, Shading, reshaded
from naris.render.scene import Scene, render

EYE = CAMERA_OF_TRIALS.resized(FRAME_PX, FRAME_PX)
LOOSE = np.diag([1.0**2] * 3 + [np.deg2rad(4.0) ** 2] * 3)


@pytest.fixture(scope="module")
def scene(nose: Anatomy) -> Scene:
    return Scene(nose)


@pytest.fixture(scope="module")
def pictures(nose: Anatomy, trials: list[Trial]) -> np.ndarray:
    """Under looks that the renderings it is compared with do not have."""
    return frames(nose, trials, 5)


def registered(pose: Pose) -> Registration:
    return Registration(pose, pose, "registered", None, 0.9, 1.0, 0.0, 9.0, LOOSE, pose.reshape(-1)[:0])


def beside(pose: Pose, seed: int) -> Pose:
    twist = np.random.default_rng(seed).standard_normal(6) * np.sqrt(np.diag(LOOSE))
    return pose @ Pose.exp(twist, CAMERA, CAMERA)


def bare(scene: Scene, pose: Pose) -> np.ndarray:
    rgb = render(scene, pose.reshape(1), EYE, BARE, want=("rgb",)).rgb
    assert rgb is not None
    return rgb[0]


def off(pose: Pose, truth: Pose) -> float:
    off_mm, off_rad = distance(pose, truth)
    return float(off_mm + np.rad2deg(off_rad) / 4.0)


def test_poses_come_nearer_whatever_the_mucosa(scene: Scene, trials: list[Trial], pictures: np.ndarray) -> None:
    before, after = [], []
    for number, (trial, picture) in enumerate(zip(trials, pictures, strict=True)):
        begun = registered(beside(trial.anatomy_T_camera, number))
        made = reshaded(scene, begun, picture, EYE)
        assert np.linalg.eigvalsh(LOOSE - made.registration.covariance).min() > -1e-9
        assert made.cost[1] <= made.cost[0] + 1.0
        before.append(off(begun.best, trial.anatomy_T_camera))
        after.append(off(made.registration.best, trial.anatomy_T_camera))
    assert np.median(after) < 0.6 * np.median(before)


def test_from_the_truth_with_our_own_picture_nothing_moves(scene: Scene, trials: list[Trial]) -> None:
    for trial in trials[:3]:
        truth = trial.anatomy_T_camera
        shading = Shading(scene, bare(scene, truth), EYE)
        made = shading.refined(truth, np.linalg.inv(LOOSE))
        assert off(made.pose, truth) < 0.05
        assert made.contrast == pytest.approx(1.0, abs=0.1)
        assert made.cost < 1.0


def test_light_and_tone_are_no_shape(scene: Scene, trials: list[Trial]) -> None:
    """A brighter picture, one that falls off to a side and one of another tone curve cost hardly more at the truth."""
    truth = trials[0].anatomy_T_camera
    picture = bare(scene, truth).astype(np.float64)
    side = np.linspace(0.8, 1.0, FRAME_PX)[None, :, None]
    changed = (0.7 * picture, side * picture, 255 * (picture / 255) ** 0.8)
    alike = [Shading(scene, one.astype(np.uint8), EYE).cost(truth) for one in changed]
    others = [Shading(scene, bare(scene, trial.anatomy_T_camera), EYE).cost(truth) for trial in trials[1:]]
    assert max(alike) < 6.0
    assert max(alike) < 0.3 * np.median(others)


def test_what_was_decided_stays(scene: Scene, trials: list[Trial], pictures: np.ndarray) -> None:
    begun = registered(beside(trials[0].anatomy_T_camera, 0))
    refused = replace(begun, anatomy_T_camera=None, status="refused", reason="why")
    made = reshaded(scene, refused, pictures[0], EYE).registration
    assert (made.anatomy_T_camera, made.status, made.reason) == (None, "refused", "why")
    assert made.probability == begun.probability


def test_a_plain_frame_moves_nothing(scene: Scene, trials: list[Trial]) -> None:
    begun = registered(beside(trials[0].anatomy_T_camera, 1))
    made = reshaded(scene, begun, np.full((FRAME_PX, FRAME_PX, 3), 120, np.uint8), EYE)
    assert not made.used
    assert made.registration is begun


def test_the_black_frame_of_an_endoscope_is_no_shadow(scene: Scene, trials: list[Trial]) -> None:
    truth = trials[0].anatomy_T_camera
    y, x = np.mgrid[:FRAME_PX, :FRAME_PX] - (FRAME_PX - 1) / 2
    inside = (np.hypot(x, y) < 0.48 * FRAME_PX)[..., None]
    masked = np.where(inside, bare(scene, truth), np.uint8(0))
    shading = Shading(scene, masked, EYE)
    assert shading.cost(truth) < 1.0
    assert off(shading.refined(truth, np.linalg.inv(LOOSE)).pose, truth) < 0.05


def test_a_frame_of_another_size_and_a_black_one_are_refused(scene: Scene) -> None:
    with pytest.raises(ImageError, match=f"{FRAME_PX}×{FRAME_PX} pixels"):
        Shading(scene, np.zeros((100, 120, 3), np.uint8), EYE)
    with pytest.raises(ImageError, match="100% of it black"):
        Shading(scene, np.zeros((FRAME_PX, FRAME_PX, 3), np.uint8), EYE)


def test_frames_of_other_places_are_told_from_the_right_ones(
    scene: Scene, trials: list[Trial], pictures: np.ndarray
) -> None:
    """Held where depth has them, poses are moved by the right frames, and by some of the others not at all."""
    tight = np.diag([0.1**2] * 3 + [0.005**2] * 3)
    begun = [replace(registered(trial.anatomy_T_camera), covariance=tight) for trial in trials]
    right = [reshaded(scene, one, picture, EYE).used for one, picture in zip(begun, pictures, strict=True)]
    other = [
        reshaded(scene, one, picture, EYE) for one, picture in zip(begun, np.roll(pictures, 1, axis=0), strict=True)
    ]
    assert all(right)
    assert not all(one.used for one in other)
    assert all(one.registration is start for one, start in zip(other, begun, strict=True) if not one.used)
