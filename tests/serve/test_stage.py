"""What the page is given of an anatomy is what the anatomy says."""

from __future__ import annotations

import numpy as np
import pytest

from naris.anatomy.distance import signed_distance
from naris.core.anatomy import Anatomy
from naris.render.appearance import ENDOSCOPE, PAPER
from naris.render.look import pack
from naris.serve import stage
from tests.serve.test_parcel import read


def test_the_surface_with_the_region_of_the_air_before_it(anatomy: Anatomy) -> None:
    regions = anatomy.region_set()
    about, arrays = read(stage.surface_parcel(anatomy, regions))
    np.testing.assert_allclose(arrays["vertices"], anatomy.vertices_mm, atol=1e-4)
    np.testing.assert_array_equal(arrays["faces"], anatomy.faces)
    np.testing.assert_allclose(np.linalg.norm(arrays["normals"], axis=1), 1, atol=1e-5)
    near = regions.label(anatomy.vertices_mm)
    assert (arrays["region"] == near).mean() > 0.97  # but at the borders
    assert [one["name"] for one in about["regions"]] == list(regions.names)
    assert about["digest"] == anatomy.digest
    np.testing.assert_allclose(arrays["passage0"], anatomy.passages[0].points_mm, atol=1e-4)
    assert about["missing"] == ["no landmarks to jump to"]


def test_the_room_is_the_distance_to_the_wall_and_the_region(anatomy: Anatomy) -> None:
    regions = anatomy.region_set()
    about, arrays = read(stage.room_parcel(anatomy, regions))
    rng, distance = np.random.default_rng(0), signed_distance(anatomy)
    values = arrays["distance"]
    node = np.stack([rng.integers(0, n, 500) for n in values.shape], axis=-1)
    places = np.array(about["origin"]) + about["spacing"] * node
    told = values[tuple(node.T)] * about["step"]
    inside = distance(places) > 0.1
    assert inside.sum() > 20
    np.testing.assert_allclose(told[inside], distance.exact(places[inside]), atol=0.002)
    assert (told[distance(places) < -0.1] < 0).all()
    every = about["stride"]
    coarse = np.stack([rng.integers(0, n, 500) for n in arrays["region"].shape], axis=-1)
    label = regions.label(np.array(about["origin"]) + every * about["spacing"] * coarse)
    np.testing.assert_array_equal(arrays["region"][tuple(coarse.T)], np.where(label < 0, about["nowhere"], label))


def test_the_look_is_that_of_the_renderer(anatomy: Anatomy) -> None:
    about, arrays = read(stage.look_parcel())
    looks = pack([ENDOSCOPE], 0)
    row = looks.rows[0]
    for name in ("blood", "vessel", "quadratic", "wrap_g", "vignette", "target"):
        assert about[name] == pytest.approx(float(row[name]))
    assert all(0 <= about[f"{field}_{axis}"] < about["edge"] for field in ("tissue", "relief") for axis in "xyz")
    np.testing.assert_array_equal(arrays["tissue"][3, 5, 7], looks.bank[row["bank"], 0, 7, 5, 3])
    np.testing.assert_array_equal(arrays["ramp"], looks.ramp[0])
    with pytest.raises(ValueError, match="only a mucosa"):
        stage.look_parcel(PAPER)


def test_places_stand_in_the_lumen_and_regions_in_theirs(anatomy: Anatomy) -> None:
    regions, distance = anatomy.region_set(), signed_distance(anatomy)
    found = stage.places(anatomy, regions)
    assert [one.name for one in found if one.kind == "region"] == list(regions.names)
    for one in found:
        place = one.anatomy_T_camera.position_mm
        assert distance(place) > 0.3
        if one.kind == "region":
            assert regions.names[int(regions.label(place))] == one.name
    assert distance(stage.start_pose(anatomy).position_mm) > 0.3


def test_without_regions_and_passages_it_says_so_and_begins_in_the_widest_place(anatomy: Anatomy) -> None:
    bare = anatomy.with_(regions={}, passages=(), landmarks_mm={})
    about, arrays = read(stage.surface_parcel(bare, None))
    assert [one.split(":")[0] for one in about["missing"]] == ["no regions", "no passages", "no landmarks to jump to"]
    assert (arrays["region"] == stage.NOWHERE).all()
    assert about["places"] == []
    widest = signed_distance(bare)(stage.start_pose(bare).position_mm)
    assert widest == pytest.approx(signed_distance(bare).values_mm.max(), abs=0.3)
    _, room = read(stage.room_parcel(bare, None))
    assert (room["region"] == stage.NOWHERE).all()
