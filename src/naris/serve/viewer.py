"""The viewer: an anatomy to steer through, what our renderer and a model say of it, and the keyframes.

Nothing here knows of requests (`naris.serve.app`), of who may ask (`naris.serve.guard`) or where it is served.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import chain, count
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import UInt8

from naris.core.anatomy import Anatomy, RegionSet
from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.core.progress import Progress
from naris.core.results import Prediction
from naris.errors import InputError, KeyframeError, NarisError, PoseError, RegionError
from naris.render.appearance import ENDOSCOPE
from naris.render.keyframes import (
    Keyframe,
    Keyframes,
    interpolate,
    read_keyframes,
    write_keyframes,
)
from naris.render.scene import Scene, render
from naris.serve.brush import Brush
from naris.serve.exchange import as_json, as_original, taken
from naris.serve.messages import FrameAsked, KeyframesTold, LensTold, SimulationAsked, SlicesAsked, StrokeTold, UndoTold
from naris.serve.slices import Slices
from naris.serve.stage import look_parcel, regions_parcel, room_parcel, start_pose, steady, surface_parcel
from naris.serve.work import Stopped, Work

_PICTURE_PX = 300

Locate = Callable[[UInt8[np.ndarray, "h w 3"]], Prediction]
Simulate = Callable[[Path, Path, Path | None, SimulationAsked, Progress], int]
"""Pictures along the keyframes of a file, into a folder, labelled by a file of painted regions where there is one, as
they are asked for; gives their number."""


@dataclass(eq=False)
class Viewer:
    """What is looked at, and what was saved.

    Attributes:
        anatomy: to steer through.
        regions: that its places are named by; None where it has none.
        keyframes: the file that they are kept in.
        locate: a model's answer to a picture, where there is a model.
        model_camera: the camera that the model knows.
        simulate: makes pictures along keyframes.
        slices: of the CT that the anatomy was found in, where that is given.
    """

    PARCELS: ClassVar[tuple[str, ...]] = ("surface", "look", "room")  # the last takes longest

    anatomy: Anatomy
    regions: RegionSet | None
    keyframes: Path
    locate: Locate | None = None
    model_camera: Intrinsics | None = None
    simulate: Simulate | None = None
    slices: Slices | None = None
    work: Work = field(default_factory=Work)
    _kept: Keyframes | None = None
    _brush: Brush | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        if self.keyframes.exists():
            self._kept = read_keyframes(self.keyframes, self.anatomy)
        self._scene = Scene(self.anatomy)
        self._made: dict[str, bytes] = {}
        self._making = threading.Lock()
        self._painting = threading.Lock()
        self._locating = threading.Lock()
        self._worker: threading.Thread | None = None

    # --- what is looked at ------------------------------------------------------------------------------------------

    def parcel(self, name: str) -> bytes:
        """`surface`, `room` or `look`, made when it is first asked for."""
        makers: dict[str, Callable[[], bytes]] = {
            "surface": lambda: surface_parcel(self.anatomy, self.regions),
            "room": lambda: room_parcel(self.anatomy, self.regions),
            "look": look_parcel,
        }
        with self._making:
            if name not in self._made:
                self._made[name] = makers[name]()
            return self._made[name]

    def prepare(self) -> None:
        """Makes all parcels, in a thread of its own: they are there when a browser has started and asks for them."""
        threading.Thread(target=lambda: [self.parcel(name) for name in self.PARCELS], daemon=True).start()

    def start(self) -> dict[str, Any]:
        """Where to begin, and what there is."""
        return {
            "pose": start_pose(self.anatomy).matrix.tolist(),
            "digest": self.anatomy.digest,
            "hasModel": self.locate is not None,
            "hasSimulate": self.simulate is not None and self.regions is not None,
            "hasSlices": self.slices is not None,
            "keyframesFile": self.keyframes.name,
            "place": self.place,
            "brush": None if self._brush is None else self._brush.state(),
        }

    @property
    def place(self) -> str:
        """What tells this anatomy and file of keyframes from others that are served at the same address later."""
        return hashlib.sha256(f"{self.anatomy.digest} {self.keyframes.resolve()}".encode()).hexdigest()[:24]

    def frame(self, asked: FrameAsked) -> UInt8[np.ndarray, "h w 3"]:
        """A picture by our own renderer.

        Raises:
            PoseError: if the pose is none.
        """
        return self._rendered(self._pose(asked.pose), asked.camera(asked.width, asked.height), asked.steady)

    def sliced(self, asked: SlicesAsked) -> UInt8[np.ndarray, "h w 3"]:
        """Three slices of the CT, side by side.

        Raises:
            InputError: if there is no CT.
        """
        if self.slices is None:
            raise InputError("a CT", "none", "start naris steer with --ct")
        return self.slices.picture(np.array(asked.place), asked.span_mm, asked.size, (asked.level, asked.width))

    def _rendered(self, pose: Pose, camera: Intrinsics, is_steady: bool) -> UInt8[np.ndarray, "h w 3"]:
        look = steady() if is_steady else ENDOSCOPE
        rgb = render(self._scene, pose.reshape(1), camera, look, want=("rgb",)).rgb
        if rgb is None:
            raise AssertionError("a rendering without the channel that was asked for")
        return rgb[0]

    def _pose(self, matrix: Sequence[Sequence[float]]) -> Pose:
        numbers = np.array(matrix, dtype=np.float64) if _is_square(matrix) else np.zeros(0)
        if numbers.shape != (4, 4):
            raise PoseError("a pose of 4×4 numbers", "another shape", "send anatomy_T_camera row by row")
        return Pose(numbers, self.anatomy.frame, CAMERA)

    # --- regions that are painted -----------------------------------------------------------------------------------

    def paint(self, asked: StrokeTold) -> bytes:
        """A stroke of the brush; the regions as they are then.

        Raises:
            RegionError: if there are no regions, or none of that number.
        """
        with self._painting:
            brush = self._brushed()
            return self._repainted(brush.state(brush.paint(asked.region, asked.radius_mm, asked.points)))

    def unpaint(self, asked: UndoTold) -> bytes:
        """Takes the last of so many strokes back; the regions as they are then."""
        with self._painting:
            brush = self._brushed()
            return self._repainted(brush.state(brush.undo(asked.strokes)))

    def save_regions(self) -> dict[str, Any]:
        """Writes the painted set beside the keyframes."""
        with self._painting:
            brush = self._brushed()
            return brush.state(0, brush.save(self.keyframes.parent).name)

    def painted_file(self) -> Path | None:
        """The file of the painted set, written if need be; None where nothing was painted.

        Raises:
            RegionError: if it cannot be written.
        """
        with self._painting:
            if self._brush is None or (self._brush.is_saved and not self._brush.state()["undoable"]):
                return None
            return self._brush.save(self.keyframes.parent)

    def _brushed(self) -> Brush:
        if self.regions is None:
            raise RegionError("regions to paint", "an anatomy without any", "start naris steer with --regions slabs")
        if self._brush is None:
            self._brush = Brush(self.anatomy, self.regions)
        return self._brush

    def _repainted(self, about: dict[str, Any]) -> bytes:
        if self._brush is None:
            raise AssertionError("regions without a brush")
        with self._making:
            self.regions = self._brush.regions
            for name in ("surface", "room"):
                self._made.pop(name, None)
        return regions_parcel(self.anatomy, self.regions, about)

    # --- what a model says ------------------------------------------------------------------------------------------

    def believed(self, image: UInt8[np.ndarray, "h w 3"]) -> dict[str, Any]:
        """What the model says of a picture.

        Raises:
            InputError: if there is no model.
        """
        if self.locate is None:
            raise InputError("a model to locate with", "none", "start naris steer with --model")
        with self._locating:
            told = self.locate(image)
        poses = [] if told.hypotheses is None else told.hypotheses.matrix.tolist()
        weights = [] if told.weights is None else told.weights.tolist()
        return {
            "regions": list(told.region_names),
            "probabilities": told.probabilities.tolist(),
            "hypotheses": [{"pose": pose, "weight": w} for pose, w in zip(poses, weights, strict=True)],
            "outOfDomain": told.out_of_domain,
        }

    def believed_here(self, matrix: Sequence[Sequence[float]]) -> dict[str, Any]:
        """What the model says of what its own camera would see from a pose."""
        camera = self.model_camera or Intrinsics.from_vertical_fov(_PICTURE_PX, _PICTURE_PX, 45.0)
        return self.believed(self._rendered(self._pose(matrix), camera, is_steady=False))

    # --- keyframes --------------------------------------------------------------------------------------------------

    def told_keyframes(self) -> dict[str, Any]:
        """All keyframes as their file has them, and their revision: a digest, the same for the same keyframes."""
        with self._lock:
            return self._told()

    def _told(self) -> dict[str, Any]:
        rows = _rows(self._kept)
        return {"revision": _revision(rows), "keyframes": rows}

    def keep(self, told: KeyframesTold) -> dict[str, Any]:
        """Writes the keyframes of the page; the same ones again change nothing.

        Raises:
            KeyframeError: if the page did not know what it would replace, because another page or program changed the
                file meanwhile; if it is a page of another anatomy or file; or if that cannot be written.
            PoseError: if one has no pose.
        """
        if told.place != self.place:
            raise KeyframeError("keyframes of this anatomy and file", "those of another page", "load the page again")
        rows = tuple(Keyframe(one.name, self._pose(one.pose)) for one in told.keyframes)
        wanted = Keyframes(rows, self.anatomy.name, self.anatomy.digest) if rows else None
        with self._lock:
            self._kept = read_keyframes(self.keyframes, self.anatomy) if self.keyframes.exists() else None
            now, then = (_revision(_rows(one)) for one in (self._kept, wanted))
            if now not in (told.revision, then):
                raise KeyframeError(
                    "keyframes as they are now", "some that were changed elsewhere meanwhile", "take those in as well"
                )
            if now != then:
                self._write(wanted)
                self._kept = wanted
            return self._told()

    def _write(self, wanted: Keyframes | None) -> None:
        try:
            if wanted is None:
                self.keyframes.unlink(missing_ok=True)
            else:
                write_keyframes(wanted, self.keyframes)
        except OSError as error:
            raise KeyframeError(
                f"to write {self.keyframes.name}", f"{error.strerror}", "start naris steer with another --keyframes"
            ) from error

    def taken(self, content: bytes, name: str) -> list[dict[str, Any]]:
        """The keyframes of a file, for the page to add (`naris.serve.exchange.taken`)."""
        return _rows(taken(content, name, self.anatomy))

    def exported(self, kind: str, lens: LensTold) -> bytes:
        """All keyframes as our JSON file (`json`), or zipped as text files of the original (`original`) with pictures.

        Raises:
            KeyframeError: if there are none.
        """
        kept = self._some()
        if kind == "json":
            return as_json(kept)
        camera = lens.camera(_PICTURE_PX, _PICTURE_PX)
        return as_original(kept, lambda pose: self._rendered(pose, camera, is_steady=False))

    def trajectory(self, step_mm: float) -> list[list[list[float]]]:
        """The poses from keyframe to keyframe, as `naris simulate` goes.

        Raises:
            KeyframeError: if there are fewer than two.
        """
        return interpolate(self._some(), step_mm).anatomy_T_camera.matrix.tolist()

    def _some(self) -> Keyframes:
        if self._kept is None:
            raise KeyframeError("at least one keyframe", "none", "save a viewpoint first")
        return self._kept

    # --- pictures along them ----------------------------------------------------------------------------------------

    def begin(self, asked: SimulationAsked) -> dict[str, Any]:
        """Begins to make pictures along the keyframes, in a folder beside their file.

        Raises:
            InputError: if that runs already, or cannot be done here.
            KeyframeError: if there are fewer than two.
        """
        self.trajectory(asked.step_mm)
        if self.simulate is None:
            raise InputError("a program that simulates", "none", "start the page with naris steer")
        with self._lock:
            if self.work.running:
                raise InputError("one simulation at a time", "another", "wait until it has ended")
            folder = self._free_folder()
            self.work = Work(running=True, folder=folder.name)
        self._worker = threading.Thread(target=self._simulated, args=(folder, asked), daemon=True)
        self._worker.start()
        return self.told_work()

    def stop(self, *, wait_s: float = 0.0) -> dict[str, Any]:
        """Stops the simulation that runs, if one does: its folder, which is not whole, is removed."""
        self.work.stopped = True
        if self._worker is not None and wait_s > 0:
            self._worker.join(wait_s)
        return self.told_work()

    def _free_folder(self) -> Path:
        """A new one beside the keyframes: what was made along others stays."""
        first = self.keyframes.with_name(f"{self.keyframes.stem}-pictures")
        numbered = (first.with_name(f"{first.name}-{k}") for k in count(2))
        return next(folder for folder in chain([first], numbered) if not folder.exists())

    def _simulated(self, folder: Path, asked: SimulationAsked) -> None:
        work = self.work
        try:
            if self.simulate is not None:
                regions = self.painted_file()
                count = self.simulate(self.keyframes, folder, regions, asked, work)
                work.said = f"{count} pictures in {folder.name}"
        except Stopped:
            shutil.rmtree(folder, ignore_errors=True)
            at = f"at {work.done} of {work.total} pictures" if work.total else "before the first picture"
            work.said = f"stopped {at}: none is kept"
        except NarisError as error:
            work.said = str(error)
        except OSError as error:
            work.said = f"cannot use {folder.name}: {error.strerror}"
        finally:
            work.said = work.said or "it ended by a fault of naris: see what the command printed"
            work.running = False

    def told_work(self) -> dict[str, Any]:
        """How far the pictures are."""
        work = self.work
        return {
            "place": self.place,
            "done": work.done,
            "total": work.total,
            "running": work.running,
            "said": "stopping" if work.running and work.stopped else work.said,
            "folder": work.folder,
        }


def _rows(keyframes: Keyframes | None) -> list[dict[str, Any]]:
    rows = () if keyframes is None else keyframes.keyframes
    return [{"name": one.name, "pose": one.anatomy_T_camera.matrix.tolist()} for one in rows]


def _revision(rows: list[dict[str, Any]]) -> str:
    return hashlib.sha256(json.dumps(rows).encode()).hexdigest()[:24]


def _is_square(matrix: Sequence[Sequence[float]]) -> bool:
    return len(matrix) == 4 and all(len(row) == 4 for row in matrix)
