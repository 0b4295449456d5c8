"""An anatomy prepared for registration: rays, distances, and places inside with what is seen from them all around."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from naris.anatomy.distance import SignedDistance, grid_shape, known_distance, signed_distance
from naris.core.anatomy import Anatomy, Between
from naris.core.kept import Kept
from naris.errors import SurfaceError
from naris.register.directions import texel_directions
from naris.register.map_file import MapArrays, map_file, read_map, write_map
from naris.register.rays import cast_rays, memory_for, ranges_met, rays_of
from naris.register.threads import spread
from naris.render.embree import ARGUMENTS, SCATTERED, PacketScene, library
from naris.render.geometry import geometry_of
from naris.render.packets import Embree

GRID_MM = 0.4
PLACES_MM = 1.5
ROOM_MM = 0.8
TEXELS = 32
"""Edge of the square that everything around a place is told on: about 6° a texel."""
_STEPS_PER_FACTOR = 40.0
_LEAST_MM = 0.25
_TISSUE_MM = 2 * GRID_MM
_SETTINGS = (GRID_MM, TEXELS, _STEPS_PER_FACTOR, _LEAST_MM, _TISSUE_MM)
_kept: Kept[RegistrationMap] = Kept(4)


@dataclass(frozen=True, eq=False)
class RegistrationMap:
    """Make it with `registration_map`.

    Attributes:
        anatomy: what is registered to.
        distance: to its walls, on a grid of 0.4 mm.
        places_mm: (P, 3) inside, one in each cube of 1.5 mm that has room for a camera.
        panoramas: (P, T) what is seen from each of them in all directions, as `quantised`.
        inward: (3,) unit, where the passages lead.
        embree: addresses for the compiled code; `scene` keeps them alive.
    """

    anatomy: Anatomy
    distance: SignedDistance
    places_mm: Float[np.ndarray, "p 3"]
    panoramas: UInt8[np.ndarray, "p t"]
    inward: Float[np.ndarray, "3"]
    embree: Embree
    scene: PacketScene

    @property
    def embree_scattered(self) -> Embree:
        """The same for few rays over a whole view."""
        return self.embree._replace(arguments=ctypes.addressof(SCATTERED))

    @property
    def inside(self) -> float:
        """The side of a wall that is seen from the lumen, as the kernels tell it."""
        return 1.0 if isinstance(self.anatomy.airspace, Between) else -1.0


def registration_map(
    anatomy: Anatomy, places_mm: float = PLACES_MM, room_mm: float = ROOM_MM, *, cache: Path | str | None = None
) -> RegistrationMap:
    """Prepare an anatomy (some seconds); the last few are kept, by the digest of the anatomy.

    Args:
        anatomy: what is to be registered to.
        places_mm, room_mm: how far places lie apart, and the room of a camera there.
        cache: a folder that keeps what takes the time for another process (`naris.register.map_file`); None for none.

    Raises:
        SurfaceError: if there is no room for a camera anywhere inside.
        EngineUnavailable: if rays cannot be shot on this machine.
    """
    folder = None if cache is None else Path(cache)
    kept = _kept.get((anatomy.digest, places_mm, room_mm), lambda: _made(anatomy, places_mm, room_mm, folder))
    # The digest is that of the lumen: regions and passages may be others.
    return kept if kept.anatomy is anatomy else replace(kept, anatomy=anatomy, inward=_inward(anatomy))


def quantised(ranges: Float[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n"]:
    """Logarithms of ranges (mm) in steps of 1/40, from 0.25 mm up."""
    steps = _STEPS_PER_FACTOR * np.log(np.maximum(ranges, 1e-6) / _LEAST_MM)
    return np.clip(np.rint(steps), 0, 255).astype(np.uint8)


def steps_of(factor: float) -> int:
    """How many steps of `quantised` a factor makes."""
    return round(_STEPS_PER_FACTOR * float(np.log(factor)))


def factor_of(steps: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """The logarithm of the factor that so many steps make."""
    return np.asarray(steps, dtype=np.float64) / _STEPS_PER_FACTOR


def _made(anatomy: Anatomy, places_mm: float, room_mm: float, cache: Path | None) -> RegistrationMap:
    geometry = geometry_of(anatomy)
    scene, found = PacketScene(geometry.vertices_mm, geometry.faces), library()
    embree = Embree(found.intersect, scene.address, ctypes.addressof(ARGUMENTS), found.width)
    file = None if cache is None else map_file(cache, anatomy.digest, (places_mm, room_mm, *_SETTINGS))
    known = None if file is None else read_map(file)
    if known is not None and known.distances_mm.shape == grid_shape(anatomy, GRID_MM):
        distance = known_distance(anatomy, GRID_MM, known.distances_mm)
        places, panoramas = known.places_mm, known.panoramas
    else:
        distance = signed_distance(anatomy, GRID_MM, tissue_to_mm=_TISSUE_MM)
        places = _places(distance, places_mm, room_mm)
        if not len(places):
            raise SurfaceError(
                f"an anatomy with {room_mm:g} mm of room for a camera",
                f"none inside {anatomy.name}",
                "check its unit, and on which side of the surface the air is",
            )
        panoramas = _panoramas(embree, places)
        if file is not None:
            write_map(file, MapArrays(distance.values_mm, places, panoramas))
    return RegistrationMap(anatomy, distance, places, panoramas, _inward(anatomy), embree, scene)


def _places(distance: SignedDistance, apart_mm: float, room_mm: float) -> Float[np.ndarray, "p 3"]:
    """The roomiest node of each cube of nodes, where it has the room."""
    step = max(round(apart_mm / distance.spacing_mm), 1)
    whole = [n // step * step for n in distance.values_mm.shape]
    nx, ny, nz = (n // step for n in whole)
    cubes = distance.values_mm[: whole[0], : whole[1], : whole[2]].reshape(nx, step, ny, step, nz, step)
    cubes = cubes.transpose(0, 2, 4, 1, 3, 5).reshape(nx, ny, nz, step**3)
    roomiest, cube = cubes.argmax(axis=-1), np.argwhere(cubes.max(axis=-1) > room_mm)
    inside = np.stack(np.unravel_index(roomiest[tuple(cube.T)], (step, step, step)), axis=1)
    return distance.origin_mm + distance.spacing_mm * (cube * step + inside)


def _panoramas(embree: Embree, places_mm: Float[np.ndarray, "p 3"]) -> UInt8[np.ndarray, "p t"]:
    directions = texel_directions(TEXELS)
    n = len(directions)
    rays = rays_of(np.zeros_like(directions), directions, np.ones(n), np.ones(n), np.ones(n))
    seen = np.zeros((len(places_mm), n), np.uint8)

    def look(first: int, last: int) -> None:
        memory, pose = memory_for(rays), np.eye(4)
        for k in range(first, last):
            pose[:3, 3] = places_mm[k]
            cast_rays(embree, rays, pose, 1.0, memory)
            seen[k] = quantised(ranges_met(rays, memory))

    spread(look, len(places_mm))
    return seen


def _inward(anatomy: Anatomy) -> Float[np.ndarray, "3"]:
    """Along the passages; straight back (+y) where there are none."""
    ways = [passage.points_mm[-1] - passage.points_mm[0] for passage in anatomy.passages]
    way = np.sum(ways, axis=0) if ways else np.array([0.0, 1.0, 0.0])
    length = float(np.linalg.norm(way))
    return np.asarray(way / length) if length > 1.0 else np.array([0.0, 1.0, 0.0])
