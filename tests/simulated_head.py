"""A head made by code, its scan and the airway found in it: made once in a process, as each takes seconds."""

from __future__ import annotations

from functools import cache

from naris.airway.segment import Airway, segment_airway
from naris.anatomy.builtin import built_in_nose
from naris.anatomy.virtual_ct import Scanner, virtual_ct
from naris.core.anatomy import Anatomy
from naris.core.volume import Volume


@cache
def nose() -> Anatomy:
    return built_in_nose()


@cache
def scan() -> Volume:
    return virtual_ct(nose(), Scanner())


@cache
def airway() -> Airway:
    return segment_airway(scan())
