"""The viewer: how soon it is there, how often it draws in a browser without a graphics card, and how true it is."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from skimage.metrics import structural_similarity

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.folder import load_anatomy, save_anatomy
from naris.bench import BenchRequest, Measurement
from naris.bench.browser import chromium, opened, shown, steering
from naris.bench.result import Figure
from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.render.scene import Scene, render
from naris.serve.stage import places, steady

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

_FOV_DEG, _SIZE_PX, _PICTURES, _SECONDS, _STARTS = 70.0, 300, 12, 10.0, 5
_QUICK_PICTURES, _QUICK_SECONDS, _QUICK_STARTS = 3, 2.0, 1


def measure(request: BenchRequest) -> Measurement:
    """Starts the command on a saved anatomy, opens its page, draws for a while, and compares pictures.

    Raises:
        EngineUnavailable: if there is no browser that can be driven.
    """
    anatomy = load_anatomy(request.anatomy) if request.anatomy else built_in_nose()
    starts, seconds = (_QUICK_STARTS, _QUICK_SECONDS) if request.quick else (_STARTS, _SECONDS)
    with tempfile.TemporaryDirectory(prefix="naris-bench-viewer-") as folder, chromium() as driver:
        save_anatomy(anatomy, Path(folder) / "anatomy")
        begun, ready = [], []
        with request.progress.task("starts", starts) as advance:
            for number in range(starts):
                with steering(["anatomy"], Path(folder)) as (address, seconds_to_start):
                    begun.append(seconds_to_start)
                    ready.append(opened(driver, address))
                    if number == starts - 1:
                        drawn, fineness = _frames_a_second(driver, seconds)
                        likeness = _likeness(driver, anatomy, _QUICK_PICTURES if request.quick else _PICTURES)
                advance(1)
        browser = f"{driver.capabilities['browserName']} {driver.capabilities['browserVersion']}"
    figures = (
        Figure("viewer.start_s", float(np.median(begun)), "s", starts, "lower", 3.0),
        Figure("viewer.ready_s", float(np.median(ready)), "s", starts, "lower"),
        Figure("viewer.fps", drawn, "1/s", 1, "higher"),
        Figure("viewer.fineness", fineness, "1", 1, "higher"),
        Figure("viewer.ssim", float(np.min(likeness)), "1", len(likeness), "higher", 0.9),
    )
    name = f"{anatomy.name}, {len(anatomy.faces)} faces, digest {anatomy.digest}"
    return Measurement(figures, {"anatomy": name, "browser": f"{browser}, graphics in software"})


def _frames_a_second(driver: Chrome, seconds: float) -> tuple[float, float]:
    """While the scope turns, both views at 1280 × 800; and how fine the inside was drawn then, 1 as at rest."""
    driver.execute_script("naris.page.keys.press('ArrowRight')")
    before, begun = int(driver.execute_script("return naris.state.drawn")), time.monotonic()
    time.sleep(seconds)
    drawn = int(driver.execute_script("return naris.state.drawn")) - before
    spent = time.monotonic() - begun
    fineness = float(driver.execute_script("return naris.state.ratio / Math.min(devicePixelRatio, 2)"))
    driver.execute_script("naris.page.keys.releaseAll()")
    return drawn / spent, fineness


def _likeness(driver: Chrome, anatomy: Anatomy, count: int) -> list[float]:
    """Structural similarity of the page to our renderer, without noise and sharpening, at places in the lumen."""
    scene, camera = Scene(anatomy), Intrinsics.from_vertical_fov(_SIZE_PX, _SIZE_PX, _FOV_DEG)
    regions = anatomy.region_set() if anatomy.regions else None
    everywhere = places(anatomy, regions)
    told = []
    for one in everywhere[:: max(len(everywhere) // count, 1)][:count]:
        matrix = one.anatomy_T_camera.matrix
        ours = render(scene, Pose(matrix[None], anatomy.frame, CAMERA), camera, steady(), want=("rgb",)).rgb
        if ours is not None:
            theirs = shown(driver, matrix.tolist(), _FOV_DEG, _SIZE_PX)
            told.append(float(structural_similarity(theirs, ours[0], channel_axis=2)))
    return told
