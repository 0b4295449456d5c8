"""The picture of a hit, written down once in numpy: the slow, readable twin of `naris.render.kernel`.

All vectors are in the anatomy's frame; light is linear until `develop`. Symbols: p the point, n the interpolated
vertex normal turned to the side of the wall that is seen, l towards the light, v towards the camera, r the distance
to the light.

    wall        albedo(blood), blood from solid noise                      `mucosa_albedo`
    light       ambient·albedo + spot(θ)·fall(r)·(spot_ambient·albedo
                + diffuse·albedo·(wrapped n·l + bounce·albedo) + highlights)       `radiance`
    highlights  gloss·D(film) + sheen·D(tissue), D the GGX lobe of Walter et al. 2007 with its peak at 1
    sensor      gain, tone curve, noise, separable filter                   `develop`
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int, Int8, UInt8

from naris.render.look import (
    LIT_VERTICES,
    MUCOSA,
    RAMP_BLOOD,
    RAMP_SIZE,
    SPOT_SIZE,
    TONE_REACH,
    TONE_SIZE,
    UNIFORM,
    Looks,
)
from naris.render.noise import EDGE, STEPS, white_noise

SHALLOWEST_COSINE = 0.05
"""n·v is never less: interpolated normals turn away from the camera at silhouettes and would leave black dots."""
LUMINANCE = (0.30, 0.59, 0.11)
METER_BINS = 512
METER_BINS_PER_OCTAVE = 32
METER_FIRST_OCTAVE = -12


class Hits(NamedTuple):
    """What M rays found, in the anatomy's frame.

    Attributes:
        point_mm: (M, 3).
        view: (M, 3) unit, towards the camera.
        distance_mm: (M,) from the camera.
        normal: (M, 3) unit, of the interpolated vertex normals, on the side that is seen.
        base: (M, 3) interpolated vertex colour, or zeros.
        pixel_mm: (M,) size of a pixel on a wall that faces the camera.
    """

    point_mm: Float32[np.ndarray, "m 3"]
    view: Float32[np.ndarray, "m 3"]
    distance_mm: Float32[np.ndarray, "m"]
    normal: Float32[np.ndarray, "m 3"]
    base: Float32[np.ndarray, "m 3"]
    pixel_mm: Float32[np.ndarray, "m"]


def radiance(
    hits: Hits, looks: Looks, i: int, light_mm: Float32[np.ndarray, "3"], axis: Float32[np.ndarray, "3"]
) -> Float32[np.ndarray, "m 3"]:
    """Linear light that frame i sees of each hit, before optics and sensor."""
    row = looks.rows[i]
    if row["kind"] == LIT_VERTICES:
        return hits.base
    normal, albedo = hits.normal, hits.base
    if row["kind"] == UNIFORM:
        albedo = np.broadcast_to(_rgb(row, "albedo"), hits.base.shape)
    if row["kind"] == MUCOSA:
        albedo, slope = mucosa_albedo(hits, looks, i)
        normal = unit(normal - row["relief"] * (slope - dot(slope, normal)[:, None] * normal))
    to_light = light_mm - hits.point_mm
    r = length(to_light)
    to_light = to_light / r[:, None]
    cosine = np.clip(dot(normal, to_light), SHALLOWEST_COSINE, 1)[:, None]
    fall = spot_light(looks, i, -dot(to_light, axis)) / (row["constant"] + r * (row["linear"] + r * row["quadratic"]))
    wrap = _rgb(row, "wrap")
    wrapped = (cosine + wrap) / (1 + wrap)
    light = _rgb(row, "spot_ambient") + _rgb(row, "light") * (wrapped + row["bounce"] * albedo)
    out = albedo * (_rgb(row, "ambient") + fall[:, None] * light)
    if row["kind"] == MUCOSA:
        half = unit(to_light + hits.view)
        facing = np.clip(dot(normal, half), 0, 1) ** 2
        shine = row["gloss"] * _lobe(facing, row["film"]) + row["sheen"] * _lobe(facing, row["tissue"])
        out = out + (fall * shine)[:, None] * _rgb(row, "light")
    return out.astype(np.float32)


def _lobe(cosine_squared: Float32[np.ndarray, "m"], alpha_squared: np.float32) -> Float32[np.ndarray, "m"]:
    return (alpha_squared / (1 - cosine_squared * (1 - alpha_squared))) ** 2


def spot_light(looks: Looks, i: int, cosine: Float32[np.ndarray, "m"]) -> Float32[np.ndarray, "m"]:
    """Strength of the spot of frame i at an angle to its axis."""
    inside = cosine >= looks.rows[i]["cosine_cut"]
    return inside * _table(looks.spot[i], (1 - cosine) * np.float32((SPOT_SIZE - 1) / 2))


def _table(table: Float32[np.ndarray, "n *c"], at: Float32[np.ndarray, "m"]) -> Float32[np.ndarray, "m *c"]:
    """Linear interpolation in a table, clamped at its ends."""
    at = np.clip(at, 0, len(table) - 1.001).astype(np.float32)
    low = at.astype(np.int32)
    t = (at - low.astype(np.float32)).reshape(-1, *(1,) * (table.ndim - 1))
    return table[low] + t * (table[low + 1] - table[low])


def mucosa_albedo(hits: Hits, looks: Looks, i: int) -> tuple[Float32[np.ndarray, "m 3"], Float32[np.ndarray, "m 3"]]:
    """Albedo of a mucosa and the slope of its relief (of unit rms, before `relief`), faded where pixels are coarse."""
    row = looks.rows[i]
    turn = np.array([[row[f"m{j}{k}"] for k in range(3)] for j in range(3)], np.float32)
    inside = turned(hits.point_mm, turn)
    tissue, relief = looks.bank[row["bank"], 0], looks.bank[row["bank"], 1]
    coarse = hits.pixel_mm * row["relief_per_mm"]
    fade = 1 / (1 + (coarse / 4) ** 2)
    fine = trilinear(relief, inside * row["relief_per_mm"] + _xyz(row, "relief"))
    fine[:, 1:] *= fade[:, None]
    noise = trilinear(tissue, inside * row["tissue_per_mm"] + _xyz(row, "tissue"))
    blotch, change = noise[:, 0], noise[:, 1]
    width = row["vessel"] * np.clip(0.5 + 0.5 * change, 0.05, 1.5)
    spread = hits.pixel_mm * row["tissue_per_mm"]
    blood = row["blood"] + row["blotches"] * blotch
    blood += row["vessels"] * (_line(noise[:, 2], width, spread) + 0.6 * _line(noise[:, 3], 0.6 * width, spread))
    narrow = row["fine_vessel"] * np.clip(0.6 - 0.6 * change, 0.05, 1.5)
    blood += row["fine_vessels"] * _line(fine[:, 0], narrow, coarse)
    albedo = _table(looks.ramp[i], np.maximum(blood, 0) * np.float32((RAMP_SIZE - 1) / RAMP_BLOOD))
    cover = row["mucus"] * np.clip(0.5 - 0.5 * blotch + 0.5 * change, 0, 1)[:, None]
    return albedo + cover * (_rgb(row, "mucus") - albedo), turned(fine[:, 1:], turn.T)


def _line(
    field: Float32[np.ndarray, "m"], width: Float32[np.ndarray, "m"], coarse: Float32[np.ndarray, "m"]
) -> Float32[np.ndarray, "m"]:
    """1 on the zero line of a field, 0 beyond a half width; wider and weaker where a pixel spans `coarse` voxels."""
    seen = np.sqrt(width**2 + (0.5 * coarse) ** 2)
    t = np.maximum(1 - np.abs(field) / seen, 0)
    return t * t * (3 - 2 * t) * (width / seen)


def trilinear(volume: Int8[np.ndarray, "e e e 4"], at: Float32[np.ndarray, "m 3"]) -> Float32[np.ndarray, "m 4"]:
    """Four fields of a periodic volume between its voxels; coordinates in voxels, positive."""
    low = at.astype(np.int32)
    t = (at - low).astype(np.float32)
    x, y, z = (low & (EDGE - 1)).T
    x1, y1, z1 = ((low + 1) & (EDGE - 1)).T
    tx, ty, tz = (t[:, k, None] for k in range(3))
    corners = [[volume[i, j, k].astype(np.float32) for k in (z, z1)] for i in (x, x1) for j in (y, y1)]
    c00, c01, c10, c11 = (low_z + tz * (high_z - low_z) for low_z, high_z in corners)
    c0, c1 = c00 + ty * (c01 - c00), c10 + ty * (c11 - c10)
    return (c0 + tx * (c1 - c0)) * np.float32(1 / STEPS)


def optics_weight(looks: Looks, i: int, height: int, width: int) -> Float32[np.ndarray, "h w"]:
    """What the vignette and the round stop let through of each pixel."""
    row = looks.rows[i]
    half = np.float32(height / 2)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    x, y = (x - np.float32((width - 1) / 2)) / half, (y - np.float32((height - 1) / 2)) / half
    corner = np.float32(1 + (width / height) ** 2)
    weight = 1 - row["vignette"] * (x * x + y * y) / corner
    if row["mask_radius"] >= 0:
        radius = np.sqrt((x - row["mask_x"]) ** 2 + (y - row["mask_y"]) ** 2)
        weight = weight * np.clip((row["mask_radius"] - radius) / row["mask_softness"], 0, 1)
    return np.maximum(weight, 0).astype(np.float32)


def metered(light: Float32[np.ndarray, "h w 3"], weight: Float32[np.ndarray, "h w"], quantile: float) -> float:
    """The quantile of the luminance where the stop lets light through, from a histogram of its octaves; 0 if dark.

    Every second pixel of every second row is metered.
    """
    luminance = light[::2, ::2] @ np.array(LUMINANCE, np.float32)
    values = luminance[weight[::2, ::2] > 0]
    base = (127 + METER_FIRST_OCTAVE) * METER_BINS_PER_OCTAVE
    bins = (values.view(np.int32) >> (23 - 5)) - base
    counts = np.bincount(np.clip(bins, 0, METER_BINS - 1), minlength=METER_BINS)
    return quantile_of_histogram(counts, quantile)


def quantile_of_histogram(counts: Int[np.ndarray, "bins"], quantile: float) -> float:
    """The value below which a share of the counts lies, linear inside a bin; 0 if that is the first bin."""
    wanted = quantile * counts.sum()
    below = np.cumsum(counts)
    at = int(np.searchsorted(below, wanted))
    if at == 0 or below[-1] == 0:
        return 0.0
    at = min(at, METER_BINS - 1)
    share = (wanted - below[at - 1]) / max(counts[at], 1)
    octave, step = divmod(at, METER_BINS_PER_OCTAVE)
    return float(2.0 ** (METER_FIRST_OCTAVE + octave) * (1 + (step + share) / METER_BINS_PER_OCTAVE))


def develop(
    light: Float32[np.ndarray, "h w 3"], weight: Float32[np.ndarray, "h w"], looks: Looks, i: int, seed: int
) -> UInt8[np.ndarray, "h w 3"]:
    """Grey levels of linear light (optics already applied): exposure, tone curve, noise, filter."""
    row = looks.rows[i]
    gain = np.float32(row["gain"])
    if row["auto"] > 0:
        level = metered(light, weight, float(row["quantile"]))
        automatic = np.clip(row["target"] / max(level, 1e-9), row["gain_low"], row["gain_high"])
        gain = np.float32(gain * automatic ** row["auto"])
    exposed = light * gain * _rgb(row, "balance")
    if row["clips"]:
        grey = np.minimum(exposed, 1) * np.float32(255)
    else:
        at = np.sqrt(exposed).ravel() * np.float32((TONE_SIZE - 1) / TONE_REACH)
        grey = _table(looks.tone[i], at).reshape(light.shape)
    if row["read_noise"] > 0 or row["shot_noise"] > 0:
        noise = white_noise(seed, np.arange(grey.size)).reshape(grey.shape)
        strength = row["read_noise"] + row["shot_noise"] * np.sqrt(grey * np.float32(1 / 255))
        grey = grey + np.where(weight[..., None] > 0, noise * strength, 0)
    taps = (float(row["tap0"]), float(row["tap1"]), float(row["tap2"]))
    if taps[0] != 1:
        grey = _filter(_filter(grey, taps, 1), taps, 0)
    return np.clip(grey + np.float32(0.5), 0, 255).astype(np.uint8)


def _filter(
    grey: Float32[np.ndarray, "h w 3"], taps: tuple[float, float, float], axis: int
) -> Float32[np.ndarray, "h w 3"]:
    """Five symmetric taps along an axis; the border pixel is repeated."""
    n = grey.shape[axis]
    index = np.arange(n)

    def shifted(by: int) -> np.ndarray:
        return np.take(grey, np.clip(index + by, 0, n - 1), axis=axis)

    t0, t1, t2 = (np.float32(t) for t in taps)
    return t0 * grey + t1 * (shifted(-1) + shifted(1)) + t2 * (shifted(-2) + shifted(2))


def light_vertices(
    vertices_mm: Float32[np.ndarray, "v 3"],
    normals: Float32[np.ndarray, "v 3"],
    looks: Looks,
    i: int,
    light_mm: Float32[np.ndarray, "3"],
    axis: Float32[np.ndarray, "3"],
) -> Float32[np.ndarray, "2 v 3"]:
    """Colours of the vertices lit as by OpenGL's fixed pipeline, clamped to 0–1: outside of the wall, then inside."""
    row = looks.rows[i]
    albedo = _rgb(row, "albedo") if row["colours"] < 0 else looks.colours[row["colours"]]
    to_light = light_mm - vertices_mm
    r = np.maximum(length(to_light), np.float32(1e-9))
    to_light = to_light / r[:, None]
    spot = spot_light(looks, i, -dot(to_light, axis))
    fall = spot / (row["constant"] + r * (row["linear"] + r * row["quadratic"]))
    cosine = dot(normals, to_light)
    sides = np.stack([np.maximum(cosine, 0), np.maximum(-cosine, 0)])[..., None]
    light = _rgb(row, "spot_ambient") + _rgb(row, "light") * sides
    return np.clip(albedo * (_rgb(row, "ambient") + fall[:, None] * light), 0, 1).astype(np.float32)


def _rgb(row: np.void, name: str) -> Float32[np.ndarray, "3"]:
    return np.array([row[f"{name}_r"], row[f"{name}_g"], row[f"{name}_b"]], np.float32)


def _xyz(row: np.void, name: str) -> Float32[np.ndarray, "3"]:
    return np.array([row[f"{name}_x"], row[f"{name}_y"], row[f"{name}_z"]], np.float32)


def dot(a: Float[np.ndarray, "m 3"], b: Float[np.ndarray, "*m 3"]) -> Float[np.ndarray, "m"]:
    """Scalar products of rows (written out: the threads of a matrix product would cost more than they save)."""
    return a[:, 0] * b[..., 0] + a[:, 1] * b[..., 1] + a[:, 2] * b[..., 2]


def length(v: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m"]:
    """Lengths of rows."""
    return np.sqrt(dot(v, v))


def turned(v: Float[np.ndarray, "m 3"], matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "m 3"]:
    """The matrix times each row."""
    return np.stack([dot(v, row) for row in matrix], axis=-1)


def unit(v: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """Rows of length one."""
    return v / np.maximum(length(v), np.float32(1e-12))[:, None]
