"""The picture of the surface against rays counted one by one."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from naris.core.anatomy import NOWHERE, Anatomy, Between, GridRegions, SlabRegions
from naris.report.pictures import region_colours
from naris.report.surface_picture import FROM_ABOVE, FROM_FRONT, FROM_LEFT, Aspect, _k_buffer, draw_surface

ASPECTS = (FROM_LEFT, FROM_FRONT, FROM_ABOVE)
RED_BLUE = np.array([[255, 0, 0], [0, 0, 255]], dtype=np.uint8)
HALVES = SlabRegions("halves", ("front", "back"), "mean", 1, (0.0,))


def ball(radius_mm: float = 6.0) -> Anatomy:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius_mm)
    return Anatomy(mesh.vertices, np.asarray(mesh.faces, dtype=np.int32), "mean", "ball", "test", {"halves": HALVES})


@pytest.mark.parametrize("aspect", ASPECTS, ids=lambda a: a.name)
def test_axes_are_right_handed_towards_the_eye(aspect: Aspect) -> None:
    frame = np.stack([aspect.right, aspect.up, aspect.towards_eye])
    assert np.linalg.det(frame) == pytest.approx(1.0)
    eye = {"from the left": [1, 0, 0], "from the front": [0, -1, 0], "from above": [0, 0, 1]}[aspect.name]
    assert aspect.towards_eye == pytest.approx(eye)


@pytest.mark.parametrize("aspect", ASPECTS, ids=lambda a: a.name)
def test_outline_of_a_ball_is_a_disc(aspect: Aspect) -> None:
    picture = draw_surface(ball(), HALVES, RED_BLUE, aspect, px_per_mm=8)
    height, width = picture.rgba.shape[:2]
    y, x = np.mgrid[:height, :width]
    from_centre_mm = np.hypot(*(np.stack([x, y]) / 8 + 0.5 / 8 + picture.corner_mm[:, None, None]))
    covered = picture.rgba[..., 3] > 0
    assert covered[from_centre_mm < 5.9].all()
    assert not covered[from_centre_mm > 6.01].any()


def test_halves_have_their_colours_and_points_meet_the_picture() -> None:
    picture = draw_surface(ball(), HALVES, RED_BLUE, FROM_LEFT, px_per_mm=8)
    for y_mm, strong, weak in ((-4.0, 0, 2), (4.0, 2, 0)):
        column, row = ((FROM_LEFT.flatten(np.array([0.0, y_mm, 1.0])) - picture.corner_mm) * 8).astype(int)
        rgba = picture.rgba[row, column].astype(int)
        assert rgba[strong] > rgba[weak] + 60


@pytest.mark.parametrize(("airspace", "hidden"), [(Between(), False), (None, True)])
def test_regions_are_looked_up_on_the_side_of_the_air(airspace: Between | None, hidden: bool) -> None:
    """Labels only outside the ball: visible where the air is outside, grey where it is inside."""
    grid = np.stack(np.meshgrid(*[np.arange(-10, 10.5, 0.5)] * 3, indexing="ij"), axis=-1)
    labels = np.where(np.linalg.norm(grid, axis=-1) > 6.3, 0, NOWHERE).astype(np.int8)
    around = GridRegions("around", ("air",), "mean", labels, np.full(3, -10.0), 0.5)
    anatomy = ball() if airspace is None else ball().with_(airspace=airspace)
    rgba = draw_surface(anatomy, around, RED_BLUE[:1], FROM_LEFT, px_per_mm=6).rgba
    middle = rgba[rgba.shape[0] // 2, rgba.shape[1] // 2].astype(int)
    assert bool(abs(middle[0] - middle[2]) < 20) is hidden


def test_layers_agree_with_rays_counted_one_by_one() -> None:
    rng = np.random.default_rng(4)
    corners = rng.uniform(0, 40, (25, 3, 3))
    faces = np.arange(75, dtype=np.int32).reshape(25, 3)
    found, place = _k_buffer(corners.reshape(-1, 3).astype(np.float32), faces, np.array([40, 40, 8]))
    for y in range(0, 40, 3):
        for x in range(0, 40, 3):
            hits = []
            for f, (a, b, c) in enumerate(corners):
                solve = np.linalg.solve(np.array([[a[0], b[0], c[0]], [a[1], b[1], c[1]], [1, 1, 1]]), [x, y, 1.0])
                if np.abs(solve).min() < 1e-4:
                    break  # too near an edge for the two to have to agree
                if (solve > 0).all():
                    hits.append((solve @ [a[2], b[2], c[2]], f, solve[:2]))
            else:
                nearest = sorted(hits, key=lambda hit: hit[0])[-8:]
                used = found[y, x] >= 0
                assert found[y, x][used].tolist() == [f for _, f, _ in nearest]
                for got, (_, _, weights) in zip(place[y, x][used], nearest, strict=True):
                    assert got == pytest.approx(weights, abs=1e-3)


def test_sides_share_a_hue_and_all_colours_differ() -> None:
    names = tuple(f"{side} {name}" for side in ("left", "right") for name in ("valve", "inferior meatus", "cleft"))
    colours = region_colours((*names, "nasopharynx"))
    assert len({tuple(c) for c in colours.tolist()}) == 7
    assert colours.dtype == np.uint8
    left, right = colours[0].astype(int), colours[3].astype(int)
    assert left.argmax() == right.argmax()
    assert left.sum() > right.sum()
    assert len({tuple(c) for c in region_colours(tuple(f"region {i}" for i in range(20))).tolist()}) == 20
