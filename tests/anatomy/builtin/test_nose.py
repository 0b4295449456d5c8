"""The built-in nose as a whole: a closed surface, sides where they belong, open passages, the shape of a nose."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from naris.anatomy.builtin import NORMAL_RANGES, NoseParameters, built_in_nose
from naris.anatomy.builtin.field import grid_for, lumen_field
from naris.anatomy.builtin.layout import layout_of
from naris.anatomy.builtin.nose import Shape, shape_of
from naris.anatomy.level_set import softened
from naris.core.anatomy import Anatomy
from naris.errors import InputError

COARSE_MM, FAIR_MM = 1.0, 0.8
SMOOTH = {"irregularity_mm": 0.0, "septal_spur_mm": 0.0}


@pytest.fixture(scope="module")
def mesh(nose: Anatomy) -> trimesh.Trimesh:
    return trimesh.Trimesh(nose.vertices_mm, nose.faces, process=False)


@pytest.fixture(scope="module")
def shape() -> Shape:
    return shape_of(NoseParameters())


def air_mm2(shape: Shape, sign: int) -> tuple[np.ndarray, np.ndarray]:
    """y (mm) and the coronal sections of the air of one side there, by counting voxels."""
    side = shape.lumen[sign * shape.grid.x_mm > 0] > 0
    return shape.grid.y_mm, side.sum(axis=(0, 2)) * shape.grid.spacing_mm**2


def runs_of_air(shape: Shape, sign: int, y_mm: float, z_mm: float) -> list[tuple[float, float]]:
    """Where a line from the midline to the side passes through air: (from, to) in mm from the midline."""
    grid = shape.grid
    profile = shape.lumen[:, np.argmin(abs(grid.y_mm - y_mm)), np.argmin(abs(grid.z_mm - z_mm))]
    u = np.arange(0, 20, 0.01)
    air = np.interp(sign * u, grid.x_mm, profile) > 0
    edges = u[1:][np.diff(air.astype(int)) != 0]
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=False))


def is_closed_manifold(faces: np.ndarray) -> bool:
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    _, directed = np.unique(edges @ [2**31, 1], return_counts=True)
    _, undirected = np.unique(np.sort(edges, axis=1) @ [2**31, 1], return_counts=True)
    return bool((directed == 1).all() and (undirected == 2).all())


def test_surface_is_a_closed_manifold_in_one_piece_without_handles(nose: Anatomy, mesh: trimesh.Trimesh) -> None:
    assert is_closed_manifold(nose.faces)
    assert len(mesh.split(only_watertight=False)) == 1
    assert mesh.euler_number == 2  # the two sides meet behind the septum only: no synechia, no perforation
    assert 60_000 <= len(nose.faces) <= 150_000


def test_normals_point_from_the_lumen_to_the_tissue(nose: Anatomy, mesh: trimesh.Trimesh) -> None:
    assert mesh.volume > 0
    centre = nose.landmarks_mm["nasopharynx"]
    assert mesh.contains([centre])[0]
    nearest = np.argmin(np.linalg.norm(nose.vertices_mm - centre, axis=1))
    assert nose.vertex_normals[nearest] @ (nose.vertices_mm[nearest] - centre) > 0


def test_it_lies_where_the_frame_says(nose: Anatomy, mesh: trimesh.Trimesh) -> None:
    low, high = nose.bounds_mm
    p = NoseParameters()
    assert low[1] == pytest.approx(-45, abs=1.0)
    assert high[1] == pytest.approx(-45 + p.cavity_length_mm + p.nasopharynx_depth_mm, abs=2.5)
    assert high[2] == pytest.approx(-18 + p.cavity_height_mm, abs=1.0)
    z = np.arange(-24, -15, 0.1)
    column = mesh.contains(np.stack([np.full_like(z, 7.0), np.full_like(z, 5.0), z], axis=-1))
    assert z[np.argmax(column)] == pytest.approx(-18, abs=0.8)  # the nasal floor
    labels = nose.regions["paper"].label(nose.vertices_mm)
    assert (np.bincount(labels, minlength=4) > 0.05 * len(labels)).all()


def test_left_is_positive_x(nose: Anatomy) -> None:
    regions = nose.regions["anatomical"]
    for side, sign in (("left", 1), ("right", -1)):
        for name, point in nose.landmarks_mm.items():
            if name.startswith(f"{side}."):
                assert sign * point[0] > 0, name
                label = int(regions.label(point))
                assert label >= 0 and regions.names[label].split()[0] in (side, "nasopharynx"), name
        for passage in nose.passages:
            if passage.name.startswith(f"{side}."):
                anterior = passage.points_mm[passage.points_mm[:, 1] < 20]
                assert (sign * anterior[:, 0] > 0).all(), passage.name


@pytest.mark.parametrize("deviation_mm", [3.0, -3.0])
def test_a_deviated_septum_narrows_its_side(deviation_mm: float) -> None:
    bent = shape_of(NoseParameters(septum_deviation_mm=deviation_mm), COARSE_MM)
    (y_mm, left), (_, right) = air_mm2(bent, 1), air_mm2(bent, -1)
    bow = (y_mm > -20) & (y_mm < 0)
    assert (left[bow].sum() < right[bow].sum()) == (deviation_mm > 0)


def test_mirrored_parameters_give_the_mirrored_nose() -> None:
    """Before small handles are closed, which breaks ties by the order of nodes."""
    fields = []
    for deviation_mm in (2.0, -2.0):
        p = NoseParameters(septum_deviation_mm=deviation_mm, septal_spur_mm=2.0, irregularity_mm=0.0)
        at = layout_of(p)
        fields.append(softened(lumen_field(p, at, grid_for(p, at, COARSE_MM)), COARSE_MM))
    one, other = fields
    assert np.abs(one - other[::-1]).max() < 0.05
    assert np.abs(one - other).max() > 1.0


def test_the_same_parameters_give_the_same_bits() -> None:
    first, second, other = (shape_of(NoseParameters(irregularity_seed=seed), COARSE_MM) for seed in (3, 3, 4))
    assert (first.vertices_mm == second.vertices_mm).all() and (first.faces == second.faces).all()
    assert first.vertices_mm.shape != other.vertices_mm.shape or (first.vertices_mm != other.vertices_mm).any()


def test_resolution_does_not_change_the_shape(nose: Anatomy) -> None:
    coarse = shape_of(NoseParameters(), COARSE_MM)
    apart, _ = cKDTree(nose.vertices_mm).query(coarse.vertices_mm)
    assert np.quantile(apart, 0.95) < 0.65  # the spacing of the vertices themselves is about 0.5 mm


@pytest.mark.parametrize("side", ["left", "right"])
def test_passages_lead_through_open_air(nose: Anatomy, mesh: trimesh.Trimesh, side: str) -> None:
    for name in ("septal", "inferior", "middle", "superior"):
        passage = nose.passage(f"{side}.{name}")
        assert mesh.contains(passage.points_mm).all()
        start = passage.points_mm[0]
        assert np.linalg.norm(start - nose.landmarks_mm[f"{side}.nostril"]) < 2
        assert passage.clearance_mm[10:].min() > 0.9  # a camera needs 1 mm; narrow places lie in the meatuses
    assert nose.passage(f"{side}.septal").clearance_mm[10:].min() > 1.2
    assert nose.passage(f"{side}.middle").clearance_mm[10:].min() > 1.2
    assert np.linalg.norm(nose.passage(f"{side}.septal").points_mm[-1] - nose.landmarks_mm["nasopharynx"]) < 2


@pytest.mark.parametrize(("gap_mm", "thick_mm"), [(3.4, 7.2), (4.4, 5.6)])
def test_common_meatus_and_inferior_turbinate_measure_what_was_asked(gap_mm: float, thick_mm: float) -> None:
    """On a coronal section, as a reader would measure them."""
    p = NoseParameters(common_meatus_width_mm=gap_mm, inferior_thickness_mm=thick_mm, **SMOOTH)
    made = shape_of(p, FAIR_MM)
    for sign in (1, -1):
        runs = [runs_of_air(made, sign, y_mm=6.0, z_mm=z) for z in np.arange(-13, -6, 0.65)]
        assert min(run[0][1] - run[0][0] for run in runs) == pytest.approx(gap_mm, abs=0.6)
        assert max(run[1][0] - run[0][1] for run in runs) >= thick_mm - 0.6  # with the curled border it may be more


@pytest.mark.parametrize("thick_mm", [2.2, 4.2])
def test_septum_measures_what_was_asked(thick_mm: float) -> None:
    made = shape_of(NoseParameters(septum_thickness_mm=thick_mm, **SMOOTH), FAIR_MM)
    middle = [runs_of_air(made, sign, y_mm=14.0, z_mm=-2.0)[0][0] for sign in (1, -1)]
    assert sum(middle) == pytest.approx(thick_mm, abs=0.5)


@pytest.mark.parametrize("length_mm", [66.0, 78.0])
def test_the_septum_ends_at_the_choana(length_mm: float) -> None:
    made = shape_of(NoseParameters(cavity_length_mm=length_mm, **SMOOTH), COARSE_MM)
    middle = np.argmin(abs(made.grid.x_mm)), np.argmin(abs(made.grid.z_mm + 8))
    air = made.lumen[middle[0], :, middle[1]] > 0
    assert made.grid.y_mm[np.argmax(air)] == pytest.approx(-45 + length_mm, abs=3.0)


def test_coronal_sections_are_those_of_a_nose(shape: Shape) -> None:
    """Least section near the valve, within what 47 healthy adults have (Borojeni et al. 2020: 24 to 121 mm² a side)."""
    for sign in (1, -1):
        y_mm, areas = air_mm2(shape, sign)
        behind_vestibule = (y_mm > -33) & (y_mm < 26)
        least = y_mm[behind_vestibule][np.argmin(areas[behind_vestibule])]
        assert -31 < least < -22
        assert 24 < areas[behind_vestibule].min() < 121
        assert np.median(areas[(y_mm > 0) & (y_mm < 26)]) > 2 * areas[behind_vestibule].min()


@pytest.mark.slow
def test_noses_drawn_from_the_normal_ranges_are_closed_or_refused() -> None:
    rng = np.random.default_rng(11)
    made = 0
    for seed in range(8):
        drawn = {name: float(rng.uniform(normal.low, normal.high)) for name, normal in NORMAL_RANGES.items()}
        try:
            nose = shape_of(NoseParameters(**drawn, irregularity_seed=seed), COARSE_MM)
        except InputError:
            continue
        assert is_closed_manifold(nose.faces)
        made += 1
    assert made >= 6


@pytest.mark.parametrize("resolution_mm", [0.0, -1.0, float("nan"), 0.01, 5.0])
def test_absurd_resolutions_are_refused(resolution_mm: float) -> None:
    with pytest.raises(InputError, match="resolution"):
        built_in_nose(resolution_mm=resolution_mm)


def test_a_nose_without_room_for_its_turbinates_is_refused() -> None:
    with pytest.raises(InputError, match="middle turbinate"):
        built_in_nose(
            NoseParameters(cavity_length_mm=58.0, inferior_head_distance_mm=34.0, middle_head_setback_mm=18.0)
        )
