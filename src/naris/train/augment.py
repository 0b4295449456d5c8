# ruff: noqa: ANN001, ANN202
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The same view, seen a little differently: turned cameras, other light and tint, noise. Never mirrored.

A camera that turns about its centre sees the same rays at other pixels, so its new picture is a homography of the old
one (K Rᵀ K⁻¹) and its new pose is exactly known: `anatomy_T_camera · R`. The position, and with it the region, stays. A
zoom stands for another scope. Left and right nostrils mirror each other, so a flip would name the wrong side.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, UInt8
from numba import njit
from scipy.spatial.transform import Rotation

_COARSE, _FINE = 5, 23  # nodes of the smooth fields that imitate light and mucosa


@dataclass(frozen=True)
class Augmentation:
    """How far views are changed; every number is drawn anew for every picture.

    Attributes:
        turn_deg: standard deviation of the camera's turn about its x and y axes.
        roll_deg: of its turn about the optical axis.
        zoom: largest factor of the focal length, up and down, uniform in the logarithm.
        gain: brightness is multiplied by exp(normal · this).
        tint: each channel is multiplied by exp(normal · this).
        grey: largest share of colour that is taken away.
        gamma: the tone curve's exponent is exp(normal · this).
        shade: standard deviation of a smooth field that brightness is multiplied by (its logarithm).
        mottle: the same at a finer grain, like blotches of mucosa.
        noise: largest standard deviation of sensor noise, grey levels.
        blur: largest share of the neighbours in a 3×3 blur.
        still: share of pictures that are left as they are but for the resizing.
    """

    turn_deg: float = 0.0
    roll_deg: float = 0.0
    zoom: float = 1.0
    gain: float = 0.0
    tint: float = 0.0
    grey: float = 0.0
    gamma: float = 0.0
    shade: float = 0.0
    mottle: float = 0.0
    noise: float = 0.0
    blur: float = 0.0
    still: float = 0.0


FEW_PICTURES = Augmentation(
    turn_deg=5.0,
    roll_deg=8.0,
    zoom=1.25,
    gain=0.25,
    tint=0.08,
    grey=0.7,
    gamma=0.25,
    shade=0.35,
    mottle=0.12,
    noise=8.0,
    blur=0.8,
    still=0.05,
)
"""Strong: for a fixed set of a thousand pictures or so."""

SEEN_AGAIN = Augmentation(
    turn_deg=2.0, roll_deg=4.0, zoom=1.05, gain=0.1, gamma=0.1, shade=0.15, noise=3.0, blur=0.5, still=0.2
)
"""Slight: for rendered views that are shown a few times, and so that a resized picture reads like a rendered one."""


@dataclass(frozen=True, eq=False)
class _Draws:
    """The random numbers of B pictures."""

    turn: Float[np.ndarray, "b 3 3"]
    zoom: Float[np.ndarray, "b"]
    colour: Float32[np.ndarray, "b 3 3"]
    gamma: Float32[np.ndarray, "b"]
    coarse: Float32[np.ndarray, "b n n"]
    fine: Float32[np.ndarray, "b m m"]
    noise: Float32[np.ndarray, "b"]
    blur: Float32[np.ndarray, "b"]
    seed: np.ndarray


def augment(
    images: UInt8[np.ndarray, "b h w 3"],
    vertical_fov_deg: Float[np.ndarray, "b"],
    size_px: int,
    augmentation: Augmentation,
    rng: np.random.Generator,
) -> tuple[UInt8[np.ndarray, "b {size_px} {size_px} 3"], Float[np.ndarray, "b 3 3"]]:
    """Pictures of pinhole cameras with square pixels and a centred axis, changed and resized to a square.

    Returns:
        the pictures, and for each the rotation R of its new camera in the old one: the new pose is
        `anatomy_T_camera · R`.
    """
    draws = _draw(len(images), augmentation, rng)
    height, width = images.shape[1:3]
    focal = height / 2 / np.tan(np.deg2rad(vertical_fov_deg) / 2)
    maps = np.stack(
        [
            _map(draws.turn[i], float(focal[i]), (height, width), size_px, float(draws.zoom[i]))
            for i in range(len(images))
        ]
    ).astype(np.float32)
    out = np.empty((len(images), size_px, size_px, 3), np.uint8)

    def work(i: int) -> None:
        look = (draws.colour[i], draws.gamma[i], draws.coarse[i], draws.fine[i])
        sharp = _changed(np.ascontiguousarray(images[i]), maps[i], look, size_px)
        _finish(sharp, draws.noise[i], draws.blur[i], draws.seed[i], out[i])

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(work, range(len(images))))
    return out, draws.turn


