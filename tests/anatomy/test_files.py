"""Mesh files: round trips, other libraries as oracles, and everything that is no mesh."""

import logging
import struct

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from naris.anatomy.ply import ply_bytes, read_ply, write_surface
from naris.anatomy.read import read_surface
from naris.core.anatomy import Anatomy, Between, Enclosed
from naris.errors import SurfaceError

from .shapes import anatomy_of, box, sphere, torus

FORMATS = ["ply", "stl", "obj"]
COORDINATE = st.floats(-200, 200, width=32)


def same_surface(a, b, atol=1e-5):
    """The same triangles, whatever the order of vertices and faces."""

    def canonical(anatomy):
        corners = anatomy.vertices_mm[anatomy.faces]
        first = np.array([np.lexsort(c.round(3).T[::-1])[0] for c in corners])
        corners = corners[np.arange(len(corners))[:, None], (first[:, None] + np.arange(3)) % 3]
        return corners[np.lexsort(corners.reshape(len(corners), 9).round(3).T[::-1])]

    np.testing.assert_allclose(canonical(a), canonical(b), atol=atol)


@pytest.mark.parametrize("kind", FORMATS)
def test_what_trimesh_writes_is_read(tmp_path, kind):
    path = tmp_path / f"torus.{kind}"
    trimesh.Trimesh(torus().vertices_mm, torus().faces, process=False).export(path)
    same_surface(read_surface(path), torus())


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_both_kinds_of_ply_of_trimesh_are_read(tmp_path, encoding):
    path = tmp_path / "torus.ply"
    trimesh.Trimesh(torus().vertices_mm, torus().faces, process=False).export(path, encoding=encoding)
    read = read_surface(path)
    np.testing.assert_allclose(read.vertices_mm, torus().vertices_mm, atol=1e-5)
    np.testing.assert_array_equal(read.faces, torus().faces)


def test_text_stl_is_read(tmp_path):
    path = tmp_path / "box.stl"
    path.write_text(trimesh.exchange.stl.export_stl_ascii(trimesh.Trimesh(box().vertices_mm, box().faces)))
    same_surface(read_surface(path), box())


@pytest.mark.parametrize("compressed", [False, True], ids=["text", "compressed"])
def test_what_vtk_writes_is_read(tmp_path, compressed):
    pytest.importorskip("pyvista")
    import pyvista

    path = tmp_path / "sphere.vtp"
    pyvista.PolyData.from_regular_faces(sphere().vertices_mm, sphere().faces).save(path, binary=compressed)
    same_surface(read_surface(path), sphere())


def test_vtk_reads_what_is_written(tmp_path):
    pytest.importorskip("pyvista")
    import pyvista

    path = tmp_path / "torus.ply"
    write_surface(torus(), path)
    mesh = pyvista.read(path)
    np.testing.assert_allclose(mesh.points, torus().vertices_mm, atol=1e-5)
    np.testing.assert_array_equal(mesh.regular_faces, torus().faces)


@given(arrays(np.float64, (4, 3), elements=COORDINATE), st.booleans(), st.sampled_from(["LPS", "mean", "my_frame"]))
def test_ply_gives_back_every_bit(vertices, double, frame):
    vertices = vertices + np.pi * 1e-9 if double else vertices
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], dtype=np.int32)
    anatomy = Anatomy(vertices, faces, frame, "a name with\nline ends and ü", "a test")
    from pathlib import Path

    read = read_ply(Path("a.ply"), ply_bytes(anatomy))
    np.testing.assert_array_equal(read.vertices, anatomy.vertices_mm)
    np.testing.assert_array_equal(read.faces, faces)
    assert (read.space or "LPS") == frame


