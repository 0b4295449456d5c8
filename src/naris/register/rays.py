"""From observations to what the compiled code reads."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from naris.register.cloud import lattice_of, no_cloud
from naris.register.cloud_equations import Cloud
from naris.register.equations import (
    BLOCKS,
    CLOUD,
    MOST_UNKNOWNS,
    ON_RAY,
    RANGES,
    ROW,
    Memory,
    Model,
    Rays,
    Work,
    cast_alone,
)
from naris.register.observation import Observation
from naris.register.smooth import SmoothError, smooth_error
from naris.register.steps import Sight
from naris.render.fast import aligned
from naris.render.lanes import LANES
from naris.render.packets import PACKET_FIELDS, Embree, Packet
from naris.render.sources import OF_PACKETS, sources_of

if TYPE_CHECKING:
    from naris.register.map import RegistrationMap

MOST_SMOOTH = 54
REACH = 3.0  # how far outliers lie, in medians of the ranges


@dataclass(frozen=True, eq=False)
class Prepared:
    """An observation as the compiled code reads it.

    Attributes:
        rays: of the observation, or of the lattices beside a cloud.
        model: how likely they are.
        cloud: empty where rays are compared one by one.
        count: of what is compared, rays or points.
    """

    rays: Rays
    model: Model
    cloud: Cloud
    count: int


def prepared(at: RegistrationMap, observation: Observation, *, fine: bool, lattice: bool = True) -> Prepared:
    """The rays of an observation and how likely they are.

    Args:
        at: the anatomy.
        observation: what was seen.
        fine: estimate the smooth error with the pose, and compare points with all that is seen around them; else the
            smooth error counts as if every ray had its own, and points belong to the wall that their ray meets.
        lattice: for that, have the rays of a lattice; else those of the points, for others to compare.
    """
    has_field = fine and observation.smooth > 0
    if fine and observation.is_cloud and lattice:
        around = lattice_of(observation)
        ones = np.ones(len(around.directions))
        rays = rays_of(around.origins, around.directions, ones, ones, ones, None, around.view)
        return Prepared(rays, _model(at, observation, CLOUD, 0), around.cloud, len(observation))
    field = _fields(observation) if has_field else None
    left = observation.smooth if field is None else _left_out(observation, field)
    radial = np.hypot(observation.radial, left * observation.ranges)
    rays = rays_of(
        observation.origins,
        observation.directions,
        observation.ranges,
        radial,
        observation.isotropic,
        field,
        observation.view,
    )
    kind = ON_RAY if observation.is_cloud and not observation.scale.free else RANGES
    model = _model(at, observation, kind, 0 if field is None else len(field.precision))
    return Prepared(rays, model, no_cloud(), len(observation))


def _model(at: RegistrationMap, observation: Observation, kind: int, smooth: int) -> Model:
    scale = observation.scale
    return Model(
        kind,
        float(observation.outliers),
        REACH * float(np.median(observation.ranges)),
        int(scale.free),
        float(np.log(scale.factor)) if scale.kind == "prior" else 0.0,
        1 / scale.sd_log**2 if scale.kind == "prior" else 0.0,
        float(np.log(scale.low)) if scale.kind == "unknown" else -np.inf,
        float(np.log(scale.high)) if scale.kind == "unknown" else np.inf,
        at.inside,
        smooth,
    )


def rays_of(
    origins: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
    ranges: Float[np.ndarray, "n"],
    radial: Float[np.ndarray, "n"],
    isotropic: Float[np.ndarray, "n"],
    field: SmoothError | None = None,
    view: np.ndarray | None = None,
) -> Rays:
    """Rays in blocks of sixteen, each of one view and so of one origin."""
    edges = [0, len(ranges)] if view is None else [*np.flatnonzero(np.diff(view, prepend=-1)).tolist(), len(ranges)]
    source = np.concatenate([_in_sixteens(first, last) for first, last in pairwise(edges)])
    real, row = source >= 0, np.maximum(source, 0)
    valid = aligned(len(source), np.int32)
    valid[:] = np.where(real, -1, 0)

    def column(values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values[row], dtype=np.float32)

    x, y, z = (column(directions[:, k]) for k in range(3))
    count = 0 if field is None else len(field.precision)
    functions = np.zeros((len(ranges), LANES * max(-(-count // LANES), 1)))
    if field is not None:
        functions[:, :count] = field.functions
    return Rays(
        x,
        y,
        z,
        valid,
        np.ascontiguousarray(origins[row[::LANES]], dtype=np.float64),
        column(ranges),
        column(radial),
        column(isotropic),
        column(functions),
        np.ones(1) if field is None else np.ascontiguousarray(field.precision),
    )


def sight(at: RegistrationMap, seen: Prepared, *, scattered: bool = False) -> Sight:
    """All that one thread needs for the equations of an observation; `scattered` if its rays are few over the view."""
    embree = at.embree_scattered if scattered else at.embree
    return Sight(embree, seen.rays, seen.model, memory_for(seen.rays), seen.cloud, _sources())


def cast_rays(embree: Embree, rays: Rays, pose: Float[np.ndarray, "4 4"], scale: float, memory: Memory) -> None:
    """What the rays meet from a pose (`anatomy_T_rig`, origins times the scale), left in `memory` (`ranges_met`)."""
    cast_alone(_sources(), embree, rays, pose, scale, memory)


def memory_for(rays: Rays) -> Memory:
    """Working memory for one thread."""
    wide, narrow = aligned(PACKET_FIELDS * LANES, np.float32), aligned(PACKET_FIELDS * LANES, np.float32)
    again, part = aligned(LANES, np.int32), aligned(LANES, np.int32)
    packet = Packet(wide, wide.view(np.int32), narrow, narrow.view(np.int32), again, part)
    n = len(rays.x)
    rows = 16 * BLOCKS * ROW
    work = Work(*(aligned(size, np.float32) for size in (128, LANES, LANES, LANES, MOST_UNKNOWNS, rows, rows)))
    for array in work:
        array[:] = 0
    return Memory(packet, np.zeros((3, n), np.float32), np.zeros(n, np.float32), np.zeros((3, n), np.float32), work)


def ranges_met(rays: Rays, memory: Memory) -> Float[np.ndarray, "n"]:
    """How far away the wall is that each ray met (mm), after `cast_rays`; infinite where it left the anatomy.

    Such a ray has no normal.
    """
    real = rays.valid != 0
    return np.where(memory.normal[:, real].any(axis=0), np.abs(memory.hit[real]), np.inf)


def _in_sixteens(first: int, last: int) -> np.ndarray:
    """Row numbers, filled up with −1."""
    count = -(-(last - first) // LANES) * LANES
    rows = np.arange(first, first + count)
    return np.where(rows < last, rows, -1)


def _fields(observation: Observation) -> SmoothError:
    """That of each view, side by side."""
    most = MOST_SMOOTH // observation.views
    edges = [*np.flatnonzero(np.diff(observation.view, prepend=-1)).tolist(), len(observation)]
    parts = [
        _field_of(
            np.ascontiguousarray(observation.directions[a:b]).tobytes(), observation.smooth, observation.reach_deg, most
        )
        for a, b in pairwise(edges)
    ]
    functions = np.zeros((len(observation), sum(len(part.precision) for part in parts)))
    column = 0
    for part, (a, b) in zip(parts, pairwise(edges), strict=True):
        functions[a:b, column : column + len(part.precision)] = part.functions
        column += len(part.precision)
    return SmoothError(functions, np.concatenate([part.precision for part in parts]))


def _left_out(observation: Observation, field: SmoothError) -> Float[np.ndarray, "n"] | float:
    """The relative deviation that the few functions of each of several views leave out; noise of each ray by itself.

    Of a single view they leave hardly any, and an observation counts that as noise of its rays.
    """
    if observation.views == 1:
        return 0.0
    said = (np.square(field.functions) / field.precision).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(observation.smooth**2 - said, 0.0)))


@lru_cache(maxsize=8)
def _field_of(directions: bytes, sd: float, reach_deg: float, most: int) -> SmoothError:
    """Kept for the next picture of the same camera."""
    return smooth_error(np.frombuffer(directions, np.float64).reshape(-1, 3), sd, reach_deg, most)


@lru_cache(maxsize=1)
def _sources() -> np.ndarray:
    return sources_of("naris.register.equations", "naris.register.cloud_equations", "naris.register.steps", *OF_PACKETS)
