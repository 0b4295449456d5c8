"""Whether a head lies in a scan as the header says, or looks back to front or upside down.

Neither air nor tissue tells where a face looks, so the search for a nose is asked: where it finds none, or one that is
odd, and finds a whole one in the same head turned round, the header is likely wrong. Only turns are tried: a mirrored
head has a nose like any other, and nothing in it tells left from right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from naris.airway.segment import LEFT, NASOPHARYNX, RIGHT, Airway, segment_airway
from naris.core.nasal_frame import LANDMARKS, NasalFrame
from naris.core.volume import Volume
from naris.ct.size import check_head_size
from naris.errors import InputError, ScanError

_TURNS = {
    "back to front": (-1.0, -1.0, 1.0),
    "upside down": (-1.0, 1.0, -1.0),
    "upside down and back to front": (1.0, -1.0, -1.0),
}
"""Half turns about the axes of the patient; a nose has two sides alike, so a mirrored head is found by them as well."""

_STEP_MM = 0.8
_LEAST_ABOVE_MM = 2.0


def airway_in(volume: Volume, steps_mm: Sequence[float]) -> Airway:
    """The airway of the nose on the first lattice that shows one.

    Args:
        volume: a CT of a head in LPS.
        steps_mm: of the lattices, in the order to try.

    Raises:
        ScanError: if there is none; the message says what is likely wrong with the scan where that can be seen, such as
            the unit of its spacings or the direction of an axis.
    """
    check_head_size(volume)
    reason: ScanError | None = None
    for step_mm in steps_mm:
        try:
            found = segment_airway(volume, step_mm)
        except ScanError as error:
            reason = error
            continue
        if not _odd(found):
            return found
        check_not_turned(volume)
        return found
    check_not_turned(volume)
    raise reason or ScanError("a lattice to look on", "none", "give one or more")


def check_not_turned(volume: Volume) -> None:
    """See that no nose comes to light in a head that is turned round (some ten seconds).

    Raises:
        ScanError: if one does.
    """
    for name, signs in _TURNS.items():
        turned = replace(volume, frame_T_index=np.diag([*signs, 1.0]) @ volume.frame_T_index)
        try:
            found = segment_airway(turned, _STEP_MM)
        except ScanError:
            continue
        if not _odd(found):
            raise ScanError(
                "a head whose face looks forwards and whose crown is on top, by the directions in the header",
                f"one that looks {name}: turned round, a nose is found in it",
                "mend the direction matrix or the order of the data, then see that left and right are not swapped",
            )


def _odd(airway: Airway) -> bool:
    """Whether what was found is unlike a nose that stands upright, though it may be one.

    A throat that was taken for a pharynx holds more air than the nose; and a nose lies above the line from its nostrils
    to its choanae, which are low, by 9 to 13 mm on average in real and virtual ones.
    """
    if airway.volume_ml(NASOPHARYNX) > airway.volume_ml(LEFT) + airway.volume_ml(RIGHT):
        return True
    try:
        frame = NasalFrame.of(airway.landmarks_mm)
    except InputError:
        return True
    nodes = np.argwhere((airway.labels == LEFT) | (airway.labels == RIGHT))
    middle_mm = frame.coordinates_mm(airway.block.points_mm(nodes.mean(axis=0)))
    ends_mm = np.mean([frame.coordinates_mm(airway.landmarks_mm[name]) for name in LANDMARKS], axis=0)
    return bool(middle_mm[2] - ends_mm[2] < _LEAST_ABOVE_MM)
