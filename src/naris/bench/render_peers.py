"""Other renderers on the same views, each in a process of its own: `python -m naris.bench.render_peers NAME JOB OUT`.

A peer may crash, print, or want environment variables before it is imported; none of this may touch the benchmark.
`vtk` is PyVista with one headlight, RGB and depth. `immediate` is what the published code does for a picture: OpenGL's
immediate mode, three calls from Python for each corner of each face, two-sided light, RGB; only the drawing is timed,
not that the published code starts a process and reads the surface for each picture.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from naris.core.provenance import Stopwatch

PEERS = ("vtk", "immediate")
_TIME_LIMIT_S = 120.0
_NEAR_MM, _FAR_MM = 0.01, 1000.0


@dataclass(frozen=True, eq=False)
class PeerRun:
    """What a peer did.

    Attributes:
        cpu_ms: a frame over all threads, the median of the frames.
        pictures: (N, H, W, 3) uint8, top row first.
    """

    cpu_ms: float
    pictures: UInt8[np.ndarray, "n h w 3"]


def run_peer(name: str, job: Path, out: Path) -> PeerRun | str:
    """A peer on a job (`write_job`), or the sentence that says why it could not start."""
    environment = {**os.environ, "PYOPENGL_PLATFORM": "egl", "EGL_PLATFORM": "surfaceless"}
    environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    command = [sys.executable, "-m", "naris.bench.render_peers", name, str(job), str(out)]
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=_TIME_LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return f"did not end within {_TIME_LIMIT_S:.0f} s"
    if done.returncode != 0 or not out.is_file():
        lines = done.stderr.strip().splitlines() or ["no reason given"]
        return f"cannot start here ({lines[-1][:160]})"
    with np.load(out) as saved:
        return PeerRun(float(np.median(saved["cpu_ms"])), saved["pictures"])


def write_job(path: Path, **arrays: np.ndarray) -> Path:
    """What a peer needs, as an .npz: vertices_mm, vertex_normals, colours, faces, matrices (anatomy_T_camera), size
    (width, height) and fov_deg (vertical)."""
    np.savez(path, allow_pickle=False, **arrays)
    return path


def _opengl_view(matrix: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """Anatomy to eye coordinates: OpenGL's camera looks along −z with y up."""
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    return np.asarray(flip @ np.linalg.inv(matrix))


def _perspective(fov_deg: float, aspect: float) -> Float[np.ndarray, "4 4"]:
    focal = 1 / np.tan(np.deg2rad(fov_deg) / 2)
    depth, product = (_FAR_MM + _NEAR_MM) / (_NEAR_MM - _FAR_MM), 2 * _FAR_MM * _NEAR_MM / (_NEAR_MM - _FAR_MM)
    return np.array([[focal / aspect, 0, 0, 0], [0, focal, 0, 0], [0, 0, depth, product], [0, 0, -1.0, 0]])


def _draw_with_vtk(job: dict[str, np.ndarray]) -> tuple[list[float], list[np.ndarray]]:
    import pyvista

    width, height = (int(v) for v in job["size"])
    surface = pyvista.PolyData.from_regular_faces(job["vertices_mm"], job["faces"])
    surface.point_data["colour"] = np.rint(255 * job["colours"]).astype(np.uint8)
    plotter = pyvista.Plotter(off_screen=True, window_size=(width, height), lighting="none")
    plotter.add_light(pyvista.Light(light_type="headlight"))
    plotter.add_mesh(surface, scalars="colour", rgb=True, smooth_shading=True)
    plotter.background_color = "black"
    plotter.camera.view_angle = float(job["fov_deg"])
    spent, pictures = [], []
    for k, matrix in enumerate([job["matrices"][0], *job["matrices"]]):
        with Stopwatch() as watch:
            plotter.camera.position = matrix[:3, 3]
            plotter.camera.focal_point = matrix[:3, 3] + matrix[:3, 2]
            plotter.camera.up = -matrix[:3, 1]
            plotter.camera.clipping_range = (_NEAR_MM, _FAR_MM)
            picture = plotter.screenshot(return_img=True) if k else plotter.show(auto_close=False) or None
            if k:
                plotter.get_image_depth()
        if k and picture is not None:
            spent.append(1e3 * watch.cpu_s)
            pictures.append(np.asarray(picture)[..., :3])
    return spent, pictures


