"""What the wall of the lumen looks like by itself: one colour, the published texture, or a solid mucosa."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, UInt8

from naris.errors import InputError

RGB = tuple[float, float, float]

NOISE_FAMILIES = ("branching", "winding")
"""How the solid noise of a mucosa is made: forking vessels on smooth bumps, or winding vessels on cobbles."""
VOLUMES_PER_FAMILY = 6
"""How many noise volumes each family has (each is placed anew by the mucosa's seed)."""


@dataclass(frozen=True)
class Uniform:
    """A wall of one colour.

    Attributes:
        rgb: albedo, 0–1.
    """

    rgb: RGB = (0.82, 0.50, 0.44)


@dataclass(frozen=True, eq=False)
class TextureColours:
    """A colour for each vertex, from a picture by the texel rule of Sinha et al. 2018.

    Vertex i has the colour of the texel in column (i mod width) and row (i mod height) from the top; the colour is
    interpolated over each face. There are no texture coordinates, so the picture itself is not to be seen.

    Attributes:
        image: (h, w, 3) uint8, RGB.
    """

    image: UInt8[np.ndarray, "h w 3"]

    @staticmethod
    def read(path: Path) -> TextureColours:
        """From a picture file of any common kind (`naris.core.pictures.read_picture`).

        Raises:
            ImageError: if the file is missing, no picture, damaged, or of more than 64 megapixels.
        """
        from naris.core.pictures import read_picture

        return TextureColours(read_picture(path, least_px=1))

    def vertex_colours(self, count: int) -> Float32[np.ndarray, "{count} 3"]:
        """The colours of vertices 0 … count − 1, 0–1."""
        index = np.arange(count)
        height, width = self.image.shape[:2]
        return self.image[index % height, index % width].astype(np.float32) / np.float32(255)


@dataclass(frozen=True)
class Mucosa:
    """A wet mucosa, solid in space, so that it fits any surface without texture coordinates.

    The colour follows the amount of blood: albedo = pale · exp(−absorption · blood) in each channel (Beer–Lambert).
    Blood varies by blotches and vessels, which are where fields of solid noise cross zero.

    Attributes:
        seed: where and how the anatomy lies in the noise.
        family: which kind of noise, one of `NOISE_FAMILIES`.
        volume: which of the family's volumes.
        pale: albedo without blood.
        absorption: of a unit of blood.
        blood: mean amount, 1 is healthy.
        blotches: how much the amount varies.
        blotch_mm: size of the blotches.
        vessels: blood that a large vessel adds.
        vessel_mm: width of large vessels where they are strong.
        fine_vessels: blood that a small vessel adds.
        fine_vessel_mm: width of small vessels where they are strong.
        mucus: how much of the wall is under pale mucus, 0–1.
        mucus_rgb: albedo of mucus.
        relief: slope of the fine bumps (rms, 0 for none).
        relief_mm: size of the fine bumps and small vessels.
        gloss: peak of the wet highlight against a white wall.
        roughness: of the wet film (GGX alpha).
        sheen: peak of the broad highlight of the tissue beneath.
        sheen_roughness: of the tissue beneath.
    """

    seed: int = 0
    family: str = "branching"
    volume: int = 0
    pale: RGB = (0.90, 0.66, 0.55)
    absorption: RGB = (0.16, 0.85, 0.98)
    blood: float = 1.0
    blotches: float = 0.2
    blotch_mm: float = 5.0
    vessels: float = 0.65
    vessel_mm: float = 0.26
    fine_vessels: float = 0.35
    fine_vessel_mm: float = 0.1
    mucus: float = 0.04
    mucus_rgb: RGB = (0.90, 0.72, 0.52)
    relief: float = 0.045
    relief_mm: float = 1.5
    gloss: float = 10.0
    roughness: float = 0.055
    sheen: float = 0.05
    sheen_roughness: float = 0.35

    def __post_init__(self) -> None:
        if self.family not in NOISE_FAMILIES or not 0 <= self.volume < VOLUMES_PER_FAMILY:
            raise InputError(
                f"a noise family of {NOISE_FAMILIES} and a volume 0…{VOLUMES_PER_FAMILY - 1}",
                f"{self.family!r}, {self.volume}",
                "name one of those",
            )
        if min(self.blotch_mm, self.relief_mm, self.roughness, self.sheen_roughness) <= 0:
            raise InputError("sizes and roughnesses above 0 in a mucosa", f"{self}", "correct them")


Material = Uniform | TextureColours | Mucosa
