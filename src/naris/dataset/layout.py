"""How a data set lies on the disk: names of files, what `dataset.json` and a row of `samples.jsonl` hold.

dataset.json        schema, version, seed, anatomy, region set, intrinsics, views, appearance; no times, no paths
samples.jsonl       one row a sample; written last, so a folder without it is unfinished
images/000000.png   RGB, 8 bits
depth/000000.png    z-depth, 16 bits: value × scale = mm, 0 where invalid
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, UInt16

from naris.core.anatomy import RegionSet
from naris.core.camera import Brown, Fisheye, Intrinsics, Lens, Pinhole
from naris.core.provenance import digest
from naris.errors import DatasetError

SCHEMA = "naris.dataset/1"
ABOUT = "dataset.json"
SAMPLES = "samples.jsonl"
IMAGES = "images"
DEPTHS = "depth"
DEPTH_SCALE_MM = 0.005
"""One step of a depth picture; the deepest that fits is 327 mm."""

_LENSES: dict[str, type[Pinhole] | type[Brown] | type[Fisheye]] = {
    "pinhole": Pinhole,
    "brown": Brown,
    "fisheye": Fisheye,
}
_HUGE = 1e9  # no number of a camera; what is not finite is not below it either
_CAMERA_KEYS = {"width", "height", "fx", "fy", "cx", "cy", "lens"}


@dataclass(frozen=True, eq=False)
class RegionLabels:
    """What a data set keeps of a region set: enough to train and to judge, not to label new points.

    Attributes:
        name: of the region set.
        names: of its K regions, in the order of the labels.
        neighbours: (K, K) which regions touch.
        digest: of the whole region set, borders included, so that labels by other borders are told apart; None where
            the set is not known.
    """

    name: str
    names: tuple[str, ...]
    neighbours: Bool[np.ndarray, "k k"]
    digest: str | None = None

    @staticmethod
    def of(regions: RegionSet) -> RegionLabels:
        return RegionLabels(regions.name, tuple(regions.names), regions.neighbours, digest(regions))

    def to_json(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "names": list(self.names),
            "neighbours": self.neighbours.astype(int).tolist(),
            "digest": self.digest,
        }

    @staticmethod
    def from_json(content: dict[str, Any]) -> RegionLabels:
        """Raises KeyError, TypeError or ValueError where the content is not what `to_json` makes."""
        names, neighbours = tuple(content["names"]), np.array(content["neighbours"], dtype=bool)
        if neighbours.shape != (len(names), len(names)):
            raise ValueError(f"neighbours of shape {neighbours.shape} for {len(names)} regions")
        return RegionLabels(content["name"], names, neighbours, content.get("digest"))


def intrinsics_to_json(intrinsics: Intrinsics) -> dict[str, Any]:
    """Sizes, focal lengths and principal point in pixels, and the lens with its coefficients."""
    return asdict(intrinsics)


def intrinsics_from_json(content: dict[str, Any]) -> Intrinsics:
    """The reverse of `intrinsics_to_json`.

    Raises:
        DatasetError: if something is missing, more than needed or no number, or the lens is unknown.
        InputError: if the numbers make no camera.
    """
    todo = 'give a camera such as {"width": 640, …, "lens": {"kind": "pinhole"}}'
    if not isinstance(content, dict) or not isinstance(content.get("lens", {}), dict):
        what = f"the lens {content['lens']!r:.40}" if isinstance(content, dict) else "something else"
        raise DatasetError("intrinsics and their lens as objects", what, todo)
    lacks, more = sorted(_CAMERA_KEYS - set(content)), sorted(set(content) - _CAMERA_KEYS)
    if lacks or more:
        got = [*([f"none of {', '.join(lacks)}"] if lacks else []), *([f"also {', '.join(more)}"] if more else [])]
        raise DatasetError(f"intrinsics with {', '.join(sorted(_CAMERA_KEYS))}", " and ".join(got), todo)
    fields = dict(content)
    lens = dict(fields.pop("lens"))
    kind = str(lens.get("kind"))
    if kind not in _LENSES:
        raise DatasetError(f"a lens of the kind {', '.join(_LENSES)}", f"{kind!r}", todo)
    for name, number in {**fields, **lens, "kind": 0}.items():
        whole = name in ("width", "height")
        is_number = isinstance(number, (int, float)) and not isinstance(number, bool) and abs(number) < _HUGE
        if not is_number or (whole and number != int(number)):
            what = "a whole number" if whole else "a number"
            raise DatasetError(f"{what} for {name} of the intrinsics", f"{number!r}", "correct it")
    try:
        made: Lens = _LENSES[kind](**lens)
    except TypeError as error:
        raise DatasetError(f"the numbers of a {kind} lens", f"{lens}", "correct them") from error
    return Intrinsics(**fields, lens=made)


def image_name(index: int) -> str:
    """Of a sample's picture, relative to the folder."""
    return f"{IMAGES}/{index:06d}.png"


def depth_name(index: int) -> str:
    """Of a sample's depth picture, relative to the folder."""
    return f"{DEPTHS}/{index:06d}.png"


def depth_to_steps(depth_mm: Float32[np.ndarray, "*n"], scale_mm: float = DEPTH_SCALE_MM) -> UInt16[np.ndarray, "*n"]:
    """Depth in whole steps, 0 where invalid.

    Raises:
        DatasetError: if a depth does not fit into 16 bits.
    """
    steps = np.rint(depth_mm * np.float32(1 / scale_mm))
    if steps.max(initial=0) > np.iinfo(np.uint16).max:
        raise DatasetError(
            f"depths below {scale_mm * np.iinfo(np.uint16).max:.0f} mm",
            f"{depth_mm.max():.0f} mm",
            "check the unit of the surface, or leave depth out",
        )
    # A wall nearer than half a step is still a wall.
    return np.where((depth_mm > 0) & (steps == 0), 1, steps).astype(np.uint16)
