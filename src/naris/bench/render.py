"""How fast and how right pictures are made: the published picture, the endoscope's and the training stream's.

`render.plain.*` is the published light and texture with RGB, depth, normals and face ids, rendered in one call, on
views as an inspection has them. CPU time is the operating system's, over all threads.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from naris.anatomy.distance import signed_distance
from naris.bench import BenchRequest, Measurement
from naris.bench.oracle import nearest_faces
from naris.bench.render_peers import PeerRun, run_peer, write_job
from naris.bench.result import Figure, Peer
from naris.bench.subject import Subject, subject
from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.core.provenance import Stopwatch
from naris.render.appearance import ENDOSCOPE, TRAINING_APPEARANCE, Appearance
from naris.render.material import TextureColours, Uniform
from naris.render.scene import Rendering, Scene, render
from naris.render.viewpoints import INSPECTION, draw_views, passages_of, view_bank

SMALL = Intrinsics.from_vertical_fov(300, 300, 45.0)
LARGE = Intrinsics.from_vertical_fov(640, 480, 45.0)
STREAM = Intrinsics.from_vertical_fov(112, 112, 75.0)
_PEER_FRAMES = 3
_ORACLE_RAYS = 2000
_LEVELS_OF_OPENGL = 2


def measure(request: BenchRequest) -> Measurement:
    """Times the engine and its peers on the same views, and compares what they see."""
    what = subject(request)
    scene, slow = Scene(what.anatomy), Scene(what.anatomy, engine="numpy")
    poses = _views(what, scene, 24 if request.quick else 64, request.seed)
    repeats = 5 if request.quick else 15
    figures = [
        *_plain(what, scene, slow, poses, repeats),
        *_stream(scene, poses, repeats, request.seed),
        *_agreement(scene, slow, poses, request),
    ]
    return Measurement(tuple(_with_outside_peers(what, scene, poses, figures)), {**what.inputs, "engine": scene.engine})


def _views(what: Subject, scene: Scene, count: int, seed: int) -> Pose:
    distance = signed_distance(what.anatomy)
    bank = view_bank(distance, passages_of(what.anatomy, distance), what.anatomy.region_set(), INSPECTION)
    return draw_views(scene, bank, count, np.random.default_rng(seed)).anatomy_T_camera


def _plain(what: Subject, scene: Scene, slow: Scene, poses: Pose, repeats: int) -> list[Figure]:
    figures = []
    for name, intrinsics, goal in (("300", SMALL, 9.0), ("640x480", LARGE, 28.0)):
        cpu, wall = _timed(partial(render, scene, poses, intrinsics, what.appearance), repeats)
        by_numpy, _ = _timed(partial(render, slow, poses[:_PEER_FRAMES], intrinsics, what.appearance), 1)
        peers: dict[str, Peer] = {"embreex and numpy": float(np.median(by_numpy))}
        figures.append(_milliseconds(f"render.plain.{name}.cpu_ms", cpu, len(poses), goal, peers))
        if intrinsics is SMALL:
            fps = 1e3 / wall
            figures.append(
                Figure("render.plain.300.fps", float(np.median(fps)), "fps", len(poses), "higher", None, _spread(fps))
            )
    cpu, _ = _timed(partial(render, scene, poses, SMALL, ENDOSCOPE), repeats)
    figures.append(_milliseconds("render.endoscope.300.cpu_ms", cpu, len(poses)))
    return figures


def _stream(scene: Scene, poses: Pose, repeats: int, seed: int) -> list[Figure]:
    """Training pictures: RGB alone, an appearance drawn for each, on one thread; the drawing is timed too."""
    rng = np.random.default_rng(seed)

    def batch() -> Rendering:
        looks = [TRAINING_APPEARANCE.sample(rng) for _ in range(len(poses))]
        return render(scene, poses, STREAM, looks, want=("rgb",), threads=1)

    cpu, _ = _timed(batch, repeats)
    rate = 1e3 / cpu
    name = "render.training.112.frames_per_cpu_s"
    return [Figure(name, float(np.median(rate)), "fps", len(poses), "higher", 500.0, _spread(rate))]


def _timed(
    work: Callable[[], Rendering], repeats: int
) -> tuple[Float[np.ndarray, "{repeats}"], Float[np.ndarray, "{repeats}"]]:
    """CPU and wall milliseconds a frame of each repeat, after one that is not counted."""
    spent = []
    for _ in range(repeats + 1):
        with Stopwatch() as watch:
            count = len(work())
        spent.append((1e3 * watch.cpu_s / count, 1e3 * watch.wall_s / count))
    cpu, wall = np.array(spent[1:]).T
    return cpu, wall


def _milliseconds(
    name: str,
    cpu: Float[np.ndarray, "r"],
    frames: int,
    goal: float | None = None,
    peers: dict[str, Peer] | None = None,
) -> Figure:
    return Figure(name, float(np.median(cpu)), "ms", frames, "lower", goal, _spread(cpu), peers or {})


def _spread(values: Float[np.ndarray, "r"]) -> tuple[float, float]:
    """A 95 % interval of the median, by the bootstrap."""
    rng = np.random.default_rng(0)
    medians = np.median(rng.choice(values, (1000, len(values))), axis=1)
    low, high = np.percentile(medians, [2.5, 97.5])
    return float(low), float(high)


def _agreement(scene: Scene, slow: Scene, poses: Pose, request: BenchRequest) -> list[Figure]:
    """Against every face tried in double precision, and of the two engines with each other."""
    count = 6 if request.quick else 24
    some, rays = poses[:count], SMALL.rays().reshape(-1, 3)
    seen = render(scene, some, SMALL, want=("depth", "face_id"))
    if seen.depth_mm is None or seen.face_ids is None:
        return []
    rng, same, apart = np.random.default_rng(request.seed), [], []
    for i in range(count):
        at = rng.choice(len(rays), _ORACLE_RAYS, replace=False)
        world = rays[at] @ some.rotation[i].T
        origins = np.broadcast_to(some.position_mm[i], world.shape)
        face, distance = nearest_faces(scene.anatomy.vertices_mm, scene.anatomy.faces, origins, world)
        agree = face == seen.face_ids[i].ravel()[at]
        met = agree & (face >= 0)
        same.append(agree)
        apart.append(np.abs(distance * rays[at, 2] - seen.depth_mm[i].ravel()[at])[met])
    few = poses[:_PEER_FRAMES]
    fast_rgb, slow_rgb = (_rgb(s, few, ENDOSCOPE) for s in (scene, slow))
    levels = (np.abs(fast_rgb.astype(int) - slow_rgb) <= 1).mean()
    n = count * _ORACLE_RAYS
    return [
        Figure("render.oracle.face_agreement", float(np.concatenate(same).mean()), "1", n, "higher", 0.999),
        Figure("render.oracle.depth_mm", float(np.concatenate(apart).max()), "mm", n, "lower", 1e-3),
        Figure("render.engines.rgb_within_one_level", float(levels), "1", slow_rgb.size, "higher", 0.999),
    ]


def _rgb(scene: Scene, poses: Pose, look: Appearance) -> np.ndarray:
    return np.asarray(render(scene, poses, SMALL, look, want=("rgb",)).rgb)


def _with_outside_peers(what: Subject, scene: Scene, poses: Pose, figures: list[Figure]) -> list[Figure]:
    """Adds PyVista and OpenGL's immediate mode to the plain picture, and how near ours is to OpenGL's."""
    few = poses[:_PEER_FRAMES]
    with tempfile.TemporaryDirectory(prefix="bench-render-") as folder:
        job = write_job(Path(folder) / "job.npz", **_job(what, few))
        vtk, opengl = (run_peer(name, job, Path(folder) / f"{name}.npz") for name in ("vtk", "immediate"))
    peers = {"PyVista, RGB and depth": _cpu_ms(vtk), "OpenGL immediate mode, RGB": _cpu_ms(opengl)}
    out = [
        Figure(**{**vars(f), "peers": {**f.peers, **peers}}) if f.name == "render.plain.300.cpu_ms" else f
        for f in figures
    ]
    if isinstance(opengl, PeerRun):
        ours = _rgb(scene, few, what.appearance).astype(int)
        levels = float((np.abs(ours - opengl.pictures) <= _LEVELS_OF_OPENGL).mean())
        out.append(Figure("render.paper.rgb_within_two_levels_of_opengl", levels, "1", ours.size, "higher"))
    return out


def _cpu_ms(peer: PeerRun | str) -> Peer:
    return peer if isinstance(peer, str) else peer.cpu_ms


def _job(what: Subject, poses: Pose) -> dict[str, np.ndarray]:
    anatomy, material = what.anatomy, what.appearance.material
    count = len(anatomy.vertices_mm)
    if isinstance(material, TextureColours):
        colours = material.vertex_colours(count)
    else:
        colours = np.tile(np.array(material.rgb if isinstance(material, Uniform) else (0.5, 0.5, 0.5)), (count, 1))
    return {
        "vertices_mm": anatomy.vertices_mm,
        "vertex_normals": anatomy.vertex_normals,
        "colours": colours.astype(np.float64),
        "faces": anatomy.faces,
        "matrices": poses.matrix,
        "size": np.array([SMALL.width, SMALL.height]),
        "fov_deg": np.array(SMALL.vertical_fov_deg),
    }
