"""Appearance: everything about a picture that is not geometry, its presets, and the distributions it is drawn from.

An `Appearance` is a material (what the wall looks like), a light, optics and a sensor.

`TRAINING_APPEARANCE` and `UNSEEN_APPEARANCE` are disjoint: their noise comes from different families (forking vessels
on smooth bumps against winding vessels on cobbles), and so are the intervals that the latter names.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from naris.render.instrument import Light, Optics, Sensor
from naris.render.material import (
    NOISE_FAMILIES,
    RGB,
    VOLUMES_PER_FAMILY,
    Material,
    Mucosa,
    TextureColours,
    Uniform,
)

__all__ = [
    "ENDOSCOPE",
    "NOISE_FAMILIES",
    "PAPER",
    "PAPER_CULLED",
    "TRAINING_APPEARANCE",
    "UNSEEN_APPEARANCE",
    "Appearance",
    "AppearanceDistribution",
    "Light",
    "Material",
    "Mucosa",
    "Optics",
    "Sensor",
    "TextureColours",
    "Uniform",
]


@dataclass(frozen=True)
class Appearance:
    """Everything about a picture that is not geometry.

    Attributes:
        material: what the wall looks like.
        light: at the camera.
        optics: of the lens.
        sensor: behind it.
        cull_near_walls: leave out every face whose outward side is turned away from the camera, as the published code
            did: to a camera inside the surface its near walls vanish. Only `PAPER_CULLED` does.
    """

    material: Material = Uniform()
    light: Light = Light()
    optics: Optics = Optics()
    sensor: Sensor = Sensor()
    cull_near_walls: bool = False

    def __post_init__(self) -> None:
        if self.light.per_vertex and isinstance(self.material, Mucosa):
            object.__setattr__(self, "light", replace(self.light, per_vertex=False))

    def with_(self, **changes: object) -> Appearance:
        """A copy with some attributes replaced."""
        return replace(self, **changes)  # type: ignore[arg-type]


PAPER = Appearance(
    material=Uniform((0.505, 0.249, 0.234)),
    light=Light(
        diffuse=(10.5, 10.0, 10.0),
        specular=0.0,
        ambient=(0.2, 0.2, 0.2),
        spot_ambient=(0.2, 0.2, 0.2),
        attenuation=(7.5, 0.0, 0.0),
        cutoff_deg=45.0,
        exponent=0.5,
        per_vertex=True,
    ),
)
"""The light model of the published code (OpenGL's fixed pipeline), lit at the vertices as there.

Its wall has the mean colour of the published texture; give it `material=TextureColours.read(...)` for the texture
itself. With a `Mucosa` the light is computed in every pixel instead. Highlights are absent: in the published code the
material had none when the first frame was drawn, and each process drew one. Near walls are seen, unlike there."""

PAPER_CULLED = PAPER.with_(cull_near_walls=True)
"""`PAPER` with the published code's culling: from inside, the near walls vanish."""

ENDOSCOPE = Appearance(
    material=Mucosa(),
    light=Light(
        diffuse=(1.0, 0.97, 0.92),
        bounce=0.35,
        attenuation=(1.0, 0.0, 0.05),
        exponent=1.0,
        wrap=(0.25, 0.10, 0.08),
        offset_mm=(0.0, -1.2, 0.0),
    ),
    optics=Optics(vignette=0.25),
    sensor=Sensor(
        auto_exposure=0.9,
        meter_quantile=0.92,
        target=0.5,
        gain_range=(0.3, 30.0),
        gamma=2.2,
        shoulder=0.6,
        black=10.0,
        blur_px=0.5,
        sharpen=0.4,
        read_noise=1.2,
        shot_noise=1.6,
    ),
)
"""A white-light endoscope in a healthy nose: wet orange-pink mucosa, automatic exposure, a little noise."""

Interval = tuple[float, float]


@dataclass(frozen=True)
class AppearanceDistribution:
    """From which appearances are drawn, each number on its own.

    An interval is uniform; the `log_…` intervals are uniform in the logarithm.

    Attributes:
        family: of the noise.
        hue: of the pale albedo, from orange (−1) to violet-pink (+1).
        paleness: brightness of the pale albedo.
        blood, blotches, vessels, fine_vessels, mucus, relief, gloss, sheen: as in `Mucosa`.
        log_blotch_mm, log_vessel_mm, log_relief_mm, log_roughness: as in `Mucosa`.
        light_warmth: share of blue that the light lacks (negative: of red).
        log_falloff: the quadratic attenuation per mm².
        spot_exponent, bounce, wrap, light_offset_mm: as in `Light` (the offset in a random direction).
        vignette: as in `Optics`.
        round_mask: share of the pictures with a round stop.
        exposure, auto_exposure, gamma, shoulder, black, blur_px, sharpen, read_noise, shot_noise: as in `Sensor`.
        white_balance: each factor is within 1 ± this.
        flat: share of the pictures with a light that hardly falls off and a tone curve like a screen's, as simple
            renderers have them (`PAPER`); a network that never saw such a picture takes depth from brightness alone,
            and is further off in one, by more than 5 mm in a third of them.
    """

    family: str
    hue: Interval
    paleness: Interval
    blood: Interval
    blotches: Interval
    log_blotch_mm: Interval
    vessels: Interval
    log_vessel_mm: Interval
    fine_vessels: Interval
    mucus: Interval
    relief: Interval
    log_relief_mm: Interval
    gloss: Interval
    log_roughness: Interval
    sheen: Interval
    light_warmth: Interval
    log_falloff: Interval
    spot_exponent: Interval
    bounce: Interval
    wrap: Interval
    light_offset_mm: Interval
    vignette: Interval
    round_mask: float
    exposure: Interval
    auto_exposure: Interval
    gamma: Interval
    shoulder: Interval
    black: Interval
    blur_px: Interval
    sharpen: Interval
    read_noise: Interval
    shot_noise: Interval
    white_balance: float
    flat: float = 0.0

    def sample(self, rng: np.random.Generator) -> Appearance:
        """One appearance."""
        look = Appearance(self._mucosa(rng), self._light(rng), self._optics(rng), self._sensor(rng))
        return _flattened(look, rng) if self.flat and rng.random() < self.flat else look

    def _mucosa(self, rng: np.random.Generator) -> Mucosa:
        pale = _pale(_uniform(rng, self.hue), _uniform(rng, self.paleness))
        return Mucosa(
            seed=int(rng.integers(2**31)),
            family=self.family,
            volume=int(rng.integers(VOLUMES_PER_FAMILY)),
            pale=pale,
            blood=_uniform(rng, self.blood),
            blotches=_uniform(rng, self.blotches),
            blotch_mm=_log_uniform(rng, self.log_blotch_mm),
            vessels=_uniform(rng, self.vessels),
            vessel_mm=(width := _log_uniform(rng, self.log_vessel_mm)),
            fine_vessel_mm=0.4 * width,
            fine_vessels=_uniform(rng, self.fine_vessels),
            mucus=_uniform(rng, self.mucus),
            relief=_uniform(rng, self.relief),
            relief_mm=_log_uniform(rng, self.log_relief_mm),
            gloss=_uniform(rng, self.gloss),
            roughness=_log_uniform(rng, self.log_roughness),
            sheen=_uniform(rng, self.sheen),
        )

    def _light(self, rng: np.random.Generator) -> Light:
        warmth, wrap = _uniform(rng, self.light_warmth), _uniform(rng, self.wrap)
        offset, angle = _uniform(rng, self.light_offset_mm), rng.uniform(0, 2 * np.pi)
        return Light(
            diffuse=(1 + min(warmth, 0.0), 1 - abs(warmth) / 2, 1 - max(warmth, 0.0)),
            bounce=_uniform(rng, self.bounce),
            attenuation=(1.0, 0.0, _log_uniform(rng, self.log_falloff)),
            exponent=_uniform(rng, self.spot_exponent),
            wrap=(wrap, 0.4 * wrap, 0.3 * wrap),
            offset_mm=(float(offset * np.cos(angle)), float(offset * np.sin(angle)), 0.0),
        )

    def _optics(self, rng: np.random.Generator) -> Optics:
        vignette, masked = _uniform(rng, self.vignette), rng.uniform() < self.round_mask
        radius = float(rng.uniform(0.85, 1.15))
        centre = tuple(float(x) for x in rng.uniform(-0.06, 0.06, 2))
        if not masked:
            return Optics(vignette)
        return Optics(vignette, radius, 0.02, (centre[0], centre[1]))

    def _sensor(self, rng: np.random.Generator) -> Sensor:
        balance = 1 + rng.uniform(-self.white_balance, self.white_balance, 3)
        return Sensor(
            gain=_uniform(rng, self.exposure),
            auto_exposure=_uniform(rng, self.auto_exposure),
            meter_quantile=0.92,
            target=0.5,
            gain_range=(0.3, 30.0),
            white_balance=(float(balance[0]), float(balance[1]), float(balance[2])),
            gamma=_uniform(rng, self.gamma),
            shoulder=_uniform(rng, self.shoulder),
            black=_uniform(rng, self.black),
            blur_px=_uniform(rng, self.blur_px),
            sharpen=_uniform(rng, self.sharpen),
            read_noise=_uniform(rng, self.read_noise),
            shot_noise=_uniform(rng, self.shot_noise),
        )


def _flattened(look: Appearance, rng: np.random.Generator) -> Appearance:
    """The same mucosa, less wet, as a simple renderer shows it."""
    mucosa = cast(Mucosa, look.material)
    wrap = float(rng.uniform(0.0, 0.15))
    return look.with_(
        material=replace(
            mucosa, gloss=0.3 * mucosa.gloss * rng.random(), vessels=mucosa.vessels * rng.random(), sheen=0.0
        ),
        light=replace(
            look.light,
            attenuation=(1.0, 0.0, float(rng.uniform(0.0, 0.004))),
            bounce=float(rng.uniform(0.0, 0.2)),
            wrap=(wrap, 0.4 * wrap, 0.3 * wrap),
            offset_mm=(0.0, 0.0, 0.0),
        ),
        sensor=replace(look.sensor, gamma=float(rng.uniform(1.0, 1.8)), shoulder=float(rng.uniform(0.0, 0.5))),
    )


def _uniform(rng: np.random.Generator, interval: Interval) -> float:
    return float(rng.uniform(*interval))


def _log_uniform(rng: np.random.Generator, interval: Interval) -> float:
    return float(np.exp(rng.uniform(*np.log(interval))))


def _pale(hue: float, paleness: float) -> RGB:
    return (paleness, paleness * (0.75 - 0.08 * hue), paleness * (0.65 + 0.15 * hue))


TRAINING_APPEARANCE = AppearanceDistribution(
    family="branching",
    hue=(-1.0, 0.4),
    paleness=(0.75, 1.0),
    blood=(0.3, 1.5),
    blotches=(0.05, 0.35),
    log_blotch_mm=(3.0, 9.0),
    vessels=(0.0, 1.2),
    log_vessel_mm=(0.15, 0.45),
    fine_vessels=(0.0, 0.7),
    mucus=(0.0, 0.3),
    relief=(0.0, 0.12),
    log_relief_mm=(0.7, 3.0),
    gloss=(1.0, 15.0),
    log_roughness=(0.04, 0.15),
    sheen=(0.0, 0.2),
    light_warmth=(-0.05, 0.25),
    log_falloff=(0.01, 0.1),
    spot_exponent=(0.0, 3.0),
    bounce=(0.1, 0.6),
    wrap=(0.0, 0.4),
    light_offset_mm=(0.0, 2.0),
    vignette=(0.0, 0.5),
    round_mask=0.3,
    exposure=(0.6, 1.6),
    auto_exposure=(0.7, 1.0),
    gamma=(1.8, 2.4),
    shoulder=(0.4, 0.9),
    black=(0.0, 15.0),
    blur_px=(0.0, 0.8),
    sharpen=(0.0, 1.0),
    read_noise=(0.0, 3.0),
    shot_noise=(0.0, 3.0),
    white_balance=0.12,
    flat=0.2,
)
"""What training may see."""

UNSEEN_APPEARANCE = AppearanceDistribution(
    family="winding",
    hue=(0.5, 1.0),
    paleness=(0.75, 1.0),
    blood=(0.3, 1.5),
    blotches=(0.05, 0.35),
    log_blotch_mm=(3.0, 9.0),
    vessels=(0.0, 1.2),
    log_vessel_mm=(0.15, 0.45),
    fine_vessels=(0.0, 0.7),
    mucus=(0.0, 0.3),
    relief=(0.0, 0.12),
    log_relief_mm=(0.7, 3.0),
    gloss=(1.0, 15.0),
    log_roughness=(0.04, 0.15),
    sheen=(0.0, 0.2),
    light_warmth=(-0.15, -0.06),
    log_falloff=(0.1, 0.16),
    spot_exponent=(3.1, 4.5),
    bounce=(0.1, 0.6),
    wrap=(0.0, 0.4),
    light_offset_mm=(0.0, 2.0),
    vignette=(0.0, 0.5),
    round_mask=0.3,
    exposure=(0.6, 1.6),
    auto_exposure=(0.7, 1.0),
    gamma=(1.8, 2.4),
    shoulder=(0.4, 0.9),
    black=(0.0, 15.0),
    blur_px=(0.0, 0.8),
    sharpen=(0.0, 1.0),
    read_noise=(0.0, 3.0),
    shot_noise=(0.0, 3.0),
    white_balance=0.12,
)
"""Disjoint from `TRAINING_APPEARANCE` in the noise family, hue, light colour, fall-off and spot exponent."""
