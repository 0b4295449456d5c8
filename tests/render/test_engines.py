"""Both engines against each other, against every face tried in double precision, and against themselves."""

from __future__ import annotations

import logging
import multiprocessing
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import naris
from naris.bench.oracle import nearest_faces
from naris.core.camera import Brown, Fisheye, Intrinsics
from naris.core.pose import Pose, stack
from naris.errors import EngineUnavailable, InputError
from naris.render import engine as engines
from naris.render.appearance import (
    ENDOSCOPE,
    PAPER,
    PAPER_CULLED,
    TRAINING_APPEARANCE,
    UNSEEN_APPEARANCE,
    Appearance,
    Light,
    Mucosa,
    Optics,
    Sensor,
    TextureColours,
    Uniform,
)
from naris.render.embree import library
from naris.render.scene import Scene, render
from tests.render.surfaces import UP, picture, pod, ring, sphere, views, views_in_ring

RNG = np.random.default_rng(11)
TEXTURE = TextureColours(RNG.integers(0, 256, (13, 7, 3), dtype=np.uint8))
LOOKS = {
    "uniform, lit in the pixel": Appearance(Uniform(), Light(offset_mm=(1.0, 0.5, 0.0), attenuation=(1, 0.1, 0.02))),
    "paper": PAPER,
    "paper, texture": PAPER.with_(material=TEXTURE),
    "paper, mucosa": PAPER.with_(material=Mucosa(seed=4)),
    "texture, lit in the pixel": Appearance(TEXTURE, Light(cutoff_deg=40, edge_deg=10, exponent=2)),
    "endoscope": ENDOSCOPE,
    "round stop": ENDOSCOPE.with_(optics=Optics(0.3, 0.8, 0.1, (0.1, -0.05))),
    "noise alone": Appearance(sensor=Sensor(read_noise=4, shot_noise=3)),
    "training": TRAINING_APPEARANCE.sample(np.random.default_rng(1)),
    "unseen": UNSEEN_APPEARANCE.sample(np.random.default_rng(2)),
}
LENSES = {
    "pinhole": picture(),
    "odd size": picture(61, 35),
    "thin": picture(3, 2),
    "brown": Intrinsics.from_vertical_fov(50, 50, 60, Brown(-0.2, 0.02, 0.001, -0.002)),
    "fisheye past its edge": Intrinsics(64, 64, 16.0, 16.0, 31.5, 31.5, Fisheye(-0.05, -0.02)),
}


@pytest.fixture(scope="module")
def both() -> tuple[Scene, Scene]:
    return Scene(pod(), engine="fast"), Scene(pod(), engine="numpy")


def assert_same_pictures(fast, slow) -> None:
    same = fast.face_ids == slow.face_ids
    assert same.mean() >= 0.999
    assert np.array_equal(fast.valid[same], slow.valid[same])
    assert np.abs(fast.depth_mm - slow.depth_mm)[same].max() < 1e-3
    assert np.abs(fast.normals - slow.normals)[same].max() < 1e-4
    apart = np.abs(fast.rgb.astype(int) - slow.rgb)
    assert (apart <= 1).mean() >= 0.999
    assert fast.rgb.max() > 0


@pytest.mark.parametrize("name", LOOKS)
def test_engines_give_the_same_picture(both, name) -> None:
    poses = views(4, seed=3)
    fast, slow = (render(scene, poses, picture(), LOOKS[name]) for scene in both)
    assert_same_pictures(fast, slow)


@pytest.mark.parametrize("lens", LENSES)
def test_engines_agree_behind_any_lens(both, lens) -> None:
    poses = views(3, seed=8)
    fast, slow = (render(scene, poses, LENSES[lens], ENDOSCOPE) for scene in both)
    assert_same_pictures(fast, slow)
    exists = np.isfinite(LENSES[lens].rays()).all(axis=-1)
    assert np.array_equal(fast.valid, np.broadcast_to(exists, fast.valid.shape))
    assert (fast.depth_mm[~fast.valid] == 0).all() and (fast.face_ids[~fast.valid] == -1).all()
    assert (fast.normals[~fast.valid] == 0).all()


