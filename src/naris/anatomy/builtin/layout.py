"""Where things lie: positions along y (anterior to posterior) and z (floor to roof) that follow from the parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass

from naris.anatomy.builtin.parameters import NoseParameters
from naris.errors import InputError

Y_TIP_MM = -45.0
"""The anterior margin of the nostrils: fixes the nose in its frame."""
Z_FLOOR_MM = -18.0
"""The nasal floor."""
NOSTRIL_BELOW_FLOOR_MM = 9.5
_VALVE_ABOVE_FLOOR_MM = 4.0
_NOMINAL_HEIGHT_MM = 43.0
_LEAST_SPAN_MM = 18.0
_LEAST_VESTIBULE_MM = 2.0
_LEAST_ATRIUM_MM = 3.0


@dataclass(frozen=True)
class Layout:
    """Positions in mm; names beginning with `y_` and `z_` are coordinates of the frame.

    What does not fit is moved or cut: the valve lies at least 2 mm behind the sill, the head of the inferior turbinate
    at least 3 mm behind the valve, and the turbinates end at the choana or the face of the sphenoid.
    """

    y_nostril: float
    y_sill: float
    y_valve: float
    y_inferior_head: float
    y_inferior_tail: float
    y_middle_head: float
    y_middle_tail: float
    y_superior_head: float
    y_superior_tail: float
    y_sphenoid_face: float
    y_choana: float
    y_posterior_wall: float
    z_nostril: float
    z_roof: float
    height_scale: float

    def z_at(self, height_mm: float | int) -> float:
        """The z of a height above the floor given for a cavity of nominal height; nothing below is scaled."""
        return Z_FLOOR_MM + float(height_mm) * (self.height_scale if height_mm > 0 else 1.0)


def layout_of(p: NoseParameters) -> Layout:
    """The layout that the parameters ask for.

    Raises:
        InputError: if parts do not fit one behind the other.
    """
    z_nostril = Z_FLOOR_MM - NOSTRIL_BELOW_FLOOR_MM
    y_nostril = Y_TIP_MM + p.nostril_length_mm / 2
    rise_mm = NOSTRIL_BELOW_FLOOR_MM + _VALVE_ABOVE_FLOOR_MM
    y_sill = Y_TIP_MM + p.nostril_length_mm
    y_valve = y_nostril + math.sqrt(max(p.valve_distance_mm**2 - rise_mm**2, 0.0))
    y_valve = max(y_valve, y_sill + _LEAST_VESTIBULE_MM)
    y_inferior_head = y_nostril + math.sqrt(max(p.inferior_head_distance_mm**2 - (rise_mm + 3) ** 2, 0.0))
    y_inferior_head = max(y_inferior_head, y_valve + _LEAST_ATRIUM_MM)
    y_choana = Y_TIP_MM + p.cavity_length_mm
    y_middle_head = y_inferior_head + p.middle_head_setback_mm
    y_sphenoid = y_choana - 7.0
    layout = Layout(
        y_nostril=y_nostril,
        y_sill=y_sill,
        y_valve=y_valve,
        y_inferior_head=y_inferior_head,
        y_inferior_tail=min(y_inferior_head + p.inferior_length_mm, y_choana + 0.5),
        y_middle_head=y_middle_head,
        y_middle_tail=min(y_middle_head + p.middle_length_mm, y_choana - 1.5),
        y_superior_head=max(y_sphenoid - 0.5 - p.superior_length_mm, y_middle_head + 8),
        y_superior_tail=y_sphenoid - 0.5,
        y_sphenoid_face=y_sphenoid,
        y_choana=y_choana,
        y_posterior_wall=y_choana + p.nasopharynx_depth_mm,
        z_nostril=z_nostril,
        z_roof=Z_FLOOR_MM + p.cavity_height_mm,
        height_scale=p.cavity_height_mm / _NOMINAL_HEIGHT_MM,
    )
    _require_room(layout)
    return layout


def _require_room(layout: Layout) -> None:
    """Refuses a nose with no room for its turbinates."""
    span_mm = layout.y_sphenoid_face - layout.y_middle_head
    if span_mm < _LEAST_SPAN_MM:
        raise InputError(
            f"at least {_LEAST_SPAN_MM:g} mm from the head of the middle turbinate to the face of the sphenoid",
            f"{span_mm:.1f} mm",
            "lengthen the cavity or move the heads of the turbinates forwards",
        )