def ply_text(vertices, faces, header=""):
    rows = [" ".join(map(str, v)) for v in vertices] + [" ".join(map(str, [len(f), *f])) for f in faces]
    lines = [
        "ply", "format ascii 1.0", *([header] if header else []), f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"), f"element face {len(faces)}",
        "property list uchar int vertex_indices", "end_header", *rows,
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


CUBE = np.array([[x, y, z] for x in (0, 20) for y in (0, 20) for z in (0, 20)], dtype=float)
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def test_quadrilaterals_become_triangles(tmp_path):
    path = tmp_path / "cube.ply"
    path.write_text(ply_text(CUBE, QUADS))
    cube = read_surface(path)
    assert len(cube.faces) == 12
    assert trimesh.Trimesh(cube.vertices_mm, cube.faces).volume == pytest.approx(8000)


def test_other_elements_and_properties_are_passed_over(tmp_path):
    """Big-endian, colours on vertices, flags on faces, an unknown list element between the two."""
    header = (
        "ply\r\nformat binary_big_endian 1.0\r\ncomment made by hand\r\nelement vertex 8\r\nproperty uchar red\r\n"
        "property double x\r\nproperty double y\r\nproperty double z\r\nelement strip 2\r\n"
        "property list ushort short data\r\nelement face 6\r\nproperty uchar flag\r\n"
        "property list uint int vertex_index\r\nend_header\r\n"
    )
    body = b"".join(struct.pack(">Bddd", 7, *v) for v in CUBE)
    body += struct.pack(">Hhh", 2, -1, 5) + struct.pack(">H", 0)
    body += b"".join(struct.pack(">BIiiii", 1, 4, *q) for q in QUADS)
    path = tmp_path / "cube.ply"
    path.write_bytes(header.encode() + body)
    read = read_surface(path)
    np.testing.assert_array_equal(read.vertices_mm, CUBE)


@pytest.mark.parametrize("space", ["RAS", "LPS", None])
def test_coordinates_come_out_in_lps(tmp_path, space):
    header = f"comment SPACE={space}" if space else ""
    path = tmp_path / "cube.ply"
    path.write_text(ply_text(CUBE, QUADS, header))
    read = read_surface(path)
    turned = CUBE * [-1, -1, 1] if space == "RAS" else CUBE
    np.testing.assert_array_equal(read.vertices_mm, turned)
    assert read.frame == "LPS"
    # Turned, not mirrored: what was wound outwards still is.
    assert trimesh.Trimesh(read.vertices_mm, read.faces).volume > 0
    assert read_surface(path, frame="phantom").frame == "phantom"
    np.testing.assert_array_equal(read_surface(path, frame="RAS").vertices_mm, CUBE * [-1, -1, 1])


@pytest.mark.parametrize("told", ["ras", "Ras", "lps"])
def test_the_letters_of_a_patient_frame_count_in_any_case(tmp_path, told):
    path = tmp_path / "cube.ply"
    expected = CUBE * [-1, -1, 1] if told.lower() == "ras" else CUBE
    for header, frame in (("", told), (f"comment SPACE={told}", None), (f"comment FRAME={told}", None)):
        path.write_text(ply_text(CUBE, QUADS, header))
        read = read_surface(path, frame=frame)
        assert read.frame == "LPS"
        np.testing.assert_array_equal(read.vertices_mm, expected)


@pytest.mark.parametrize("told", ["LAS", "las", "RPI", "SAR"])
def test_another_frame_of_the_patient_is_refused_and_a_name_of_its_own_is_not(tmp_path, told):
    path = tmp_path / "cube.ply"
    path.write_text(ply_text(CUBE, QUADS, f"comment SPACE={told}"))
    with pytest.raises(SurfaceError, match=f"in LPS, RAS or .*got {told.upper()}"):
        read_surface(path)
    with pytest.raises(SurfaceError, match=told.upper()):
        read_surface(path, frame=told)
    assert read_surface(path, frame="LPS").frame == "LPS"
    for name in ("mean", "phantom", "CT1", "LPSA", "LLS", "rat"):
        assert read_surface(path, frame=name).frame == name


def test_slicer_tags_in_stl_and_obj_headers_are_honoured(tmp_path):
    mesh = trimesh.Trimesh(box().vertices_mm, box().faces)
    stl = mesh.export(file_type="stl")
    (tmp_path / "a.stl").write_bytes(b"SPACE=RAS".ljust(80, b"\0") + stl[80:])
    (tmp_path / "a.obj").write_text("# 3D Slicer output. SPACE=RAS\n" + mesh.export(file_type="obj"))
    turned = anatomy_of(trimesh.Trimesh(box().vertices_mm * [-1, -1, 1], box().faces))
    for kind in ("stl", "obj"):
        same_surface(read_surface(tmp_path / f"a.{kind}"), turned)


def test_obj_counts_back_from_the_last_vertex(tmp_path):
    lines = [f"v {x} {y} {z}" for x, y, z in CUBE] + ["f " + " ".join(f"{i - 8}//1" for i in quad) for quad in QUADS]
    (tmp_path / "cube.obj").write_text("\n".join(lines))
    np.testing.assert_array_equal(read_surface(tmp_path / "cube.obj").vertices_mm, CUBE)


def test_the_mean_nose_is_recognised_in_any_format(mean_nose, tmp_path):
    anatomy, _ = mean_nose
    assert (anatomy.frame, anatomy.name, list(anatomy.regions)) == ("mean", "mean nose", ["paper"])
    assert isinstance(anatomy.airspace, Between)
    mesh = trimesh.Trimesh(anatomy.vertices_mm, anatomy.faces, process=False)
    for kind in ("stl", "ply"):
        mesh.export(tmp_path / f"x.{kind}")
        again = read_surface(tmp_path / f"x.{kind}")
        assert (again.frame, again.name, again.airspace) == ("mean", "mean nose", anatomy.airspace)
    # What somebody says of it counts for more.
    assert read_surface(tmp_path / "x.ply", frame="LPS").frame == "LPS"
    assert read_surface(tmp_path / "x.ply", airspace=Enclosed()).airspace == Enclosed()


def test_the_vertices_of_the_mean_nose_keep_their_order(mean_nose, mean_nose_ply):
    """The published colours go by the number of the vertex."""
    rows = [line.split() for line in mean_nose_ply.read_text().split("end_header\n")[1].splitlines()[:14056]]
    np.testing.assert_array_equal(mean_nose[0].vertices_mm, np.array(rows, dtype=np.float64))


NOT_MESHES = {
    "empty": (b"", "empty"),
    "text": (b"Dear colleague,\nplease find attached\n", "whole"),
    "picture": (b"\x89PNG\r\n\x1a\n" + bytes(300), "whole"),
    "zeros": (bytes(5000), "whole|triangle"),
    "noise": (np.random.default_rng(0).bytes(4000), "whole"),
}
HEADER = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face {}\nproperty list uchar int vertex_indices\nend_header\n"
BROKEN_PLY = {
    "no format": b"ply\nelement vertex 1\nend_header\n",
    "no end": b"ply\nformat ascii 1.0\nelement vertex 1\n",
    "unknown format": b"ply\nformat morse 1.0\nend_header\n",
    "points only": (HEADER.format("ascii", 1) + "end_header\n0 0 0\n").encode(),
    "faces without list": (HEADER.format("ascii", 1) + "element face 1\nproperty int a\nend_header\n0 0 0 1").encode(),
    "words": (HEADER.format("ascii", 1) + FACE.format(1) + "a b c\n3 0 0 0\n").encode(),
    "fractions of vertices": (HEADER.format("ascii", 1) + FACE.format(1) + "0 0 0\n3 0 0.5 0\n").encode(),
    "vertices that are not there": (HEADER.format("ascii", 1) + FACE.format(1) + "0 0 0\n3 0 1 2\n").encode(),
    "NaN": (HEADER.format("ascii", 3) + FACE.format(1) + "nan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").encode(),
    "huge text": (HEADER.format("ascii", 10**15) + FACE.format(10**15) + "0 0 0\n").encode(),
    "huge binary": (HEADER.format("binary_little_endian", 10**15) + FACE.format(10**15)).encode() + bytes(100),
    "huge faces": (HEADER.format("binary_little_endian", 1) + FACE.format(10**15)).encode() + bytes(100),
    "absurd count": (HEADER.format("ascii", "9" * 5000) + FACE.format(1)).encode(),
    "huge nothing": b"ply\nformat binary_little_endian 1.0\nelement vertex 999999999999999\nend_header\n",
    "one point thrice": (HEADER.format("ascii", 1) + FACE.format(1) + "0 0 0\n3 0 0 0\n").encode(),
}


def refused(path):
    with pytest.raises(SurfaceError) as caught:
        read_surface(path)
    message = str(caught.value)
    assert path.name in message
    assert "\n" not in message
    assert len(message) < 300
    return message


@pytest.mark.parametrize("kind", [*FORMATS, "vtp"])
@pytest.mark.parametrize("content", NOT_MESHES)
def test_what_is_no_mesh_gets_one_sentence(tmp_path, kind, content):
    path = tmp_path / f"surface.{kind}"
    path.write_bytes(NOT_MESHES[content][0])
    refused(path)


@pytest.mark.parametrize("case", BROKEN_PLY)
def test_a_broken_ply_gets_one_sentence(tmp_path, case):
    path = tmp_path / "surface.ply"
    path.write_bytes(BROKEN_PLY[case])
    refused(path)


@pytest.mark.parametrize("kind", [*FORMATS, "vtp"])
def test_a_folder_and_nothing_at_all_get_one_sentence(tmp_path, kind):
    folder = tmp_path / f"folder.{kind}"
    folder.mkdir()
    assert "folder" in refused(folder)
    assert "nothing there" in refused(tmp_path / f"absent.{kind}")


def test_an_unknown_suffix_gets_one_sentence(tmp_path):
    (tmp_path / "scan.docx").write_bytes(b"PK")
    assert ".ply" in refused(tmp_path / "scan.docx")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=80)
