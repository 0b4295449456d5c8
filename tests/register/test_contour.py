"""A pose moved by the edges of a frame: nearer to the truth where there are edges, not at all where there are none."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from naris.bench.trials import CAMERA_OF_TRIALS, Trial
from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose, distance
from naris.core.results import Registration
from naris.errors import ImageError
from naris.register.contour import FEWEST_EDGES, sharpened
from naris.render.scene import Scene, render

EYE = Intrinsics.from_vertical_fov(256, 256, CAMERA_OF_TRIALS.vertical_fov_deg)
LOOSE = np.diag([0.3**2] * 3 + [np.deg2rad(2.0) ** 2] * 3)


@pytest.fixture(scope="module")
def scene(nose: Anatomy) -> Scene:
    return Scene(nose)


def picture(scene: Scene, pose: Pose) -> np.ndarray:
    rgb = render(scene, pose.reshape(-1), EYE, want=("rgb",)).rgb
    assert rgb is not None
    return rgb[0]


def registered(pose: Pose) -> Registration:
    return Registration(pose, pose, "registered", None, 0.9, 1.0, 0.0, 9.0, LOOSE, pose.reshape(-1)[:0])


def beside(pose: Pose, seed: int) -> Pose:
    """Off by as much as it is loose."""
    twist = np.random.default_rng(seed).standard_normal(6) * np.sqrt(np.diag(LOOSE))
    return pose @ Pose.exp(twist, CAMERA, CAMERA)


def test_a_pose_comes_nearer_where_there_are_edges(scene: Scene, trials: list[Trial]) -> None:
    before, after = [], []
    for number, trial in enumerate(trials):
        truth = trial.anatomy_T_camera
        begun = registered(beside(truth, number))
        found = sharpened(scene, begun, picture(scene, truth), EYE)
        if not found.moved_mm:  # too few edges, or those of another place
            assert found.registration is begun
            continue
        assert found.edges >= FEWEST_EDGES
        assert found.off_px[1] < found.off_px[0]
        assert np.linalg.eigvalsh(LOOSE - found.registration.covariance).min() > -1e-9
        for off, pose in ((before, begun.best), (after, found.registration.best)):
            off_mm, off_rad = distance(pose, truth)
            off.append((off_mm / 0.3) ** 2 + (np.rad2deg(off_rad) / 2.0) ** 2)
    assert len(before) >= 3
    assert np.mean(after) < 0.6 * np.mean(before)


def test_what_was_decided_stays(scene: Scene, trials: list[Trial]) -> None:
    truth = trials[0].anatomy_T_camera
    begun = registered(beside(truth, 0))
    refused = replace(begun, anatomy_T_camera=None, status="refused", reason="why")
    found = sharpened(scene, refused, picture(scene, truth), EYE).registration
    assert (found.anatomy_T_camera, found.status, found.reason) == (None, "refused", "why")
    assert found.probability == begun.probability


def test_a_frame_without_edges_moves_nothing(scene: Scene, trials: list[Trial]) -> None:
    for trial in trials:
        begun = registered(beside(trial.anatomy_T_camera, 1))
        found = sharpened(scene, begun, np.full((256, 256, 3), 120, np.uint8), EYE)
        assert found.registration is begun
        assert (found.edges, found.moved_mm) == (0, 0.0)


def test_the_black_frame_of_an_endoscope_is_no_edge(scene: Scene, trials: list[Trial]) -> None:
    """Nothing but a bright disc: its rim is the strongest edge of the picture."""
    y, x = np.mgrid[:256, :256] - 127.5
    disc = np.where((np.hypot(x, y) < 90)[..., None], np.uint8(120), np.uint8(0)) * np.ones(3, np.uint8)
    for trial in trials:
        begun = registered(trial.anatomy_T_camera)
        assert sharpened(scene, begun, disc, EYE).registration is begun


def test_a_frame_of_another_size_is_refused(scene: Scene, trials: list[Trial]) -> None:
    with pytest.raises(ImageError, match="256×256 pixels"):
        sharpened(scene, registered(trials[0].anatomy_T_camera), np.zeros((100, 120, 3), np.uint8), EYE)


def test_frames_that_show_something_else_hardly_move_anything(scene: Scene, trials: list[Trial]) -> None:
    """Noise, smooth noise, and what another camera saw: each has edges beside any wall."""
    rng, moved = np.random.default_rng(0), []
    rough = rng.integers(0, 255, (256, 256, 3), dtype=np.uint8)
    smooth = cv2.GaussianBlur(rough, (0, 0), 6.0)
    smooth = cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX)
    for number, trial in enumerate(trials):
        begun = registered(trial.anatomy_T_camera)
        elsewhere = picture(scene, trials[number - 1].anatomy_T_camera)
        moved += [sharpened(scene, begun, frame, EYE).registration is not begun for frame in (rough, smooth, elsewhere)]
    assert np.mean(moved) <= 0.2


def test_both_distances_are_sought_equally_far(scene: Scene, trials: list[Trial]) -> None:
    """From the truth with the right frame nothing is to be gained, and nothing is told to be."""
    for trial in trials:
        found = sharpened(scene, registered(trial.anatomy_T_camera), picture(scene, trial.anatomy_T_camera), EYE)
        if found.edges >= FEWEST_EDGES:
            assert found.off_px[1] > 0.3 * found.off_px[0]
