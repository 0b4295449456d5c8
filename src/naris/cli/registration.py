"""What is told of a registration, as data and as text."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from naris.cli.registered import SCHEMAS

if TYPE_CHECKING:
    from naris.cli.observed import Seen
    from naris.cli.register import Options
    from naris.core.anatomy import Anatomy
    from naris.core.results import Registration
    from naris.register.observation import Observation

_LOOSEST = 1e3  # mm or rad: a deviation that says only that nothing holds the pose
_FAR_OFF_SD = 3.0
_FITTED_DEG = 60.0, 100.0
"""Lenses so high may count as those of 80° that the probability was fitted on."""


def told(found: Registration, anatomy: Anatomy, seen: Observation, method: str) -> dict[str, Any]:
    """What is kept and answered, but for what a frame and a model add."""
    import numpy as np

    sd = np.sqrt(np.diag(found.covariance))
    loose = sd.max() > _LOOSEST
    return {
        "schema": SCHEMAS[0],
        "status": found.status,
        "method": method,
        "picture_alone": seen.by_network,
        "reason": found.reason,
        "anatomy": {"name": anatomy.name, "digest": anatomy.digest, "frame": anatomy.frame},
        "anatomy_T_camera": None if found.anatomy_T_camera is None else found.anatomy_T_camera.matrix.tolist(),
        "best_guess": found.best.matrix.tolist(),
        "probability": found.probability,
        **of_scale(found.scale, seen),
        "margin": None if not np.isfinite(found.margin) else found.margin,
        "cost": found.cost,
        "covariance": None if loose else found.covariance.tolist(),
        "sd_mm": None if loose else sd[:3].tolist(),
        "sd_deg": None if loose else np.rad2deg(sd[3:]).tolist(),
        "expected_tre_mm": None if loose or found.anatomy_T_camera is None else _expected(found, anatomy),
        "alternatives": found.alternatives.matrix.tolist(),
        "rays": len(seen.used()),
        "views": seen.views,
    }


def of_scale(factor: float, seen: Observation) -> dict[str, Any]:
    """The scale that was found, and how it lies to what was said of it."""
    import numpy as np

    scale = seen.scale
    off = (np.log(factor) - np.log(scale.factor)) / scale.sd_log if scale.kind == "prior" else None
    return {
        "scale": factor,
        "scale_kind": scale.kind,
        "scale_sought": [scale.low, scale.high] if scale.kind == "unknown" else None,
        "scale_off_sd": None if off is None else float(off),
        "median_mm": factor * float(np.median(seen.ranges)),
    }


def _expected(found: Registration, anatomy: Anatomy) -> dict[str, float]:
    """Expected target registration errors, by the name of the place."""
    import numpy as np

    from naris.core.targets import expected_errors_mm
    from naris.register.files import AHEAD, AHEAD_MM

    places = {AHEAD: found.best.position_mm + AHEAD_MM * found.best.forward, **anatomy.landmarks_mm}
    errors = expected_errors_mm(found.best, found.covariance, np.stack(list(places.values())))
    return dict(zip(places, errors.tolist(), strict=True))


def doubts(options: Options, seen: Seen) -> list[str]:
    """What was said and not checked, for whoever wonders why a pose is refused, or believes one."""
    said = []
    if options.cloud is not None and options.cloud.is_dir():
        said.append("the cameras and the poses of the reconstruction, and that it is not mirrored")
    elif options.cloud is not None:
        said.append("that the points are in the frame of the camera, and not mirrored")
    elif seen.estimate is None:
        said.append("the intrinsics, and that nothing is mirrored")
    if options.region is not None:
        said.append(f"that the camera is in {options.region}")
    if options.rig is not None:
        said.append("the poses of the cameras to each other")
    lines = [f"  taken for granted, check it: {'; '.join(said)}"] if said else []
    unfitted = seen.estimate is not None or options.shape_model is not None or options.modes is not None
    fov_deg = None if seen.intrinsics is None or unfitted else seen.intrinsics.vertical_fov_deg
    if fov_deg is not None and math.isfinite(fov_deg) and not _FITTED_DEG[0] <= fov_deg <= _FITTED_DEG[1]:
        lines.append(f"  of a lens that sees {fov_deg:.0f}° the probability is a guess: it was fitted on 80°")
    return lines


def text(data: dict[str, Any], doubts: list[str]) -> str:
    """The same for people."""
    from naris.register.files import AHEAD

    x, y, z = (row[3] for row in data["best_guess"][:3])
    where = f"({x:.1f}, {y:.1f}, {z:.1f}) mm in {data['anatomy']['frame']} of {data['anatomy']['name']}"
    notes = notes_on(data)
    kept = [f"  kept in {file}" for file in data.get("files", [])]
    if data["status"] == "refused":
        guess = f"  best guess near {where}, not to be used"
        return "\n".join([f"refused: {data['reason']}", guess, *notes, *doubts, *kept])
    unit = "times what the network says" if data["picture_alone"] else "mm per unit"
    scale = "" if data["scale_kind"] == "known" else f", scale {data['scale']:.3g} {unit}"
    lines = [
        f"registered: camera at {where}, probability {data['probability']:.2f} to be within 2 mm and 5°{scale}",
        *notes,
    ]
    if (expected := data["expected_tre_mm"]) is not None:
        marks = [error for place, error in expected.items() if place != AHEAD]
        there = f", {_mm(min(marks))} to {_mm(max(marks))} at the landmarks" if marks else ""
        lines.append(f"  expected target registration error: {_mm(expected[AHEAD])} {AHEAD}{there}")
    if data["picture_alone"]:
        lines.append("  taken for granted: that the picture is of this anatomy; one tells little, look at the overlay")
    if (edges := data["contours"]) is not None:
        lines.append(f"  by edges of the frame: {_by_edges(edges)}")
    if (shading := data["shading"]) is not None:
        moved = f"moved by {shading['moved_mm']:.2f} mm and {shading['moved_deg']:.1f}°"
        other = "not moved, it is not shaded as the walls there: see that it is the right one"
        lines.append(f"  by the shading of the frame: {moved if shading['used'] else other}")
    return "\n".join([*lines, *doubts, *kept])


def _by_edges(edges: dict[str, Any]) -> str:
    """Whether they moved the pose, and why not."""
    from naris.register.contour import FEWEST_EDGES

    beside = f"{edges['edges']} places on edges of walls have one beside them"
    if edges["used"]:
        return f"moved by {edges['moved_mm']:.2f} mm and {edges['moved_deg']:.1f}°, {beside}"
    before, after = edges["off_px_before"], edges["off_px_after"]
    if before is None or after is None or edges["edges"] < FEWEST_EDGES:
        return f"not moved, too few: {beside}"
    return (
        f"not moved: {beside}, and they would lie {after:.1f} instead of {before:.1f} px from them; look at the overlay"
    )


def notes_on(data: dict[str, Any]) -> list[str]:
    """What was odd, a line each: a strange frame, a scale far from its prior, another unit, a frame that is not LPS."""
    from naris.register.noise import ENDOSCOPIC_MM

    notes, off = [], data["scale_off_sd"]
    if data["model"] is not None and not data["model"]["used"]:
        notes.append("  the frame is unlike all that the model has seen: what it says of it was not used")
    by_network = data.get("picture_alone", False)
    if off is not None and abs(off) > _FAR_OFF_SD:
        what = "what the network says of distances would be to multiply" if by_network else "its scale is"
        whose = "of what it is sure of" if by_network else "from its prior: see which of them is right"
        notes.append(f"  {what} {'by ' if by_network else ''}{data['scale']:.3g}, {abs(off):.1f} deviations {whose}")
    low, high = ENDOSCOPIC_MM
    if data["scale_kind"] != "unknown" and not by_network and not low <= data["median_mm"] <= high:
        notes.append(
            f"  the median distance is {data['median_mm']:.3g} mm, where {low:g} to {high:g} are usual: check the unit"
        )
    if "files" in data and (frame := data["anatomy"]["frame"]) != "LPS":
        notes.append(f"  nothing for 3D Slicer: the anatomy is in the frame {frame}, and it shows LPS")
    return notes


def _mm(length: float) -> str:
    return "less than 0.1 mm" if length < 0.1 else f"{length:.1f} mm"
