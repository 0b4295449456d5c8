"""Pictures of anything but the training's world, for a network to learn what it does not know.

Learning from some strangers helps to recognise others (D. Hendrycks et al., "Deep anomaly detection with outlier
exposure", ICLR 2019). These are drawn, not collected: leaves that cover each other (the statistics of natural
pictures: A. Lee et al. 2001), clouds of 1/f noise, pages of writing, plain walls, and the training's own pictures cut
up and shuffled.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import UInt8

_LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.,:;+-"
_TILES = 4


def strangers(
    n: int, size_px: int, familiar: UInt8[np.ndarray, "m s s 3"], rng: np.random.Generator
) -> UInt8[np.ndarray, "{n} {size_px} {size_px} 3"]:
    """`n` pictures of other things; some are shuffled pieces of the familiar ones."""
    out = np.empty((n, size_px, size_px, 3), np.uint8)
    for picture in out:
        kind = rng.integers(5)
        if kind == 0:
            picture[:] = _leaves(size_px, rng)
        elif kind == 1:
            picture[:] = _clouds(size_px, rng)
        elif kind == 2:
            picture[:] = _writing(size_px, rng)
        elif kind == 3:
            picture[:] = _wall(size_px, rng)
        else:
            picture[:] = _shuffled(familiar[int(rng.integers(len(familiar)))], size_px, rng)
    return out


def _leaves(size: int, rng: np.random.Generator) -> UInt8[np.ndarray, "{size} {size} 3"]:
    picture = np.empty((size, size, 3), np.uint8)
    picture[:] = rng.integers(0, 256, 3)
    for _ in range(int(rng.integers(8, 60))):
        radius = 2 + float(rng.pareto(1.5)) * size / 20
        place = rng.uniform(0, size, 2)
        corners = place + radius * _ring(int(rng.integers(3, 12)), rng)
        cv2.fillPoly(picture, [corners.astype(np.int32)], rng.integers(0, 256, 3).tolist(), cv2.LINE_AA)
    grain = rng.normal(0, rng.uniform(0, 12), picture.shape)
    return np.clip(picture + grain, 0, 255).astype(np.uint8)


def _ring(corners: int, rng: np.random.Generator) -> np.ndarray:
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    return rng.uniform(0.6, 1.4, (corners, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _clouds(size: int, rng: np.random.Generator) -> UInt8[np.ndarray, "{size} {size} 3"]:
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None])
    fall = np.maximum(frequency, 1 / size) ** -rng.uniform(0.0, 2.0)
    phases = np.exp(2j * np.pi * rng.random((3, *fall.shape)))
    mixed = phases[:1] + rng.uniform(0, 1) * phases
    waves = np.fft.irfft2(mixed * fall, s=(size, size)).transpose(1, 2, 0)
    waves = waves / max(float(waves.std()), 1e-9)
    return np.clip(rng.uniform(60, 200, 3) + rng.uniform(15, 60) * waves, 0, 255).astype(np.uint8)


def _writing(size: int, rng: np.random.Generator) -> UInt8[np.ndarray, "{size} {size} 3"]:
    paper, ink = rng.integers(150, 256, 3), rng.integers(0, 100, 3)
    if rng.random() < 0.3:
        paper, ink = ink, paper
    picture = np.empty((size, size, 3), np.uint8)
    picture[:] = paper
    scale = float(rng.uniform(0.25, 1.2))
    step = max(int(26 * scale), 6)
    for row in range(step, size + step, step):
        text = "".join(_LETTERS[i] for i in rng.integers(0, len(_LETTERS), 40))
        cv2.putText(picture, text, (int(rng.integers(-20, 20)), row), 0, scale, ink.tolist(), 1, cv2.LINE_AA)
    return picture


def _wall(size: int, rng: np.random.Generator) -> UInt8[np.ndarray, "{size} {size} 3"]:
    corners = (
        rng.uniform(0, 256, (2, 2, 3)) if rng.random() < 0.7 else np.tile(rng.uniform(0, 256, (1, 1, 3)), (2, 2, 1))
    )
    smooth = cv2.resize(corners.astype(np.float32), (size, size), interpolation=cv2.INTER_LINEAR)
    return np.clip(smooth + rng.normal(0, rng.uniform(0, 10), smooth.shape), 0, 255).astype(np.uint8)


def _shuffled(
    picture: UInt8[np.ndarray, "s s 3"], size: int, rng: np.random.Generator
) -> UInt8[np.ndarray, "{size} {size} 3"]:
    edge = size // _TILES
    tiles = [(i * edge, j * edge) for i in range(_TILES) for j in range(_TILES)]
    out = picture.copy()
    for (to_row, to_column), k in zip(tiles, rng.permutation(len(tiles)), strict=True):
        row, column = tiles[k]
        piece = np.rot90(picture[row : row + edge, column : column + edge], int(rng.integers(4)))
        out[to_row : to_row + edge, to_column : to_column + edge] = piece
    return out
