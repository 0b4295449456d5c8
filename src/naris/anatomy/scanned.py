"""From a segmented airway to an anatomy: a closed surface on the sub-voxel boundary, passages, landmarks, regions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int32

from naris.airway.segment import NASOPHARYNX, NOSE, Airway
from naris.airway.septum import Seam, seam_of
from naris.anatomy.checks import check_surface, faces_of_piece, pieces_of
from naris.anatomy.crossings import uncrossed
from naris.anatomy.distance import lumen_distance
from naris.anatomy.level_set import only_lumen, surface, taubin
from naris.anatomy.passages import find_passages
from naris.anatomy.regions import nasal_slabs
from naris.core.anatomy import Anatomy
from naris.core.volume import LPS
from naris.ct.scan import Finding
from naris.errors import InputError, ScanError

MOST_MOVED_MM = 0.3
"""Smoothing moves no vertex further than this from the boundary."""

_SOFT_HU = 300.0  # a level this far from the boundary is surely air or tissue
_STEPS, _PASS_BAND = 8, (0.50, -0.53)
_MANY_HANDLES = 8
_TOLD_MM2 = 2.0


@dataclass(frozen=True, eq=False)
class ScannedAnatomy:
    """An anatomy from a scan.

    Attributes:
        anatomy: in LPS, normals out of the air.
        genus: handles of the surface: tunnels through a septum or between a turbinate and the wall.
        moved_mm: (V,) how far smoothing took each vertex from the boundary.
        findings: of the segmentation and of the surface.
    """

    anatomy: Anatomy
    genus: int
    moved_mm: Float[np.ndarray, "v"]
    findings: tuple[Finding, ...]


def anatomy_of_airway(airway: Airway, name: str, source: str, *, attached: bool = False) -> ScannedAnatomy:
    """The nose that was found in a scan, as an anatomy, with the paper's four slabs from front to back as its regions.

    Where the air was cut (nostrils, pharynx, sinuses) the surface goes half-way between the nodes on either side.

    Args:
        airway: of `naris.airway.segment.segment_airway`.
        name: of the anatomy; nothing of the patient.
        source: where it came from.
        attached: keep sinuses and whatever else opens into the nose.

    Raises:
        ScanError: if the surface does not close to a manifold, or the landmarks do not tell how the nose lies.
        PoseError: if the nose is too narrow for passages.
    """
    kept = airway.labels > 0 if attached else np.isin(airway.labels, NOSE)
    seam = seam_of(airway.labels, airway.block.hu, NASOPHARYNX, airway.block.step_mm)
    field = only_lumen(_field(airway, kept & ~seam.wall))
    rough, faces = _largest_piece(*surface(field, airway.block.origin_mm, airway.block.step_mm))
    vertices, moved_mm = _smoothed(rough, faces)
    report = check_surface(vertices, faces)
    if not report.closed or report.genus is None:
        raise ScanError("a closed surface without edges of three faces", "another", "segment on a finer lattice")
    findings = [*airway.findings, *_about(seam)]
    if report.genus > _MANY_HANDLES:
        findings.append(
            Finding("many handles", f"{report.genus} tunnels through thin walls, some of them may be noise", "warning")
        )
    bare = Anatomy(vertices, faces, LPS, name, source, landmarks_mm=dict(airway.landmarks_mm))
    try:
        slabs = nasal_slabs(bare)
    except InputError as error:
        raise ScanError("nostrils and choanae that tell how the nose lies", "others", "segment it by hand") from error
    bare = bare.with_(regions={slabs.name: slabs})
    passages = find_passages(bare, lumen_distance(bare))
    return ScannedAnatomy(bare.with_(passages=passages), report.genus, moved_mm, tuple(findings))


def _about(seam: Seam) -> list[Finding]:
    """What a user should know of the septum."""
    found = []
    if seam.wall_mm2 >= _TOLD_MM2:
        text = f"the septum is fainter than tissue over {seam.wall_mm2:.0f} mm²; a wall was put where it goes on"
        found.append(Finding("faint septum", text, "warning"))
    if seam.hole_mm2 >= _TOLD_MM2:
        text = f"{seam.hole_mm2:.0f} mm² of clear air between the sides: a perforation, or a septum that the scan lost"
        found.append(Finding("open septum", text, "warning"))
    return found


def _field(airway: Airway, kept: Bool[np.ndarray, "nx ny nz"]) -> Float[np.ndarray, "nx ny nz"]:
    """1 in the kept air, −1 outside, 0 on the boundary; air that is not kept counts as tissue."""
    level = np.clip(airway.level.astype(np.float64) / _SOFT_HU, -1, 1)
    least = 1e-3  # never quite 0, where the surface would pass through a node
    inside = np.maximum(level, least)
    return np.where(kept, inside, -np.maximum(np.abs(level), least))


def _largest_piece(
    vertices: Float[np.ndarray, "v 3"], faces: Int32[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "w 3"], Int32[np.ndarray, "g 3"]]:
    piece = pieces_of(len(vertices), faces)
    most = int(np.bincount(piece[faces[:, 0]]).argmax())
    own = faces[faces_of_piece(faces, piece, most)]
    used, renumbered = np.unique(own, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3).astype(np.int32)


def _smoothed(
    rough: Float[np.ndarray, "v 3"], faces: Int32[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v"]]:
    """Smoothed vertices and how far each was moved, at most `MOST_MOVED_MM`; no face crosses another."""
    shift = taubin(rough, faces, _STEPS, _PASS_BAND) - rough
    moved = np.linalg.norm(shift, axis=1)
    shift *= np.minimum(1.0, MOST_MOVED_MM / np.maximum(moved, 1e-12))[:, None]
    vertices = uncrossed(rough, rough + shift, faces)
    return vertices, np.minimum(np.linalg.norm(vertices - rough, axis=1), MOST_MOVED_MM)
