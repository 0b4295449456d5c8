"""Several depth images with the poses of their cameras, as a JSON file lists them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose, stack
from naris.dataset.layout import intrinsics_from_json
from naris.errors import InputError, PoseError
from naris.register.files import DEVIATIONS, content_of, read_depth_image
from naris.register.noise import DepthNoise, Scale
from naris.register.observation import Observation, from_depth, together

_FEWEST, _MOST = 2, 16  # of more the smooth error of each would have next to no functions left
_KEYS = {"depth", "intrinsics", "first_T_camera"}
_SD = "depth_sd"
_SAME = 1e-6
_TODO = "see docs/registration.md"


@dataclass(frozen=True, eq=False)
class Rig:
    """What several cameras saw, and where they stood.

    Attributes:
        depths: z-depth of each.
        intrinsics: of each.
        first_T_camera: (V,) in the unit of the depths; the identity first.
        sds: standard deviation of each pixel of each depth, None where only the noise of all is known.
    """

    depths: tuple[Float[np.ndarray, "_ _"], ...]
    intrinsics: tuple[Intrinsics, ...]
    first_T_camera: Pose
    sds: tuple[Float[np.ndarray, "_ _"] | None, ...]

    def observed(self, noise: DepthNoise, scale: Scale) -> Observation:
        """All of it as one observation in the first camera.

        Raises:
            InputError: if a depth image is not of the size of its camera, or tells too little.
        """
        seen = zip(self.depths, self.intrinsics, self.sds, strict=True)
        return together([from_depth(d, i, noise, scale, sd) for d, i, sd in seen], self.first_T_camera)


def read_rig(path: Path, unit_mm: float) -> Rig:
    """The views of a JSON file: `{"views": [{"depth", "intrinsics", "first_T_camera"}, …]}`.

    Depth images lie beside the file, and those of their deviations, where a view names one as `depth_sd`. `intrinsics`
    may stand once, beside `views`. Matrices are 4 × 4, row by row, their translations in mm, or in the unit of the
    depths (after `unit_mm`) where its scale is not known.

    Raises:
        InputError: if the file, or a depth image that it names, is not there or holds something else.
    """
    content = content_of(path, (".json",), "a list of views")
    try:
        told = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InputError(f"views in JSON in {path.name}", "something else", _TODO) from error
    if not isinstance(told, dict):
        raise InputError(f'{{"views": […]}} in {path.name}', f"a {type(told).__name__}", _TODO)
    views = told.get("views")
    if not isinstance(views, list) or not _FEWEST <= len(views) <= _MOST:
        got = f"{len(views)}" if isinstance(views, list) else "none"
        raise InputError(f"{_FEWEST} to {_MOST} views in {path.name}", got, "list those that differ most")
    whole = [_whole(view, told, f"view {number} of {path.name}") for number, view in enumerate(views, 1)]
    poses = stack([pose for _, _, _, pose in whole])
    if np.abs(poses.matrix[0] - np.eye(4)).max() > _SAME:
        raise InputError(
            f"the identity as first_T_camera of view 1 of {path.name}",
            "another pose",
            "tell all poses in the first camera",
        )
    depths = tuple(read_depth_image(path.parent / depth, unit_mm) for depth, _, _, _ in whole)
    sds = tuple(
        None if sd is None else read_depth_image(path.parent / sd, unit_mm, DEVIATIONS) for _, sd, _, _ in whole
    )
    return Rig(depths, tuple(intrinsics for _, _, intrinsics, _ in whole), poses, sds)


def depths_of(path: Path) -> list[Path]:
    """The files that the views of a JSON file name, of one that `read_rig` has read."""
    views = json.loads(path.read_bytes())["views"]
    return [path.parent / view[key] for view in views for key in ("depth", _SD) if key in view]


def _whole(view: Any, told: dict[str, Any], where: str) -> tuple[str, str | None, Intrinsics, Pose]:
    """Depth, its deviations, camera and pose of one view."""
    shared = {key: told[key] for key in ("intrinsics",) if key in told}
    both = shared | view if isinstance(view, dict) else {}
    names = isinstance(both.get("depth"), str) and isinstance(both.get(_SD, ""), str)
    if set(both) - {_SD} != _KEYS or not names or not isinstance(both["intrinsics"], dict):
        raise InputError(f"depth, intrinsics and first_T_camera of {where}", f"{sorted(both) or 'none'}", _TODO)
    try:
        intrinsics = intrinsics_from_json(both["intrinsics"])
        matrix = np.array(both["first_T_camera"], dtype=np.float64)
        if matrix.shape != (4, 4):
            raise ValueError(f"{matrix.shape}")
        return both["depth"], both.get(_SD), intrinsics, Pose(matrix, CAMERA, CAMERA)
    except (ValueError, TypeError) as error:
        raise InputError(f"a 4×4 matrix as first_T_camera of {where}", "something else", _TODO) from error
    except PoseError as error:
        raise PoseError(f"{error.expected} as first_T_camera of {where}", error.got, error.todo) from error
    except InputError as error:
        raise InputError(f"a camera of {where}", error.got, _TODO) from error
