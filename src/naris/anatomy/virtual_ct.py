"""The CT that a scanner would make of an anatomy: a head around the lumen, blur, slices, noise, streaks, a tilt.

The truth is known, so what is found in such a scan can be judged. It is no picture of a person: around the lumen lie
soft tissue and a thin plate of bone; the face is an ellipsoid with a nose on it, whose nostrils are open to the air.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int16
from scipy.ndimage import gaussian_filter, map_coordinates

from naris.anatomy.distance import lumen_distance
from naris.core.anatomy import Anatomy, Enclosed
from naris.core.progress import SILENT, Progress
from naris.core.volume import LPS, Volume
from naris.errors import InputError

AIR_HU, SOFT_HU, BONE_HU, METAL_HU = -1000.0, 40.0, 500.0, 3000.0
_FINE_MM = 0.5
_RAMP_MM = 0.5  # across which a wall goes from air to tissue before any blur
_BONE_MM = (1.5, 2.6)  # from the wall of the lumen to either face of the plate of bone
_SKIN_MM = 4.0  # of tissue between the vestibule and the face
_FACE_MM = 16.0  # the cheeks lie so far behind the tip of the lumen
_FINEST_MM, _LONGEST_MM, _MOST_NOISE_HU = 0.15, 60.0, 1000.0
_HEAD_ABOVE_MM = 44.0  # the middle of the head, above the nostrils
_NOSTRIL_MM, _NOSTRIL_WIDE_MM = 1.0, 4.0  # the nostrils end so far below their landmark
_HEAD_MM = (72.0, 90.0, 110.0)
_METAL_MM = 3.0
_SPOKES = 11


@dataclass(frozen=True)
class Scanner:
    """How the scan is made.

    Attributes:
        spacing_mm: of the voxels across, down and from slice to slice.
        thickness_mm: of a slice; None makes it its distance to the next.
        margin_mm: around the lumen.
        blur_mm: standard deviation of the point spread within a slice.
        noise_hu: standard deviation of the noise.
        tilt_deg: of the gantry, about the patient's left-right axis.
        metal: pieces of metal, as fillings in the upper teeth, with their streaks.

    Raises:
        InputError: if a number cannot be.
    """

    spacing_mm: tuple[float, float, float] = (0.5, 0.5, 1.0)
    thickness_mm: float | None = None
    margin_mm: float = 15.0
    blur_mm: float = 0.4
    noise_hu: float = 25.0
    tilt_deg: float = 0.0
    metal: int = 0

    def __post_init__(self) -> None:
        lengths = (*self.spacing_mm, 1.0 if self.thickness_mm is None else self.thickness_mm, self.margin_mm)
        rest = (self.blur_mm, self.noise_hu, float(self.metal))
        if not (min(lengths) > 0 and min(rest) >= 0 and np.isfinite([*lengths, *rest]).all()):
            raise InputError("spacings, thickness and margin above 0, the rest from 0", f"{self}", "correct them")
        if max(lengths) > _LONGEST_MM or min(self.spacing_mm) < _FINEST_MM or self.noise_hu > _MOST_NOISE_HU:
            limits = (
                f"spacings from {_FINEST_MM:g} mm, lengths up to {_LONGEST_MM:g} mm, noise up to {_MOST_NOISE_HU:g} HU"
            )
            raise InputError(limits, f"{self}", "no scanner has others: correct them")
        if not abs(self.tilt_deg) <= 30:
            raise InputError("a gantry tilted by at most 30°", f"{self.tilt_deg:g}°", "correct it")


@dataclass(frozen=True, eq=False)
class _Block:
    """Values on a fine lattice along the axes of the frame."""

    values: Float32[np.ndarray, "nx ny nz"]
    origin_mm: Float[np.ndarray, "3"]

    def points_mm(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x (nx, 1, 1), y (1, ny, 1) and z (1, 1, nz)."""
        axes = [low + _FINE_MM * np.arange(n) for low, n in zip(self.origin_mm, self.values.shape, strict=True)]
        x, y, z = np.meshgrid(*axes, indexing="ij", sparse=True)
        return x, y, z


