"""Appearances as the numbers and tables that both engines read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from naris.render.appearance import Appearance, Mucosa, TextureColours, Uniform
from naris.render.instrument import Light, Sensor
from naris.render.noise import VOXELS_PER_FEATURE, bank_index, noise_bank

UNIFORM, VERTEX_COLOURS, MUCOSA, LIT_VERTICES = range(4)
"""How a wall gets its colour."""

RAMP_SIZE = 256
RAMP_BLOOD = 6.0
"""The colour ramp runs over blood 0…6."""
TONE_SIZE = 1024
TONE_REACH = 2.0
"""The tone table runs over the square root of the light, 0…2."""
SPOT_SIZE = 512
"""The spot table runs over (1 − cos θ)/2, 0…1, θ from the spot's axis."""

_SCALARS = (
    "albedo_r albedo_g albedo_b mucus mucus_r mucus_g mucus_b blood blotches vessels vessel fine_vessel "
    "fine_vessels relief gloss film sheen tissue tissue_per_mm relief_per_mm m00 m01 m02 m10 m11 m12 m20 "
    "m21 m22 tissue_x tissue_y tissue_z relief_x relief_y relief_z light_r light_g light_b ambient_r "
    "ambient_g ambient_b spot_ambient_r spot_ambient_g spot_ambient_b bounce constant linear quadratic "
    "wrap_r wrap_g wrap_b light_x light_y light_z vignette mask_radius mask_softness mask_x mask_y gain "
    "auto quantile target gain_low gain_high balance_r balance_g balance_b tap0 tap1 tap2 read_noise "
    "shot_noise cosine_cut "
)
LOOK = np.dtype(
    [("kind", "i4"), ("cull", "i4"), ("clips", "i4"), ("bank", "i4"), ("colours", "i4")]
    + [(n, "f4") for n in _SCALARS.split()]
)
"""One appearance, flat. `film` and `tissue` are squared roughnesses; `vessel` and `fine_vessel` are half widths in
voxels; `clips` says that the tone curve does nothing else; `m..` turns the anatomy into the noise."""


class Looks(NamedTuple):
    """Appearances of N frames.

    Attributes:
        rows: (N,) of `LOOK`.
        ramp: (N, RAMP_SIZE, 3) albedo by blood.
        tone: (N, TONE_SIZE) display value 0–255 by the square root of the light.
        spot: (N, SPOT_SIZE) strength of the spot by angle.
        colours: (T, V, 3) vertex colours that `colours` points into.
        bank: of solid noise, that `bank` points into.
    """

    rows: np.ndarray
    ramp: np.ndarray
    tone: np.ndarray
    spot: np.ndarray
    colours: np.ndarray
    bank: np.ndarray


def pack(appearances: Sequence[Appearance], vertex_count: int) -> Looks:
    """The numbers of the appearances for a surface with so many vertices; equal objects are packed once."""
    rows = np.zeros(len(appearances), LOOK)
    textures: dict[int, TextureColours] = {}
    for row, appearance in zip(rows, appearances, strict=True):
        _pack_material(row, appearance, textures)
        _pack_instrument(row, appearance)
    colours = [texture.vertex_colours(vertex_count) for texture in textures.values()]
    return Looks(
        rows,
        _ramps(appearances),
        _tones([a.sensor for a in appearances]),
        _spots(appearances),
        np.stack(colours) if colours else np.zeros((1, 1, 3), np.float32),
        noise_bank(rows["bank"][rows["kind"] == MUCOSA].tolist()),
    )


def _pack_material(row: np.void, appearance: Appearance, textures: dict[int, TextureColours]) -> None:
    material, light = appearance.material, appearance.light
    row["cull"] = appearance.cull_near_walls
    if isinstance(material, Mucosa):
        row["kind"] = MUCOSA
        _pack_mucosa(row, material)
        row["gloss"], row["sheen"] = material.gloss * light.specular, material.sheen * light.specular
    elif isinstance(material, TextureColours):
        row["kind"] = LIT_VERTICES if light.per_vertex else VERTEX_COLOURS
        textures.setdefault(id(material), material)
        row["colours"] = list(textures).index(id(material))
    elif isinstance(material, Uniform):
        row["kind"] = LIT_VERTICES if light.per_vertex else UNIFORM
        row["colours"] = -1
        _put(row, "albedo", material.rgb)


def _pack_mucosa(row: np.void, material: Mucosa) -> None:
    row["bank"] = bank_index(material.family, material.volume)
    _put(row, "mucus", material.mucus_rgb)
    for name in ("mucus", "blood", "blotches", "vessels", "fine_vessels", "relief"):
        row[name] = getattr(material, name)
    row["film"], row["tissue"] = material.roughness**2, material.sheen_roughness**2
    row["tissue_per_mm"] = VOXELS_PER_FEATURE / material.blotch_mm
    row["relief_per_mm"] = VOXELS_PER_FEATURE / material.relief_mm
    row["vessel"] = material.vessel_mm / 2 * row["tissue_per_mm"]
    row["fine_vessel"] = material.fine_vessel_mm / 2 * row["relief_per_mm"]
    rng = np.random.default_rng(material.seed)
    w, x, y, z = (q := rng.standard_normal(4)) / np.linalg.norm(q)
    rotation = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    for i in range(3):
        for j in range(3):
            row[f"m{i}{j}"] = rotation[i][j]
    # Far from zero, so that truncation is the floor for every point of a head.
    place = rng.uniform(2**12, 2**12 + 64, 6)
    for name, value in zip(
        ("tissue_x", "tissue_y", "tissue_z", "relief_x", "relief_y", "relief_z"), place, strict=True
    ):
        row[name] = value


