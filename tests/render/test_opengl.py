"""The published light against OpenGL itself, drawn as the published code draws."""

from __future__ import annotations

import numpy as np
import pytest

from naris.bench.render_peers import run_peer, write_job
from naris.render.appearance import PAPER, TextureColours
from naris.render.scene import Scene, render
from tests.render.surfaces import picture, pod, views


@pytest.mark.parametrize("engine", ["fast", "numpy"])
def test_paper_is_what_opengl_draws(engine, tmp_path) -> None:
    anatomy, poses, intrinsics = pod(), views(2, seed=6), picture(120, 90, 60)
    texture = TextureColours(np.random.default_rng(0).integers(0, 256, (17, 23, 3), dtype=np.uint8))
    job = write_job(
        tmp_path / "job.npz",
        vertices_mm=anatomy.vertices_mm,
        vertex_normals=anatomy.vertex_normals,
        colours=texture.vertex_colours(len(anatomy.vertices_mm)).astype(np.float64),
        faces=anatomy.faces,
        matrices=poses.matrix,
        size=np.array([120, 90]),
        fov_deg=np.array(60.0),
    )
    drawn = run_peer("immediate", job, tmp_path / "out.npz")
    if isinstance(drawn, str):
        pytest.skip(f"OpenGL {drawn}")
    ours = render(Scene(anatomy, engine=engine), poses, intrinsics, PAPER.with_(material=texture))
    assert (np.abs(ours.rgb.astype(int) - drawn.pictures) <= 2).mean() > 0.999
    assert drawn.pictures.max() > 50