def virtual_ct(anatomy: Anatomy, scanner: Scanner = Scanner(), seed: int = 0, progress: Progress = SILENT) -> Volume:
    """A CT of an anatomy that encloses its air; the same bits for the same arguments.

    Where the anatomy has landmarks `left.nostril` and `right.nostril`, the lumen is open to the air of the room below
    them; else the whole block is tissue.

    Args:
        anatomy: in LPS.
        scanner: how it is scanned.
        seed: of noise and metal.
        progress: told of the planes of the head, and of the slices.

    Raises:
        InputError: if the anatomy is in another frame or lies between walls.
    """
    if anatomy.frame != LPS or not isinstance(anatomy.airspace, Enclosed):
        raise InputError(
            "an anatomy in LPS whose surface encloses the air",
            f"one in {anatomy.frame}, {anatomy.airspace.kind}",
            "give a segmented airway or the built-in nose",
        )
    rng = np.random.default_rng(seed)
    block = _block(anatomy, scanner)
    lumen_mm = _lumen_mm(anatomy, block, progress)
    outside_mm = _outside_mm(anatomy, block, lumen_mm)
    hu = _tissue(lumen_mm, outside_mm)
    metal = _metal(anatomy, block, scanner.metal, rng)
    hu[metal] = METAL_HU
    blurred = gaussian_filter(hu, scanner.blur_mm / _FINE_MM) if scanner.blur_mm else hu
    return _scanned(_Block(blurred, block.origin_mm), anatomy, scanner, _places(metal, block), rng, progress)


def _block(anatomy: Anatomy, scanner: Scanner) -> _Block:
    low, high = anatomy.bounds_mm + np.array([[-1.0], [1.0]]) * (scanner.margin_mm + 4.0)
    shape = tuple(int(n) for n in np.ceil((high - low) / _FINE_MM) + 1)
    return _Block(np.empty(shape, np.float32), low)


def _lumen_mm(anatomy: Anatomy, block: _Block, progress: Progress) -> Float32[np.ndarray, "nx ny nz"]:
    """Signed distance to the wall at the nodes, positive in the lumen; true to the skin, beyond which all is room."""
    distance = lumen_distance(anatomy, _SKIN_MM + _RAMP_MM)
    x, y, z = block.points_mm()
    out = np.empty_like(block.values)
    with progress.task("head", len(out)) as advance:
        for i, plane in enumerate(out):
            points = np.stack(np.broadcast_arrays(x[i], y[0], z[0]), axis=-1)
            plane[:] = distance(points)
            advance(1)
    return out


def _outside_mm(
    anatomy: Anatomy, block: _Block, lumen_mm: Float32[np.ndarray, "nx ny nz"]
) -> Float32[np.ndarray, "nx ny nz"]:
    """About the signed distance to the skin, positive in the air of the room."""
    nostrils = [anatomy.landmarks_mm.get(f"{side}.nostril") for side in ("left", "right")]
    known = [point for point in nostrils if point is not None]
    if not known:
        return np.full_like(lumen_mm, -1e3)
    x, y, z = block.points_mm()
    front = float(anatomy.bounds_mm[0, 1])
    a, b, c = _HEAD_MM
    middle = _head_mm(known) + [0.0, front + _FACE_MM + b, 0.0]
    radius = np.sqrt(((x - middle[0]) / a) ** 2 + ((y - middle[1]) / b) ** 2 + ((z - middle[2]) / c) ** 2)
    cheeks_mm = (radius - 1) * min(_HEAD_MM)
    nose_mm = -lumen_mm - _SKIN_MM
    nose_mm = np.where(y < front + _FACE_MM + 12, nose_mm, 1e3)
    below_mm = _nostrils_end_mm(anatomy, known) - z  # positive below the nostrils
    skin_mm = np.minimum(cheeks_mm, np.maximum(nose_mm, below_mm))
    return np.asarray(skin_mm, dtype=np.float32)


def _head_mm(nostrils_mm: list[Float[np.ndarray, "3"]]) -> Float[np.ndarray, "3"]:
    """x and z of the middle of the head, to a whole cm: noses differ by less, scanners put a head anywhere."""
    nose = np.mean(nostrils_mm, axis=0)
    return np.round((nose + [0.0, 0.0, _HEAD_ABOVE_MM]) / 10) * [10.0, 0.0, 10.0]


def _nostrils_end_mm(anatomy: Anatomy, nostrils_mm: list[Float[np.ndarray, "3"]]) -> float:
    """The height at which the nose is cut: below the landmarks, but within the lumen, or no nostril would be open."""
    lowest = []
    for point in nostrils_mm:
        near = np.linalg.norm(anatomy.vertices_mm[:, :2] - point[:2], axis=1) < _NOSTRIL_WIDE_MM
        lowest.append(float(anatomy.vertices_mm[near, 2].min()) if near.any() else float(point[2]))
    landmark = min(float(point[2]) for point in nostrils_mm)
    return max(landmark - _NOSTRIL_MM, max(lowest) + _NOSTRIL_MM)


def _tissue(
    lumen_mm: Float32[np.ndarray, "nx ny nz"], outside_mm: Float32[np.ndarray, "nx ny nz"]
) -> Float32[np.ndarray, "nx ny nz"]:
    air = np.clip(np.maximum(lumen_mm, outside_mm) / _RAMP_MM + 0.5, 0, 1)
    thin, thick = _BONE_MM
    depth = np.minimum(-lumen_mm - thin, thick + lumen_mm)
    bone = np.clip(depth / _RAMP_MM + 0.5, 0, 1) * (outside_mm < -_SKIN_MM)
    return np.asarray((1 - air) * (SOFT_HU + bone * (BONE_HU - SOFT_HU)) + air * AIR_HU, dtype=np.float32)


