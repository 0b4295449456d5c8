"""Several depth images from one file: their poses are kept, and what is wrong with it is said with its view."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from naris.core.camera import Fisheye, Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.errors import InputError, PoseError
from naris.register.noise import KNOWN, DepthNoise
from naris.register.rig import read_rig

LENS = Intrinsics.from_vertical_fov(32, 24, 60.0)
WIDE = Intrinsics.from_vertical_fov(40, 30, 90.0, Fisheye(k1=0.01))
ASIDE = Pose.exp(np.array([1.0, -2.0, 0.5, 0.1, 0.2, -0.3]), CAMERA, CAMERA)


def told(folder):
    """Two views of different cameras on disk, and what the file would say of them."""
    for name, camera in (("a", LENS), ("b", WIDE)):
        np.save(folder / f"{name}.npy", np.full((camera.height, camera.width), 500.0))
    one = {"depth": "a.npy", "intrinsics": asdict(LENS), "first_T_camera": np.eye(4).tolist()}
    return {"views": [one, {"depth": "b.npy", "intrinsics": asdict(WIDE), "first_T_camera": ASIDE.matrix.tolist()}]}


def kept(folder, content):
    file = folder / "rig.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    return file


def test_each_view_has_its_depth_camera_and_pose(tmp_path):
    rig = read_rig(kept(tmp_path, told(tmp_path)), 0.01)
    assert rig.intrinsics == (LENS, WIDE)
    np.testing.assert_allclose(rig.first_T_camera.matrix, [np.eye(4), ASIDE.matrix])
    assert rig.depths[1].shape == (30, 40) and (rig.depths[1] == 5.0).all()
    seen = rig.observed(DepthNoise(), KNOWN)
    assert seen.views == 2
    np.testing.assert_allclose(seen.origins[seen.view == 1][0], ASIDE.position_mm)


def test_a_view_may_say_how_sure_each_of_its_pixels_is(tmp_path):
    content = told(tmp_path)
    np.save(tmp_path / "sd.npy", np.full((24, 32), 90.0))
    content["views"][0]["depth_sd"] = "sd.npy"
    rig = read_rig(kept(tmp_path, content), 0.01)
    assert rig.sds[0] is not None and np.allclose(rig.sds[0], 0.9)
    assert rig.sds[1] is None
    seen = rig.observed(DepthNoise(smooth=0.0, pixel_mm=0.1), KNOWN)
    assert seen.radial[seen.view == 0].min() > 2 * seen.radial[seen.view == 1].max()


def test_a_camera_is_needed(tmp_path):
    content = told(tmp_path)
    del content["views"][1]["intrinsics"]
    with pytest.raises(InputError, match=r"of view 2 of rig.json, got \['depth', 'first_T_camera'\]"):
        read_rig(kept(tmp_path, content), 1.0)


def test_one_camera_may_stand_for_all(tmp_path):
    content = told(tmp_path)
    np.save(tmp_path / "b.npy", np.full((24, 32), 5.0))
    for view in content["views"]:
        del view["intrinsics"]
    assert read_rig(kept(tmp_path, content | {"intrinsics": asdict(LENS)}), 1.0).intrinsics == (LENS, LENS)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: "{", "views in JSON"),
        (lambda content: [content], "in rig.json, got a list"),
        (lambda content: {}, "2 to 16 views in rig.json, got none"),
        (lambda content: {"views": content["views"][:1]}, "2 to 16 views in rig.json, got 1"),
        (lambda content: {"views": content["views"] * 9}, "2 to 16 views in rig.json, got 18"),
        (lambda content: {"views": [*content["views"], 7]}, "first_T_camera of view 3 of rig.json, got none"),
        (lambda content: {"views": content["views"][::-1]}, "the identity as first_T_camera of view 1"),
        (lambda content: _second(content, depth=3), "depth, intrinsics and first_T_camera of view 2"),
        (lambda content: _second(content, depth="c.npy"), "no such file"),
        (lambda content: _second(content, scale=3), "depth, intrinsics and first_T_camera of view 2"),
        (lambda content: _second(content, intrinsics={"width": 3}), "a camera of view 2"),
        (lambda content: _second(content, first_T_camera="eye"), "a 4×4 matrix as first_T_camera of view 2"),
        (
            lambda content: _second(content, first_T_camera=np.eye(3).tolist()),
            "a 4×4 matrix as first_T_camera of view 2",
        ),
        (lambda content: _second(content, first_T_camera=[[1, 2], [3]]), "a 4×4 matrix as first_T_camera of view 2"),
    ],
)
def test_what_is_no_rig_is_refused_in_a_sentence(tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        read_rig(kept(tmp_path, change(told(tmp_path))), 1.0)


@pytest.mark.parametrize("matrix", [(2 * np.eye(4)).tolist(), [[float("nan")] * 4] * 4])
def test_poses_that_are_none_name_their_view(tmp_path, matrix):
    with pytest.raises(PoseError, match="as first_T_camera of view 2"):
        read_rig(kept(tmp_path, _second(told(tmp_path), first_T_camera=matrix)), 1.0)


def _second(content, **changes):
    return {"views": [content["views"][0], content["views"][1] | changes]}
