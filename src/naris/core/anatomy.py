"""An anatomy: a closed surface in mm with a named frame, regions and passages, and where it came from."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int, Int32

from naris.errors import RegionError, SurfaceError

NOWHERE = -1
"""The label of a point that lies in no region."""


@runtime_checkable
class RegionSet(Protocol):
    """A division of the lumen into named regions that a camera can be in.

    Implementations: `SlabRegions`, `GridRegions`. Labels are 0 … len(names) − 1, or `NOWHERE`.
    """

    @property
    def name(self) -> str: ...

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def frame(self) -> str: ...

    @property
    def neighbours(self) -> Bool[np.ndarray, "k k"]:
        """Which regions touch (symmetric, true on the diagonal)."""
        ...

    def label(self, points_mm: Float[np.ndarray, "*n 3"]) -> Int[np.ndarray, "*n"]:
        """The region of each point."""
        ...


@dataclass(frozen=True)
class SlabRegions:
    """Slabs across one axis: region i holds borders_mm[i−1] < x ≤ borders_mm[i], as in Sinha et al. 2018."""

    name: str
    names: tuple[str, ...]
    frame: str
    axis: int
    borders_mm: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.names) != len(self.borders_mm) + 1 or list(self.borders_mm) != sorted(set(self.borders_mm)):
            raise RegionError(
                "one more region name than rising borders",
                f"{len(self.names)} names and borders {self.borders_mm}",
                "list the borders from low to high",
            )

    @property
    def neighbours(self) -> Bool[np.ndarray, "k k"]:
        index = np.arange(len(self.names))
        return np.abs(index[:, None] - index[None, :]) <= 1

    def label(self, points_mm: Float[np.ndarray, "*n 3"]) -> Int[np.ndarray, "*n"]:
        coordinate = np.asarray(points_mm)[..., self.axis]
        return np.asarray(np.searchsorted(np.asarray(self.borders_mm), coordinate, side="left"))


@dataclass(frozen=True, eq=False)
class GridRegions:
    """Labels on a regular grid; the voxel nearest to a point tells its region.

    Attributes:
        labels: (nx, ny, nz) int8, `NOWHERE` outside.
        origin_mm: (3,) centre of voxel (0, 0, 0) in `frame`.
        spacing_mm: edge of a voxel.
    """

    name: str
    names: tuple[str, ...]
    frame: str
    labels: Int[np.ndarray, "nx ny nz"]
    origin_mm: Float[np.ndarray, "3"]
    spacing_mm: float

    @cached_property
    def neighbours(self) -> Bool[np.ndarray, "k k"]:
        k = len(self.names)
        touch = np.eye(k, dtype=bool)
        for axis in range(3):
            low = np.moveaxis(self.labels, axis, 0)[:-1].ravel()
            high = np.moveaxis(self.labels, axis, 0)[1:].ravel()
            both = (low >= 0) & (high >= 0)
            touch[low[both], high[both]] = True
        return touch | touch.T

    def label(self, points_mm: Float[np.ndarray, "*n 3"]) -> Int[np.ndarray, "*n"]:
        index = np.rint((np.asarray(points_mm) - self.origin_mm) / self.spacing_mm)
        inside = ((index >= 0) & (index < self.labels.shape)).all(axis=-1)
        i, j, k = np.moveaxis(np.where(inside[..., None], index, 0).astype(np.intp), -1, 0)
        return np.where(inside, self.labels[i, j, k].astype(np.intp), NOWHERE)


@dataclass(frozen=True, eq=False)
class Passage:
    """A centreline through the lumen, in order from outside to inside.

    Attributes:
        points_mm: (N, 3) about 0.5 mm apart.
        clearance_mm: (N,) distance to the nearest wall.
    """

    name: str
    points_mm: Float[np.ndarray, "n 3"]
    clearance_mm: Float[np.ndarray, "n"]

    @property
    def length_mm(self) -> float:
        return float(np.linalg.norm(np.diff(self.points_mm, axis=0), axis=1).sum())


@dataclass(frozen=True)
class Enclosed:
    """The closed surface encloses the air; its normals point into the tissue."""

    kind: Literal["enclosed"] = "enclosed"


@dataclass(frozen=True)
class Entrance:
    """A box around the place where the camera comes in, for a surface that lacks some of the walls there.

    Attributes:
        low_mm, high_mm: corners of the box in the frame of the anatomy.
        ball_mm: radius of the ball that ends the air in the box.
        room_mm: how far the camera may stand beyond that.
    """

    low_mm: tuple[float, float, float]
    high_mm: tuple[float, float, float]
    ball_mm: float = 40.0
    room_mm: float = 4.0


@dataclass(frozen=True)
class Between:
    """The closed surface encloses tissue and its normals point into the air, which lies between the walls.

    The air ends where a ball of radius `ball_mm` can come from outside without touching the surface.
    """

    ball_mm: float = 8.0
    entrance: Entrance | None = None
    kind: Literal["between"] = "between"


Airspace = Enclosed | Between
"""On which side of the surface the air is, and how far it goes."""
BEFORE_WALLS_MM = 0.4
"""So near to a wall there is air before it, and no other wall yet."""


@dataclass(frozen=True, eq=False)
class Anatomy:
    """A closed surface in mm, with what is known about it.

    Attributes:
        vertices_mm: (V, 3) float64 in `frame`.
        faces: (F, 3) int32, counter-clockwise seen from outside the closed surface.
        frame: `LPS`, or a name of its own such as `mean`.
        name: what people call it.
        source: where it came from (a file and its digest, or a generator and its parameters).
        regions: region sets by name.
        passages: centrelines by name.
        landmarks_mm: named points, each (3,).
        airspace: where the air is: enclosed by the surface, or between walls that the surface encloses.
    """

    vertices_mm: Float[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "f 3"]
    frame: str
    name: str
    source: str
    regions: dict[str, RegionSet] = field(default_factory=dict)
    passages: tuple[Passage, ...] = ()
    landmarks_mm: dict[str, Float[np.ndarray, "3"]] = field(default_factory=dict)
    airspace: Airspace = Enclosed()

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices_mm, dtype=np.float64)
        faces = np.ascontiguousarray(self.faces, dtype=np.int32)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
            raise SurfaceError(
                "vertices (V, 3) and faces (F, 3)", f"{vertices.shape} and {faces.shape}", "give a triangle mesh"
            )
        if not np.isfinite(vertices).all():
            raise SurfaceError("finite vertices", "NaN or infinity", "repair the surface")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise SurfaceError(
                f"face indices 0…{len(vertices) - 1}", f"{faces.min()}…{faces.max()}", "repair the surface"
            )
        for array, name in ((vertices, "vertices_mm"), (faces, "faces")):
            object.__setattr__(self, name, array.copy())
        self._protect()

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Arrays that come from another process could be written, and numba compiles anew for those."""
        self.__dict__.update(state)
        self._protect()

    def _protect(self) -> None:
        for array in (self.vertices_mm, self.faces):
            array.setflags(write=False)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of frame, air space, vertices and faces: two anatomies of one digest have the same lumen."""
        hasher = hashlib.sha256(self.frame.encode())
        if self.airspace != Enclosed():
            hasher.update(repr(self.airspace).encode())
        hasher.update(self.vertices_mm.tobytes())
        hasher.update(self.faces.tobytes())
        return hasher.hexdigest()

    @cached_property
    def vertex_normals(self) -> Float[np.ndarray, "v 3"]:
        """Unit normals, the mean of the adjoining faces weighted by their angle at the vertex."""
        a, b, c = (self.vertices_mm[self.faces[:, i]] for i in range(3))
        face_normal = _unit(np.cross(b - a, c - a))
        normals = np.zeros_like(self.vertices_mm)
        for corner, (p, q, r) in enumerate(((a, b, c), (b, c, a), (c, a, b))):
            angle = np.arccos(np.clip((_unit(q - p) * _unit(r - p)).sum(axis=1), -1, 1))
            np.add.at(normals, self.faces[:, corner], face_normal * angle[:, None])
        return _unit(normals)

    def before_walls_mm(self, away_mm: float = BEFORE_WALLS_MM) -> Float[np.ndarray, "v 3"]:
        """The air in front of each vertex, so far from it."""
        outwards = -1.0 if self.airspace.kind == "enclosed" else 1.0
        return self.vertices_mm + outwards * away_mm * self.vertex_normals

    @cached_property
    def bounds_mm(self) -> Float[np.ndarray, "2 3"]:
        return np.stack([self.vertices_mm.min(axis=0), self.vertices_mm.max(axis=0)])

    def region_set(self, name: str | None = None) -> RegionSet:
        """The set of that name, or the only (or first) one.

        Raises:
            RegionError: if there is none of that name.
        """
        if not self.regions:
            raise RegionError(f"an anatomy with regions ({self.name})", "one with none", "give it a region set")
        if name is None:
            return next(iter(self.regions.values()))
        if name not in self.regions:
            raise RegionError(
                f"one of the region sets {sorted(self.regions)} of {self.name}", repr(name), "name one of those"
            )
        return self.regions[name]

    def passage(self, name: str) -> Passage:
        for passage in self.passages:
            if passage.name == name:
                return passage
        raise RegionError(f"one of the passages {[p.name for p in self.passages]}", repr(name), "name one of those")

    def with_(self, **changes: object) -> Anatomy:
        """A copy with some attributes replaced."""
        return replace(self, **changes)  # type: ignore[arg-type]


def _unit(v: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    length = np.linalg.norm(v, axis=1, keepdims=True)
    return v / np.where(length > 0, length, 1.0)
