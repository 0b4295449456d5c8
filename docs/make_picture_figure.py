"""Draws `figures/picture_alone.webp`: pictures that were registered without depth, and one that was not.

    python docs/make_picture_figure.py

Views of the built-in nose as those of the registration trials, under looks that no training had, in the order in which
they are drawn: a row for each of the first ones that is registered, the frame, how far away the network says the walls
are, our picture from the pose that was found, and its edges on the frame; the last row is the first one refused.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib
import numpy as np
from PIL import Image

from naris.anatomy.builtin import built_in_nose
from naris.bench.trials import CAMERA_OF_TRIALS, FRAME_PX, drawn_trials, frames
from naris.core.results import DepthEstimate
from naris.locate.depth import open_depth
from naris.register.look import overlay, seen_from
from naris.register.map import registration_map
from naris.register.picture import register_picture
from naris.render.scene import Scene

OUT = Path(__file__).with_name("figures") / "picture_alone.webp"
SEED, DRAWN, ROWS, EDGE = 77, 8, 3, 240
FARTHEST_MM = 25.0


def main() -> None:
    """Draws it."""
    nose, camera = built_in_nose(), CAMERA_OF_TRIALS.resized(FRAME_PX, FRAME_PX)
    at, scene, trials = registration_map(nose), Scene(nose), drawn_trials(nose, DRAWN, SEED)
    kept: dict[str, list[np.ndarray]] = {"registered": [], "refused": []}
    for frame in frames(nose, trials, SEED):
        estimate = open_depth().estimate(frame, camera)
        found = register_picture(at, scene, (frame, camera, estimate))
        ours, depth = seen_from(scene, found.best, camera)
        row = [frame, coloured(estimate), ours, overlay(frame, depth)]
        kept[found.status].append(
            np.hstack([cv2.resize(one, (EDGE, EDGE), interpolation=cv2.INTER_AREA) for one in row])
        )
    rows = [*kept["registered"][:ROWS], *kept["refused"][:1]]
    Image.fromarray(np.vstack(rows)).save(OUT, quality=85, method=6)
    print(f"{OUT}: {len(kept['registered'])} of {DRAWN} registered")


def coloured(estimate: DepthEstimate) -> np.ndarray:
    """Near walls dark, far ones bright, up to `FARTHEST_MM`."""
    share = np.clip(np.nan_to_num(estimate.ranges_mm) / FARTHEST_MM, 0, 1)
    return np.asarray(matplotlib.colormaps["magma"](share, bytes=True)[..., :3])


if __name__ == "__main__":
    main()
