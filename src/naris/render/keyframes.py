"""Keyframes: viewpoints that a person saved, in a JSON file (docs/keyframes.md) or as the text files of the original.

Between keyframes the camera goes straight, in steps of 1 mm, and looks where the next keyframe looks, as in the code
published with Sinha et al. 2018 (github.com/AyushiSinha/AutoInitialization).
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from naris.core.anatomy import Anatomy
from naris.core.atomic import write_json, write_text
from naris.core.pose import CAMERA, Pose, stack
from naris.errors import KeyframeError, PoseError

SCHEMA = "naris.keyframes/1"
UP = (0.0, 0.0, 1.0)
"""The original's camera stands upright: +z of the anatomy is up in every picture."""

_UPRIGHT_RAD = 1e-6


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A viewpoint that somebody saved.

    Attributes:
        name: what it is called, `00`, `01`, … where nobody named it.
        anatomy_T_camera: one pose, mm, camera x right, y down, z forward.
    """

    name: str
    anatomy_T_camera: Pose

    def __post_init__(self) -> None:
        if self.anatomy_T_camera.shape != () or self.anatomy_T_camera.source != CAMERA:
            raise KeyframeError(
                "one camera pose a keyframe",
                f"{self.anatomy_T_camera.target}_T_{self.anatomy_T_camera.source} of shape "
                f"{self.anatomy_T_camera.shape} in {self.name!r}",
                "make a keyframe of each pose",
            )


@dataclass(frozen=True, eq=False)
class Keyframes:
    """Keyframes in the order in which they were saved, and the anatomy that they were saved in.

    Attributes:
        keyframes: at least one, all in one frame.
        anatomy_name: for people; None where unknown.
        anatomy_digest: of `Anatomy.digest`; None where unknown, as in the original's files.

    Raises:
        KeyframeError: if there are none or their frames differ.
    """

    keyframes: tuple[Keyframe, ...]
    anatomy_name: str | None = None
    anatomy_digest: str | None = None

    def __post_init__(self) -> None:
        if not self.keyframes:
            raise KeyframeError("at least one keyframe", "none", "save a viewpoint first")
        frames = {keyframe.anatomy_T_camera.target for keyframe in self.keyframes}
        if len(frames) > 1:
            raise KeyframeError("keyframes in one frame", f"{sorted(frames)}", "split them by frame")

    @staticmethod
    def of(poses: Pose, anatomy: Anatomy | None = None, names: Sequence[str] | None = None) -> Keyframes:
        """From a batch (N,) of camera poses, named `00`, `01`, … unless `names` says otherwise."""
        width = max(2, len(str(len(poses) - 1)))
        names = [f"{i:0{width}d}" for i in range(len(poses))] if names is None else names
        keyframes = tuple(Keyframe(name, poses[i]) for i, name in enumerate(names))
        if anatomy is None:
            return Keyframes(keyframes)
        return Keyframes(keyframes, anatomy.name, anatomy.digest)

    @property
    def frame(self) -> str:
        return self.keyframes[0].anatomy_T_camera.target

    @property
    def anatomy_T_camera(self) -> Pose:
        """All poses as a batch (N,)."""
        return stack([keyframe.anatomy_T_camera for keyframe in self.keyframes])

    def __len__(self) -> int:
        return len(self.keyframes)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Camera positions between keyframes.

    Attributes:
        positions_mm: (P, 3).
        directions: (P, 3) unit viewing directions.
        ups: (P, 3) what is up in the picture (need not be orthogonal to the direction).
        segments: (P,) the keyframe that each position comes after.
        frame: that of the keyframes.
    """

    positions_mm: Float[np.ndarray, "p 3"]
    directions: Float[np.ndarray, "p 3"]
    ups: Float[np.ndarray, "p 3"]
    segments: Int[np.ndarray, "p"]
    frame: str

    def __len__(self) -> int:
        return len(self.positions_mm)

    @property
    def anatomy_T_camera(self) -> Pose:
        """The poses (P,) without any jitter."""
        return Pose.look(self.positions_mm, self.directions, self.ups, self.frame)


