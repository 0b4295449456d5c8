"""The depth network on a real shot, and pictures and points of it in noses that are another person's.

The reconstruction of `sinus-sfm` says how far away some points of each frame are, in a unit of its own; nobody knows
the truth. The person's CT is not known either, so every frame that is registered to another nose is registered wrongly,
by its picture or by the points of the reconstruction.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.read import read_surface
from naris.bench import BenchRequest
from naris.bench.deformable import SFM, SHOT, SHOT_FILES
from naris.bench.result import Figure, wilson
from naris.bench.trials import MEAN
from naris.core.pictures import read_picture
from naris.core.results import DepthEstimate
from naris.locate.depth import open_depth
from naris.register.map import RegistrationMap, registration_map
from naris.register.noise import PointNoise
from naris.register.picture import register_picture
from naris.register.register import register
from naris.register.sfm.read import read_reconstruction
from naris.register.sfm.reconstruction import Reconstruction, View, noise_of, observed, unknown_scale
from naris.render.scene import Scene

PICTURES, POINTS = "register.picture.shot.refused", f"{SFM}.frames"
_BESIDE_DEG = 2.5  # a point belongs to a ray of the network that is no further away
_FEWEST = 20
_OF_POINTS = {"usual": (1.0, False), "larger_noise": (5 / 3, False), "alone": (1.0, True)}
"""By name: how wrong points are said to be, over what is usual, and whether the frame's own alone are taken."""


def figures(request: BenchRequest) -> list[Figure]:
    """Without values where the shot is not given."""
    folder = None if request.scans is None else request.scans / SHOT
    if folder is None or not all((folder / name).is_file() for name in SHOT_FILES):
        return [*_of_depth(np.zeros((0, 3))), _of_refused(PICTURES, []), *_of_points({})]
    made = read_reconstruction(folder)
    frames = sorted(folder.glob("[0-9]*.jpg"))[:: 12 if request.quick else 1]
    noses = [built_in_nose()]
    if request.scans is not None and (request.scans / MEAN).is_file() and not request.quick:
        noses.append(read_surface(request.scans / MEAN))
    likeness, refused = [], []
    points: dict[str, list[bool]] = {name: [] for name in _OF_POINTS}
    with request.progress.task("a real shot", len(noses) * len(frames)) as advance:
        for number, nose in enumerate(noses):
            at, scene = registration_map(nose), Scene(nose)
            for file in frames:
                view, image = made.view(str(int(file.stem))), read_picture(file)
                for name, (noise, alone) in _OF_POINTS.items():
                    points[name].append(_refused(at, made, view, noise, alone))
                camera = view.intrinsics.resized(image.shape[1], image.shape[0])
                estimate = open_depth().estimate(image, camera)
                if not number:
                    likeness.append(alike(estimate, made.seen_by(view)))
                refused.append(register_picture(at, scene, (image, camera, estimate)).status == "refused")
                advance(1)
    return [*_of_depth(np.array(likeness)), _of_refused(PICTURES, refused), *_of_points(points)]


def _refused(at: RegistrationMap, made: Reconstruction, view: View, factor: float, alone: bool) -> bool:
    """Whether the points of the reconstruction, in the camera of a view, are refused."""
    seen = made.seen_by(view)
    noise = PointNoise(factor * noise_of(seen).sd_mm)
    return register(at, observed(made, view, noise, unknown_scale(seen), alone=alone)).status == "refused"


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


def _of_points(refused: dict[str, list[bool]]) -> list[Figure]:
    """Frames of one shot in each nose: no independent trials, so the intervals are too narrow."""
    return [_of_refused(f"{POINTS}.{name}.refused", refused.get(name, [])) for name in _OF_POINTS]


def _of_refused(name: str, refused: list[bool]) -> Figure:
    n = len(refused)
    share = float(np.mean(refused)) if n else None
    return Figure(name, share, "1", n, "higher", None, wilson(sum(refused), n) if n else None)
