"""One picture from inside the built-in nose, and where in the anatomy each of its pixels lies.

python examples/00_one_view.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from naris.anatomy.builtin import built_in_nose
from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.render.appearance import ENDOSCOPE
from naris.render.scene import Scene, render


def main(folder: Path) -> None:
    """Places a camera, takes a picture, and takes one pixel of it back into the anatomy."""
    nose = built_in_nose()
    print(f"{nose.name}: {len(nose.faces):,} triangles in frame {nose.frame}, mm")

    # A camera a third of the way down the first passage. In LPS +z points up; the camera's own axes are x right,
    # y down, z forward. A pose is named after what it does: anatomy_T_camera takes camera points into the anatomy.
    line = nose.passages[0].points_mm
    here, ahead = line[len(line) // 3], line[len(line) // 3 + 12]
    anatomy_T_camera = Pose.look(here, ahead - here, np.array([0.0, 0.0, 1.0]), nose.frame)
    regions = nose.region_set("paper")
    print(f"the camera stands in the region {regions.names[int(regions.label(here))]!r}")

    camera = Intrinsics.from_vertical_fov(300, 300, 70.0)
    view = render(Scene(nose), anatomy_T_camera, camera, ENDOSCOPE)

    # Depth is z-depth, not distance along the ray: the ray is scaled until its z is the depth.
    u, v = 150, 150
    ray = camera.rays()[v, u]
    wall_mm = anatomy_T_camera.apply(ray / ray[2] * view.depth_mm[0, v, u])
    corner_mm = nose.vertices_mm[nose.faces[view.face_ids[0, v, u]][0]]
    print(
        f"pixel ({u}, {v}) sees the wall at {wall_mm.round(1)} mm, on a triangle with a corner at {corner_mm.round(1)}"
    )

    folder.mkdir(parents=True, exist_ok=True)
    Image.fromarray(view.rgb[0]).save(folder / "view.png")
    print(f"wrote {folder / 'view.png'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/examples"))
