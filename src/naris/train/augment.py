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
_TONES = 1024  # levels of the tone curve's table


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
    images: UInt8[np.ndarray, "b s s 3"],
    vertical_fov_deg: Float[np.ndarray, "b"],
    size_px: int,
    augmentation: Augmentation,
    rng: np.random.Generator,
    aspect: float = 1.0,
) -> tuple[UInt8[np.ndarray, "b {size_px} {size_px} 3"], Float[np.ndarray, "b 3 3"]]:
    """Square pictures of pinhole cameras with a centred axis, changed and resized.

    Args:
        images: as many pixels wide as high (`naris.model.localizer.squared`).
        vertical_fov_deg: of each.
        size_px: edge of the new pictures.
        augmentation: how far they are changed.
        rng: for the changes.
        aspect: fx / fy of the cameras, 1 where pixels are square.

    Returns:
        the pictures, and for each the rotation R of its new camera in the old one: the new pose is
        `anatomy_T_camera · R`.
    """
    draws = _draw(len(images), augmentation, rng)
    edge = images.shape[1]
    focal = edge / 2 / np.tan(np.deg2rad(vertical_fov_deg) / 2)
    maps = np.stack(
        [
            _map(draws.turn[i], np.array([float(focal[i]) * aspect, focal[i]]), edge, size_px, float(draws.zoom[i]))
            for i in range(len(images))
        ]
    ).astype(np.float32)
    out = np.empty((len(images), size_px, size_px, 3), np.uint8)

    def work(i: int) -> None:
        look = (draws.colour[i], draws.gamma[i], draws.coarse[i], draws.fine[i], augmentation.mottle > 0)
        sharp = _changed(np.ascontiguousarray(images[i]), maps[i], look, size_px)
        _finish(sharp, draws.noise[i], draws.blur[i], draws.seed[i], out[i].reshape(size_px, -1))

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
    turn: Float[np.ndarray, "3 3"], focal_px: Float[np.ndarray, "2"], edge_px: int, out_px: int, zoom: float
) -> Float[np.ndarray, "3 3"]:
    """Homogeneous pixels of the new picture to those of the old one; focal lengths across and down."""
    middle = (edge_px - 1) / 2
    old = np.array([[focal_px[0], 0, middle], [0, focal_px[1], middle], [0, 0, 1]])
    fx, fy = focal_px * zoom * out_px / edge_px
    middle = (out_px - 1) / 2
    back = np.array([[1 / fx, 0, -middle / fx], [0, 1 / fy, -middle / fy], [0, 0, 1]])
    return old @ turn @ back


@njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def _shade(nodes, v, bright):
    """Multiply a row of pixels by a smooth field, bilinear between nodes; v from 0 to 1 down the picture."""
    n, size = nodes.shape[0] - 1, bright.shape[0]
    j = min(int(v * n), n - 1)
    y = np.float32(v * n - j)
    row = np.empty(n + 1, np.float32)
    for i in range(n + 1):
        row[i] = nodes[j, i] + (nodes[j + 1, i] - nodes[j, i]) * y
    step = np.float32(n / (size - 1))
    for column in range(size):
        x = np.float32(column) * step
        i = min(int(x), n - 1)
        bright[column] *= row[i] + (row[i + 1] - row[i]) * (x - np.float32(i))


@njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def _place(to_old, row, limit, start, x, y):
    """Where a row of new pixels lies in the old picture: the upper left of four neighbours, and how far beyond it."""
    height, width = limit
    v = np.float32(row)
    for column in range(len(x)):
        u = np.float32(column)
        scale = np.float32(1) / (to_old[2, 0] * u + to_old[2, 1] * v + to_old[2, 2])
        old_x = (to_old[0, 0] * u + to_old[0, 1] * v + to_old[0, 2]) * scale
        old_y = (to_old[1, 0] * u + to_old[1, 1] * v + to_old[1, 2]) * scale
        old_x = min(max(old_x, np.float32(0)), np.float32(width - 1))
        old_y = min(max(old_y, np.float32(0)), np.float32(height - 1))
        i, j = min(np.int32(old_x), np.int32(width - 2)), min(np.int32(old_y), np.int32(height - 2))
        x[column], y[column] = old_x - np.float32(i), old_y - np.float32(j)
        start[column] = np.uint32(np.int32(3) * (j * np.int32(width) + i))


@njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def _changed(image, to_old, look, size):
    """One picture in its new place and light, as float32 rows (size, 3 · size); the edge is repeated outside.

    Each row goes through short loops that run in vectors; indices are unsigned, which spares numba the test for
    negative ones. Together that takes a quarter of the time of one loop over the pixels.
    """
    colour, gamma, coarse, fine, fine_too = look
    height, width = image.shape[0], image.shape[1]
    tone = np.empty(_TONES + 1, np.float32)
    for level in range(_TONES + 1):
        tone[level] = np.float32(255) * (np.float32(level) / np.float32(_TONES)) ** gamma
    flat, pixel, stride = image.ravel(), np.uint32(3), np.uint32(3 * width)
    sharp, bright, raw = (
        np.empty((size, 3 * size), np.float32),
        np.empty(size, np.float32),
        np.empty(3 * size, np.float32),
    )
    start, x, y = np.empty(size, np.uint32), np.empty(size, np.float32), np.empty(size, np.float32)
    for row in range(size):
        bright[:] = np.float32(_TONES / 255)
        _shade(coarse, row / (size - 1), bright)
        if fine_too:
            _shade(fine, row / (size - 1), bright)
        _place(to_old, row, (height, width), start, x, y)
        for column in range(size):
            for c in range(np.uint32(3)):
                upper = start[column] + c
                lower = upper + stride
                left = np.float32(flat[upper]) * (np.float32(1) - y[column]) + np.float32(flat[lower]) * y[column]
                right = np.float32(flat[upper + pixel]) * (np.float32(1) - y[column])
                right += np.float32(flat[lower + pixel]) * y[column]
                raw[3 * column + c] = left + x[column] * (right - left)
        for column in range(size):
            red, green, blue = raw[3 * column], raw[3 * column + 1], raw[3 * column + 2]
            for c in range(3):
                level = (colour[c, 0] * red + colour[c, 1] * green + colour[c, 2] * blue) * bright[column]
                raw[3 * column + c] = min(max(level + np.float32(0.5), np.float32(0)), np.float32(_TONES))
        for k in range(3 * size):
            sharp[row, k] = tone[np.uint32(np.int32(raw[k]))]
    return sharp


@njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def _finish(sharp, noise, blur, seed, out):
    """Blur by a share of the four neighbours, then add noise (triangular, of that standard deviation).

    The random bits are a hash of the pixel's number (the finaliser of MurmurHash3, A. Appleby): no state, so that the
    loop runs in vectors.
    """
    size, width = sharp.shape
    near = blur / np.float32(8)
    self_weight = np.float32(1) - np.float32(4) * near
    amplitude = noise * np.float32(6**0.5 / 2**16)
    for row in range(size):
        above, here, below = sharp[max(row - 1, 0)], sharp[row], sharp[min(row + 1, size - 1)]
        for k in range(width):
            left, right = k - 3 if k >= 3 else k, k + 3 if k < width - 3 else k
            value = self_weight * here[k] + near * (above[k] + below[k] + here[left] + here[right])
            bits = np.uint32(np.uint32(row * width + k) * np.uint32(0x9E3779B1) + seed)
            bits = np.uint32((bits ^ (bits >> np.uint32(16))) * np.uint32(0x85EBCA6B))
            bits = np.uint32((bits ^ (bits >> np.uint32(13))) * np.uint32(0xC2B2AE35))
            bits = np.uint32(bits ^ (bits >> np.uint32(16)))
            drawn = np.int32(bits & np.uint32(0xFFFF)) - np.int32(bits >> np.uint32(16))
            value += amplitude * np.float32(drawn) + np.float32(0.5)
            out[row, k] = np.uint8(np.int32(min(max(value, np.float32(0)), np.float32(255))))