def interpolate(keyframes: Keyframes, step_mm: float = 1.0) -> Trajectory:
    """Go from keyframe to keyframe in straight steps, looking where the next keyframe looks, as the original does.

    Between keyframes a and b the positions are a + j·step·(b − a)/|b − a| for j = 0, 1, …, floor(|b − a| / step).
    Up is +z where the next keyframe stands upright (the original knows nothing else), else its own up.

    Raises:
        KeyframeError: if there are fewer than two keyframes, or the step is not positive.
    """
    if len(keyframes) < 2 or not 0 < step_mm < np.inf:
        raise KeyframeError(
            "two keyframes or more and a positive step in mm",
            f"{len(keyframes)} and {step_mm}",
            "save another viewpoint" if len(keyframes) < 2 else "give a step such as 1",
        )
    poses = keyframes.anatomy_T_camera
    steps, segments = [], []
    for i, (start, end) in enumerate(zip(poses.position_mm[:-1], poses.position_mm[1:], strict=True)):
        reach = float(np.linalg.norm(end - start))
        way_mm = step_mm * np.arange(int(np.floor(reach / step_mm + 1e-9)) + 1)
        unit = (end - start) / reach if reach > 0 else np.zeros(3)
        steps.append(start + way_mm[:, None] * unit)
        segments.append(np.full(len(way_mm), i))
    segment = np.concatenate(segments)
    return Trajectory(
        np.concatenate(steps), poses.forward[segment + 1], up_of(poses)[segment + 1], segment, keyframes.frame
    )


def up_of(poses: Pose) -> Float[np.ndarray, "*batch 3"]:
    """What is up for each camera: +z of the anatomy if that gives its very roll (as the original), else its own −y."""
    upright = Pose.look(poses.position_mm, poses.forward, np.array(UP), poses.target)
    down = poses.rotation[..., :, 1]
    sine, cosine = ((upright.rotation[..., :, axis] * down).sum(axis=-1) for axis in (0, 1))
    same = (np.abs(sine) < _UPRIGHT_RAD) & (cosine > 0)
    return np.where(same[..., None], np.array(UP), -down)


# --- the JSON file ------------------------------------------------------------------------------------------------


def write_keyframes(keyframes: Keyframes, path: Path) -> None:
    """Write the JSON file of docs/keyframes.md.

    Raises:
        DiskFull: if there is no room; an old file stays.
    """
    anatomy = {"name": keyframes.anatomy_name, "digest": keyframes.anatomy_digest}
    rows = [{"name": k.name, "anatomy_T_camera": k.anatomy_T_camera.matrix.tolist()} for k in keyframes.keyframes]
    write_json(path, {"schema": SCHEMA, "frame": keyframes.frame, "anatomy": anatomy, "keyframes": rows})


def read_keyframes(path: Path, anatomy: Anatomy | None = None) -> Keyframes:
    """Read the JSON file of docs/keyframes.md, and see that it belongs to `anatomy` if one is given.

    Raises:
        KeyframeError: if the file is missing or not such a file, has no keyframe or a broken pose, or was saved in
            another anatomy or frame.
    """
    content = _read_json(path)
    try:
        frame, rows = content["frame"], content["keyframes"]
        owner = content.get("anatomy") or {}
        poses = [(str(row.get("name", f"{i:02d}")), row["anatomy_T_camera"]) for i, row in enumerate(rows)]
        owner_name, owner_digest = owner.get("name"), owner.get("digest")
    except (KeyError, TypeError, AttributeError) as error:
        raise KeyframeError(
            "`frame` and `keyframes`, each with `anatomy_T_camera`", f"{path.name} without", "see docs/keyframes.md"
        ) from error
    if not poses:
        raise KeyframeError(f"at least one keyframe in {path.name}", "none", "save a viewpoint first")
    keyframes = tuple(Keyframe(name, _pose(matrix, str(frame), f"{name!r} of {path.name}")) for name, matrix in poses)
    found = Keyframes(keyframes, owner_name, owner_digest)
    if anatomy is not None:
        check_belongs(found, anatomy)
    return found


def check_belongs(keyframes: Keyframes, anatomy: Anatomy) -> None:
    """See that keyframes were saved in this anatomy (where they say so) and stand in its frame.

    Raises:
        KeyframeError: if not.
    """
    if keyframes.frame != anatomy.frame:
        raise KeyframeError(
            f"keyframes in the frame {anatomy.frame!r} of {anatomy.name}",
            f"keyframes in {keyframes.frame!r}",
            "give the anatomy that they were saved in",
        )
    if keyframes.anatomy_digest is not None and keyframes.anatomy_digest != anatomy.digest:
        raise KeyframeError(
            f"keyframes saved in {anatomy.name} (digest {anatomy.digest[:12]})",
            f"keyframes of {keyframes.anatomy_name or 'another anatomy'} (digest {keyframes.anatomy_digest[:12]})",
            "give the anatomy that they were saved in",
        )


