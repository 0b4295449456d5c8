"""What registrations read and write: depth images, clouds, transforms and landmarks for 3D Slicer."""

from __future__ import annotations

import io
import re
from pathlib import Path
from tokenize import TokenError
from typing import Any
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float
from PIL import Image, UnidentifiedImageError

from naris.anatomy.ply import read_ply_points
from naris.core.anatomy import Anatomy
from naris.core.atomic import replacing
from naris.core.pose import Pose
from naris.errors import InputError, MachineError

CLOUDS, DEPTHS = (".npy", ".ply", ".txt", ".xyz", ".csv"), (".npy", ".png", ".tif", ".tiff")
AHEAD_MM = 10.0
AHEAD = f"{AHEAD_MM:.0f} mm ahead of the camera"
_MOST_BYTES = 1 << 30
_MOST_PIXELS = 64_000_000
DEVIATIONS = "standard deviations of depth"
_MOST_NEGATIVE = 0.1  # of the depths that are known: of more the sign is another
_NOT_NUMPY = (
    *(ValueError, TypeError, LookupError, SyntaxError, TokenError),  # of a header, which is a word of Python
    *(EOFError, OSError, OverflowError, MemoryError, BadZipFile),
)
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d+,\d+(\s+[-+]?\d+,\d+){2,}\s*")
_UNIT = 0.02  # how far from 1 the length of a normal may be that was rounded to two digits


def read_cloud(path: Path) -> Float[np.ndarray, "n 3"]:
    """The points (N, 3) of a cloud: the vertices of a PLY, three numbers a line of text, or a numpy array.

    Raises:
        InputError: if there is no such file, or it holds no points.
    """
    return _read_cloud(path, 3)


def read_normals(path: Path) -> Float[np.ndarray, "n 3"]:
    """The normals (N, 3) of a cloud: nx, ny and nz of a PLY, or what stands behind x, y and z in text or numpy.

    Raises:
        InputError: if there is no such file, or it holds no normals.
    """
    return _read_cloud(path, 6)[:, 3:]


def has_normals(path: Path) -> bool:
    """Whether three numbers behind each point are a direction; colours are none.

    Raises:
        InputError: if there is no such file.
    """
    try:
        length = np.linalg.norm(read_normals(path), axis=1)
    except InputError:
        content_of(path, CLOUDS, "a cloud")
        return False
    return bool(len(length) and (np.abs(length - 1) < _UNIT).all())


def _read_cloud(path: Path, columns: int) -> Float[np.ndarray, "n c"]:
    content = content_of(path, CLOUDS, "a cloud")
    try:
        if path.suffix.lower() == ".npy":
            points = _array(path, content)
        elif path.suffix.lower() == ".ply":
            points = read_ply_points(path, content, normals=columns > 3)
        else:
            lines = _lines(content.decode("utf-8-sig", "strict"))
            if lines and all(_DECIMAL_COMMA.fullmatch(line) for line in lines):
                raise ValueError("commas in its numbers")
            points = np.array([[float(word) for word in line.replace(",", " ").split()] for line in lines])
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(
            f"points in {path.name}", f"something else ({error})", "give three numbers a line, a PLY or a .npy (N, 3)"
        ) from error
    fits = points.ndim == 2 and points.shape[1] in {columns, 6} and _is_real(points)
    if not fits:
        todo = "give x, y and z, or those and the normal" if columns == 3 else "give x, y, z and the normal"
        got = f"an array of shape {points.shape}" if points.size else "none"
        raise InputError(f"points (N, {columns}) in {path.name}", got, todo)
    return np.asarray(points[:, :columns], dtype=np.float64)


def read_depth_image(path: Path, unit_mm: float, what: str = "depth") -> Float[np.ndarray, "h w"]:
    """Z-depth in mm: a 16-bit picture, each step `unit_mm`, or a numpy array in units of `unit_mm`; 0 or NaN unknown.

    Args:
        path: of the file.
        unit_mm: of its numbers.
        what: they are, for messages: depth, or its deviations.

    Raises:
        InputError: if there is no such file, or it is no depth image.
    """
    content = content_of(path, DEPTHS, "a depth image")
    depth = _array(path, content) if path.suffix.lower() == ".npy" else _picture(path, content)
    if depth.ndim != 2 or not _is_real(depth):
        got = f"an array of shape {depth.shape} and type {depth.dtype}"
        raise InputError(f"an image (H, W) of {what} in {path.name}", got, "give one channel")
    known = depth[np.isfinite(depth) & (depth != 0)]
    negative = int((known < 0).sum())
    if not len(known) or negative > _MOST_NEGATIVE * len(known):
        got = f"{negative} of {len(known)} below it" if len(known) else "none"
        todo = "check the file, and which way its z looks" if what == "depth" else "check the file"
        raise InputError(f"{what} above 0 in {path.name}", got, todo)
    return np.asarray(depth, dtype=np.float64) * unit_mm


