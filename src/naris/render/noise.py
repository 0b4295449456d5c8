"""Solid noise: periodic volumes that are looked up trilinearly, and white noise from a hash.

Two volumes make a mucosa: `tissue` has four independent fields (blotches, their own variation, two vessel fields),
`relief` has one field and its gradient. Every field has zero mean and unit variance, the gradient unit rms length,
and `VOXELS_PER_FEATURE` voxels to a feature. They are kept as signed bytes, `STEPS` to a
unit: the four fields of a voxel are one 32-bit word, which is what makes them cheap to look up.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Float32, Int8, Integer

from naris.render.material import NOISE_FAMILIES, VOLUMES_PER_FAMILY

EDGE = 64
"""Voxels along each edge of a volume, a power of two so that wrapping is a mask."""
VOXELS_PER_FEATURE = 10.0
STEPS = 36.0
"""Steps of a stored byte in a standard deviation: 3.5 of them fit."""
_BANDWIDTH = 0.5
_CELLS = 220

_bank = np.zeros((len(NOISE_FAMILIES) * VOLUMES_PER_FAMILY, 2, EDGE, EDGE, EDGE, 4), np.int8)
_made: set[int] = set()
_lock = threading.Lock()


def bank_index(family: str, volume: int) -> int:
    """Where a family's volume lies in the bank."""
    return NOISE_FAMILIES.index(family) * VOLUMES_PER_FAMILY + volume


def noise_bank(wanted: Iterable[int]) -> Int8[np.ndarray, "bank 2 x y z 4"]:
    """The bank of volumes (tissue, relief), in which those of the wanted indices are ready.

    A volume is made when it is first wanted (about 0.1 s, 2 MB) and stays for the life of the process.
    """
    with _lock:
        for index in set(wanted) - _made:
            family, volume = divmod(index, VOLUMES_PER_FAMILY)
            make = _smooth_volumes if NOISE_FAMILIES[family] == "smooth" else _cellular_volumes
            fields = np.zeros(_bank.shape[1:], np.float32)
            make(np.random.default_rng([family, volume]), fields)
            _bank[index] = np.clip(np.rint(fields * STEPS), -127, 127)
            _made.add(index)
    return _bank


def _smooth_volumes(rng: np.random.Generator, out: Float32[np.ndarray, "2 x y z 4"]) -> None:
    """Gaussian noise with a log-normal band around the feature's frequency."""
    for channel in range(4):
        out[0, ..., channel] = _unit_variance(np.fft.irfftn(_band(rng), (EDGE,) * 3, axes=(0, 1, 2)))
    band = _band(rng)
    out[1, ..., 0] = _unit_variance(np.fft.irfftn(band, (EDGE,) * 3, axes=(0, 1, 2)))
    frequencies = np.meshgrid(*_frequencies(), indexing="ij", sparse=True)
    gradient = [np.fft.irfftn(2j * np.pi * f * band, (EDGE,) * 3, axes=(0, 1, 2)) for f in frequencies]
    out[1, ..., 1:] = _unit_length(np.stack(gradient, axis=-1))


def _cellular_volumes(rng: np.random.Generator, out: Float32[np.ndarray, "2 x y z 4"]) -> None:
    """Distances to the nearest and the second nearest of random cells (Worley 1996)."""
    nearest, second = _worley(rng)
    border = (second - nearest) / (second - nearest).std()
    out[0, ..., 0] = _unit_variance(nearest)
    out[0, ..., 1] = _unit_variance(np.roll(nearest.transpose(1, 2, 0), EDGE // 2, axis=0))
    out[0, ..., 2] = border
    out[0, ..., 3] = np.roll(border.transpose(2, 0, 1), EDGE // 3, axis=1)
    height, other = _worley(rng)
    out[1, ..., 0] = (other - height) / (other - height).std()
    gradient = [(np.roll(height, -1, axis) - np.roll(height, 1, axis)) / 2 for axis in range(3)]
    out[1, ..., 1:] = _unit_length(np.stack(gradient, axis=-1))


def _frequencies() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    full, half = np.fft.fftfreq(EDGE), np.fft.rfftfreq(EDGE)
    return full, full, half


def _band(rng: np.random.Generator) -> np.ndarray:
    fx, fy, fz = np.meshgrid(*_frequencies(), indexing="ij", sparse=True)
    frequency = np.sqrt(fx**2 + fy**2 + fz**2)
    frequency[0, 0, 0] = 1e-9
    octave = np.log(frequency * VOXELS_PER_FEATURE)
    white = np.fft.rfftn(rng.standard_normal((EDGE,) * 3), axes=(0, 1, 2))
    return white * np.exp(-((octave / _BANDWIDTH) ** 2) / 2) * (frequency > 1e-6)


def _worley(rng: np.random.Generator) -> tuple[Float[np.ndarray, "x y z"], Float[np.ndarray, "x y z"]]:
    from scipy.spatial import cKDTree

    tree = cKDTree(rng.uniform(0, EDGE, (_CELLS, 3)), boxsize=EDGE)
    grid = np.stack(np.meshgrid(*(np.arange(EDGE, dtype=float),) * 3, indexing="ij"), axis=-1)
    found, _ = tree.query(grid, k=2)
    return found[..., 0], found[..., 1]


def _unit_variance(field: Float[np.ndarray, "x y z"]) -> Float[np.ndarray, "x y z"]:
    return (field - field.mean()) / field.std()


def _unit_length(gradient: Float[np.ndarray, "x y z 3"]) -> Float[np.ndarray, "x y z 3"]:
    return gradient / np.sqrt((gradient**2).sum(axis=-1).mean())


def white_noise(seed: int, index: Integer[np.ndarray, "*n"]) -> Float32[np.ndarray, "*n"]:
    """Nearly normal noise of unit variance (four hashed bytes summed) for each index.

    The hash is `lowbias32` of C. Wellons (public domain).
    """
    mask = np.uint64(0xFFFFFFFF)
    x = (index.astype(np.uint64) * np.uint64(0x9E3779B1) + np.uint64(seed & 0xFFFFFFFF)) & mask
    x ^= x >> np.uint64(16)
    x = (x * np.uint64(0x7FEB352D)) & mask
    x ^= x >> np.uint64(15)
    x = (x * np.uint64(0x846CA68B)) & mask
    x ^= x >> np.uint64(16)
    bytes_ = [(x >> np.uint64(8 * i)) & np.uint64(255) for i in range(4)]
    total = np.stack(bytes_).sum(axis=0).astype(np.float32)
    return (total - np.float32(510)) * np.float32(1 / BYTE_SUM_STD)


BYTE_SUM_STD = float(np.sqrt(4 * (256**2 - 1) / 12))
"""Standard deviation of the sum of four random bytes."""
