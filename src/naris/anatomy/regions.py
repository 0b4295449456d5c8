"""Region sets: the paper's slabs, the trivial set, region sets as JSON, and the regions of viewpoints."""

from __future__ import annotations

import base64
import binascii
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from naris.core.anatomy import Anatomy, GridRegions, RegionSet, SlabRegions
from naris.core.atomic import write_json
from naris.core.nasal_frame import NasalFrame
from naris.core.pose import Pose
from naris.errors import RegionError

SCHEMA = "naris.regions/1"
PAPER_BORDERS_MM = (-30.0, -15.0, 0.0)
PAPER_DEPTHS = (0.13, 0.35, 0.58)
"""Where those borders lie in a nose: shares of the way in, from the nostrils to the choanae."""
PAPER = "paper"
PAPER_NAMES = ("slab 1 (anterior)", "slab 2", "slab 3", "slab 4 (posterior)")
_AROUND_MM = 4.0
_MOST_VOXELS = 500_000_000


def paper_slabs(frame: str) -> SlabRegions:
    """The four slabs of Sinha et al. 2018 in a frame whose y runs from the nostril to the nasopharynx.

    y ≤ −30, −30 < y ≤ −15, −15 < y ≤ 0 and y > 0, in mm, of the camera's position.
    """
    return SlabRegions(PAPER, PAPER_NAMES, frame, axis=1, borders_mm=PAPER_BORDERS_MM)


PAPER_SLABS = paper_slabs("mean")


def whole(frame: str) -> SlabRegions:
    """The trivial region set: everything is one region."""
    return SlabRegions("whole", ("whole",), frame, axis=1, borders_mm=())


def even_slabs(anatomy: Anatomy, count: int = 4, axis: int = 1) -> SlabRegions:
    """Slabs of one thickness across the bounds of an anatomy (along y from front to back, if not told otherwise).

    Raises:
        RegionError: if there is less than one slab or no such axis.
    """
    if count < 1 or axis not in (0, 1, 2):
        raise RegionError("at least one slab across axis 0, 1 or 2", f"{count} across {axis}", "give other numbers")
    low, high = anatomy.bounds_mm[:, axis]
    borders = tuple(float(border) for border in np.linspace(low, high, count + 1)[1:-1])
    names = tuple(f"slab {number + 1}" for number in range(count))
    return SlabRegions("slabs", names, anatomy.frame, axis=axis, borders_mm=borders)


def nasal_slabs(anatomy: Anatomy) -> GridRegions:
    """The paper's four slabs in the coordinates of a nose (`NasalFrame`): borders at the same shares of its depth.

    Where the built-in nose has the paper's borders, at 13, 35 and 58 % of the way in from the nostrils to the choanae;
    on a grid of 1 mm around the anatomy.

    Raises:
        InputError: if the anatomy has not the landmarks for it.
    """
    nasal = NasalFrame.of(anatomy.landmarks_mm)
    origin = np.floor(anatomy.bounds_mm[0]) - _AROUND_MM
    shape = np.ceil(anatomy.bounds_mm[1] + _AROUND_MM - origin).astype(int) + 1
    nodes = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1) + origin
    borders = np.array(PAPER_DEPTHS) * nasal.depth_mm
    labels = np.searchsorted(borders, nasal.coordinates_mm(nodes)[..., 1], side="left").astype(np.int8)
    return GridRegions(PAPER, PAPER_NAMES, anatomy.frame, labels, origin, 1.0)


def region_of_viewpoints(regions: RegionSet, anatomy_T_camera: Pose) -> Int[np.ndarray, "*batch"]:
    """The region that each camera stands in (`NOWHERE` outside all of them).

    Raises:
        RegionError: if the poses and the regions are in different frames.
    """
    if anatomy_T_camera.target != regions.frame:
        raise RegionError(
            f"poses in the frame {regions.frame!r} of the region set {regions.name!r}",
            f"poses in {anatomy_T_camera.target!r}",
            "bring them to one frame",
        )
    return np.asarray(regions.label(anatomy_T_camera.position_mm))


