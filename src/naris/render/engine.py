"""Which engine a scene gets: the fast one where its self-test passes, else numpy."""

from __future__ import annotations

import logging
import threading
from dataclasses import replace
from functools import lru_cache

import numpy as np

from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.errors import EngineUnavailable, InputError
from naris.render.appearance import PAPER
from naris.render.reference import NumpyEngine
from naris.render.scene import Engine, Shot

ENGINES = ("auto", "fast", "numpy")
_PATIENCE_S = 5.0
_NOTE = "making the renderer ready; the first time it is compiled, which takes half a minute"
_TEST_PIXELS = 32
_TEST_DEPTH_MM = 1e-3
_log = logging.getLogger(__name__)


def start_engine(anatomy: Anatomy, name: str) -> Engine:
    """The engine of that name for an anatomy.

    Raises:
        InputError: if there is no engine of that name.
        EngineUnavailable: if it cannot start here.
    """
    if name not in ENGINES:
        raise InputError(f"one of the engines {ENGINES}", repr(name), "name one of those")
    if name == "numpy":
        return NumpyEngine(anatomy)
    reason = why_not_fast()
    if reason is None:
        from naris.render.fast import FastEngine

        return FastEngine(anatomy)
    if name == "fast":
        raise EngineUnavailable("the fast engine", reason, "use engine auto or numpy")
    _log.warning("rendering with numpy, about ten times slower: %s", reason)
    return NumpyEngine(anatomy)


@lru_cache(maxsize=1)
def why_not_fast() -> str | None:
    """None if the fast engine works here, else the reason; tested once a process against `embreex` itself.

    The first test of an installation compiles the kernel, which is kept on disk.
    """
    note = threading.Timer(_PATIENCE_S, _log.info, [_NOTE])
    note.daemon = True
    note.start()
    try:
        from numba.core.errors import NumbaError

        try:
            return _self_test()
        except NumbaError as error:
            return f"numba cannot compile it: {str(error).splitlines()[0]}"
    except (EngineUnavailable, OSError, ImportError) as error:
        return str(error)
    finally:
        note.cancel()


def _self_test() -> str | None:
    """The channels of both engines from inside a lumpy ball."""
    from naris.render.fast import FastEngine

    ball = _lumpy_ball()
    shot = Shot(
        np.eye(3, dtype=np.float32)[None],
        np.array([[0.5, -0.3, 0.2]], np.float32),
        Intrinsics.from_vertical_fov(_TEST_PIXELS, _TEST_PIXELS, 90.0),
        [PAPER.with_(light=replace(PAPER.light, cutoff_deg=60.0))],
        np.zeros(1, np.int64),
        frozenset(("rgb", "depth", "face_id")),
        1,
    )
    fast, slow = FastEngine(ball).render(shot), NumpyEngine(ball).render(shot)
    if fast.depth_mm is None or slow.depth_mm is None or fast.face_ids is None or fast.rgb is None or slow.rgb is None:
        return "the self-test made no picture"
    same = fast.face_ids == slow.face_ids
    if same.mean() < 0.99 or np.abs(fast.depth_mm - slow.depth_mm)[same].max() > _TEST_DEPTH_MM:
        return f"its self-test agrees on {same.mean():.1%} of the faces"
    if (np.abs(fast.rgb.astype(int) - slow.rgb) > 1).mean() > 0.01:
        return "its self-test gives other colours"
    return None


def _lumpy_ball() -> Anatomy:
    """A closed surface of 800 faces, 8–12 mm from its middle."""
    rings, sectors = 20, 20
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, sectors, endpoint=False), indexing="ij"
    )
    radius = 10 + 2 * np.sin(3 * azimuth) * np.sin(polar) ** 2
    points = radius[..., None] * np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    )
    i, j = np.meshgrid(np.arange(rings), np.arange(sectors), indexing="ij")
    a, b = i * sectors + j, i * sectors + (j + 1) % sectors
    c, d = a + sectors, b + sectors
    faces = np.stack([np.stack([a, c, d], -1), np.stack([a, d, b], -1)]).reshape(-1, 3)
    return Anatomy(points.reshape(-1, 3), faces.astype(np.int32), "ball", "lumpy ball", "self-test")