def _draw_in_immediate_mode(job: dict[str, np.ndarray]) -> tuple[list[float], list[np.ndarray]]:
    from OpenGL import GL

    width, height = (int(v) for v in job["size"])
    _open_context(width, height)
    GL.glViewport(0, 0, width, height)
    GL.glMatrixMode(GL.GL_PROJECTION)
    GL.glLoadMatrixd(_perspective(float(job["fov_deg"]), width / height).T.copy())
    for capability in (GL.GL_DEPTH_TEST, GL.GL_LIGHTING, GL.GL_LIGHT0, GL.GL_NORMALIZE, GL.GL_COLOR_MATERIAL):
        GL.glEnable(capability)
    GL.glShadeModel(GL.GL_SMOOTH)
    GL.glLightModelfv(GL.GL_LIGHT_MODEL_AMBIENT, (0.2, 0.2, 0.2, 1.0))
    GL.glLightModeli(GL.GL_LIGHT_MODEL_TWO_SIDE, GL.GL_TRUE)
    spent, pictures = [], []
    for matrix in job["matrices"]:
        with Stopwatch() as watch:
            GL.glClear(GL.GL_COLOR_BUFFER_BIT | GL.GL_DEPTH_BUFFER_BIT)
            _place_light(GL, matrix)
            _draw_corners(GL, job)
            GL.glFinish()
            GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
            data = GL.glReadPixels(0, 0, width, height, GL.GL_RGB, GL.GL_UNSIGNED_BYTE)
        spent.append(1e3 * watch.cpu_s)
        pictures.append(np.frombuffer(data, np.uint8).reshape(height, width, 3)[::-1])
    return spent, pictures


def _place_light(GL: Any, matrix: np.ndarray) -> None:
    """The published light at the camera."""
    GL.glMatrixMode(GL.GL_MODELVIEW)
    GL.glLoadMatrixd(_opengl_view(matrix).T.copy())
    GL.glLightfv(GL.GL_LIGHT0, GL.GL_AMBIENT, (0.2, 0.2, 0.2, 1.0))
    GL.glLightfv(GL.GL_LIGHT0, GL.GL_DIFFUSE, (10.5, 10.0, 10.0, 1.0))
    GL.glLightfv(GL.GL_LIGHT0, GL.GL_POSITION, (*matrix[:3, 3].tolist(), 1.0))
    GL.glLightf(GL.GL_LIGHT0, GL.GL_CONSTANT_ATTENUATION, 7.5)
    GL.glLightf(GL.GL_LIGHT0, GL.GL_SPOT_CUTOFF, 45.0)
    GL.glLightf(GL.GL_LIGHT0, GL.GL_SPOT_EXPONENT, 0.5)
    GL.glLightfv(GL.GL_LIGHT0, GL.GL_SPOT_DIRECTION, matrix[:3, 2].tolist())


def _draw_corners(GL: Any, job: dict[str, np.ndarray]) -> None:
    vertices, normals, colours = (job[name].tolist() for name in ("vertices_mm", "vertex_normals", "colours"))
    GL.glBegin(GL.GL_TRIANGLES)
    for face in job["faces"].tolist():
        for corner in face:
            GL.glColor3f(*colours[corner])
            GL.glNormal3f(*normals[corner])
            GL.glVertex3f(*vertices[corner])
    GL.glEnd()


def _open_context(width: int, height: int) -> None:
    """An OpenGL context without a window."""
    from OpenGL import EGL

    display = EGL.eglGetDisplay(EGL.EGL_DEFAULT_DISPLAY)
    EGL.eglInitialize(display, None, None)
    EGL.eglBindAPI(EGL.EGL_OPENGL_API)
    wanted = [EGL.EGL_SURFACE_TYPE, EGL.EGL_PBUFFER_BIT, EGL.EGL_RENDERABLE_TYPE, EGL.EGL_OPENGL_BIT]
    wanted += [EGL.EGL_RED_SIZE, 8, EGL.EGL_GREEN_SIZE, 8, EGL.EGL_BLUE_SIZE, 8, EGL.EGL_DEPTH_SIZE, 24, EGL.EGL_NONE]
    configs, count = (EGL.EGLConfig * 1)(), EGL.EGLint()
    EGL.eglChooseConfig(display, (EGL.EGLint * len(wanted))(*wanted), configs, 1, count)
    size = [EGL.EGL_WIDTH, width, EGL.EGL_HEIGHT, height, EGL.EGL_NONE]
    buffer = EGL.eglCreatePbufferSurface(display, configs[0], (EGL.EGLint * len(size))(*size))
    context = EGL.eglCreateContext(display, configs[0], EGL.EGL_NO_CONTEXT, None)
    EGL.eglMakeCurrent(display, buffer, buffer, context)


def main(arguments: list[str]) -> int:
    """Runs one peer; what it measured goes to the file OUT."""
    name, job_path, out = arguments
    with np.load(job_path) as saved:
        job = {key: saved[key] for key in saved.files}
    draw = {"vtk": _draw_with_vtk, "immediate": _draw_in_immediate_mode}[name]
    spent, pictures = draw(job)
    np.savez(out, cpu_ms=np.array(spent), pictures=np.stack(pictures))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
