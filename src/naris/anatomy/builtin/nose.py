"""The built-in nose: parameters in, anatomy out."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float, Int32
from scipy import ndimage

from naris.anatomy.builtin.field import grid_for, lumen_field
from naris.anatomy.builtin.implicit import Grid
from naris.anatomy.builtin.landmarks import landmarks_mm
from naris.anatomy.builtin.layout import Layout, layout_of
from naris.anatomy.builtin.parameters import NoseParameters
from naris.anatomy.builtin.regions import anatomical_regions
from naris.anatomy.builtin.routes import routes
from naris.anatomy.builtin.variants import Alteration, altered, told
from naris.anatomy.crossings import uncrossed
from naris.anatomy.distance import signed_distance
from naris.anatomy.handles import without_small_handles
from naris.anatomy.level_set import only_lumen, softened, surface, taubin
from naris.anatomy.passages import find_passages
from naris.anatomy.regions import paper_slabs
from naris.core.anatomy import Anatomy, Passage
from naris.errors import InputError, PoseError

FRAME = "LPS"
NAME = "built-in nose"
RESOLUTION_MM = 0.65
_RESOLUTION_LIMITS_MM = (0.25, 1.0)
_PASSAGE_SPACING_MM, _NARROW_SPACING_MM = 1.0, 0.5
_SMOOTHING_STEPS = 4
_PASS_BAND = (0.50, -0.53)


@dataclass(frozen=True, eq=False)
class Shape:
    """The bare shape of a built-in nose, before anything is named in it.

    Attributes:
        vertices_mm, faces: the closed surface, normals out of the lumen; no face crosses another.
        lumen: (nx, ny, nz) field on `grid`, positive in the air.
        at: where its parts lie.
    """

    vertices_mm: Float[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "f 3"]
    lumen: Float[np.ndarray, "nx ny nz"]
    grid: Grid
    at: Layout


def shape_of(
    parameters: NoseParameters, resolution_mm: float = RESOLUTION_MM, alterations: tuple[Alteration, ...] = ()
) -> Shape:
    """The surface that the parameters and alterations make, on a grid of that spacing.

    Raises:
        InputError: if the resolution is out of range or the parameters do not make a nose.
    """
    low, high = _RESOLUTION_LIMITS_MM
    if not np.isfinite(resolution_mm) or not low <= resolution_mm <= high:
        raise InputError(f"a resolution between {low} and {high} mm", f"{resolution_mm}", "use about 0.6 mm")
    at = layout_of(parameters)
    grid = grid_for(parameters, at, resolution_mm)
    field = altered(lumen_field(parameters, at, grid), grid, alterations)
    lumen = without_small_handles(only_lumen(softened(field, resolution_mm)), resolution_mm)
    vertices, faces = surface(lumen, grid.origin_mm, grid.spacing_mm)
    smoothed = uncrossed(vertices, taubin(vertices, faces, _SMOOTHING_STEPS, _PASS_BAND), faces)
    return Shape(smoothed, faces, lumen, grid, at)


def built_in_nose(
    parameters: NoseParameters = NoseParameters(),
    *,
    resolution_mm: float = RESOLUTION_MM,
    passages: bool = True,
    alterations: tuple[Alteration, ...] = (),
) -> Anatomy:
    """A decongested adult nose, both sides and the nasopharynx, as one closed surface.

    The same parameters and resolution give the same surface, bit for bit, on one machine.

    Args:
        parameters: lengths in mm and angles in degrees.
        resolution_mm: spacing of the grid that the implicit model is sampled on.
        passages: find them, which takes most of the time, and refuse a nose in which one is closed.
        alterations: tissue taken away or added (`naris.anatomy.builtin.variants`).

    Returns:
        An anatomy in the frame `LPS` (x to the patient's left, nasal floor at z = −18, tip of the nostrils at y = −45),
        with the region sets `paper` and `anatomical`, passages `left.septal`, `left.inferior`, `left.middle`,
        `left.superior` and the same of the right, and landmarks.

    Raises:
        InputError: if the resolution is out of range or the parameters do not make a nose.
    """
    shape = shape_of(parameters, resolution_mm, alterations)
    clearance = ndimage.distance_transform_edt(shape.lumen > 0, sampling=resolution_mm).astype(np.float32)
    anatomy = Anatomy(
        vertices_mm=shape.vertices_mm,
        faces=shape.faces,
        frame=FRAME,
        name=NAME,
        source=f"naris.anatomy.builtin at {resolution_mm:g} mm with {_told(parameters)}"
        + (f", altered by {told(alterations)}" if alterations else ""),
        regions={
            "paper": paper_slabs(FRAME),
            "anatomical": anatomical_regions(parameters, shape.at, shape.lumen, shape.grid, FRAME),
        },
        landmarks_mm=landmarks_mm(parameters, shape.at, clearance, shape.grid),
    )
    return anatomy.with_(passages=_passages(anatomy)) if passages else anatomy


def _passages(anatomy: Anatomy) -> tuple[Passage, ...]:
    """Along the routes of the built-in nose."""
    lumen = signed_distance(anatomy, _PASSAGE_SPACING_MM, tissue_to_mm=2 * _PASSAGE_SPACING_MM)
    try:
        return find_passages(anatomy, lumen, routes(anatomy.landmarks_mm), finer_mm=_NARROW_SPACING_MM)
    except PoseError as error:
        raise InputError("passages open from the nostrils to their ends", str(error), "widen the meatuses") from error


def _told(parameters: NoseParameters) -> str:
    """The parameters that differ from the default, or that none do."""
    default = asdict(NoseParameters())
    changed = [
        f"{name}={value if isinstance(value, int) else format(value, 'g')}"
        for name, value in asdict(parameters).items()
        if value != default[name]
    ]
    return ", ".join(changed) if changed else "default parameters"
