"""Where was this picture taken? Region with its probability and the camera's pose, or that it cannot be told."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven

if TYPE_CHECKING:
    from naris.core.results import Prediction
    from naris.locate import Doubt
    from naris.model.checkpoint import Checkpoint


@dataclass(frozen=True)
class Options:
    """Which pictures, by which model."""

    pictures: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="PICTURE…")]
    """PNG, JPEG, TIFF, BMP or WebP files of any size; the round picture of an endoscope on black is understood."""
    model: Annotated[Path, tyro.conf.arg(aliases=["-m"], metavar="MODEL")]
    """Weights made by naris train: the file, or the folder of the training."""
    intrinsics: Annotated[IfGiven[Path], tyro.conf.arg(metavar="FILE")] = None
    """Camera that took the pictures: JSON with width, height, fx, fy, cx, cy in pixels and the lens, as in the
    dataset.json of a data set; by default the angle of the training's pictures is assumed."""
    out_of_domain: float = 0.5
    """A picture that is further than this from those of the training (0–1) is not localised; 1 refuses none."""
    probability: float = 0.7
    """The most probable region must be at least so probable, or the picture is not localised."""
    threads: Annotated[IfGiven[int], tyro.conf.arg(metavar="N")] = None
    """Of the network; by default as many as the library likes."""


def run(options: Options, console: Console) -> int:
    """Tells where each picture was taken; 1 if none could be localised."""
    from naris.cli.cameras import read_intrinsics
    from naris.cli.models import open_model
    from naris.errors import InputError
    from naris.locate import Doubt, is_localised, locate

    if not options.pictures:
        raise InputError("one picture or more", "none", "name a picture file")
    doubt = Doubt(options.out_of_domain, options.probability)
    localizer = open_model(options.model)
    intrinsics = None if options.intrinsics is None else read_intrinsics(options.intrinsics)
    found = locate(options.pictures, localizer, intrinsics=intrinsics, threads=options.threads)
    told = [
        {"picture": str(path), "localised": is_localised(one, doubt), "why_not": _why_not(one, doubt), **_told(one)}
        for path, one in zip(options.pictures, found, strict=True)
    ]
    console.answer({"model": _model(localizer.checkpoint), "pictures": told}, "\n".join(map(_line, told)))
    return 0 if any(one["localised"] for one in told) else 1


def _model(checkpoint: Checkpoint) -> dict[str, Any]:
    subject = checkpoint.subject
    return {
        "network": checkpoint.network,
        "region_set": subject.regions.name,
        "regions": list(subject.regions.names),
        "anatomy": {"name": subject.anatomy, "digest": subject.anatomy_digest, "frame": subject.frame},
    }


def _why_not(prediction: Prediction, doubt: Doubt) -> str | None:
    from naris.locate import is_strange

    if is_strange(prediction, doubt):
        return "unlike the training's pictures"
    return "no region is likely enough" if prediction.probabilities.max() < doubt.probability else None


def _told(prediction: Prediction) -> dict[str, Any]:
    probabilities = prediction.probabilities.tolist()
    return {
        "region": prediction.region_name,
        "probability": probabilities[prediction.region],
        "probabilities": dict(zip(prediction.region_names, probabilities, strict=True)),
        "out_of_domain": prediction.out_of_domain,
        "hypotheses": _hypotheses(prediction),
    }


def _hypotheses(prediction: Prediction) -> list[dict[str, Any]]:
    """Poses `anatomy_T_camera`, best first; the spreads are standard deviations along the worst axis."""
    import numpy as np

    poses, weights, covariance = prediction.hypotheses, prediction.weights, prediction.covariance
    if poses is None or weights is None:
        return []
    told = [
        {"weight": float(weight), "frame": poses.target, "anatomy_T_camera": matrix.tolist()}
        for weight, matrix in zip(weights, poses.matrix, strict=True)
    ]
    if covariance is not None:
        for one, spread in zip(told, covariance, strict=True):
            one["sd_mm"] = float(np.sqrt(np.linalg.eigvalsh(spread[:3, :3]).max()))
            one["sd_deg"] = float(np.rad2deg(np.sqrt(np.linalg.eigvalsh(spread[3:, 3:]).max())))
    return told


def _line(told: dict[str, Any]) -> str:
    guess = f"{told['region']}, {100 * told['probability']:.0f} %"
    if not told["localised"]:
        return f"{told['picture']}: not localised, {told['why_not']} (best guess {guess})"
    if not told["hypotheses"]:
        judged = "" if told["out_of_domain"] is not None else " (this model cannot tell pictures of something else)"
        return f"{told['picture']}: {guess}{judged}"
    best = told["hypotheses"][0]
    x, y, z = (row[3] for row in best["anatomy_T_camera"][:3])
    spread = f" ± {best['sd_mm']:.1f} mm (SD)" if "sd_mm" in best else " mm"
    return f"{told['picture']}: {guess}; camera near ({x:.1f}, {y:.1f}, {z:.1f}){spread} in {best['frame']}"