def _draw(n: int, a: Augmentation, rng: np.random.Generator) -> _Draws:
    moves = rng.random(n) >= a.still
    angles = np.deg2rad([a.turn_deg, a.turn_deg, a.roll_deg]) * rng.standard_normal((n, 3)) * moves[:, None]
    zoom = np.exp(np.log(a.zoom) * rng.uniform(-1, 1, n) * moves)
    gain = np.exp(a.gain * rng.standard_normal((n, 1)) + a.tint * rng.standard_normal((n, 3))) ** moves[:, None]
    grey = a.grey * rng.random(n) ** 2 * moves
    colour = (1 - grey)[:, None, None] * np.eye(3) + grey[:, None, None] / 3
    return _Draws(
        Rotation.from_rotvec(angles).as_matrix(),
        zoom,
        (colour * gain[:, :, None]).astype(np.float32),
        np.exp(a.gamma * rng.standard_normal(n) * moves).astype(np.float32),
        np.exp(a.shade * rng.standard_normal((n, _COARSE, _COARSE)) * moves[:, None, None]).astype(np.float32),
        np.exp(a.mottle * rng.standard_normal((n, _FINE, _FINE)) * moves[:, None, None]).astype(np.float32),
        (a.noise * rng.random(n) * moves).astype(np.float32),
        (a.blur * rng.random(n) * moves).astype(np.float32),
        rng.integers(1, 2**31, n).astype(np.uint32),
    )


def _map(
    turn: Float[np.ndarray, "3 3"], focal_px: float, size: tuple[int, int], out_px: int, zoom: float
) -> Float[np.ndarray, "3 3"]:
    """Homogeneous pixels of the new picture to those of the old one."""
    height, width = size
    old = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
    new_focal = focal_px * zoom * out_px / min(size)
    middle = (out_px - 1) / 2
    back = np.array([[1 / new_focal, 0, -middle / new_focal], [0, 1 / new_focal, -middle / new_focal], [0, 0, 1]])
    return old @ turn @ back


@njit(nogil=True, cache=True)
def _field(nodes, u, v):
    """Bilinear between nodes; u and v from 0 to 1."""
    n = nodes.shape[0] - 1
    x, y = u * n, v * n
    i, j = min(int(x), n - 1), min(int(y), n - 1)
    x, y = x - i, y - j
    upper = nodes[j, i] * (1 - x) + nodes[j, i + 1] * x
    lower = nodes[j + 1, i] * (1 - x) + nodes[j + 1, i + 1] * x
    return upper * (1 - y) + lower * y


@njit(nogil=True, cache=True, error_model="numpy")
def _sample(image, x, y, pixel):
    """Bilinear, the edge repeated outside; values 0–255 into pixel."""
    height, width = image.shape[0], image.shape[1]
    x, y = min(max(x, np.float32(0)), np.float32(width - 1)), min(max(y, np.float32(0)), np.float32(height - 1))
    i, j = min(int(x), width - 2), min(int(y), height - 2)
    x, y = x - i, y - j
    for c in range(3):
        upper = image[j, i, c] * (1 - x) + image[j, i + 1, c] * x
        lower = image[j + 1, i, c] * (1 - x) + image[j + 1, i + 1, c] * x
        pixel[c] = upper * (1 - y) + lower * y


@njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def _changed(image, to_old, look, size):
    """One picture in its new place and light, as float32."""
    colour, gamma, coarse, fine = look
    tone = np.empty(257, np.float32)
    for level in range(257):
        tone[level] = 255 * (level / 256) ** gamma
    sharp = np.empty((size, size, 3), np.float32)
    pixel = np.empty(3, np.float32)
    for row in range(size):
        for column in range(size):
            scale = 1 / (to_old[2, 0] * column + to_old[2, 1] * row + to_old[2, 2])
            x = (to_old[0, 0] * column + to_old[0, 1] * row + to_old[0, 2]) * scale
            y = (to_old[1, 0] * column + to_old[1, 1] * row + to_old[1, 2]) * scale
            _sample(image, np.float32(x), np.float32(y), pixel)
            u, v = np.float32(column / (size - 1)), np.float32(row / (size - 1))
            bright = _field(coarse, u, v) * _field(fine, u, v)
            for c in range(3):
                value = colour[c, 0] * pixel[0] + colour[c, 1] * pixel[1] + colour[c, 2] * pixel[2]
                level = min(max(value * bright * np.float32(256 / 255), np.float32(0)), np.float32(255.99))
                below = int(level)
                sharp[row, column, c] = tone[below] + (tone[below + 1] - tone[below]) * (level - below)
    return sharp


@njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def _finish(sharp, noise, blur, seed, out):
    """Blur by a share of the four neighbours, then add noise (triangular, of that standard deviation)."""
    size = out.shape[0]
    near = blur / 8
    state = np.uint32(seed)
    amplitude = noise * np.float32(6**0.5 / 2**32)
    for row in range(size):
        above, below = max(row - 1, 0), min(row + 1, size - 1)
        for column in range(size):
            left, right = max(column - 1, 0), min(column + 1, size - 1)
            for c in range(3):
                around = sharp[above, column, c] + sharp[below, column, c] + sharp[row, left, c] + sharp[row, right, c]
                value = (1 - 4 * near) * sharp[row, column, c] + near * around
                state ^= (state << np.uint32(13)) & np.uint32(0xFFFFFFFF)
                state ^= state >> np.uint32(17)
                state ^= (state << np.uint32(5)) & np.uint32(0xFFFFFFFF)
                first = state
                state ^= (state << np.uint32(13)) & np.uint32(0xFFFFFFFF)
                state ^= state >> np.uint32(17)
                state ^= (state << np.uint32(5)) & np.uint32(0xFFFFFFFF)
                value += amplitude * (np.float32(first) - np.float32(state)) + np.float32(0.5)
                out[row, column, c] = np.uint8(min(max(value, np.float32(0)), np.float32(255)))
