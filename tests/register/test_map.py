"""The map of an anatomy: places with room, what is seen from them, and the same from the cache as without it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from naris.anatomy.distance import known_distance
from naris.errors import InputError
from naris.register import map as room
from naris.register import map_file
from naris.register.directions import texel_directions
from naris.register.map import TEXELS, RegistrationMap, factor_of, registration_map
from naris.register.map_file import MapArrays, read_map, write_map
from tests.winding_tube import RADIUS_MM, winding_tube

SOME = MapArrays(np.zeros((2, 3, 4), np.float32), np.zeros((5, 3)), np.zeros((5, 6), np.uint8))


def made(cache: Path | None = None) -> RegistrationMap:
    """Of the tube, never the one that the process keeps."""
    return room._made(winding_tube(), 3.0, 0.8, cache)


def test_every_place_has_room_and_sees_its_walls() -> None:
    at = made()
    exact = at.distance.exact(at.places_mm)
    assert exact.min() > 0.8 - 1e-4
    ranges = 0.25 * np.exp(factor_of(at.panoramas.ravel().astype(np.int64))).reshape(at.panoramas.shape)
    # Of 1,024 directions one comes near the nearest wall; none goes past it.
    assert (ranges.min(axis=1) > exact - 0.05 * exact - 0.05).all()
    assert (ranges.min(axis=1) < 1.1 * exact + 0.3).all()
    across = np.abs(texel_directions(TEXELS) @ at.inward) < 0.1
    assert np.median(ranges[:, across]) == pytest.approx(RADIUS_MM, rel=0.1)


def test_from_the_cache_it_is_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = made(tmp_path / "maps")
    assert len(list((tmp_path / "maps").iterdir())) == 1
    monkeypatch.setattr(room, "_panoramas", _never)
    second = made(tmp_path / "maps")
    for name in ("places_mm", "panoramas", "inward"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    np.testing.assert_array_equal(first.distance.values_mm, second.distance.values_mm)
    np.testing.assert_array_equal(first.distance.origin_mm, second.distance.origin_mm)
    assert first.distance.spacing_mm == second.distance.spacing_mm


def test_other_settings_and_anatomies_have_other_files(tmp_path: Path) -> None:
    files = {
        map_file.map_file(tmp_path, anatomy, settings)
        for anatomy in ("a", "b")
        for settings in ((1.5, 0.8), (1.5, 0.9))
    }
    assert len(files) == 4
    assert map_file.map_file(tmp_path, "a", (1.5, 0.8)) in files


@pytest.mark.parametrize(
    "harm",
    [
        lambda content: b"",
        lambda content: content[: len(content) // 2],
        lambda content: content[:600] + bytes([content[600] ^ 255]) + content[601:],
        lambda content: b"no archive",
    ],
)
def test_a_broken_file_is_made_anew(harm: Callable[[bytes], bytes], tmp_path: Path) -> None:
    first = made(tmp_path)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    file.write_bytes(harm(whole))
    np.testing.assert_array_equal(made(tmp_path).panoramas, first.panoramas)
    assert read_map(file) is not None


def test_where_nothing_can_be_kept_it_is_made_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert len(made(tmp_path / "file").places_mm)


def test_the_files_that_were_used_last_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_file, "MOST_FILES", 3)
    files = [map_file.map_file(tmp_path, str(k), ()) for k in range(4)]
    for age, file in enumerate(files[:3]):
        write_map(file, SOME)
        os.utime(file, (1000 + age, 1000 + age))
    assert read_map(files[0]) is not None  # used now, so the second is the oldest
    write_map(files[3], SOME)
    assert set(tmp_path.iterdir()) == {files[0], files[2], files[3]}


def test_distances_of_another_grid_are_refused() -> None:
    with pytest.raises(InputError, match="compute them anew"):
        known_distance(winding_tube(), 0.4, np.zeros((2, 2, 2), np.float32))


def test_a_map_is_kept_in_the_process() -> None:
    assert registration_map(winding_tube(), 4.0) is registration_map(winding_tube(), 4.0)


def _never(*_: object) -> np.ndarray:
    raise AssertionError


def test_whichever_byte_is_broken_the_map_is_made_anew_or_right(tmp_path: Path) -> None:
    file = map_file.map_file(tmp_path, "a", ())
    write_map(file, SOME)
    whole = file.read_bytes()
    for at in range(len(whole)):
        for change in (1, 8, 255):
            file.write_bytes(whole[:at] + bytes([whole[at] ^ change]) + whole[at + 1 :])
            found = read_map(file)
            if found is not None:
                np.testing.assert_array_equal(found.panoramas, SOME.panoramas)


def test_a_cache_of_somebody_else_is_read_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = map_file.map_file(tmp_path, "a", ())
    write_map(file, SOME)

    def refused(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr("naris.register.map_file.os.utime", refused)
    assert read_map(file) is not None


def test_what_a_killed_writer_left_is_removed(tmp_path: Path) -> None:
    left, fresh = tmp_path / ".a.map.12.part.npz", tmp_path / ".b.map.34.part.npz"
    for one in (left, fresh):
        one.touch()
    os.utime(left, (1000, 1000))
    write_map(map_file.map_file(tmp_path, "a", ()), SOME)
    assert not left.exists()
    assert fresh.exists()


def test_of_one_lumen_each_anatomy_has_its_own_regions_and_passages() -> None:
    tube = winding_tube()
    bare = tube.with_(passages=(), regions={})
    assert bare.digest == tube.digest and tube.passages and tube.regions
    whole, without, again = (registration_map(one, 4.0) for one in (tube, bare, tube))
    assert without.anatomy is bare and without.panoramas is whole.panoramas
    np.testing.assert_array_equal(without.inward, [0.0, 1.0, 0.0])
    assert whole.inward[1] < 0.999
    assert again.anatomy is tube
    np.testing.assert_array_equal(again.inward, whole.inward)