# --- the original's text files ------------------------------------------------------------------------------------


def read_original_keyframes(folder: Path, frame: str, pattern: str = "*.txt") -> Keyframes:
    """Read the original's keyframes: one text file each, in the order of their names.

    Each file has three rows `position_i forward_i` (mm; i = x, y, z). The camera stands upright.

    Args:
        folder: the folder with the files (`dataset/pose` in the original), or one such file.
        frame: the frame that the numbers are in; the files do not say. `mean` for the published mean nose.
        pattern: which files; the original takes one trajectory as `2*`.

    Raises:
        KeyframeError: if there are none, or one cannot be read.
    """
    files = [folder] if folder.is_file() else sorted(folder.glob(pattern), key=natural_order)
    if not files:
        raise KeyframeError(f"keyframe files {pattern} in {folder.name}", "none", "give the folder of the poses")
    return Keyframes(tuple(Keyframe(file.stem, read_original_pose(file, frame)) for file in files))


def write_original_keyframes(keyframes: Keyframes, folder: Path) -> tuple[Path, ...]:
    """Write each keyframe as `NAME.txt` in the original's format. A roll is lost: the format has no word for it.

    Raises:
        KeyframeError: if names repeat or cannot name a file.
        DiskFull: if there is no room.
    """
    names = [keyframe.name for keyframe in keyframes.keyframes]
    if len(set(names)) < len(names) or not all(re.fullmatch(r"[\w.-]+", name) for name in names):
        raise KeyframeError(
            "keyframe names that differ and can name files", f"{names}", "rename the keyframes before writing them"
        )
    paths = tuple(folder / f"{name}.txt" for name in names)
    for path, keyframe in zip(paths, keyframes.keyframes, strict=True):
        write_text(path, original_pose_text(keyframe.anatomy_T_camera), durable=False)
    return paths


def original_pose_text(pose: Pose) -> str:
    """A pose in the original's two columns: rows x, y, z of position (mm) and viewing direction, six decimals."""
    rows = zip(pose.position_mm, pose.forward, strict=True)
    return "".join(f"{position:f} {forward:f}\n" for position, forward in rows)


def read_original_pose(path: Path, frame: str) -> Pose:
    """An upright camera from the original's two columns.

    Raises:
        KeyframeError: if the file is not three rows of two finite numbers, or the direction has no length.
    """
    try:
        numbers = np.array([[float(word) for word in line.split()] for line in path.read_text().splitlines() if line])
        if numbers.shape != (3, 2):
            raise ValueError(f"{numbers.shape}")
    except (ValueError, OSError) as error:
        raise KeyframeError(
            f"three rows `position forward` in {path.name}", "something else", "give a pose file of the original"
        ) from error
    if not np.isfinite(numbers).all() or np.linalg.norm(numbers[:, 1]) < 1e-12:
        raise KeyframeError(
            f"finite numbers and a viewing direction in {path.name}", "NaN, infinity or zero", "remove this keyframe"
        )
    return Pose.look(numbers[:, 0], numbers[:, 1], np.array(UP), frame)


def natural_order(path: Path) -> tuple[tuple[int, int | str], ...]:
    """A sorting key under which `9` comes before `10`."""
    parts = re.findall(r"\d+|\D+", path.stem)
    return tuple((0, int(part)) if part.isdigit() else (1, part) for part in parts)


def _pose(matrix: Any, frame: str, where: str) -> Pose:
    try:
        numbers = np.array(matrix, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise KeyframeError(f"a 4×4 matrix in keyframe {where}", "something else", "see docs/keyframes.md") from error
    if numbers.shape != (4, 4):
        raise KeyframeError(f"a 4×4 matrix in keyframe {where}", f"shape {numbers.shape}", "see docs/keyframes.md")
    try:
        return Pose(numbers, frame, CAMERA)
    except PoseError as error:
        raise KeyframeError(f"{error.expected} in keyframe {where}", error.got, error.todo) from error


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise KeyframeError(f"a keyframe file {path.name}", "no such file", "check the path") from error
    except (ValueError, OSError) as error:
        raise KeyframeError(f"JSON in {path.name}", "something else", "see docs/keyframes.md") from error
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = content.get("schema") if isinstance(content, dict) else type(content).__name__
        raise KeyframeError(f"a file of schema {SCHEMA}", f"{found!r} in {path.name}", "see docs/keyframes.md")
    return content
