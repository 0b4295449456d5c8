"""Each variant is what it is called: measured in the anatomy, beside the same nose without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.anatomy.builtin import NORMAL_RANGES, NoseParameters, built_in_nose
from naris.anatomy.builtin.variants import VARIANTS, Alteration, varied
from naris.anatomy.checks import check_surface
from naris.anatomy.distance import signed_distance
from naris.core.anatomy import Anatomy
from naris.errors import InputError

PLAIN = replace(NoseParameters(), irregularity_mm=0.0)


def volume_ml(nose: Anatomy) -> float:
    return abs(float(check_surface(nose.vertices_mm, nose.faces).volume_ml))


def made(name: str, seed: int) -> Anatomy:
    parameters, alterations = varied(name, PLAIN, np.random.default_rng(seed))
    return built_in_nose(parameters, alterations=alterations, passages=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIANTS)
def test_every_variant_is_a_closed_nose_of_its_own(name: str) -> None:
    one, other = made(name, 0), made(name, 1)
    for nose in (one, other):
        report = check_surface(nose.vertices_mm, nose.faces)
        assert report.closed
        assert not report.inside_out
        assert report.pieces == 1
    assert one.digest != other.digest
    more_air = {
        "after sinus surgery": True,
        "septal perforation": True,
        "polyps": False,
        "turbinate hypertrophy": False,
    }
    if name in more_air:
        plain = volume_ml(built_in_nose(PLAIN, passages=False))
        assert (volume_ml(one) > plain) == more_air[name]


@pytest.mark.slow
def test_a_perforation_joins_the_two_sides() -> None:
    """One handle more than the nose without it, and air where the septum was."""
    parameters, (hole,) = varied("septal perforation", PLAIN, np.random.default_rng(0))
    noses = [built_in_nose(parameters, alterations=some, passages=False) for some in ((), (hole,))]
    genus = [check_surface(nose.vertices_mm, nose.faces).genus for nose in noses]
    assert genus[1] == genus[0] + 1
    inside = [bool(signed_distance(nose, 1.0).inside(np.array([hole.centre_mm]))[0]) for nose in noses]
    assert inside == [False, True]


def test_swollen_and_bowed_parts_are_beyond_the_normal_range() -> None:
    of = {
        "deviated septum": "septum_deviation_mm",
        "turbinate hypertrophy": "inferior_thickness_mm",
        "concha bullosa": "middle_thickness_mm",
    }
    for name, parameter in of.items():
        values = [getattr(varied(name, PLAIN, np.random.default_rng(seed))[0], parameter) for seed in range(20)]
        normal = NORMAL_RANGES[parameter]
        assert min(map(abs, values)) > normal.high
        assert max(map(abs, values)) <= normal.maximum
        assert len(set(values)) == 20
    bows = [varied("deviated septum", PLAIN, np.random.default_rng(s))[0].septum_deviation_mm for s in range(20)]
    assert min(bows) < 0 < max(bows)


def test_what_is_no_variant_or_no_alteration_is_refused() -> None:
    with pytest.raises(InputError, match="'runny'"):
        varied("runny", PLAIN, np.random.default_rng(0))
    for centre, radii in (((0, 0, np.nan), (1, 1, 1)), ((0, 0, 0), (1, 0, 1))):
        with pytest.raises(InputError, match="radii above 0"):
            Alteration(centre, radii, air=True)
