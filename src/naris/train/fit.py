"""What is fitted to a network after it has learned: how much its words count, and the look of usual pictures."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
from jaxtyping import Int, UInt8

from naris.errors import PoseError, RegionError
from naris.model.calibration import Calibration, Usual, fit_pool, fit_temperature, fit_usual
from naris.model.checkpoint import Checkpoint
from naris.model.localizer import Outputs, fitted, open_localizer, run, shares
from naris.train.data import Examples, FixedLessons, Lessons, Stream, StreamLessons

_KEPT_FROM = 2**40
"""Batches of a stream from this number on are never learned from."""

_KEPT_PICTURES = 1024
_LEAST = 64
"""Pictures to calibrate with: after a long training so many, after a short one no more than it learned from."""

_PER_POSITION = 4
_log = logging.getLogger(__name__)


def calibrated(checkpoint: Checkpoint, lessons: Lessons, kept: Examples | None, learned: int) -> Checkpoint:
    """The checkpoint with its calibration, after it learned from so many pictures.

    A stream gives new views for it, a fixed set the trajectories that were kept apart. Without any there is no honest
    calibration: a network knows its training pictures by heart, so their probabilities would say nothing, and every
    other picture would look strange beside them. The temperature then stays 1 and the domain head's word as it is.

    What is usual is found in views as the training's. How much the regions by the poses count is found in those of a
    steered camera: the training's lie anywhere with room and look anywhere, and so many of them show too little to
    tell a pose that it would seem worth less than it is to somebody who looks where the way goes.
    """
    if isinstance(lessons, StreamLessons):
        return _fitted_to(checkpoint, lessons.stream, min(max(learned, _LEAST), _KEPT_PICTURES))
    if not isinstance(lessons, FixedLessons) or kept is None or len(kept) < _LEAST:
        return checkpoint
    seen = lessons.examples
    known, unseen = _said(checkpoint, seen.images), _said(checkpoint, kept.images)
    usual = fit_usual(known.embedding, seen.region, unseen.embedding, unseen.domain_logit)
    return _with_calibration(checkpoint, unseen, kept.region, usual)


def fresh(stream: Stream, count: int, size: int = 16) -> tuple[UInt8[np.ndarray, "n h w 3"], Int[np.ndarray, "n"]]:
    """Views of a stream that no training sees, in small batches, as each is of one anatomy."""
    batches = [stream.batch(_KEPT_FROM + i, size) for i in range(-(-count // size))]
    return np.concatenate([b.images for b in batches]), np.concatenate([b.region for b in batches])


def _fitted_to(checkpoint: Checkpoint, stream: Stream, count: int) -> Checkpoint:
    """Means and covariance from the even ones of fresh views, scales from the odd ones."""
    images, region = fresh(stream, count)
    said = _said(checkpoint, images)
    odd = None if said.domain_logit is None else said.domain_logit[1::2]
    usual = fit_usual(said.embedding[::2], region[::2], said.embedding[1::2], odd)
    try:
        steered = stream.steered(count // 2 // _PER_POSITION, _PER_POSITION)
    except (RegionError, PoseError) as error:
        _log.info("calibrated on views of the training, as nobody can steer through its passages: %s", error)
        return _with_calibration(checkpoint, said, region, usual)
    return _with_calibration(checkpoint, _said(checkpoint, steered.images), steered.region, usual)


def _with_calibration(checkpoint: Checkpoint, said: Outputs, region: Int[np.ndarray, "n"], usual: Usual) -> Checkpoint:
    by_pose = shares(said, checkpoint.subject)
    if by_pose is None:
        temperature, power = fit_temperature(said.logits, region), 0.0
    else:
        temperature, power = fit_pool(said.logits, by_pose, region)
    return replace(checkpoint, calibration=Calibration(temperature, len(region), usual, power))


def _said(checkpoint: Checkpoint, images: UInt8[np.ndarray, "n h w 3"]) -> Outputs:
    localizer = open_localizer(checkpoint)
    return run(localizer.network, fitted(images, localizer.input_px))
