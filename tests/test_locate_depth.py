"""The depth network that ships with naris: what it tells of a nose that it never saw, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from naris.anatomy.builtin import built_in_nose
from naris.bench.trials import CAMERA_OF_TRIALS, FRAME_PX, drawn_trials, frames
from naris.core.anatomy import Anatomy
from naris.core.camera import Brown, Fisheye, Intrinsics
from naris.errors import CheckpointError, ImageError, InputError
from naris.locate.depth import FOV_DEG, ErrorShares, angle_deg, open_depth, told
from naris.model.checkpoint import write_tensors

EYE = CAMERA_OF_TRIALS.resized(FRAME_PX, FRAME_PX)


@pytest.fixture(scope="module")
def nose() -> Anatomy:
    return built_in_nose()


def test_it_tells_the_shape_of_a_nose_that_it_never_saw(nose: Anatomy) -> None:
    """Far better than a guess: the spread of ranges in a view is several times its error."""
    trials = drawn_trials(nose, 12, 3)
    errors, spreads = [], []
    for trial, image in zip(trials, frames(nose, trials, 3), strict=True):
        made = open_depth().estimate(image, EYE)
        pixels, _ = CAMERA_OF_TRIALS.project(made.rays)
        row, column = np.rint(pixels[..., 1]).astype(int), np.rint(pixels[..., 0]).astype(int)
        true = np.log(trial.ranges["a"][row, column])
        off = np.log(made.ranges_mm) - true
        errors.append(np.nanmedian(np.abs(off - np.nanmedian(off))))
        spreads.append(np.nanmedian(np.abs(true - np.nanmedian(true))))
    assert np.median(errors) < 0.16
    assert np.median(errors) < 0.5 * np.median(spreads)


def test_rays_are_of_the_middle_of_the_picture() -> None:
    wide = Intrinsics.from_vertical_fov(400, 300, 60.0)
    made = open_depth().estimate(np.full((300, 400, 3), 120, np.uint8), wide)
    assert made.rays.shape == (*made.ranges_mm.shape, 3)
    np.testing.assert_allclose(np.linalg.norm(made.rays, axis=2), 1.0)
    up = np.rad2deg(np.arctan2(made.rays[0, 12, 1], made.rays[0, 12, 2]))
    assert -30.0 < up < -27.0


def test_what_is_black_to_the_border_tells_nothing() -> None:
    image = np.full((FRAME_PX, FRAME_PX, 3), 120, np.uint8)
    image[:, : FRAME_PX // 4] = 0
    made = open_depth().estimate(image, EYE)
    assert np.isnan(made.ranges_mm[:, :5]).all()
    assert np.isfinite(made.ranges_mm[:, 8:]).all()


def test_a_black_picture_and_one_of_another_shape_are_refused() -> None:
    with pytest.raises(ImageError, match="something in its middle"):
        open_depth().estimate(np.zeros((FRAME_PX, FRAME_PX, 3), np.uint8), EYE)
    with pytest.raises(ImageError, match="of the shape"):
        open_depth().estimate(np.full((200, 300, 3), 120, np.uint8), EYE)


def test_the_angle_is_that_of_the_lens_as_far_as_the_network_knows_it() -> None:
    assert angle_deg(Intrinsics.from_vertical_fov(300, 300, 70.0)) == pytest.approx(70.0, abs=0.1)
    assert angle_deg(Intrinsics.from_vertical_fov(400, 300, 70.0)) == pytest.approx(70.0, abs=0.1)
    narrow = Intrinsics.from_vertical_fov(300, 300, 20.0)
    with pytest.raises(InputError, match="at least 40° high"):
        open_depth().estimate(np.full((300, 300, 3), 120, np.uint8), narrow)
    barrel = replace(Intrinsics.from_vertical_fov(300, 300, 70.0), lens=Brown(k1=-0.2))
    assert angle_deg(barrel) > 71.0
    fisheye = Intrinsics(300, 300, 120.0, 120.0, 149.5, 149.5, Fisheye(0.0, 0.0, 0.0, 0.0))
    assert angle_deg(fisheye) == FOV_DEG[1]


def test_errors_are_shares_of_what_is_claimed() -> None:
    rays = Intrinsics.from_vertical_fov(4, 4, 60.0).rays()
    log_range = np.full((4, 4), np.log(8.0))
    log_range[0, 0] = np.nan
    made = told(log_range, np.full((4, 4), 0.2), rays, ErrorShares(1.5, 0.5, 20.0, 0.1))
    assert made.scale_sd_log == pytest.approx(0.3)
    assert made.smooth == pytest.approx(0.1)
    assert made.sd_log[1, 1] == pytest.approx(0.02)
    assert np.isnan(made.ranges_mm[0, 0]) and made.ranges_mm[1, 1] == pytest.approx(8.0)


def test_another_file_is_refused(tmp_path: Path) -> None:
    write_tensors(tmp_path / "other.safetensors", "naris.depth/1", {}, {"stem.0.weight": np.zeros((2, 2), np.float32)})
    with pytest.raises(CheckpointError, match="a depth network in other"):
        open_depth(tmp_path / "other.safetensors")
