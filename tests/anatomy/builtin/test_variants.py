"""Each variant is what it is called: measured in the anatomy, beside the same nose without it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from naris.anatomy.builtin import NORMAL_RANGES, NoseParameters, built_in_nose
from naris.anatomy.builtin.field import grid_for, lumen_field
from naris.anatomy.builtin.layout import layout_of
from naris.anatomy.builtin.nose import RESOLUTION_MM, shape_of
from naris.anatomy.builtin.variants import VARIANTS, Alteration, varied
from naris.anatomy.builtin.variation import drawn_parameters
from naris.anatomy.builtin.walls import septum_centre_mm, septum_thickness_mm
from naris.anatomy.checks import check_surface
from naris.anatomy.distance import signed_distance
from naris.core.anatomy import Anatomy
from naris.errors import InputError

PLAIN = replace(NoseParameters(), irregularity_mm=0.0)


def volume_ml(nose: Anatomy) -> float:
    return abs(float(check_surface(nose.vertices_mm, nose.faces).volume_ml))


@cache
def plain_ml() -> float:
    return volume_ml(built_in_nose(PLAIN, passages=False))


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
        "concha bullosa": False,
        "turbinate hypertrophy": False,
    }
    if name in more_air:
        assert (volume_ml(one) > plain_ml()) == more_air[name]


@pytest.mark.slow
def test_a_perforation_joins_the_two_sides() -> None:
    """One handle more than the nose without it, and air where the septum was."""
    parameters, (hole,) = varied("septal perforation", PLAIN, np.random.default_rng(0))
    noses = [built_in_nose(parameters, alterations=some, passages=False) for some in ((), (hole,))]
    genus = [check_surface(nose.vertices_mm, nose.faces).genus for nose in noses]
    assert genus[1] == genus[0] + 1
    inside = [bool(signed_distance(nose, 1.0).inside(np.array([hole.centre_mm]))[0]) for nose in noses]
    assert inside == [False, True]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_perforation_takes_the_septum_and_hardly_more(seed: int) -> None:
    """Of what became air, nearly all lies within the septum's own thickness, however it is bowed."""
    rng = np.random.default_rng(seed)
    p = replace(drawn_parameters(rng), irregularity_mm=0.0)
    _, (hole,) = varied("septal perforation", p, rng)
    at = layout_of(p)
    grid = grid_for(p, at, 0.5)
    lumen = lumen_field(p, at, grid)
    new = (hole(lumen, grid) > 0) & (lumen <= 0)
    middle = septum_centre_mm(p, at, grid.y_mm, grid.z_mm)[None]
    half = septum_thickness_mm(p, at, grid.y_mm, grid.z_mm)[None] / 2
    within = np.abs(grid.x - middle) < half + 1.0
    assert new.sum() > 100
    assert (new & within).sum() > 0.9 * new.sum()


@pytest.mark.slow
def test_every_polyp_stands_in_air() -> None:
    at = layout_of(PLAIN)
    grid = grid_for(PLAIN, at, 0.8)
    air = lumen_field(PLAIN, at, grid) > 0
    for seed in range(4):
        _, made = varied("polyps", PLAIN, np.random.default_rng(seed))
        assert 2 <= len(made) <= 4
        for one in made:
            body = one.inside_mm(grid) > 0
            assert (air & body).sum() > 0.4 * body.sum()


@pytest.mark.slow
@pytest.mark.parametrize("number", range(3))
def test_polyps_take_air_from_the_meatus(number: int) -> None:
    p = drawn_parameters(np.random.default_rng([0, number]))
    plain = (shape_of(p).lumen > 0).sum() * RESOLUTION_MM**3
    _, made = varied("polyps", p, np.random.default_rng(number))
    taken = plain - (shape_of(p, alterations=made).lumen > 0).sum() * RESOLUTION_MM**3
    assert taken > 100 * len(made)  # mm³


@pytest.mark.slow
@pytest.mark.parametrize("number", range(3))
def test_a_concha_bullosa_is_swollen_and_leaves_the_septum_free(number: int) -> None:
    p = replace(drawn_parameters(np.random.default_rng([0, number])), irregularity_mm=0.0)
    plain = shape_of(p)
    _, made = varied("concha bullosa", p, np.random.default_rng(number))
    swollen = shape_of(p, alterations=made)
    taken = ((plain.lumen > 0) & (swollen.lumen <= 0)).sum() * RESOLUTION_MM**3
    assert taken > 150 * len(made)  # mm³
    grid = swollen.grid
    for one in made:
        x, y, z = one.centre_mm
        assert one.radii_mm[0] > 2
        line = swollen.lumen[:, np.argmin(abs(grid.y_mm - y)), np.argmin(abs(grid.z_mm - z))]
        medial = (np.sign(x) * grid.x_mm > 0) & (np.abs(grid.x_mm) < abs(x))
        assert line[np.argmin(abs(grid.x_mm - x))] < 0
        assert (line[medial] > 0).any()


def test_swollen_and_bowed_parts_are_beyond_the_normal_range() -> None:
    of = {
        "deviated septum": "septum_deviation_mm",
        "turbinate hypertrophy": "inferior_thickness_mm",
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
