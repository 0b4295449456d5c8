"""The built-in nose: parameters in, anatomy out."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
from scipy import ndimage

from naris.anatomy.builtin.extract import only_lumen, softened, surface, taubin
from naris.anatomy.builtin.field import grid_for, lumen_field
from naris.anatomy.builtin.landmarks import landmarks_mm
from naris.anatomy.builtin.layout import layout_of
from naris.anatomy.builtin.parameters import NoseParameters
from naris.anatomy.builtin.regions import anatomical_regions
from naris.anatomy.builtin.routes import routes
from naris.anatomy.distance import signed_distance
from naris.anatomy.passages import find_passages
from naris.anatomy.regions import paper_slabs
from naris.core.anatomy import Anatomy
from naris.errors import InputError

FRAME = "LPS"
NAME = "built-in nose"
RESOLUTION_MM = 0.65
_RESOLUTION_LIMITS_MM = (0.25, 1.0)
_PASSAGE_SPACING_MM = 1.0
_SMOOTHING_STEPS = 4
_PASS_BAND = (0.50, -0.53)


def built_in_nose(parameters: NoseParameters = NoseParameters(), *, resolution_mm: float = RESOLUTION_MM) -> Anatomy:
    """A decongested adult nose, both sides and the nasopharynx, as one closed surface.

    The same parameters and resolution give the same surface, bit for bit, on one machine.

    Args:
        parameters: lengths in mm and angles in degrees.
        resolution_mm: spacing of the grid that the implicit model is sampled on.

    Returns:
        An anatomy in the frame `LPS` (x to the patient's left, nasal floor at z = −18, tip of the nostrils at y = −45),
        with the region sets `paper` and `anatomical`, passages `left.septal`, `left.inferior`, `left.middle`,
        `left.superior` and the same of the right, and landmarks.

    Raises:
        InputError: if the resolution is out of range or the parameters do not make a nose.
    """
    low, high = _RESOLUTION_LIMITS_MM
    if not np.isfinite(resolution_mm) or not low <= resolution_mm <= high:
        raise InputError(f"a resolution between {low} and {high} mm", f"{resolution_mm}", "use about 0.6 mm")
    at = layout_of(parameters)
    grid = grid_for(parameters, at, resolution_mm)
    lumen = only_lumen(softened(lumen_field(parameters, at, grid), resolution_mm))
    vertices, faces = surface(lumen, grid)
    vertices = taubin(vertices, faces, _SMOOTHING_STEPS, _PASS_BAND)
    clearance = ndimage.distance_transform_edt(lumen > 0, sampling=resolution_mm).astype(np.float32)
    landmarks = landmarks_mm(parameters, at, clearance, grid)
    anatomy = Anatomy(
        vertices_mm=vertices,
        faces=faces,
        frame=FRAME,
        name=NAME,
        source=f"naris.anatomy.builtin at {resolution_mm:g} mm with {_told(parameters)}",
        regions={
            "paper": paper_slabs(FRAME),
            "anatomical": anatomical_regions(parameters, at, lumen, grid, FRAME),
        },
        landmarks_mm=landmarks,
    )
    distance = signed_distance(anatomy, _PASSAGE_SPACING_MM)
    return anatomy.with_(passages=find_passages(anatomy, distance, routes(landmarks)))


def _told(parameters: NoseParameters) -> str:
    """The parameters that differ from the default, or that none do."""
    default = asdict(NoseParameters())
    changed = [f"{name}={value:g}" for name, value in asdict(parameters).items() if value != default[name]]
    return ", ".join(changed) if changed else "default parameters"