@given(st.data())
def test_a_file_cut_short_or_damaged_is_refused_or_sound(tmp_path, data):
    """Never another exception, never a surface that is not closed."""
    kind = data.draw(st.sampled_from(["ply", "stl", "obj", "text.ply"]))
    mesh = trimesh.Trimesh(box().vertices_mm, box().faces, process=False)
    content = mesh.export(file_type="ply", encoding="ascii") if kind == "text.ply" else mesh.export(file_type=kind)
    content = bytearray(content.encode() if isinstance(content, str) else content)
    if data.draw(st.booleans()):
        content = content[: data.draw(st.integers(0, len(content) - 1))]
    for _ in range(data.draw(st.integers(0, 3))):
        if content:
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / f"damaged.{kind}"
    path.write_bytes(bytes(content))
    try:
        read = read_surface(path)
    except SurfaceError as error:
        assert "\n" not in str(error)
    else:
        assert trimesh.Trimesh(read.vertices_mm, read.faces, process=False).is_volume


def test_a_truncated_binary_stl_says_what_is_missing(tmp_path):
    content = trimesh.Trimesh(sphere().vertices_mm, sphere().faces).export(file_type="stl")
    (tmp_path / "a.stl").write_bytes(content[: len(content) // 2])
    assert f"{len(sphere().faces):,} facets" in refused(tmp_path / "a.stl")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.97])
@pytest.mark.parametrize("compressed", [False, True], ids=["text", "compressed"])
def test_a_vtp_cut_short_is_refused_and_vtk_says_nothing_of_its_own(tmp_path, capfd, share, compressed):
    pytest.importorskip("pyvista")
    import pyvista

    path = tmp_path / "a.vtp"
    pyvista.PolyData.from_regular_faces(sphere().vertices_mm, sphere().faces).save(path, binary=compressed)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    refused(path)
    assert capfd.readouterr() == ("", "")


def test_notices_go_through_logging(tmp_path, caplog):
    path = tmp_path / "inside out.ply"
    trimesh.Trimesh(box().vertices_mm, box().faces[:, ::-1], process=False).export(path)
    with caplog.at_level(logging.WARNING):
        read = read_surface(path)
    assert "inside out" in caplog.text
    same_surface(read, box())