@pytest.mark.parametrize("name", ["fast", "numpy"])
def test_faces_and_depth_agree_with_every_face_tried(name) -> None:
    anatomy, poses, intrinsics = pod(), views(3, seed=5), picture()
    rendering = render(Scene(anatomy, engine=name), poses, intrinsics, want=("depth", "face_id", "normal"))
    rays = intrinsics.rays().reshape(-1, 3)
    for i in range(3):
        world = rays @ poses.rotation[i].T
        origin = np.broadcast_to(poses.position_mm[i], world.shape)
        face, distance = nearest_faces(anatomy.vertices_mm, anatomy.faces, origin, world)
        same = face == rendering.face_ids[i].ravel()
        assert same.mean() >= 0.999
        assert np.abs(distance * rays[:, 2] - rendering.depth_mm[i].ravel())[same].max() < 1e-3
        a, b, c = (anatomy.vertices_mm[anatomy.faces[face, k]] for k in range(3))
        normal = np.cross(b - a, c - a) @ poses.rotation[i]
        normal *= -np.sign((normal * rays).sum(-1, keepdims=True)) / np.linalg.norm(normal, axis=-1, keepdims=True)
        assert np.abs(normal - rendering.normals[i].reshape(-1, 3))[same].max() < 1e-3


def test_culling_sees_walls_from_their_outside_only() -> None:
    look, poses = PAPER_CULLED.with_(material=TEXTURE), views_in_ring(4)
    fast, slow = (render(Scene(ring(), engine=name), poses, picture(), look) for name in ("fast", "numpy"))
    assert_same_pictures(fast, slow)
    assert 0.05 < fast.valid.mean() < 1
    faces = ring().vertices_mm[ring().faces]
    outward = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    for i in range(4):
        seen = fast.valid[i]
        middle = faces[fast.face_ids[i][seen]].mean(axis=1)
        assert (((middle - poses.position_mm[i]) * outward[fast.face_ids[i][seen]]).sum(-1) < 0).all()
    plain = render(Scene(ring()), poses, picture(), PAPER)
    assert plain.valid.all() and (plain.depth_mm < fast.depth_mm)[fast.valid].all()


def test_from_outside_nothing_is_culled_and_from_inside_a_ball_everything() -> None:
    poses = views(3, seed=7)
    outside = Pose.look(np.array([[0, -60.0, 0]]), np.array([[0, 1.0, 0]]), UP, "LPS")
    for name in ("fast", "numpy"):
        scene = Scene(sphere(), engine=name)
        culled, plain = (render(scene, outside, picture(40, 40, 30), look) for look in (PAPER_CULLED, PAPER))
        assert np.array_equal(culled.face_ids, plain.face_ids) and culled.valid.any()
        assert not render(scene, poses, picture(), PAPER_CULLED).valid.any()


def outside_and_inside() -> Pose:
    outside = Pose.look(np.array([[0, -90.0, 0]]), np.array([[0, 1.0, 0]]), UP, "LPS")
    return stack([outside[0], views(1)[0]])


@pytest.mark.parametrize("width", [4, 8])
def test_narrow_packets_give_the_same(both, width) -> None:
    import ctypes

    engine = Scene(pod(), engine="fast")._engine
    function = getattr(library().functions, f"rtcIntersect{width}")
    address = ctypes.cast(function, ctypes.c_void_p).value
    engine._embree = engine._embree._replace(function=address, width=width)
    scene = Scene.__new__(Scene)
    scene.anatomy, scene._engine = pod(), engine
    for look in (ENDOSCOPE, PAPER_CULLED):
        narrow, wide = (render(s, outside_and_inside(), picture(), look) for s in (scene, both[0]))
        assert wide.valid.any()
        assert np.array_equal(narrow.face_ids, wide.face_ids)
        assert (np.abs(narrow.rgb.astype(int) - wide.rgb) <= 1).mean() > 0.999


def test_pictures_do_not_depend_on_threads_or_batches(both) -> None:
    poses, seeds = views(9, seed=1), np.arange(100, 109)
    looks = [TRAINING_APPEARANCE.sample(np.random.default_rng(i)) for i in range(9)]
    whole = render(both[0], poses, picture(), looks, seeds=seeds, threads=1)
    spread = render(both[0], poses, picture(), looks, seeds=seeds, threads=3)
    for name in ("rgb", "depth_mm", "normals", "face_ids", "valid"):
        assert np.array_equal(getattr(whole, name), getattr(spread, name))
    for i in range(9):
        one = render(both[0], poses[i : i + 1], picture(), looks[i], seeds=seeds[i : i + 1])
        assert np.array_equal(one.rgb[0], whole.rgb[i])


