"""Registers a real shot of a person without CT to the mean nose; puts what its camera sees there beside the frame.

    python docs/make_real_shot.py SHOT MEAN_NOSE [VIEW]

SHOT is the folder of the shot `sinus-sfm` (structure from motion of 35 frames, as EndoscopyDepthEstimation-Pytorch
publishes it), MEAN_NOSE the file `ASR.ply` of naris fetch mean-nose, VIEW the number of a frame; 4600 is in the middle.
Writes `out/real-shot/`: `rendering.png`, ours alone, and `beside.png` with the frame and the edges of our walls on it.
The frames are under the GPL 3: no picture that shows one goes into this repository. Once with the mean as it is, once
with its shape estimated; about a minute.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image

from naris.anatomy.gaussian_process import GaussianProcess
from naris.anatomy.read import read_surface
from naris.bench.deformable import VIEW, observed_shot
from naris.core.camera import Intrinsics
from naris.core.pictures import read_picture
from naris.register.deformable.modes import of_gaussian_process
from naris.register.deformable.register import register_deformable
from naris.register.deformable.result import DeformableRegistration
from naris.register.look import overlay, seen_from
from naris.register.map import registration_map
from naris.register.observation import Observation
from naris.register.sfm.read import read_reconstruction
from naris.render.scene import Scene

OUT = Path(__file__).resolve().parents[1] / "out" / "real-shot"
WIDTH = 640
_POINT_RGB = (255, 220, 40)


def main(arguments: Sequence[str]) -> int:
    """Registers, tells and draws; the exit status."""
    if len(arguments) not in (2, 3):
        print("python docs/make_real_shot.py SHOT MEAN_NOSE [VIEW]")
        return 2
    shot, view = Path(arguments[0]), arguments[2] if len(arguments) == 3 else VIEW
    mean = read_surface(Path(arguments[1]))
    modes, at = of_gaussian_process(GaussianProcess.around(mean)), registration_map(mean)
    frame = read_picture(shot / f"{int(view):08d}.jpg")
    camera = read_reconstruction(shot).view(view).intrinsics
    small = camera.resized(WIDTH, round(WIDTH * camera.height / camera.width))
    frame = cv2.resize(frame, (small.width, small.height), interpolation=cv2.INTER_AREA)
    seen, rows, ours = observed_shot(shot, view), [], []
    for name, used in (("as it is", modes.first(0)), ("its shape estimated", modes)):
        found = register_deformable(at, used, seen)
        print(f"the mean nose {name}: {told(found)}")
        picture, depth = seen_from(Scene(found.deformed), found.best, small)
        ours.append(picture)
        with_points = points_on(frame, seen, small)
        rows.append(np.concatenate([with_points, picture, overlay(frame, depth)], axis=1))
    OUT.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(ours, axis=1)).save(OUT / "rendering.png")
    Image.fromarray(np.concatenate(rows)).save(OUT / "beside.png")
    print(f"written: {OUT / 'rendering.png'}, {OUT / 'beside.png'}")
    return 0


def told(found: DeformableRegistration) -> str:
    """One result in a line."""
    fit = found.fit
    return (
        f"{found.status}, {found.reason or 'no reason against it'}; {fit.explained:.0%} of the points explained, "
        f"median {fit.median_mm:.2f} mm, 95 % within {fit.p95_mm:.2f} mm; {found.scale:.2f} mm per unit, "
        f"margin {found.margin:.1f}, stretch {found.stretch:.1f}, camera at {np.round(found.best.position_mm, 1)}"
    )


def points_on(frame: UInt8[np.ndarray, "h w 3"], seen: Observation, camera: Intrinsics) -> UInt8[np.ndarray, "h w 3"]:
    """The frame with the points of the reconstruction that lie in it."""
    points = seen.origins + seen.ranges[:, None] * seen.directions
    pixels, visible = camera.project(points)
    drawn = frame.copy()
    for x, y in pixels[visible]:
        cv2.circle(drawn, (round(float(x)), round(float(y))), 2, _POINT_RGB, -1)
    return drawn


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
