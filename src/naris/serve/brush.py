"""Regions that are painted: the borders of a region set moved by a brush, undone, and written as a set of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_dilation, generate_binary_structure
from scipy.ndimage import label as components_of

from naris.anatomy.distance import lumen_distance
from naris.anatomy.regions import write_regions
from naris.core.anatomy import NOWHERE, Anatomy, GridRegions, RegionSet
from naris.errors import InputError, RegionError

PAINTED = "painted"
_REACH_MM = 1.0  # into the tissue that regions are told: what a wall is asked for lies before it
_FAR_MM = 3.0  # from a voxel of air, a stroke paints nothing
_MOST_UNDO = 50
_VOXEL_MM, _MOST_VOXELS = 0.5, 20_000_000
_TOUCHING = generate_binary_structure(3, 3)


class Brush:
    """A region set on a fine grid, and what was painted on it.

    Of a grid nothing else changes. Slabs come to the grid of the distances of the anatomy, their borders to its voxels,
    and beyond it and deep in tissue there is no region. A stroke paints the air that can be reached from it within its
    radius, and not what lies behind a wall.
    """

    def __init__(self, anatomy: Anatomy, regions: RegionSet) -> None:
        distance = lumen_distance(anatomy)
        name = regions.name if regions.name.endswith(PAINTED) else f"{regions.name}-{PAINTED}"
        if isinstance(regions, GridRegions):
            self.regions = replace(_divided(regions), name=name)
            self._air = distance(_nodes(self.regions)) > 0
        else:
            nodes = np.stack(np.meshgrid(*distance.nodes_mm, indexing="ij"), axis=-1)
            labels = np.where(distance.values_mm > -_REACH_MM, regions.label(nodes), NOWHERE).astype(np.int8)
            grid = distance.origin_mm, distance.spacing_mm
            self.regions = GridRegions(name, tuple(regions.names), anatomy.frame, labels, *grid)
            self._air = distance.values_mm > 0
        self._saved: tuple[GridRegions, Path] | None = None
        self._before: list[tuple[Int[np.ndarray, "v"], Int[np.ndarray, "v"]]] = []

    def state(self, changed: int = 0, file: str = "") -> dict[str, Any]:
        """What the page is told beside the regions: voxels that changed, strokes that can be taken back, and a file."""
        return {"changed": changed, "undoable": len(self._before), "saved": self.is_saved, "file": file}

    @property
    def is_saved(self) -> bool:
        """Whether what is painted is in a file, or nothing is."""
        return not self._before if self._saved is None else self._is_as_saved

    @property
    def _is_as_saved(self) -> bool:
        return self._saved is not None and np.array_equal(self._saved[0].labels, self.regions.labels)

    def paint(self, number: int, radius_mm: float, points_mm: Sequence[Sequence[float]]) -> int:
        """One stroke: the region of that number around each of the points; gives how many voxels changed.

        Raises:
            RegionError: if there is no such region.
            InputError: if the points are no places.
        """
        if not 0 <= number < len(self.regions.names):
            raise RegionError(f"a region from 0 to {len(self.regions.names) - 1}", f"{number}", "choose one of those")
        points = np.array(points_mm, dtype=np.float64).reshape(-1, 3)
        if not np.isfinite(points).all():
            raise InputError("places in mm", "numbers that are not finite", "paint on the wall")
        before = self.regions.labels
        labels = before.copy()
        for point in points:
            self._dab(labels, number, radius_mm, point)
        changed = np.flatnonzero(labels != before)
        if len(changed):
            self._before = [*self._before[1 - _MOST_UNDO :], (changed, before.ravel()[changed])]
            self.regions = replace(self.regions, labels=labels)
        return len(changed)

    def undo(self, strokes: int) -> int:
        """Takes the last stroke back if there are so many; gives how many voxels changed.

        A request that is repeated because its answer was lost takes nothing more back.
        """
        if not self._before or strokes != len(self._before):
            return 0
        changed, were = self._before.pop()
        labels = self.regions.labels.copy()
        labels.ravel()[changed] = were
        self.regions = replace(self.regions, labels=labels)
        return len(changed)

    def save(self, folder: Path) -> Path:
        """Writes the set as `regions-1.json` in a folder, or with the next number that is free; once as it is.

        Raises:
            RegionError: if it cannot be written.
        """
        if self._saved is not None and self._is_as_saved and self._saved[1].exists():
            return self._saved[1]
        path = next(one for k in count(1) if not (one := folder / f"regions-{k}.json").exists())
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_regions(self.regions, path)
        except OSError as error:
            raise RegionError(
                f"to write {path.name}", f"{error.strerror}", "start naris steer with --keyframes in another folder"
            ) from error
        self._saved = self.regions, path
        return path

    def _dab(
        self, labels: Int[np.ndarray, "nx ny nz"], number: int, radius_mm: float, point: Float[np.ndarray, "3"]
    ) -> None:
        step, shape = self.regions.spacing_mm, np.array(labels.shape)
        at = (point - self.regions.origin_mm) / step
        low = np.clip(np.floor(at - radius_mm / step).astype(int), 0, shape)
        high = np.clip(np.ceil(at + radius_mm / step).astype(int) + 1, 0, shape)
        if (low >= high).any():
            return
        box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        axes = np.ogrid[box]
        off = step * np.sqrt(sum((axis - x) ** 2 for axis, x in zip(axes, at, strict=True)))
        ball: Bool[np.ndarray, "a b c"] = off <= radius_mm
        air = ball & self._air[box]
        if not air.any():
            return
        nearest = np.unravel_index(int(np.argmin(np.where(air, off, np.inf))), off.shape)
        if off[nearest] > _FAR_MM:
            return
        pieces, _ = components_of(air, _TOUCHING)
        # The wall has the region of the air before it: as deep as regions are told.
        depth = max(round(_REACH_MM / step), 1)
        around = binary_dilation(
            pieces == pieces[nearest], _TOUCHING, iterations=depth, mask=~(air & (pieces != pieces[nearest]))
        )
        labels[box][around & ball & (self._air[box] | (labels[box] != NOWHERE))] = number


def _divided(regions: GridRegions) -> GridRegions:
    """The same regions in voxels of half a millimetre, or so: each voxel in equal parts, so that no border moves."""
    parts = max(int(np.ceil(regions.spacing_mm / _VOXEL_MM - 1e-6)), 1)
    while parts > 1 and regions.labels.size * parts**3 > _MOST_VOXELS:
        parts -= 1
    labels = regions.labels
    for axis in range(3):
        labels = np.repeat(labels, parts, axis=axis)
    step = regions.spacing_mm / parts
    return replace(regions, labels=labels, origin_mm=regions.origin_mm - (parts - 1) / 2 * step, spacing_mm=step)


def _nodes(regions: GridRegions) -> Float[np.ndarray, "nx ny nz 3"]:
    axes = (o + regions.spacing_mm * np.arange(n) for o, n in zip(regions.origin_mm, regions.labels.shape, strict=True))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