def write_regions(regions: RegionSet, path: Path | str) -> None:
    """Writes a region set as JSON (`naris.regions/1`), atomically.

    Raises:
        RegionError: if it is neither slabs nor a grid.
        DiskFull: if there is no room.
    """
    write_json(Path(path), {"schema": SCHEMA, **regions_to_json(regions)})


def read_regions(path: Path | str) -> SlabRegions | GridRegions:
    """Reads what `write_regions` wrote, or a file made by hand:

    `{"schema": "naris.regions/1", "kind": "slabs", "name": "mine", "names": ["front", "back"], "frame": "LPS",
    "axis": 1, "borders_mm": [0]}`

    Raises:
        RegionError: if there is no such file or it is no region set.
    """
    path = Path(path)
    try:
        value = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        got = error.strerror if isinstance(error, OSError) else "something else"
        raise RegionError(f"a region set in JSON at {path}", got or "an error", "check the file") from error
    if not isinstance(value, dict) or value.get("schema") != SCHEMA:
        raise RegionError(f"the schema {SCHEMA} in {path.name}", _schema_of(value), "check the file")
    return regions_from_json(value)


def regions_to_json(regions: RegionSet) -> dict[str, Any]:
    """A region set as plain JSON values; the labels of a grid as zlib-compressed int16 (little endian, C order).

    Raises:
        RegionError: if it is neither slabs nor a grid.
    """
    common = {"name": regions.name, "names": list(regions.names), "frame": regions.frame}
    if isinstance(regions, SlabRegions):
        return {"kind": "slabs", **common, "axis": regions.axis, "borders_mm": list(regions.borders_mm)}
    if isinstance(regions, GridRegions):
        packed = zlib.compress(np.ascontiguousarray(regions.labels, dtype="<i2").tobytes(), 6)
        return {
            "kind": "grid",
            **common,
            "origin_mm": regions.origin_mm.tolist(),
            "spacing_mm": float(regions.spacing_mm),
            "shape": list(regions.labels.shape),
            "labels": base64.b64encode(packed).decode(),
        }
    raise RegionError("slabs or a grid of regions", type(regions).__name__, "turn it into a grid")


def regions_from_json(value: dict[str, Any]) -> SlabRegions | GridRegions:
    """The inverse of `regions_to_json`.

    Raises:
        RegionError: if something is missing or does not fit.
    """
    try:
        name, names, frame = str(value["name"]), tuple(str(one) for one in value["names"]), str(value["frame"])
        if value["kind"] == "slabs":
            axis, borders = int(value["axis"]), tuple(float(border) for border in value["borders_mm"])
            if axis not in (0, 1, 2):
                raise ValueError("axis")
            return SlabRegions(name, names, frame, axis, borders)
        if value["kind"] != "grid":
            raise ValueError("kind")
        origin = np.array([float(x) for x in value["origin_mm"]])
        labels = _labels(value, len(names))
        if origin.shape != (3,) or not float(value["spacing_mm"]) > 0:
            raise ValueError("origin_mm or spacing_mm")
        return GridRegions(name, names, frame, labels, origin, float(value["spacing_mm"]))
    except (KeyError, TypeError, ValueError, zlib.error, binascii.Error) as error:
        raise RegionError(
            f"a whole region set of schema {SCHEMA}", f"one with a wrong or missing {error}", "write it again"
        ) from error


def _labels(value: dict[str, Any], regions: int) -> Int[np.ndarray, "nx ny nz"]:
    nx, ny, nz = (int(n) for n in value["shape"])
    count = nx * ny * nz
    if min(nx, ny, nz) < 1 or count > _MOST_VOXELS:
        raise ValueError("shape")
    # Never more than the shape announces, however well the text is compressed.
    packed = zlib.decompressobj().decompress(base64.b64decode(value["labels"], validate=True), 2 * count + 1)
    if len(packed) != 2 * count:
        raise ValueError("labels")
    labels = np.frombuffer(packed, "<i2").reshape(nx, ny, nz)
    if labels.min() < -1 or labels.max() >= regions or regions > np.iinfo(np.int8).max:
        raise ValueError("labels")
    return labels.astype(np.int8)


def _schema_of(value: Any) -> str:
    return repr(value.get("schema")) if isinstance(value, dict) else "none"
