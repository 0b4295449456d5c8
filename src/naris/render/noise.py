"""Solid noise: periodic volumes that are looked up trilinearly, and white noise from a hash.

Two volumes make a mucosa. `tissue` has a field of blotches, one of slow change, and two vessel fields; `relief` has a
field of small vessels, and the slope of fine bumps. Blotches and change have zero mean and unit variance, the slope
unit rms length. A vessel field is zero where a vessel runs and tells the distance from it in voxels, with a sign. There
are `VOXELS_PER_FEATURE` voxels to a feature. All is kept as signed bytes, `STEPS` to a unit: the four fields of a voxel
are one 32-bit word, which is what makes them cheap to look up.
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
_CELLS = 240

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
            make = _branching_volumes if NOISE_FAMILIES[family] == "branching" else _winding_volumes
            fields = np.zeros(_bank.shape[1:], np.float32)
            make(np.random.default_rng([family, volume]), fields)
            _bank[index] = np.clip(np.rint(fields * STEPS), -127, 127)
            _made.add(index)
    return _bank


def _branching_volumes(rng: np.random.Generator, out: Float32[np.ndarray, "2 x y z 4"]) -> None:
    """Vessels between random cells, so that they fork; relief of Gaussian noise."""
    out[0, ..., 0] = _unit_variance(_gaussian(_band(rng, 1.6, 0.8)))
    out[0, ..., 1] = _unit_variance(_gaussian(_band(rng, 2.5, 0.4)))
    out[0, ..., 2], out[0, ..., 3] = _borders(rng)
    out[1, ..., 0], _ = _borders(rng)
    out[1, ..., 1:] = _slope(_band(rng, 1.0, 0.6))


def _winding_volumes(rng: np.random.Generator, out: Float32[np.ndarray, "2 x y z 4"]) -> None:
    """Vessels on the zero lines of Gaussian noise, which wind and never fork; relief of cobbles (Worley 1996)."""
    out[0, ..., 0] = _unit_variance(_nearest(rng))
    out[0, ..., 1] = _unit_variance(_gaussian(_band(rng, 2.5, 0.4)))
    for volume, channel in ((0, 2), (0, 3), (1, 0)):
        band = _band(rng, 1.3, 0.5)
        slope = np.sqrt(np.square([_gaussian(d) for d in _derivatives(band)]).sum(axis=0).mean())
        out[volume, ..., channel] = _gaussian(band) / slope
    height = np.fft.rfftn(_nearest(rng), axes=(0, 1, 2))
    frequency = sum(f**2 for f in _frequencies())
    out[1, ..., 1:] = _slope(height * np.exp(-frequency * 15.0))


def _frequencies() -> list[np.ndarray]:
    full, half = np.fft.fftfreq(EDGE), np.fft.rfftfreq(EDGE)
    return list(np.meshgrid(full, full, half, indexing="ij", sparse=True))


def _band(rng: np.random.Generator, size: float, width: float) -> np.ndarray:
    """Spectrum of Gaussian noise around features of a size (in features), `width` a log-normal deviation."""
    frequency = np.sqrt(sum(f**2 for f in _frequencies()))
    frequency[0, 0, 0] = 1.0
    octave = np.log(frequency * VOXELS_PER_FEATURE * size) / width
    white = np.fft.rfftn(rng.standard_normal((EDGE,) * 3), axes=(0, 1, 2))
    band = white * np.exp(-(octave**2) / 2) / frequency**1.5
    band[0, 0, 0] = 0.0
    return band


def _gaussian(band: np.ndarray) -> Float[np.ndarray, "x y z"]:
    return np.fft.irfftn(band, (EDGE,) * 3, axes=(0, 1, 2))


def _derivatives(band: np.ndarray) -> list[np.ndarray]:
    return [2j * np.pi * f * band for f in _frequencies()]


def _slope(band: np.ndarray) -> Float[np.ndarray, "x y z 3"]:
    slope = np.stack([_gaussian(d) for d in _derivatives(band)], axis=-1)
    return slope / np.sqrt((slope**2).sum(axis=-1).mean())


def _borders(rng: np.random.Generator) -> tuple[Float[np.ndarray, "x y z"], Float[np.ndarray, "x y z"]]:
    """Signed distance to the border between two parts of random cells, for two ways to part the same cells.

    Either border winds without an end; where one leaves the other, the vessel forks. The cells are bent, since no
    vessel is straight; a part is where slow noise is positive, so that few are islands.
    """
    cells = rng.uniform(0, EDGE, (_CELLS, 3))
    at = tuple(cells.astype(int).T)
    bent = (_grid() + np.stack([_bend(rng) for _ in range(3)], axis=-1))[::2, ::2, ::2]
    parts = [_gaussian(_band(rng, 2.0, 0.4))[at] > 0 for _ in range(2)]
    first, second = ((_distance(cells[part], bent) - _distance(cells[~part], bent)) / 2 for part in parts)
    return _finer(first), _finer(second)


def _bend(rng: np.random.Generator) -> Float[np.ndarray, "x y z"]:
    slow, quick = (_unit_variance(_gaussian(_band(rng, size, 0.4))) for size in (1.4, 0.6))
    return 2.0 * slow + 0.6 * quick


def _nearest(rng: np.random.Generator) -> Float[np.ndarray, "x y z"]:
    return _finer(_distance(rng.uniform(0, EDGE, (_CELLS, 3)), _grid()[::2, ::2, ::2]))


def _finer(field: Float[np.ndarray, "a b c"]) -> Float[np.ndarray, "x y z"]:
    """Twice as many voxels along each axis, the new ones half way between the old."""
    for axis in range(3):
        between = (field + np.roll(field, -1, axis)) / 2
        field = np.stack([field, between], axis=axis + 1).reshape(*field.shape[:axis], -1, *field.shape[axis + 1 :])
    return field


def _grid() -> Float[np.ndarray, "x y z 3"]:
    return np.stack(np.meshgrid(*(np.arange(EDGE, dtype=float),) * 3, indexing="ij"), axis=-1)


def _distance(cells: Float[np.ndarray, "n 3"], points: Float[np.ndarray, "x y z 3"]) -> Float[np.ndarray, "x y z"]:
    """To the nearest cell, in a world that repeats."""
    from scipy.spatial import cKDTree

    found, _ = cKDTree(cells, boxsize=EDGE).query(points % EDGE)
    return found


def _unit_variance(field: Float[np.ndarray, "x y z"]) -> Float[np.ndarray, "x y z"]:
    return (field - field.mean()) / field.std()


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
