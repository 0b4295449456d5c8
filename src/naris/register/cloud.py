"""Points that are off in every direction, and the lattice of rays on which what a camera sees is compared with them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from naris.core.pose import Pose
from naris.register.cloud_equations import Cloud
from naris.register.observation import Observation
from naris.render.directions import upright
from naris.render.lanes import LANES

_APART_SD = 1.0  # from ray to ray, beside the noise of a point: sums of such normals are flat to a millionth
_LEAST_RAD, _MOST_RAD = np.deg2rad((0.9, 4.0))
_STEEP_RAD = np.deg2rad(85.0)  # from there on rows of one elevation are rings
_WITHIN_SD, _WITHIN_RAD = 3.2, np.deg2rad(30.0)  # a point's own ray may be so far away, and no further is looked


@dataclass(frozen=True, eq=False)
class Lattice:
    """Rays in rows of one elevation, each as long as a multiple of sixteen.

    Attributes:
        directions: (K, 3) unit, in the rig.
        origins: (K, 3) in the rig.
        view: (K,) the number of its view.
        cloud: the points, with their places on it.
    """

    directions: Float[np.ndarray, "k 3"]
    origins: Float[np.ndarray, "k 3"]
    view: Int[np.ndarray, "k"]
    cloud: Cloud


@dataclass(frozen=True, eq=False)
class _View:
    directions: Float[np.ndarray, "k 3"]
    solid: Float[np.ndarray, "k"]
    window: Int[np.ndarray, "n 4"]
    stride: int


def lattice_of(observation: Observation) -> Lattice:
    """A lattice for each view, as fine as its points are sure."""
    edges = [*np.flatnonzero(np.diff(observation.view, prepend=-1)).tolist(), len(observation)]
    views = [_view(observation, a, b) for a, b in pairwise(edges)]
    begins = np.cumsum([0, *(len(one.directions) for one in views)])
    counts = np.diff(edges)
    window = np.concatenate([one.window for one in views]).astype(np.int64)
    view = np.repeat(np.arange(len(views)), np.diff(begins))
    origins = observation.origins[edges[:-1]][view]
    points = observation.directions * observation.ranges[:, None]
    cloud = Cloud(
        np.ascontiguousarray(points.T, dtype=np.float32),
        observation.ranges.astype(np.float32),
        observation.isotropic.astype(np.float32),
        window,
        np.repeat(begins[:-1], counts),
        np.repeat([one.stride for one in views], counts).astype(np.int64),
        np.concatenate([one.solid for one in views]).astype(np.float32),
        np.ascontiguousarray(origins, dtype=np.float32),
        int(((window[:, 1] - window[:, 0]) * (window[:, 3] - window[:, 2])).max()),
    )
    return Lattice(np.concatenate([one.directions for one in views]), origins, view, cloud)


def no_cloud() -> Cloud:
    """For rays that are compared one by one."""
    none, counts = np.zeros(0, np.float32), np.zeros(0, np.int64)
    return Cloud(
        np.zeros((3, 0), np.float32), none, none, np.zeros((0, 4), np.int64), counts, counts, none,
        np.zeros((0, 3), np.float32), 0,
    )  # fmt: skip


def _view(observation: Observation, first: int, last: int) -> _View:
    """The lattice of one view: even in azimuth and elevation about the middle of what it saw."""
    ways, sd = observation.directions[first:last], observation.isotropic[first:last] / observation.ranges[first:last]
    apart = float(np.clip(_APART_SD * np.median(sd), _LEAST_RAD, _MOST_RAD))
    ahead = ways.mean(axis=0)
    turn = Pose.look(np.zeros((1, 3)), ahead[None], upright(ahead[None]), "rig").rotation[0]
    x, y, z = (ways @ turn).T
    azimuth, elevation = np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))
    reach = np.minimum(np.arcsin(np.minimum(_WITHIN_SD * np.maximum(sd, 0.5 * apart), 1.0)), _WITHIN_RAD)
    beside = reach / np.maximum(np.cos(elevation), 0.3)
    low_a, low_e = float((azimuth - beside).min()), max(float((elevation - reach).min()), -_STEEP_RAD)
    high_e = min(float((elevation + reach).max()), _STEEP_RAD)
    columns = int(np.ceil(((azimuth + beside).max() - low_a) / apart)) + 1
    rows, stride = int(np.ceil((high_e - low_e) / apart)), -(-columns // LANES) * LANES
    a, e = low_a + apart * np.arange(stride), low_e + apart * np.arange(rows)
    window = np.stack(
        [
            np.floor((elevation - reach - low_e) / apart),
            np.ceil((elevation + reach - low_e) / apart) + 1,
            np.floor((azimuth - beside - low_a) / apart),
            np.ceil((azimuth + beside - low_a) / apart) + 1,
        ],
        axis=1,
    )
    window = np.clip(window, 0, [rows, rows, columns, columns]).astype(np.int64)
    whole = -(-(window[:, 3] - window[:, 2]) // LANES) * LANES
    window[:, 2] = np.minimum(window[:, 2], stride - whole)
    window[:, 3] = window[:, 2] + whole
    lattice = np.stack(np.broadcast_arrays(
        np.cos(e)[:, None] * np.sin(a), np.sin(e)[:, None], np.cos(e)[:, None] * np.cos(a)
    ), axis=-1).reshape(-1, 3)  # fmt: skip
    return _View(lattice @ turn.T, np.repeat(apart**2 * np.cos(e), stride), window, stride)
