"""Where each point of one anatomy lies in another: an affine map, and a smooth displacement on top of it.

The two are found by their signed distances, in which every point near a wall tells how far it is from lying right:
first the affine map (Gauss–Newton over points near the wall, begun at the landmarks that both have), then a
displacement field by demons (J.-P. Thirion 1998, with the symmetric forces of T. Vercauteren et al. 2009, as SimpleITK
has them), from coarse to fine. Anatomies whose vertices correspond need neither: there the vertices themselves tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32
from scipy.ndimage import map_coordinates

from naris.anatomy.carry import Mover
from naris.anatomy.distance import SignedDistance, signed_distance
from naris.core.anatomy import Anatomy, Between
from naris.errors import InputError

LANDMARKS = ("left.nostril", "right.nostril", "left.choana", "right.choana", "nasopharynx")
"""Those that a scan's segmentation finds and the built-in nose has, in the same places to a few mm."""

_SPACING_MM = 1.0
_MARGIN_MM = 6.0
_FEWEST_MARKS = 4
_PRIOR_MM2 = 400.0  # how hard an axis is held at its length: a few landmarks tell little of it
_AFFINE_POINTS, _AFFINE_STEPS = 6000, 40
_NEAR_MM, _FAR_MM = 4.0, 8.0  # beyond, the distance to a wall says nothing about where a point belongs
_LEVELS = ((4, 100), (2, 100))  # every which node, iterations
_SMOOTH_NODES = 1.5