def content_of(path: Path, suffixes: tuple[str, ...], what: str) -> bytes:
    """All of a file.

    Raises:
        InputError: if it has another suffix, is not there, or holds more than 1 GB.
    """
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{what} as {', '.join(suffixes)}", path.name, "convert it")
    if not path.is_file():
        raise InputError(f"{what} at {path}", "a folder" if path.is_dir() else "no such file", "check the path")
    if path.stat().st_size > _MOST_BYTES:
        raise InputError(f"{what} of at most 1 GB", f"{path.stat().st_size / 1e9:.1f} GB", "thin it out")
    return path.read_bytes()


def _array(path: Path, content: bytes) -> np.ndarray:
    """The array that a file of numpy holds."""
    try:
        array = np.load(io.BytesIO(content), allow_pickle=False)
    except _NOT_NUMPY as error:
        raise InputError(f"a numpy array in {path.name}", f"something else ({error})", "save it again") from error
    if not isinstance(array, np.ndarray):
        raise InputError(f"one numpy array in {path.name}", "several (.npz)", "save the one alone with numpy.save")
    return array


def _is_real(array: np.ndarray) -> bool:
    return array.dtype.kind in "iuf"


def slicer_transform(anatomy_T_camera: Pose) -> str:
    """An ITK transform file that puts things of the camera where they are, in 3D Slicer.

    Such a file tells a resampling, from the world to the thing; so it holds the inverse of the pose, and Slicer shows
    the inverse of what the file holds. Both frames count as LPS; Slicer converts to RAS.

    Raises:
        InputError: if the anatomy is not in LPS.
    """
    numbers = " ".join(f"{x:.17g}" for x in _resampling(anatomy_T_camera))
    return (
        "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n"
        f"Parameters: {numbers}\nFixedParameters: 0 0 0\n"
    )


def write_slicer_hdf5(anatomy_T_camera: Pose, path: Path) -> None:
    """The transform of `slicer_transform` as HDF5 (`.h5`).

    Raises:
        InputError: if the anatomy is not in LPS.
        MachineError: if it cannot be written.
    """
    import SimpleITK as sitk

    numbers = _resampling(anatomy_T_camera)
    with replacing(path) as part:
        try:
            sitk.WriteTransform(sitk.AffineTransform(numbers[:9], numbers[9:]), str(part))
        except RuntimeError as error:
            raise MachineError(f"to write {path}", "an error of the HDF5 library", "see that there is room") from error


def _resampling(anatomy_T_camera: Pose) -> list[float]:
    """`camera_T_anatomy`, the rotation row by row and then the translation."""
    if anatomy_T_camera.target != "LPS":
        raise InputError(
            "an anatomy in LPS for a transform of 3D Slicer",
            f"one in the frame {anatomy_T_camera.target}",
            "use the matrix in the JSON",
        )
    camera_T_anatomy = anatomy_T_camera.inverse().matrix
    return [*camera_T_anatomy[:3, :3].ravel().tolist(), *camera_T_anatomy[:3, 3].tolist()]


def slicer_landmarks(anatomy: Anatomy, anatomy_T_camera: Pose | None) -> dict[str, Any]:
    """Markups of 3D Slicer: the landmarks of the anatomy, and the camera with a point 10 mm ahead of it.

    Raises:
        InputError: if the anatomy is not in LPS.
    """
    if anatomy.frame != "LPS":
        raise InputError("an anatomy in LPS for markups of 3D Slicer", f"one in {anatomy.frame}", "use the JSON")
    points = dict(anatomy.landmarks_mm)
    if anatomy_T_camera is not None:
        points["camera"] = anatomy_T_camera.position_mm
        points[AHEAD] = anatomy_T_camera.position_mm + AHEAD_MM * anatomy_T_camera.forward
    return {
        "@schema": "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
        "markups-schema-v1.0.3.json#",
        "markups": [
            {
                "type": "Fiducial",
                "coordinateSystem": "LPS",
                "coordinateUnits": "mm",
                "controlPoints": [
                    {
                        "id": str(number),
                        "label": name,
                        "position": [float(x) for x in point],
                        "positionStatus": "defined",
                    }
                    for number, (name, point) in enumerate(points.items(), 1)
                ],
            }
        ],
    }


def _lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.strip() and line.lstrip()[0] not in "#xX"]


def _picture(path: Path, content: bytes) -> np.ndarray:
    try:
        with Image.open(io.BytesIO(content), formats=("PNG", "TIFF")) as picture:
            if picture.width * picture.height > _MOST_PIXELS:
                raise InputError(
                    f"a depth image of at most {_MOST_PIXELS:,} pixels",
                    f"{picture.width}×{picture.height}",
                    "resize it",
                )
            if not picture.mode.startswith(("I", "F")):
                raise InputError(
                    f"16 bits a pixel in {path.name}",
                    f"a picture of the mode {picture.mode}",
                    "save depth, not colours",
                )
            return np.array(picture)
    except (UnidentifiedImageError, OSError, SyntaxError) as error:
        raise InputError(f"a depth image in {path.name}", "a damaged or other file", "save it again") from error