def _pack_instrument(row: np.void, appearance: Appearance) -> None:
    light, optics, sensor = appearance.light, appearance.optics, appearance.sensor
    for name in ("ambient", "spot_ambient", "wrap"):
        _put(row, name, getattr(light, name))
    _put(row, "light", light.diffuse)
    row["bounce"] = light.bounce
    row["cosine_cut"] = np.cos(np.deg2rad(light.cutoff_deg)) if light.cutoff_deg < 180 else -2
    row["constant"], row["linear"], row["quadratic"] = light.attenuation
    row["light_x"], row["light_y"], row["light_z"] = light.offset_mm
    row["vignette"] = optics.vignette
    row["mask_radius"] = -1 if optics.mask_radius is None else optics.mask_radius
    row["mask_softness"] = max(optics.mask_softness, 1e-4)
    row["mask_x"], row["mask_y"] = optics.mask_centre
    row["clips"] = (sensor.gamma, sensor.shoulder, sensor.black) == (1.0, 1.0, 0.0)
    row["gain"], row["auto"], row["quantile"] = sensor.gain, sensor.auto_exposure, sensor.meter_quantile
    row["target"], (row["gain_low"], row["gain_high"]) = sensor.target, sensor.gain_range
    _put(row, "balance", sensor.white_balance)
    row["tap0"], row["tap1"], row["tap2"] = filter_taps(sensor.blur_px, sensor.sharpen)
    row["read_noise"], row["shot_noise"] = sensor.read_noise, sensor.shot_noise


def _put(row: np.void, name: str, rgb: tuple[float, float, float]) -> None:
    row[f"{name}_r"], row[f"{name}_g"], row[f"{name}_b"] = rgb


def filter_taps(blur_px: float, sharpen: float) -> tuple[float, float, float]:
    """Centre, first and second neighbour of the sensor's separable filter, summing to one.

    A Gaussian of three taps, then an unsharp mask against the (1, 2, 1)/4 mean.
    """
    side = np.exp(-0.5 / blur_px**2) if blur_px > 0 else 0.0
    g1, g0 = side / (1 + 2 * side), 1 / (1 + 2 * side)
    s1, s0 = -sharpen / 4, 1 + sharpen / 2
    return float(g0 * s0 + 2 * g1 * s1), float(g0 * s1 + g1 * s0), float(g1 * s1)


def _ramps(appearances: Sequence[Appearance]) -> Float32[np.ndarray, "n ramp 3"]:
    blood = np.linspace(0, RAMP_BLOOD, RAMP_SIZE)[None, :, None]
    mucosas = [a.material if isinstance(a.material, Mucosa) else Mucosa() for a in appearances]
    pale = np.array([m.pale for m in mucosas])[:, None, :]
    absorption = np.array([m.absorption for m in mucosas])[:, None, :]
    return (pale * np.exp(-absorption * blood)).astype(np.float32)


def _tones(sensors: Sequence[Sensor]) -> Float32[np.ndarray, "n tone"]:
    light = np.linspace(0, TONE_REACH, TONE_SIZE)[None] ** 2
    shoulder, gamma, black = (
        np.array([getattr(s, n) for s in sensors])[:, None] for n in ("shoulder", "gamma", "black")
    )
    rest = np.maximum(1 - shoulder, 1e-6)
    over = np.maximum(light - shoulder, 0)
    value = np.where(light > shoulder, shoulder + rest * (1 - np.exp(-over / rest)), light)
    grey = 255 * np.clip(value, 0, 1) ** (1 / gamma)
    return np.clip((grey - black) * 255 / (255 - black), 0, 255).astype(np.float32)


def _spots(appearances: Sequence[Appearance]) -> Float32[np.ndarray, "n spot"]:
    cosine = 1 - 2 * np.linspace(0, 1, SPOT_SIZE)
    return np.stack([_spot(cosine, a.light) for a in appearances])


def _spot(cosine: Float[np.ndarray, "spot"], light: Light) -> Float32[np.ndarray, "spot"]:
    """Strength at an angle to the axis, but for a sharp edge, which is no matter for a table."""
    strength = np.maximum(cosine, 0) ** light.exponent if light.exponent else np.ones_like(cosine)
    if light.cutoff_deg < 180 and light.edge_deg > 0:
        angle_deg = np.rad2deg(np.arccos(cosine))
        t = np.clip((light.cutoff_deg - angle_deg) / light.edge_deg, 0, 1)
        strength = strength * t * t * (3 - 2 * t)
    return strength.astype(np.float32)
