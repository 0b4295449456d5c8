"""The depth network on a real shot, and pictures of it alone in noses that are another person's.

The reconstruction of `sinus-sfm` says how far away some points of each frame are, in a unit of its own; nobody knows
the truth. The person's CT is not known either, so every frame that is registered to another nose is registered wrongly.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.read import read_surface
from naris.bench import BenchRequest
from naris.bench.deformable import SHOT, SHOT_FILES
from naris.bench.result import Figure, wilson
from naris.bench.trials import MEAN
from naris.core.pictures import read_picture
from naris.core.results import DepthEstimate
from naris.locate.depth import open_depth
from naris.register.map import registration_map
from naris.register.picture import register_picture
from naris.register.sfm.read import read_reconstruction
from naris.render.scene import Scene

_BESIDE_DEG = 2.5  # a point belongs to a ray of the network that is no further away
_FEWEST = 20


def figures(request: BenchRequest) -> list[Figure]:
    """Without values where the shot is not given."""
    folder = None if request.scans is None else request.scans / SHOT
    if folder is None or not all((folder / name).is_file() for name in SHOT_FILES):
        return [*_of_depth(np.zeros((0, 3))), Figure("register.picture.shot.refused", None, "1", 0, "higher")]
    made = read_reconstruction(folder)
    frames = sorted(folder.glob("[0-9]*.jpg"))[:: 12 if request.quick else 1]
    noses = [built_in_nose()]
    if request.scans is not None and (request.scans / MEAN).is_file() and not request.quick:
        noses.append(read_surface(request.scans / MEAN))
    likeness, refused = [], []
    with request.progress.task("a real shot", len(noses) * len(frames)) as advance:
        for number, nose in enumerate(noses):
            at, scene = registration_map(nose), Scene(nose)
            for file in frames:
                view, image = made.view(str(int(file.stem))), read_picture(file)
                camera = view.intrinsics.resized(image.shape[1], image.shape[0])
                estimate = open_depth().estimate(image, camera)
                if not number:
                    likeness.append(alike(estimate, made.seen_by(view)))
                refused.append(register_picture(at, scene, (image, camera, estimate)).status == "refused")
                advance(1)
    return [*_of_depth(np.array(likeness)), _of_refused(refused)]


def alike(estimate: DepthEstimate, points: Float[np.ndarray, "n 3"]) -> tuple[float, float, float]:
    """How far a network's ranges and a reconstruction's are alike along the rays of points.

    Returns:
        the correlation of their logarithms, the median of the absolute differences once a factor is taken off, and that
        of the points' own, which is the error of whoever takes all for equally far away; NaN with too few points.
    """
    ranges = np.linalg.norm(points, axis=1)
    cosine = (points / ranges[:, None]) @ estimate.rays.reshape(-1, 3).T
    nearest = cosine.argmax(axis=1)
    told = np.log(estimate.ranges_mm.ravel()[nearest])
    used = (cosine.max(axis=1) > np.cos(np.deg2rad(_BESIDE_DEG))) & np.isfinite(told)
    if used.sum() < _FEWEST:
        return (np.nan, np.nan, np.nan)
    told, true = told[used], np.log(ranges[used])
    off = told - true
    spread = [float(np.median(np.abs(each - np.median(each)))) for each in (off, true)]
    return float(np.corrcoef(told, true)[0, 1]), spread[0], spread[1]


def _of_depth(rows: Float[np.ndarray, "n 3"]) -> list[Figure]:
    rows, base = rows[np.isfinite(rows).all(axis=1)], "register.picture.shot"
    correlation, off, spread = (float(np.median(column)) if len(rows) else None for column in rows.T)
    return [
        Figure(f"{base}.correlation", correlation, "1", len(rows), "higher"),
        Figure(f"{base}.shape", off, "1", len(rows), "lower"),
        Figure(f"{base}.spread", spread, "1", len(rows), "lower"),
    ]


def _of_refused(refused: list[bool]) -> Figure:
    n = len(refused)
    return Figure(
        "register.picture.shot.refused", float(np.mean(refused)), "1", n, "higher", None, wilson(sum(refused), n)
    )
