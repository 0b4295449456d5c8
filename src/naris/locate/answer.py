"""The answer for a picture, and when there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from naris.core.anatomy import RegionSet
from naris.core.camera import Intrinsics
from naris.core.pictures import check_array, read_picture
from naris.core.results import Prediction
from naris.locate.view import views_of
from naris.model.checkpoint import Checkpoint
from naris.model.localizer import Localizer, open_localizer


@dataclass(frozen=True)
class Doubt:
    """When the honest answer is `not localised`.

    Attributes:
        out_of_domain: a picture that scores this or more is not of the world that the network knows. Two scores
            count, the worse one: at 0.5 each refuses one in two hundred of the network's own pictures where it is
            calibrated, so both together up to one in a hundred.
        probability: the most probable region must be at least so probable. Where the probabilities are calibrated, at
            most three answers in ten are wrong just above the default, and far fewer on the whole.
    """

    out_of_domain: float = 0.5
    probability: float = 0.7


def locate(
    pictures: Sequence[Path | UInt8[np.ndarray, "_ _ 3"]],
    model: Path | Checkpoint | Localizer,
    *,
    regions: RegionSet | None = None,
    intrinsics: Intrinsics | None = None,
    threads: int | None = None,
) -> list[Prediction]:
    """What a model says about pictures, each by itself.

    Args:
        pictures: files of any common kind and size, or RGB arrays (H, W, 3) of uint8, H and W at least 16.
        model: a checkpoint file, or one that was opened.
        regions: if the model must name these.
        intrinsics: of the camera that took the pictures (for pictures of another size they are scaled). Without them
            the visible area of a picture is looked at as if it had the angle of the training's pictures; a round one is
            looked at in two ways (`naris.locate.view`), and the one that is more like the training's counts.
        threads: for torch meanwhile; None leaves its number.

    Raises:
        ImageError: if a file is no picture, is too small or too large, or has not the shape of the pictures that the
            intrinsics are for; nothing is answered for the others.
        CheckpointError: if the model cannot be read.
        RegionError: if it names other regions.
    """
    localizer = model if isinstance(model, Localizer) else open_localizer(model, regions=regions)
    made_for = localizer.checkpoint.subject.intrinsics
    views: list[UInt8[np.ndarray, "s s 3"]] = []
    owner: list[int] = []
    for number, picture in enumerate(pictures):
        image = check_array(picture) if isinstance(picture, np.ndarray) else read_picture(picture)
        found = views_of(image, localizer.input_px, made_for, intrinsics)
        views += found
        owner += [number] * len(found)
    if not views:
        return []
    answers: list[list[Prediction]] = [[] for _ in pictures]
    for number, prediction in zip(owner, localizer.predict(np.stack(views), threads), strict=True):
        answers[number].append(prediction)
    return [min(found, key=_strangeness) for found in answers]


def _strangeness(prediction: Prediction) -> tuple[float, float]:
    return prediction.out_of_domain or 0.0, -float(prediction.probabilities.max())


def is_localised(prediction: Prediction, doubt: Doubt = Doubt()) -> bool:
    """Whether the prediction is an answer: of a picture of a known kind, with a region that is likely enough."""
    return not is_strange(prediction, doubt) and float(prediction.probabilities.max()) >= doubt.probability


def is_strange(prediction: Prediction, doubt: Doubt = Doubt()) -> bool:
    """Whether the picture is not of the kind that the network knows; False where it does not judge."""
    return prediction.out_of_domain is not None and prediction.out_of_domain > doubt.out_of_domain
