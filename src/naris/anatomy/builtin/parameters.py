"""The named parameters of the built-in nose, each with its normal range in adults and where that comes from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

from naris.errors import InputError

LANG = "Lang 1989, Clinical Anatomy of the Nose, Nasal Cavity and Paranasal Sinuses (Thieme)"
GRAY = "Standring (ed.), Gray's Anatomy"


@dataclass(frozen=True)
class NormalRange:
    """What is normal for one parameter in adults.

    Attributes:
        low, high: the ends of the normal range, in `unit`.
        minimum, maximum: the widest values that the generator accepts.
        meaning: what is measured, from where to where.
        source: author, year and journal; `approximate` marks a range that was rounded or pieced together.
    """

    low: float
    high: float
    minimum: float
    maximum: float
    unit: str
    meaning: str
    source: str


def _measured(
    default: float | int,
    normal: tuple[float | int, float | int],
    accepted: tuple[float | int, float | int],
    meaning: str,
    source: str,
    unit: str = "mm",
) -> Any:
    """A dataclass field with its `NormalRange` as metadata."""
    low, high, minimum, maximum = (float(end) for end in (*normal, *accepted))
    measured = NormalRange(low, high, minimum, maximum, unit, meaning, source)
    return field(default=float(default), metadata={"range": measured})


@dataclass(frozen=True)
class NoseParameters:
    """The built-in nose in numbers: a decongested adult nose, so that a 3–4 mm endoscope passes.

    Lengths are mm, angles degrees. `NORMAL_RANGES` gives the normal range and source of each.

    Raises:
        InputError: if a value is not finite or outside what the generator accepts.
    """

    # The whole cavity
    cavity_length_mm: float = _measured(
        72,
        (64, 82),
        (58, 90),
        "tip of the nostril to the choana, along y",
        "Öksüzler et al. 2019, Int J Morphol 37:22 (columella to sphenoid sinus 66 ± 5 mm in women, 72 ± 5 mm in men); "
        "approximate",
    )
    cavity_height_mm: float = _measured(
        43, (38, 48), (34, 54), "nasal floor to the cribriform plate", f"{LANG}; approximate"
    )
    inferior_meatus_half_width_mm: float = _measured(
        16.5, (13, 19), (11, 22), "midline to the lateral wall of the inferior meatus", f"{LANG}; approximate"
    )
    middle_meatus_half_width_mm: float = _measured(
        14.0, (11, 16), (10, 18), "midline to the lateral wall of the middle meatus", f"{LANG}; approximate"
    )
    # Nostril, vestibule and valve
    nostril_length_mm: float = _measured(
        13,
        (10, 16),
        (8, 20),
        "long axis of the nostril",
        "Farkas, Hreczko, Deutsch 1983, Ann Plast Surg 11:381; approximate",
    )
    nostril_width_mm: float = _measured(
        7.5,
        (5, 10),
        (4, 13),
        "short axis of the nostril",
        "Farkas, Hreczko, Deutsch 1983, Ann Plast Surg 11:381; approximate",
    )
    columella_width_mm: float = _measured(
        6.5, (5, 8.5), (4, 11), "skin to skin between the nostrils", "Farkas 1994, Anthropometry of the Head and Face"
    )
    valve_distance_mm: float = _measured(
        17,
        (13, 22),
        (13, 24),
        "centre of the nostril to the internal nasal valve",
        "Haight, Cole 1983, Laryngoscope 93:49; Lenders, Pirsig 1990, Rhinology 28:5; approximate",
    )
    valve_angle_deg: float = _measured(
        13,
        (10, 15),
        (8, 22),
        "between septum and upper lateral cartilage",
        "Kasperbauer, Kern 1987, Otolaryngol Clin North Am 20:699",
        unit="°",
    )
    # Septum
    septum_thickness_mm: float = _measured(
        3.0,
        (2, 4.5),
        (1.5, 6),
        "mucosa to mucosa, middle of the septum",
        "Saunders et al. 1995, Clin Otolaryngol 20 (mucosa 0.5 to 3.5 mm a side); approximate",
    )
    septal_swell_body_mm: float = _measured(
        4.4,
        (0, 9),
        (0, 10),
        "what the septal swell body adds to the thickness (decongested)",
        "Costa et al. 2010, Arch Otolaryngol Head Neck Surg 136:1107 (whole width 12.4 ± 1.9 mm, not decongested)",
    )
    septum_deviation_mm: float = _measured(
        1.6,
        (-3, 3),
        (-5, 5),
        "largest shift from the midline; positive to the patient's left",
        "Mladina et al. 2008, Am J Otolaryngol 29:75 (most septa deviate); millimetres approximate",
    )
    septal_spur_mm: float = _measured(
        1.0,
        (0, 3),
        (0, 4),
        "height of the crest above the vomer, on the convex side",
        "Mladina et al. 2008; approximate",
    )
    # Inferior turbinate
    inferior_head_distance_mm: float = _measured(
        24,
        (20, 30),
        (18, 34),
        "centre of the nostril to the head of the inferior turbinate",
        "Lenders, Pirsig 1990, Rhinology 28:5; Corey et al. 1999, Otolaryngol Head Neck Surg 121:572; approximate",
    )
    inferior_length_mm: float = _measured(
        46, (40, 52), (34, 58), "length of the inferior turbinate", f"{LANG}; approximate"
    )
    inferior_thickness_mm: float = _measured(
        7.2,
        (5, 9),
        (4, 11),
        "thickness of its body at mid-length (decongested)",
        "Berger, Balum-Azim, Ophir 2003, Laryngoscope 113:1192; El-Anwar et al. 2017, Int Arch Otorhinolaryngol 21(4); "
        "approximate",
    )
    inferior_height_mm: float = _measured(
        14.4, (11, 18), (9, 20), "root to lower border of the inferior turbinate", f"{LANG}; approximate"
    )
    inferior_floor_gap_mm: float = _measured(
        3.3, (1, 5), (0.8, 6), "lower border of the inferior turbinate to the floor", f"{LANG}; approximate"
    )
    common_meatus_width_mm: float = _measured(
        3.4,
        (2, 5),
        (1.2, 7),
        "septum to inferior turbinate (decongested)",
        "Guilmette, Wicks, Wolff 1989, J Aerosol Med 2:365; approximate",
    )
    # Middle turbinate
    middle_head_setback_mm: float = _measured(
        9, (6, 14), (4, 18), "head of the inferior to head of the middle turbinate, along y", f"{LANG}; approximate"
    )
    middle_length_mm: float = _measured(
        37,
        (32, 45),
        (28, 50),
        "length of the middle turbinate",
        f"{LANG}; Lee et al. 2006, Clin Anat 19 (18.5 mm to the head of the superior turbinate); approximate",
    )
    middle_thickness_mm: float = _measured(
        5.4, (4, 8), (3, 10), "thickest part of the middle turbinate", f"{LANG}; approximate"
    )
    middle_olfactory_gap_mm: float = _measured(
        2.5, (1, 4), (0.8, 6), "septum to the body of the middle turbinate (decongested)", f"{LANG}; approximate"
    )
    # Superior turbinate, olfactory cleft
    superior_length_mm: float = _measured(
        16,
        (12, 21),
        (8, 24),
        "length of the superior turbinate",
        "Orhan, Govsa, Saylam 2010, Eur Arch Otorhinolaryngol 267:909; approximate",
    )
    superior_thickness_mm: float = _measured(
        3.0,
        (2, 4.5),
        (1.5, 6),
        "thickest part of the superior turbinate",
        "Orhan, Govsa, Saylam 2010, Eur Arch Otorhinolaryngol 267:909; approximate",
    )
    olfactory_cleft_width_mm: float = _measured(
        1.8,
        (1, 2.7),
        (0.8, 4),
        "septum to the vertical lamella of the middle turbinate",
        "Chan, Lee, Thamboo 2023, Acta Otorhinolaryngol Ital (2.0–2.3 ± 0.7 mm between bones); "
        "Leopold 1988, Laryngoscope 98:1232",
    )
    # Choana and nasopharynx
    choana_width_mm: float = _measured(12.5, (10, 15), (8, 18), "one choana, at its widest", f"{GRAY} (about 12.5 mm)")
    choana_height_mm: float = _measured(25, (20, 30), (17, 34), "one choana, at its highest", f"{GRAY} (about 25 mm)")
    nasopharynx_depth_mm: float = _measured(
        20,
        (17, 26),
        (12, 32),
        "choana to the posterior wall",
        "Normal nasopharyngeal measurement by computed tomography in adult, 2017, J Craniofac Surg 28(4) "
        "(21.8 ± 4.6 mm)",
    )
    nasopharynx_width_mm: float = _measured(
        34, (28, 42), (24, 48), "between the pharyngeal recesses", f"{GRAY}; approximate"
    )
    torus_radius_mm: float = _measured(
        3.2, (2, 5), (1.5, 6), "half the thickness of the torus tubarius", f"{GRAY}; approximate"
    )
    # Irregularity
    irregularity_mm: float = _measured(
        0.30, (0, 0.6), (0, 1.2), "amplitude of the smooth irregularity of all walls", "chosen by eye against CT"
    )
    irregularity_seed: int = 1

    def __post_init__(self) -> None:
        for name, normal in NORMAL_RANGES.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                raise InputError(f"{name} as a finite number", repr(value), "correct the parameter")
            if not normal.minimum <= value <= normal.maximum:
                raise InputError(
                    f"{name} between {normal.minimum:g} and {normal.maximum:g} {normal.unit} ({normal.meaning})",
                    f"{value:g}",
                    f"adults have {normal.low:g}–{normal.high:g} {normal.unit}",
                )
        if (
            isinstance(self.irregularity_seed, bool)
            or not isinstance(self.irregularity_seed, int)
            or self.irregularity_seed < 0
        ):
            raise InputError("irregularity_seed as a whole number from 0", repr(self.irregularity_seed), "give a seed")


NORMAL_RANGES: dict[str, NormalRange] = {
    f.name: f.metadata["range"] for f in fields(NoseParameters) if "range" in f.metadata
}
"""Normal range, unit, meaning and source by the name of the parameter."""
