"""The instrument: its light, its optics and its sensor.

The light is in OpenGL's terms (Segal and Akeley, The OpenGL Graphics System 1.5, section 2.14), so that the published
simulation and a real endoscope are two settings of one model. All light is linear; only the sensor's tone curve makes
display values. `naris.render.shading` writes the formulas down.
"""

from __future__ import annotations

from dataclasses import dataclass

from naris.render.material import RGB


@dataclass(frozen=True)
class Light:
    """A spot light at the lens or beside it, in OpenGL's terms.

    Attributes:
        diffuse: strength, linear RGB.
        specular: factor on the highlights of the surface.
        ambient: light from everywhere that nothing attenuates.
        spot_ambient: light from everywhere that falls off as the spot does.
        bounce: light that other walls send back, a share of the spot's, without a cosine, in the colour of the wall.
        attenuation: (constant, per mm, per mm²): the spot falls off as 1/(c + l·r + q·r²).
        cutoff_deg: half the angle of the cone; 180 for none.
        edge_deg: over how many degrees inside the cone the light fades out; 0 is a sharp edge.
        exponent: the spot falls off as the cosine to this power.
        wrap: how far light wraps around into the shade in each channel (0: Lambert), for subsurface scattering.
        offset_mm: where the light is, in the camera frame.
        per_vertex: light the vertices and interpolate (Gouraud), as OpenGL's fixed pipeline does; not with a mucosa.
    """

    diffuse: RGB = (1.0, 1.0, 1.0)
    specular: float = 1.0
    ambient: RGB = (0.0, 0.0, 0.0)
    spot_ambient: RGB = (0.0, 0.0, 0.0)
    bounce: float = 0.0
    attenuation: RGB = (1.0, 0.0, 0.0)
    cutoff_deg: float = 180.0
    edge_deg: float = 0.0
    exponent: float = 0.0
    wrap: RGB = (0.0, 0.0, 0.0)
    offset_mm: RGB = (0.0, 0.0, 0.0)
    per_vertex: bool = False


@dataclass(frozen=True)
class Optics:
    """What the lens and its stop do to the picture.

    Attributes:
        vignette: share of the light that is lost in the corners (quadratic in the distance from the centre).
        mask_radius: of the round stop, a share of half the picture's height; None for no stop. It blackens the
            picture only: depth, normals, face ids and `valid` stay.
        mask_softness: width of its edge, in the same unit.
        mask_centre: of the stop, in the same unit, from the centre of the picture (right, down).
    """

    vignette: float = 0.0
    mask_radius: float | None = None
    mask_softness: float = 0.01
    mask_centre: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Sensor:
    """How light becomes grey levels.

    Attributes:
        gain: factor on the light when the exposure is fixed, and a factor on the automatic one.
        auto_exposure: 0 for a fixed gain, 1 for one that brings the metered light to `target`, or between.
        meter_quantile: which part of the picture is metered: the brightest but (1 − quantile), inside the stop.
        target: linear light that the metered part shall have.
        gain_range: limits of the automatic gain.
        white_balance: factors.
        gamma: the tone curve is light^(1/gamma), 1 for none.
        shoulder: where highlights begin to be compressed, linear 0–1; 1 for a hard clip.
        black: grey levels that are cut off at the dark end.
        blur_px: standard deviation of the blur.
        sharpen: strength of the unsharp mask.
        read_noise: standard deviation in grey levels in the dark.
        shot_noise: the same at full brightness, growing with the root of the light.
    """

    gain: float = 1.0
    auto_exposure: float = 0.0
    meter_quantile: float = 0.9
    target: float = 0.5
    gain_range: tuple[float, float] = (1e-3, 1e3)
    white_balance: RGB = (1.0, 1.0, 1.0)
    gamma: float = 1.0
    shoulder: float = 1.0
    black: float = 0.0
    blur_px: float = 0.0
    sharpen: float = 0.0
    read_noise: float = 0.0
    shot_noise: float = 0.0