def _metal(anatomy: Anatomy, block: _Block, count: int, rng: np.random.Generator) -> Bool[np.ndarray, "nx ny nz"]:
    """Balls along an arch of teeth below the floor of the lumen."""
    metal = np.zeros(block.values.shape, dtype=bool)
    x, y, z = block.points_mm()
    low, middle = anatomy.bounds_mm[0], anatomy.bounds_mm.mean(axis=0)[0]
    for angle in np.deg2rad(rng.uniform(-70, 70, count)):
        place = np.array(
            [round(middle, -1) + 26 * np.sin(angle), low[1] + 55 - 30 * np.cos(angle), low[2] - 0.4 * _METAL_MM]
        )
        metal |= (x - place[0]) ** 2 + (y - place[1]) ** 2 + (z - place[2]) ** 2 < _METAL_MM**2
    return metal


def _places(metal: Bool[np.ndarray, "nx ny nz"], block: _Block) -> Float[np.ndarray, "m 3"]:
    """A few points in the metal, from which streaks start."""
    inside = np.argwhere(metal)
    return np.asarray(block.origin_mm + _FINE_MM * inside[:: max(len(inside) // 12, 1)])


def _scanned(
    block: _Block,
    anatomy: Anatomy,
    scanner: Scanner,
    metal_mm: Float[np.ndarray, "m 3"],
    rng: np.random.Generator,
    progress: Progress,
) -> Volume:
    """The block on the scanner's lattice: averaged over the thickness of a slice, with noise and streaks."""
    low, high = anatomy.bounds_mm + np.array([[-1.0], [1.0]]) * scanner.margin_mm
    spacing = np.array(scanner.spacing_mm)
    shape = tuple(int(n) for n in np.floor((high - low) / spacing) + 1)
    matrix = np.eye(4)
    matrix[:3, :3] = np.diag(spacing)
    tilt = np.deg2rad(scanner.tilt_deg)
    matrix[:3, 1] = spacing[1] * np.array([0.0, np.cos(tilt), np.sin(tilt)])
    matrix[:3, 3] = low - matrix[:3, 1] * (shape[1] - 1) / 2 + np.array([0, spacing[1] * (shape[1] - 1) / 2, 0])
    thickness = float(spacing[2]) if scanner.thickness_mm is None else scanner.thickness_mm
    count = max(round(thickness / _FINE_MM), 1)
    normal = np.array([0.0, -np.sin(tilt), np.cos(tilt)])
    across = (np.arange(count) + 0.5) / count * thickness - thickness / 2
    volume = Volume(np.empty(shape, np.int16), matrix, LPS)
    i, j = np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij")
    with progress.task("slices", shape[2]) as advance:
        for k in range(shape[2]):
            points = volume.points_mm(np.stack([i, j, np.full_like(i, k)], axis=-1))
            plane = np.zeros(shape[:2])
            for off in across:
                index = np.moveaxis((points + off * normal - block.origin_mm) / _FINE_MM, -1, 0)
                plane += (
                    map_coordinates(block.values, index, np.float32, order=1, mode="nearest", prefilter=False) / count
                )
            plane += _streaks_hu(points, normal, metal_mm, thickness)
            volume.hu[:, :, k] = _as_int(plane + scanner.noise_hu * rng.standard_normal(plane.shape))
            advance(1)
    return volume


def _streaks_hu(
    points_mm: Float[np.ndarray, "ni nj 3"],
    normal: Float[np.ndarray, "3"],
    metal_mm: Float[np.ndarray, "m 3"],
    thickness_mm: float,
) -> Float[np.ndarray, "ni nj"]:
    """Bright and dark spokes around metal that a slice cuts, fading with the distance."""
    streaks = np.zeros(points_mm.shape[:2])
    for place in metal_mm:
        off = points_mm - place
        if abs(float(off[0, 0] @ normal)) > thickness_mm / 2 + _METAL_MM / 2:
            continue
        range_mm = np.linalg.norm(off, axis=-1)
        angle = np.arctan2(off[..., 1], off[..., 0])
        streaks += 900 / len(metal_mm) ** 0.5 * np.cos(_SPOKES * angle + place[0]) / (1 + range_mm / 8)
    return streaks


def _as_int(values: Float[np.ndarray, "ni nj"]) -> Int16[np.ndarray, "ni nj"]:
    return np.rint(np.clip(values, -1024, 3071)).astype(np.int16)
