"""Noses that are not normal: named variants of the built-in nose, as they are met in practice.

Some are parameters beyond their normal ranges (a bowed septum, swollen turbinates); others take tissue away or add some
(a hole in the septum, a sinus that was opened, a turbinate with a cell in it, polyps), which an `Alteration` says.
Sizes are drawn anew for every nose, on either side.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from naris.anatomy.builtin.field import grid_for, lumen_field
from naris.anatomy.builtin.implicit import Field, Grid, smooth_max, smooth_min
from naris.anatomy.builtin.layout import layout_of
from naris.anatomy.builtin.parameters import NORMAL_RANGES, NoseParameters
from naris.anatomy.builtin.walls import lateral_wall_mm, septum_centre_mm, septum_thickness_mm
from naris.errors import InputError

_ROUND_MM = 1.0
_THROUGH = 0.7  # share of the radius across, at which a hole still has 0.7 of its height and length
_COARSE_MM, _DRAWS, _IN_AIR = 1.0, 60, 0.5  # a polyp is drawn until so much of it stands in air
_LEAST_BULLA_MM = 5.0
_BESIDE_MM, _MEATUS_MM = 1.2, 2.0  # what a swollen middle turbinate leaves to the septum and to the lateral wall
_BEYOND = 0.5  # of the way from the end of the normal range to what the generator accepts, at least


@dataclass(frozen=True)
class Alteration:
    """An ellipsoid of air where there was tissue, or of tissue where there was air.

    Attributes:
        centre_mm: in the frame of the built-in nose.
        radii_mm: along x, y, z.
        air: what it is made of.

    Raises:
        InputError: if a number is not finite, or a radius is none.
    """

    centre_mm: tuple[float, float, float]
    radii_mm: tuple[float, float, float]
    air: bool

    def __post_init__(self) -> None:
        if not np.isfinite([*self.centre_mm, *self.radii_mm]).all() or min(self.radii_mm) <= 0:
            raise InputError("a finite centre and radii above 0", f"{self}", "correct the alteration")

    def inside_mm(self, grid: Grid) -> Field:
        """Positive inside, about the distance to its wall near it: as exact as the radii are alike."""
        axes = (grid.x, grid.y, grid.z)
        square = sum(((axis - c) / r) ** 2 for axis, c, r in zip(axes, self.centre_mm, self.radii_mm, strict=True))
        return ((1 - np.sqrt(square)) * min(self.radii_mm)).astype(np.float32)

    def __call__(self, lumen: Field, grid: Grid) -> Field:
        """The lumen with it."""
        inside = self.inside_mm(grid)
        return smooth_max(lumen, inside, _ROUND_MM) if self.air else smooth_min(lumen, -inside, _ROUND_MM)


Changed = tuple[NoseParameters, tuple[Alteration, ...]]


def deviated_septum(p: NoseParameters, rng: np.random.Generator) -> Changed:
    """A septum bowed beyond the normal range to one side, with a spur (R. Mladina et al. 2008, types 3 to 6)."""
    bow = _side(rng) * _beyond("septum_deviation_mm", rng)
    return replace(p, septum_deviation_mm=bow, septal_spur_mm=float(rng.uniform(1.5, 4.0))), ()


def turbinate_hypertrophy(p: NoseParameters, rng: np.random.Generator) -> Changed:
    """Inferior turbinates thicker than normal, that leave a narrow common meatus (G. Berger et al. 2003)."""
    narrow = float(rng.uniform(1.6, 2.6))
    return replace(p, inferior_thickness_mm=_beyond("inferior_thickness_mm", rng), common_meatus_width_mm=narrow), ()


def concha_bullosa(p: NoseParameters, rng: np.random.Generator) -> Changed:
    """One or both middle turbinates blown up by a cell of air inside them, of which the nose sees the outside.

    8 to 12 mm across where there is room: a millimetre is left to the septum, and a slit of the middle meatus; in a
    narrow nose it is smaller, down to 5 mm, or leans on the lateral wall (W. Bolger et al. 1991; sizes approximate).
    """
    at = layout_of(p)
    y, z = at.y_middle_head + float(rng.uniform(7, 10)), at.z_at(float(rng.uniform(24, 26)))
    here, level = np.array([y], np.float32), np.array([z], np.float32)
    bow = float(septum_centre_mm(p, at, here, level).item())
    around = y + np.array([-4, 0, 4], np.float32), z + np.array([-3, 0, 3], np.float32)
    lateral = float(lateral_wall_mm(p, at, *around).min())
    made = []
    for side in (-1, 1) if rng.integers(2) else (_side(rng),):
        medial = side * bow + float(septum_thickness_mm(p, at, here, level).item()) / 2
        across = max(min(float(rng.uniform(8, 12)), lateral - medial - _BESIDE_MM - _MEATUS_MM), _LEAST_BULLA_MM)
        made.append(Alteration(
            (side * (medial + _BESIDE_MM + across / 2), y, z),
            (across / 2, float(rng.uniform(7, 10)), float(rng.uniform(5, 7))),
            air=False,
        ))  # fmt: skip
    return p, tuple(made)


def septal_perforation(p: NoseParameters, rng: np.random.Generator) -> Changed:
    """A hole of 6 to 16 mm in the cartilage of the septum."""
    along, up = float(rng.uniform(3.0, 8.0)), float(rng.uniform(3.0, 6.0))
    y, z = float(rng.uniform(-20, -8)), float(rng.uniform(-8, 0))
    at = layout_of(p)
    here, height = np.array([y], np.float32), np.array([z], np.float32)
    x = float(septum_centre_mm(p, at, here, height).item())
    thick = float(septum_thickness_mm(p, at, here, height).item())
    # Through the septum over most of the hole, and hardly beyond it.
    across = (thick / 2 + 0.6) / _THROUGH
    return p, (Alteration((x, y, z), (across, along, up), air=True),)


def after_sinus_surgery(p: NoseParameters, rng: np.random.Generator) -> Changed:
    """The lateral wall of both middle meatuses opened into cavities where the anterior ethmoid and the ostium were."""
    made = []
    for side in (-1, 1):
        wall = p.middle_meatus_half_width_mm
        made.append(Alteration(
            (side * (wall + 1), float(rng.uniform(-8, 0)), float(rng.uniform(0, 4))),
            (float(rng.uniform(4, 6)), float(rng.uniform(8, 12)), float(rng.uniform(5, 8))),
            air=True,
        ))  # fmt: skip
    return p, tuple(made)


def polyps(p: NoseParameters, rng: np.random.Generator) -> Changed:
    """Two to four polyps of 8 to 15 mm that hang out of the middle meatus, longer than wide, on one side or both; half
    of each stands free in the air at least."""
    at = layout_of(p)
    grid = grid_for(p, at, _COARSE_MM)
    air = lumen_field(p, at, grid) > 0
    lateral = np.abs(grid.x) > 0.4 * p.middle_meatus_half_width_mm
    along = (grid.y > at.y_middle_head) & (grid.y < at.y_middle_head + 0.6 * p.middle_length_mm)
    places = np.argwhere(air & lateral & along & (grid.z > at.z_at(14)) & (grid.z < at.z_at(23)))
    made: list[Alteration] = []
    wanted = int(rng.integers(2, 5))
    for _ in range(_DRAWS):
        if len(made) == wanted or not len(places):
            break
        i, j, k = places[rng.integers(len(places))]
        half = float(rng.uniform(4.0, 7.5))
        centre = (float(grid.x_mm[i]), float(grid.y_mm[j]), float(grid.z_mm[k]))
        polyp = Alteration(centre, (0.55 * half, 0.7 * half, half), air=False)
        body = polyp.inside_mm(grid) > 0
        if body.any() and (air & body).sum() >= _IN_AIR * body.sum():
            made.append(polyp)
    return p, tuple(made)


VARIANTS: Mapping[str, Callable[[NoseParameters, np.random.Generator], Changed]] = {
    "deviated septum": deviated_septum,
    "turbinate hypertrophy": turbinate_hypertrophy,
    "concha bullosa": concha_bullosa,
    "septal perforation": septal_perforation,
    "after sinus surgery": after_sinus_surgery,
    "polyps": polyps,
}


def varied(name: str, parameters: NoseParameters, rng: np.random.Generator) -> Changed:
    """A variant of a nose.

    Raises:
        InputError: if there is none of that name.
    """
    if name not in VARIANTS:
        raise InputError(f"one of {', '.join(VARIANTS)}", repr(name), "name one of those")
    return VARIANTS[name](parameters, rng)


def altered(lumen: Field, grid: Grid, alterations: tuple[Alteration, ...]) -> Field:
    """The lumen with all of them, in their order."""
    for alteration in alterations:
        lumen = alteration(lumen, grid)
    return lumen


def told(alterations: tuple[Alteration, ...]) -> str:
    """In words, for the record."""
    return "; ".join(
        f"{'air' if one.air else 'tissue'} of {'×'.join(f'{r:.3g}' for r in one.radii_mm)} mm at "
        f"({', '.join(f'{c:.3g}' for c in one.centre_mm)})"
        for one in alterations
    )


def _beyond(name: str, rng: np.random.Generator) -> float:
    """A value beyond the upper end of the normal range, up to what the generator accepts."""
    normal = NORMAL_RANGES[name]
    return float(normal.high + (normal.maximum - normal.high) * rng.uniform(_BEYOND, 1.0))


def _side(rng: np.random.Generator) -> int:
    return int(2 * rng.integers(2) - 1)
