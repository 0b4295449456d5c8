"""Find a camera in an anatomy from a depth image of its view, and see a view of another patient refused.

    python examples/04_register.py [FOLDER]

Depth here is rendered and given noise; yours may come from anywhere, in mm or not.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.builtin.variation import virtual_patient
from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.core.pose import Pose, distance
from naris.register.look import depth_from, overlay
from naris.register.map import registration_map
from naris.register.noise import UNKNOWN, DepthNoise
from naris.register.observation import from_depth
from naris.register.register import register
from naris.render.appearance import ENDOSCOPE
from naris.render.scene import Scene, render


def main(folder: Path) -> None:
    """Registers what a camera in the built-in nose sees to that nose, and to another."""
    nose, other = built_in_nose(), virtual_patient(seed=7, number=1)
    camera, rng = Intrinsics.from_vertical_fov(300, 300, 80.0), np.random.default_rng(0)
    true = _half_way(nose)
    scene = Scene(nose)
    view = render(scene, true, camera, ENDOSCOPE)

    # Say what the noise is: the answer is only as good as that. Here 0.3 mm a pixel, and a factor that nobody knows.
    exact_mm = view.depth_mm[0]
    depth_mm = np.where(exact_mm > 0, exact_mm + 0.3 * rng.standard_normal(exact_mm.shape), 0.0)
    seen = from_depth(1.7 * depth_mm, camera, DepthNoise(pixel_mm=1.7 * 0.3), UNKNOWN)

    for anatomy in (nose, other):
        found = register(registration_map(anatomy), seen)
        print(f"{anatomy.name}: {found.status}, probability {found.probability:.2f}")
        if found.anatomy_T_camera is None:  # never a silent pose: say why, and go without
            print(f"  {found.reason}")
            continue
        off_mm, off_rad = distance(found.anatomy_T_camera, true)  # here known; in use it is not
        sd_mm = np.sqrt(np.diag(found.covariance)[:3])
        print(f"  {off_mm:.2f} mm and {np.rad2deg(off_rad):.1f}° off, one unit is {found.scale:.3f} mm")
        print(f"  it says of itself: ± {sd_mm.round(2)} mm along the axes of the camera")
        folder.mkdir(parents=True, exist_ok=True)
        walls = overlay(view.rgb[0], depth_from(Scene(anatomy), found.anatomy_T_camera, camera))
        Image.fromarray(walls).save(folder / "overlay.png")
        print(f"  wrote {folder / 'overlay.png'}")


def _half_way(nose: Anatomy) -> Pose:
    """A camera half way down the first passage, looking on."""
    line = nose.passages[0].points_mm
    here, ahead = line[len(line) // 2], line[len(line) // 2 + 8]
    return Pose.look(here, ahead - here, np.array([0.0, 0.0, 1.0]), nose.frame)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/examples"))
