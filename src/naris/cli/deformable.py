"""`naris register` with a shape model or modes: pose and shape of a patient without CT."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from naris.cli.registered import LOOSENESS, SCHEMAS, looks_of, write_registered
from naris.cli.registration import doubts, notes_on, of_scale
from naris.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from naris.cli.console import Console
    from naris.cli.observed import Seen
    from naris.cli.register import Options
    from naris.core.anatomy import Anatomy, RegionSet
    from naris.register.deformable.modes import Modes
    from naris.register.deformable.result import DeformableRegistration
    from naris.register.starts import Belief

REFUSED = 1


@dataclass(frozen=True, eq=False)
class Shaped:
    """What is known beside what was seen.

    Attributes:
        belief: of the pose.
        model: what a model said of the frame, if one was asked.
        ground: the picture that walls are drawn on, if there is one.
        regions: that a region is named of.
        made_from: of `made_from`.
    """

    belief: Belief
    model: dict[str, Any] | None
    ground: np.ndarray | None
    regions: RegionSet
    made_from: dict[str, Any]


def register_shape(options: Options, anatomy: Anatomy, seen: Seen, known: Shaped, console: Console) -> int:
    """Registers and tells pose and shape; exit status 1 where they are refused."""
    from naris.cli.anatomies import map_of
    from naris.register.deformable.register import DeformableConfig, register_deformable

    with console.progress.task("preparing the anatomy", 1) as advance:
        modes, at = _modes(options, anatomy), map_of(anatomy)
        advance(1)
    with console.progress.task("registering", 1) as advance:
        found = register_deformable(at, modes, seen.observation, known.belief, DeformableConfig(seed=options.seed))
        advance(1)
    if options.region is not None:
        from naris.register.named import unless_elsewhere

        found = unless_elsewhere(found, found.deformed.region_set(known.regions.name), options.region)
    data = _told(found, anatomy, seen) | {"model": known.model, "made_from": known.made_from}
    if options.out is not None:
        pose = found.anatomy_T_camera
        looks = looks_of(pose, found.deformed, seen, known.ground, flickers=options.frame is not None)
        shown = anatomy if pose is None else found.deformed
        data["files"] = write_registered(
            options.out, pose, shown, looks | _shape(found), data, deformed=pose is not None
        )
    console.answer(data, _text(data, doubts(options, seen)))
    return 0 if found.status == "registered" else REFUSED


def _modes(options: Options, anatomy: Anatomy) -> Modes:
    from naris.anatomy.gaussian_process import GaussianProcess
    from naris.anatomy.shape_model import MEAN, load_shape_model
    from naris.register.deformable.modes import MODES, of_gaussian_process, of_shape_model

    if options.shape_model is None:
        return of_gaussian_process(GaussianProcess.around(anatomy), options.modes or MODES)
    model = load_shape_model(options.shape_model)
    if model.mean.digest != anatomy.digest:
        mean = options.shape_model / MEAN
        raise InputError(f"the mean of the shape model, {mean}, as ANATOMY", anatomy.name, "give that folder")
    return of_shape_model(model, options.modes)


def _shape(found: DeformableRegistration) -> dict[str, bytes]:
    """How loose each vertex is; nothing of a shape that was refused."""
    import numpy as np

    if found.anatomy_T_camera is None:
        return {}
    kept = io.BytesIO()
    np.save(kept, found.vertex_sd_mm.astype(np.float32))
    return {LOOSENESS: kept.getvalue()}


def _told(found: DeformableRegistration, anatomy: Anatomy, seen: Seen) -> dict[str, Any]:
    import numpy as np

    pose, deformed = found.anatomy_T_camera, found.deformed
    sd = np.sqrt(np.diag(found.covariance))
    return {
        "schema": SCHEMAS[1],
        "status": found.status,
        "reason": found.reason,
        "anatomy": {"name": anatomy.name, "digest": anatomy.digest, "frame": anatomy.frame},
        "deformed": None if pose is None else {"name": deformed.name, "digest": deformed.digest},
        "anatomy_T_camera": None if pose is None else pose.matrix.tolist(),
        "best_guess": found.best.matrix.tolist(),
        **of_scale(found.scale, seen.observation),
        "scale_sd": found.scale_sd,
        "weights": found.weights.tolist(),
        "weight_sd": found.weight_sd.tolist(),
        "vertex_sd_mm": {"median": float(np.median(found.vertex_sd_mm)), "most": float(found.vertex_sd_mm.max())},
        "target_sd_mm": _finite(found.target_sd_mm),
        "turn_sd_deg": _finite(found.turn_sd_deg),
        "sd_mm": sd[:3].tolist(),
        "sd_deg": np.rad2deg(sd[3:]).tolist(),
        "covariance": found.covariance.tolist(),
        "residuals": {name: _finite(value) for name, value in vars(found.fit).items()},
        "margin": _finite(found.margin),
        "iterations": found.iterations,
        "converged": found.converged,
        "rays": len(seen.observation.used()),
        "views": seen.observation.views,
    }


def _finite(value: float) -> float | None:
    import numpy as np

    return value if np.isfinite(value) else None


def _text(data: dict[str, Any], doubts: list[str]) -> str:
    x, y, z = (row[3] for row in data["best_guess"][:3])
    where = f"({x:.1f}, {y:.1f}, {z:.1f}) mm in {data['anatomy']['frame']} of {data['anatomy']['name']}"
    kept = [f"  kept in {file}" for file in data.get("files", [])]
    if data["status"] == "refused":
        guess = f"  best guess near {where}, not to be used"
        return "\n".join([f"refused: {data['reason']}", guess, *notes_on(data), *doubts, *kept])
    told = sum(1 - min(sd, 1.0) ** 2 for sd in data["weight_sd"])  # what is left of doubt: 1 where nothing was seen
    scale = "" if data["scale_kind"] == "known" else f", scale {data['scale']:.3f} mm per unit"
    lines = [
        f"registered: camera at {where}, deformed{scale}",
        f"  walls in view known to {data['target_sd_mm']:.1f} mm and {data['turn_sd_deg']:.1f}°, points "
        f"{data['residuals']['median_mm']:.2f} mm off them; the view tells as much as {told:.0f} of "
        f"{len(data['weights'])} modes",
        "  these are standard deviations for patients like the model's, not a probability",
        *notes_on(data),
    ]
    return "\n".join([*lines, *doubts, *kept])
