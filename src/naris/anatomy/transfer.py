"""Regions for an anatomy that has none: carried over from others, each of which is brought to lie on it.

Where a region of one person ends in another is not written on the wall, so one reference is not asked alone: several
noses of other shapes are laid on the target (`naris.anatomy.correspondence`), and each votes for its own regions, the
more the better it fits, there and in all (fusion of several atlases by local weights: X. Artaechevarria et al., IEEE
Transactions on Medical Imaging 2009). A vote is soft: it goes to the regions around where a point came to lie, as far
as correspondences are wrong by. The share of the votes that a region gets is how sure the transfer is there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates

from naris.anatomy.builtin import NoseParameters, built_in_nose
from naris.anatomy.builtin.variation import drawn_parameters
from naris.anatomy.correspondence import correspond
from naris.anatomy.distance import SignedDistance, signed_distance
from naris.core.anatomy import NOWHERE, Anatomy, GridRegions, RegionSet
from naris.core.progress import SILENT, Progress
from naris.errors import InputError, RegionError

LIKELY, FITS_MM = 0.8, 1.5
"""A transfer is of use if it is right for so much of the lumen by its own estimate, and its best reference lies so
near."""

_SPACING_MM = 1.0
_BEYOND_MM = 1.8  # of the wall a label reaches, as a camera's position may be a little off
_ROOM_MM = 1.0  # of a camera to the wall
_OFF_MM, _ALONE_MM = 1.5, 2.5
"""How far correspondences are wrong by: what a vote is softened with. Several references show by their differences that
borders lie elsewhere in every nose; one alone does not, and would claim 15 % more than it gets right in the valve."""
_FIT_MM, _LOCAL_MM = 0.1, 0.3
_SEED = 20260


@dataclass(frozen=True, eq=False)
class Fit:
    """How a reference lies on the target.

    Attributes:
        name: of the reference.
        mean_mm, p95_mm: distance of the target's vertices from its surface.
        weight: its share of all votes.
    """

    name: str
    mean_mm: float
    p95_mm: float
    weight: float


@dataclass(frozen=True, eq=False)
class Transfer:
    """Regions on a target, and how sure they are.

    Attributes:
        regions: in the frame of the target, in its lumen and a little beyond.
        sure: (nx, ny, nz) on the grid of the regions: the share of the votes that the region got, 0 where none is.
        lumen: which nodes of that grid lie in the lumen.
        likely: mean share where a camera has room: how much of the lumen is expected to have its right region.
        fits: of the references.
    """

    regions: GridRegions
    sure: Float32[np.ndarray, "nx ny nz"]
    lumen: Bool[np.ndarray, "nx ny nz"]
    likely: float
    fits: tuple[Fit, ...]

    @property
    def usable(self) -> bool:
        """Whether it is as sure as `LIKELY` and some reference fits as `FITS_MM` says."""
        return self.likely >= LIKELY and min(fit.mean_mm for fit in self.fits) <= FITS_MM

    def sure_at(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """The share of the votes at points (..., 3); 0 outside of all regions."""
        grid = self.regions
        at = np.rint((np.asarray(points_mm) - grid.origin_mm) / grid.spacing_mm)
        inside = ((at >= 0) & (at < self.sure.shape)).all(axis=-1)
        nearest = tuple(np.moveaxis(np.where(inside[..., None], at, 0).astype(np.intp), -1, 0))
        return np.where(inside, self.sure[nearest], 0.0).astype(np.float64)


def transfer_regions(
    target: Anatomy, references: Sequence[Anatomy], regions: str | None = None, progress: Progress = SILENT
) -> Transfer:
    """Carry a region set of the references to a target (some seconds for each).

    Args:
        target: with the landmarks that `correspond` asks for.
        references: each with a region set of that name.
        regions: its name; None for the first one of the first reference.
        progress: told of every reference.

    Raises:
        InputError: if there is no reference, or one cannot be laid on the target.
        RegionError: if a reference has no such region set, or one with other names.
    """
    if not references:
        raise InputError("a reference or more", "none", "give one")
    chosen = regions or references[0].region_set().name
    sets = [one.region_set(chosen) for one in references]
    names = sets[0].names
    off_mm = _OFF_MM if len(references) > 1 else _ALONE_MM
    if any(one.names != names for one in sets):
        raise RegionError(f"references with the same regions {', '.join(names)}", "others", "give those of one kind")
    distance = signed_distance(target, _SPACING_MM)
    near = np.argwhere(distance.values_mm > -_BEYOND_MM)
    points = distance.origin_mm + distance.spacing_mm * near
    clearance = distance.values_mm[tuple(near.T)]
    votes = np.zeros((len(points), len(names)))
    fits: list[tuple[str, float, float, float]] = []
    with progress.task("references", len(references)) as advance:
        for reference, own in zip(references, sets, strict=True):
            found = correspond(target, reference)
            there = found(points)
            of_reference = signed_distance(reference, _SPACING_MM)
            mean_mm = float(found.residual_mm.mean())
            weight = np.exp(-mean_mm / _FIT_MM) / (_LOCAL_MM + np.abs(of_reference(there) - clearance))
            votes += weight[:, None] * _soft_labels(own, of_reference, there, off_mm)
            fits.append((reference.name, mean_mm, float(np.percentile(found.residual_mm, 95)), float(weight.sum())))
            advance(1)
    share = votes / votes.sum(axis=1, keepdims=True)
    labels = np.full(distance.values_mm.shape, NOWHERE, np.int8)
    sure = np.zeros(labels.shape, np.float32)
    labels[tuple(near.T)], sure[tuple(near.T)] = share.argmax(axis=1), share.max(axis=1)
    made = GridRegions(sets[0].name, names, target.frame, labels, distance.origin_mm, distance.spacing_mm)
    roomy = clearance > _ROOM_MM
    in_all = sum(one[3] for one in fits)
    return Transfer(
        made,
        sure,
        distance.values_mm > 0,
        float(share[roomy].max(axis=1).mean()) if roomy.any() else 0.0,
        tuple(Fit(name, mean, p95, weight / in_all) for name, mean, p95, weight in fits),
    )


def virtual_references(count: int) -> Iterator[Anatomy]:
    """Noses to carry the anatomical regions from, always the same: the built-in one, and others like it.

    They are drawn from the normal ranges, and come without passages. A draw that makes no nose is passed over.
    """
    number = made = 0
    while made < count:
        try:
            parameters = drawn_parameters(np.random.default_rng([_SEED, number]))
            nose = built_in_nose(parameters if made else NoseParameters(), passages=False)
        except InputError:
            number += 1
            continue
        anatomical = nose.region_set("anatomical")
        yield nose.with_(name=f"virtual nose {made}" if made else nose.name, regions={anatomical.name: anatomical})
        number, made = number + 1, made + 1


def _soft_labels(
    regions: RegionSet, distance: SignedDistance, points_mm: Float[np.ndarray, "n 3"], off_mm: float
) -> Float[np.ndarray, "n k"]:
    """The share of each region around points of the reference, weighted as a normal distribution of `off_mm`."""
    axes = [distance.origin_mm[k] + distance.spacing_mm * np.arange(n) for k, n in enumerate(distance.values_mm.shape)]
    label = _filled(regions.label(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)))
    at = ((points_mm - distance.origin_mm) / distance.spacing_mm).T
    shares = [
        map_coordinates(
            gaussian_filter((label == k).astype(np.float32), off_mm / distance.spacing_mm, mode="nearest"),
            at,
            order=1,
            mode="nearest",
        )
        for k in range(len(regions.names))
    ]
    return np.stack(shares, axis=1).astype(np.float64)


def _filled(label: Int[np.ndarray, "nx ny nz"]) -> Int[np.ndarray, "nx ny nz"]:
    """Labels everywhere: where there is none, that of the nearest node with one."""
    if not (label >= 0).any():
        raise RegionError("regions in the lumen of the reference", "none there", "check its region set")
    nearest = distance_transform_edt(label < 0, return_distances=False, return_indices=True)
    return label[tuple(nearest)]