@dataclass(frozen=True, eq=False)
class Correspondence:
    """A map from the points of a target to those of a reference.

    Attributes:
        affine: (4, 4) applied last.
        shift_mm: (nx, ny, nz, 3) displacement in the frame of the target, at the nodes of a grid.
        origin_mm: (3,) where node (0, 0, 0) lies in the frame of the target.
        spacing_mm: between nodes.
        residual_mm: (V,) how far each vertex of the target, mapped, lies from the reference's surface.
    """

    affine: Float[np.ndarray, "4 4"]
    shift_mm: Float32[np.ndarray, "nx ny nz 3"]
    origin_mm: Float[np.ndarray, "3"]
    spacing_mm: float
    residual_mm: Float[np.ndarray, "v"]

    def __call__(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points (..., 3) of the target, in the frame of the reference."""
        points = np.asarray(points_mm, dtype=np.float64)
        shifted = points + _sampled(self.shift_mm, self.origin_mm, self.spacing_mm, points)
        return shifted @ self.affine[:3, :3].T + self.affine[:3, 3]


def correspond(target: Anatomy, reference: Anatomy) -> Correspondence:
    """Find where the target's points lie in the reference (some seconds; a fraction where vertices correspond).

    Raises:
        InputError: if neither their vertices correspond nor they have four of `LANDMARKS` in common, or the air of one
            lies between walls that its surface encloses, so that its distances have no closed surface.
    """
    for one in (target, reference):
        _check_closed(one)
    if target.faces.shape == reference.faces.shape and np.array_equal(target.faces, reference.faces):
        of_target, of_reference = (signed_distance(one, _SPACING_MM) for one in (target, reference))
        origin, nodes = _nodes(of_target)
        shift = (Mover.between(target.vertices_mm, reference.vertices_mm)(nodes) - nodes).astype(np.float32)
        return _measured(np.eye(4), shift, origin, target, of_reference)
    marks = _marks(target, reference)
    of_target, of_reference = (signed_distance(one, _SPACING_MM) for one in (target, reference))
    at, to = (np.stack([one.landmarks_mm[name] for name in marks]) for one in (target, reference))
    affine = _refined(_begun(at, to), of_target, of_reference)
    shift, origin = _displaced(affine, of_target, of_reference)
    return _measured(affine, shift, origin, target, of_reference)


def check_laid(anatomy: Anatomy) -> None:
    """See that an anatomy can be laid on others, or others on it, before work is spent on it.

    Raises:
        InputError: if its air lies between walls that the surface encloses, or it has not enough landmarks.
    """
    _check_closed(anatomy)
    _marks(anatomy, anatomy)


def _check_closed(anatomy: Anatomy) -> None:
    if isinstance(anatomy.airspace, Between):
        raise InputError("an anatomy whose surface encloses the air", f"{anatomy.name}", "give a closed airway")


def _marks(one: Anatomy, other: Anatomy) -> list[str]:
    """The landmarks that both have."""
    marks = [name for name in LANDMARKS if name in one.landmarks_mm and name in other.landmarks_mm]
    if len(marks) < _FEWEST_MARKS:
        raise InputError(
            f"{_FEWEST_MARKS} or more of the landmarks {', '.join(LANDMARKS)} in both anatomies",
            f"{', '.join(marks) or 'none'}",
            "give anatomies from a scan (naris anatomy from-ct) or built-in ones",
        )
    return marks


def _measured(
    affine: Float[np.ndarray, "4 4"],
    shift_mm: Float32[np.ndarray, "nx ny nz 3"],
    origin_mm: Float[np.ndarray, "3"],
    target: Anatomy,
    reference: SignedDistance,
) -> Correspondence:
    unmeasured = Correspondence(affine, shift_mm, origin_mm, _SPACING_MM, np.zeros(len(target.vertices_mm)))
    return replace(unmeasured, residual_mm=np.abs(reference(unmeasured(target.vertices_mm))))


def _begun(at_mm: Float[np.ndarray, "k 3"], to_mm: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "4 4"]:
    """The affine map of landmarks by least squares, its axes held near their length."""
    middle, aim = at_mm.mean(axis=0), to_mm.mean(axis=0)
    centred = at_mm - middle
    axes = np.linalg.solve(
        centred.T @ centred + _PRIOR_MM2 * np.eye(3), centred.T @ (to_mm - aim) + _PRIOR_MM2 * np.eye(3)
    )
    affine = np.eye(4)
    affine[:3, :3] = axes.T
    affine[:3, 3] = aim - axes.T @ middle
    return affine


def _refined(
    affine: Float[np.ndarray, "4 4"], target: SignedDistance, reference: SignedDistance
) -> Float[np.ndarray, "4 4"]:
    """The affine map under which the two distances agree best at points near the target's wall.

    Gauss–Newton with a step that is halved until the sum of squares falls.
    """
    near = np.argwhere(np.abs(target.values_mm) < _NEAR_MM)
    chosen = near[np.random.default_rng(0).permutation(len(near))[:_AFFINE_POINTS]]
    points = target.origin_mm + target.spacing_mm * chosen
    wanted = target.values_mm[tuple(chosen.T)].astype(np.float64)
    middle = points.mean(axis=0)
    basis = np.concatenate([points - middle, np.full((len(points), 1), 20.0)], axis=1) / 20.0

    def mapped(change: Float[np.ndarray, "4 3"]) -> Float[np.ndarray, "n 3"]:
        return points @ affine[:3, :3].T + affine[:3, 3] + basis @ change

    def missed(at_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        return np.asarray(np.clip(reference(at_mm), -_FAR_MM, _FAR_MM) - wanted)

    change = np.zeros((4, 3))
    off = missed(mapped(change))
    for _ in range(_AFFINE_STEPS):
        at_mm = mapped(change)
        slope = reference.gradient(at_mm) * (np.abs(reference(at_mm)) < _FAR_MM)[:, None]
        jacobian = (basis[:, :, None] * slope[:, None, :]).reshape(len(points), 12)
        step = np.linalg.lstsq(jacobian.T @ jacobian, -jacobian.T @ off, rcond=None)[0].reshape(4, 3)
        for _ in range(6):
            tried = missed(mapped(change + step))
            if tried @ tried < off @ off:
                break
            step = step / 2
        else:
            break
        gained = 1 - (tried @ tried) / (off @ off)
        change, off = change + step, tried
        if gained < 1e-4:
            break
    refined = affine.copy()
    refined[:3, :3] += change[:3].T / 20.0
    refined[:3, 3] += change[3] - change[:3].T @ middle / 20.0
    return refined


def _displaced(
    affine: Float[np.ndarray, "4 4"], target: SignedDistance, reference: SignedDistance
) -> tuple[Float32[np.ndarray, "nx ny nz 3"], Float[np.ndarray, "3"]]:
    """The displacement of the target's points before the affine map, and the origin of its grid."""
    import SimpleITK as sitk

    origin, nodes = _nodes(target)
    shift = np.zeros(nodes.shape)
    for skipped, iterations in _LEVELS:
        coarse = nodes[::skipped, ::skipped, ::skipped]
        begun = _sampled(shift, origin, target.spacing_mm, coarse)
        fixed = np.clip(target(coarse), -_NEAR_MM, _NEAR_MM)
        moving = np.clip(reference(coarse @ affine[:3, :3].T + affine[:3, 3]), -_NEAR_MM, _NEAR_MM)
        demons = sitk.FastSymmetricForcesDemonsRegistrationFilter()
        demons.SetNumberOfIterations(iterations)
        demons.SetSmoothDisplacementField(True)
        demons.SetStandardDeviations(_SMOOTH_NODES)
        spacing_mm = skipped * target.spacing_mm
        found = demons.Execute(*(_image(values, origin, spacing_mm) for values in (fixed, moving, begun)))
        field = sitk.GetArrayFromImage(found).transpose(2, 1, 0, 3)
        shift = _sampled(field, origin, spacing_mm, nodes)
    return shift.astype(np.float32), origin


def _nodes(distance: SignedDistance) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "nx ny nz 3"]]:
    """A grid of the distance's spacing with some margin around it: its origin and its nodes in mm."""
    margin = round(_MARGIN_MM / distance.spacing_mm)
    origin = distance.origin_mm - margin * distance.spacing_mm
    axes = [origin[k] + distance.spacing_mm * np.arange(distance.values_mm.shape[k] + 2 * margin) for k in range(3)]
    return origin, np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _sampled(
    field: Float[np.ndarray, "nx ny nz 3"],
    origin_mm: Float[np.ndarray, "3"],
    spacing_mm: float,
    points_mm: Float[np.ndarray, "*n 3"],
) -> Float[np.ndarray, "*n 3"]:
    """A field of vectors between its nodes, and beyond them as at the nearest."""
    at = np.moveaxis((points_mm - origin_mm) / spacing_mm, -1, 0)
    return np.stack([map_coordinates(field[..., k], at, order=1, mode="nearest") for k in range(3)], axis=-1)


def _image(values: np.ndarray, origin_mm: Float[np.ndarray, "3"], spacing_mm: float) -> object:
    """A SimpleITK image of numbers (nx, ny, nz) or vectors (nx, ny, nz, 3)."""
    import SimpleITK as sitk

    is_vector = values.ndim == 4
    image = sitk.GetImageFromArray(
        np.ascontiguousarray(np.swapaxes(values, 0, 2), dtype=np.float64 if is_vector else np.float32),
        isVector=is_vector,
    )
    image.SetOrigin(origin_mm.tolist())
    image.SetSpacing((spacing_mm,) * 3)
    return image