def test_an_anatomy_from_another_process_is_drawn_by_the_code_that_is_compiled() -> None:
    """Its arrays may be written there, and compiling takes half a minute."""
    from naris.render.kernel import render_frames

    drawn = []
    for anatomy in (sphere(), pickle.loads(pickle.dumps(sphere()))):
        render(Scene(anatomy, engine="fast"), views(1), picture())
        drawn.append(len(render_frames.signatures))
    assert drawn[0] == drawn[1] > 0


def test_the_seed_moves_the_noise_and_nothing_else(both) -> None:
    look = Appearance(sensor=Sensor(read_noise=5))
    for scene in both:
        a, b, c = (render(scene, views(1), picture(), look, seeds=np.array([s])) for s in (7, 7, 8))
        assert np.array_equal(a.rgb, b.rgb) and not np.array_equal(a.rgb, c.rgb)
        quiet = render(scene, views(1), picture(), Appearance()).rgb.astype(float)
        deviation = a.rgb.astype(float) - quiet
        middle = (quiet > 30) & (quiet < 225)
        assert abs(deviation[middle].mean()) < 0.3 and deviation[middle].std() == pytest.approx(5, rel=0.06)
        assert np.array_equal(a.depth_mm, c.depth_mm)


def _render_in_child(queue, scene) -> None:
    queue.put(render(scene, views(8), picture(), ENDOSCOPE, threads=2).rgb.sum(dtype=np.int64))


def test_a_forked_process_renders_too(both) -> None:
    expected = render(both[0], views(8), picture(), ENDOSCOPE, threads=2).rgb.sum(dtype=np.int64)
    context = multiprocessing.get_context("fork")
    queue = context.SimpleQueue()
    child = context.Process(target=_render_in_child, args=(queue, both[0]), daemon=True)
    child.start()
    child.join(30)
    assert child.exitcode == 0 and queue.get() == expected


def _build_in_child(queue) -> None:
    queue.put(render(Scene(pod()), views(2), picture(), ENDOSCOPE).rgb.sum(dtype=np.int64))


def test_a_forked_process_builds_scenes_too(both) -> None:
    expected = render(both[0], views(2), picture(), ENDOSCOPE).rgb.sum(dtype=np.int64)
    context = multiprocessing.get_context("fork")
    queue = context.SimpleQueue()
    child = context.Process(target=_build_in_child, args=(queue,), daemon=True)
    child.start()
    child.join(60)
    assert child.exitcode == 0 and queue.get() == expected


_IDLE = """
import time
from tests.render.surfaces import picture, pod, views
from naris.render.scene import Scene, render
render(Scene(pod(), engine="fast"), views(4), picture())
time.sleep(0.3)
before = time.process_time()
time.sleep(0.5)
print(time.process_time() - before)
"""


def test_no_thread_spins_when_there_is_nothing_to_render() -> None:
    paths = [str(Path(naris.__file__).parents[1]), str(Path(__file__).parents[2])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    done = subprocess.run([sys.executable, "-c", _IDLE], env=environment, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 0.01


def test_falls_back_to_numpy_and_says_so(monkeypatch, caplog) -> None:
    monkeypatch.setattr(engines, "why_not_fast", lambda: "the library is missing")
    with caplog.at_level(logging.WARNING):
        scene = Scene(sphere())
    assert scene.engine == "numpy" and "the library is missing" in caplog.text
    with pytest.raises(EngineUnavailable, match="the library is missing"):
        Scene(sphere(), engine="fast")


def test_the_self_test_notices_an_engine_that_is_wrong(monkeypatch) -> None:
    from naris.render.fast import FastEngine

    engines.why_not_fast.cache_clear()
    right = FastEngine.render

    def shifted(self, shot):
        out = right(self, shot)
        return type(out)(out.valid, out.rgb, out.depth_mm + 0.1, out.normals, out.face_ids)

    monkeypatch.setattr(FastEngine, "render", shifted)
    assert engines.why_not_fast() is not None
    monkeypatch.undo()
    engines.why_not_fast.cache_clear()
    assert engines.why_not_fast() is None


def test_unknown_engine_is_refused() -> None:
    with pytest.raises(InputError, match="engines"):
        engines.start_engine(sphere(), "magic")
