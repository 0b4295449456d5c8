"""What is fitted to a network after it has learned: the temperature of its word and the look of usual pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Int, UInt8

from naris.model.calibration import Calibration, fit_temperature, fit_usual
from naris.model.checkpoint import Checkpoint
from naris.model.localizer import Outputs, fitted, open_localizer, run
from naris.train.data import Examples, FixedLessons, Lessons, Stream, StreamLessons

_KEPT_FROM = 2**40
"""Batches of a stream from this number on are never learned from."""

_KEPT_PICTURES = 1024
_LEAST = 64


def calibrated(checkpoint: Checkpoint, lessons: Lessons, kept: Examples | None) -> Checkpoint:
    """The checkpoint with its calibration.

    A stream gives fresh views for it. A fixed set gives the trajectories that were kept apart; without any the
    temperature stays 1, and the training's pictures tell what is usual: half of them the shape, half the scale.
    """
    if isinstance(lessons, StreamLessons):
        images, region = fresh(lessons.stream, _KEPT_PICTURES)
        return _fitted_to(checkpoint, images, region, has_unseen=True)
    if not isinstance(lessons, FixedLessons):
        return checkpoint
    seen = lessons.examples
    if kept is None or len(kept) < _LEAST:
        return _fitted_to(checkpoint, seen.images, seen.region, has_unseen=False)
    known, unseen = _said(checkpoint, seen.images), _said(checkpoint, kept.images)
    usual = fit_usual(known.embedding, seen.region, unseen.embedding, unseen.domain_logit)
    return replace(checkpoint, calibration=Calibration(fit_temperature(unseen.logits, kept.region), len(kept), usual))


def fresh(stream: Stream, count: int, size: int = 64) -> tuple[UInt8[np.ndarray, "n h w 3"], Int[np.ndarray, "n"]]:
    """Views of a stream that no training sees."""
    batches = [stream.batch(_KEPT_FROM + i, size) for i in range(-(-count // size))]
    return np.concatenate([b.images for b in batches]), np.concatenate([b.region for b in batches])


def _fitted_to(
    checkpoint: Checkpoint, images: UInt8[np.ndarray, "n h w 3"], region: Int[np.ndarray, "n"], *, has_unseen: bool
) -> Checkpoint:
    """Means and covariance from the even pictures, scales from the odd ones, temperature (if unseen) from all."""
    said = _said(checkpoint, images)
    odd = None if said.domain_logit is None else said.domain_logit[1::2]
    usual = fit_usual(said.embedding[::2], region[::2], said.embedding[1::2], odd)
    temperature = fit_temperature(said.logits, region) if has_unseen else 1.0
    return replace(checkpoint, calibration=Calibration(temperature, len(images) if has_unseen else 0, usual))


def _said(checkpoint: Checkpoint, images: UInt8[np.ndarray, "n h w 3"]) -> Outputs:
    localizer = open_localizer(checkpoint)
    return run(localizer.network, fitted(images, localizer.input_px))
