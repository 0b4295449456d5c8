"""A scene is an anatomy that rays can be shot into; `render` makes a batch of pictures of it.

    scene = Scene(anatomy)
    rendering = render(scene, anatomy_T_camera, intrinsics, ENDOSCOPE)

A camera inside the lumen sees its walls, near ones included. A camera outside is not refused: it sees the outside of
the surface, or nothing (black, depth 0, `valid` false); `naris.render.viewpoints` is where poses are judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float32, Int32, Integer, UInt8

from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.core.cores import cores
from naris.core.pose import CAMERA, Pose
from naris.errors import InputError, PoseError
from naris.render.appearance import ENDOSCOPE, Appearance

EngineName = Literal["auto", "fast", "numpy"]
Channel = Literal["rgb", "depth", "normal", "face_id"]
CHANNELS: tuple[Channel, ...] = ("rgb", "depth", "normal", "face_id")


@dataclass(frozen=True, eq=False)
class Rendering:
    """N pictures and what each pixel of them sees. Channels that were not wanted are None.

    Attributes:
        valid: (N, H, W) whether the pixel has a ray and the ray meets the surface.
        rgb: (N, H, W, 3) uint8.
        depth_mm: (N, H, W) z-depth, 0 where not valid.
        normals: (N, H, W, 3) unit normal of the face that is seen (flat, not interpolated), in the camera frame,
            on the side that is seen; 0 where not valid. Shading uses interpolated normals.
        face_ids: (N, H, W) index into the anatomy's faces, −1 where not valid.
    """

    valid: Bool[np.ndarray, "n h w"]
    rgb: UInt8[np.ndarray, "n h w 3"] | None = None
    depth_mm: Float32[np.ndarray, "n h w"] | None = None
    normals: Float32[np.ndarray, "n h w 3"] | None = None
    face_ids: Int32[np.ndarray, "n h w"] | None = None

    def __len__(self) -> int:
        return len(self.valid)


@dataclass(frozen=True, eq=False)
class Shot:
    """What an engine is told: N frames of one scene.

    Attributes:
        rotation, position_mm: (N, 3, 3) and (N, 3), anatomy from camera.
        intrinsics: of all frames.
        appearances: one a frame.
        seeds: (N,) of the sensor noise.
        want: the channels.
        threads: at most so many.
    """

    rotation: Float32[np.ndarray, "n 3 3"]
    position_mm: Float32[np.ndarray, "n 3"]
    intrinsics: Intrinsics
    appearances: Sequence[Appearance]
    seeds: Integer[np.ndarray, "n"]
    want: frozenset[str]
    threads: int

    def __len__(self) -> int:
        return len(self.position_mm)


@runtime_checkable
class Engine(Protocol):
    """Shoots rays and shades what they hit."""

    name: str

    def render(self, shot: Shot) -> Rendering: ...


class Scene:
    """An anatomy ready for rays.

    Attributes:
        anatomy: what is seen.
        engine: `fast` (Embree in packets, shaded in compiled code) or `numpy` (Embree through `embreex`, shaded in
            numpy); both give the same picture within one grey level on at least 99.9 % of the values.

    Raises:
        EngineUnavailable: if an engine was named that cannot start here; `auto` takes the fastest that can.
    """

    def __init__(self, anatomy: Anatomy, *, engine: EngineName = "auto") -> None:
        from naris.render.engine import start_engine

        self.anatomy = anatomy
        self._engine = start_engine(anatomy, engine)

    @property
    def engine(self) -> str:
        return self._engine.name

    def shoot(self, shot: Shot) -> Rendering:
        """What `render` does once its arguments are checked."""
        return self._engine.render(shot)


def render(
    scene: Scene,
    anatomy_T_camera: Pose,
    intrinsics: Intrinsics,
    appearance: Appearance | Sequence[Appearance] = ENDOSCOPE,
    *,
    want: Sequence[str] = CHANNELS,
    seeds: Integer[np.ndarray, "n"] | None = None,
    threads: int | None = None,
) -> Rendering:
    """Pictures from N camera poses (a single pose is a batch of one).

    The result depends on the arguments alone: not on the number of threads nor on how frames are batched.

    Args:
        scene: what to look at.
        anatomy_T_camera: N poses into the anatomy's frame.
        intrinsics: of all frames, with any lens.
        appearance: of all frames, or one for each.
        want: the channels to return; `valid` always comes.
        seeds: of each frame's sensor noise; 0, 1, … when None.
        threads: at most so many; one a core when None.

    Raises:
        PoseError: if the poses are not from the camera into the anatomy's frame.
        InputError: if the numbers of poses, appearances and seeds differ, or a channel is unknown.
    """
    poses = anatomy_T_camera.reshape(-1)
    if (poses.target, poses.source) != (scene.anatomy.frame, CAMERA):
        raise PoseError(
            f"poses {scene.anatomy.frame}_T_{CAMERA}", f"{poses.target}_T_{poses.source}", "convert the poses first"
        )
    n = len(poses)
    appearances = [appearance] * n if isinstance(appearance, Appearance) else list(appearance)
    chosen = np.arange(n) if seeds is None else np.asarray(seeds)
    if len(appearances) != n or chosen.shape != (n,):
        raise InputError(
            f"one appearance and one seed for each of {n} poses",
            f"{len(appearances)} appearances and seeds of shape {chosen.shape}",
            "give as many",
        )
    if not set(want) <= set(CHANNELS):
        raise InputError(f"channels out of {CHANNELS}", f"{tuple(want)}", "name some of those")
    shot = Shot(
        poses.rotation.astype(np.float32),
        poses.position_mm.astype(np.float32),
        intrinsics,
        appearances,
        chosen,
        frozenset(want),
        threads or cores(),
    )
    return scene.shoot(shot)
