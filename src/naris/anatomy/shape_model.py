"""A statistical shape model: a mean nose, and the ways in which noses differ from it.

Built as T. Cootes et al. 1995 build one, by principal components of corresponding vertices; the correspondence is that
of `naris.anatomy.correspondence`, which moves the space around the reference to each patient, so that thin walls stay
thin walls. Regions, passages and landmarks of the reference go along with its vertices.
"""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from naris.anatomy.carry import carried_along
from naris.anatomy.correspondence import correspond
from naris.anatomy.crossings import crossings
from naris.anatomy.drawn import CLOSED, CROSSING, Drawn, reasons
from naris.anatomy.folder import load_anatomy, save_anatomy
from naris.anatomy.shape_curves import MOST_SD, ShapeCurves, principal, shape_curves
from naris.core.anatomy import Anatomy
from naris.core.atomic import write_bytes, write_json
from naris.core.progress import SILENT, Progress
from naris.errors import InputError, PoseError

SCHEMA = "naris.shape-model/2"
_WITHOUT_CURVES = "naris.shape-model/1"
DESCRIPTION, MODES, MEAN = "shape_model.json", "modes.npz", "mean"
FEWEST = 3
"""Patients that a model needs at least."""

_TRIES = 20
_SHARE = 0.98  # of the variance that is kept
_MOST_BYTES = 2_000_000_000


@dataclass(frozen=True, eq=False)
class ShapeModel:
    """A mean shape and its modes.

    Attributes:
        mean: an anatomy with the mean vertices.
        modes_mm: (K, V, 3) how vertices move at one standard deviation of each mode, the greatest first.
        share: (K,) of the variance.
        patients: it was built from.
        residual_mm: mean distance of the patients' surfaces from where the reference was laid on them.
        curves: how good it is with how many modes; None in models that were made before there were any.
    """

    mean: Anatomy
    modes_mm: Float32[np.ndarray, "k v 3"]
    share: Float[np.ndarray, "k"]
    patients: int
    residual_mm: float
    curves: ShapeCurves | None = None

    @cached_property
    def _crossings_of_mean(self) -> int:
        return len(crossings(self.mean.vertices_mm, self.mean.faces))

    def vertices_mm(self, coefficients: Float[np.ndarray, "k"]) -> Float[np.ndarray, "v 3"]:
        """Vertices at so many standard deviations along each mode."""
        return self.mean.vertices_mm + np.tensordot(coefficients, self.modes_mm.astype(np.float64), axes=1)

    def patient(self, seed: int, number: int) -> Anatomy:
        """The anatomy of `draw`, without what was passed over."""
        return self.draw(seed, number).anatomy

    def draw(self, seed: int, number: int) -> Drawn:
        """The virtual patient number `number` of a population; it depends on the seed and its number alone.

        Coefficients are normal, none beyond 2.5. A draw in which more faces cross than in the mean, or a passage leaves
        the lumen, is passed over; the source of the patient says which draw it is of.

        Raises:
            InputError: if twenty draws in a row are.
        """
        rng = np.random.default_rng([seed, number])
        passed_over = Counter({CROSSING: 0, CLOSED: 0})
        for draw in range(1, _TRIES + 1):
            coefficients = np.clip(rng.standard_normal(len(self.modes_mm)), -MOST_SD, MOST_SD)
            vertices = self.vertices_mm(coefficients)
            if len(crossings(vertices, self.mean.faces)) > self._crossings_of_mean:
                passed_over[CROSSING] += 1
                continue
            at = " ".join(f"{value:+.2f}" for value in coefficients) + (f", draw {draw}" if draw > 1 else "")
            try:
                nose = carried_along(
                    self.mean,
                    vertices,
                    f"virtual patient {number} of seed {seed}, of a shape model",
                    f"a shape model of {self.patients} patients at {at}",
                )
            except PoseError:
                passed_over[CLOSED] += 1
                continue
            return Drawn(nose, dict(+passed_over))
        raise InputError(
            "shapes whose passages are open and whose walls are apart",
            f"none in {_TRIES} draws ({reasons(passed_over)})",
            "build it of other patients",
        )


def build_shape_model(reference: Anatomy, patients: Sequence[Anatomy], progress: Progress = SILENT) -> ShapeModel:
    """The mean of patients, and their modes (some seconds a patient).

    Args:
        reference: whose mesh, regions and passages the model has; its own shape counts only if it is also a patient.
        patients: with the landmarks that `correspond` asks for, as they lay in their scanners.
        progress: told of every patient.

    Raises:
        InputError: if there are fewer patients than `FEWEST`, or the reference cannot be laid on one of them.
        PoseError: if the reference's passages leave the lumen of the mean shape.
    """
    if len(patients) < FEWEST:
        hint = "give more patients; the reference counts only where it is given as one of them"
        raise InputError(f"{FEWEST} patients or more", f"{len(patients)}", hint)
    shapes, residuals = [], []
    with progress.task("patients", len(patients)) as advance:
        for patient in patients:
            found = correspond(reference, patient)
            shapes.append(_laid_on(found(reference.vertices_mm), reference.vertices_mm))
            residuals.append(float(found.residual_mm.mean()))
            advance(1)
    matrix = np.stack(shapes).reshape(len(shapes), -1)
    middle = matrix.mean(axis=0)
    # Of N shapes there are at most N − 1 modes; they follow from the N×N matrix of the shapes' products.
    centred = matrix - middle
    products = centred @ centred.T
    values, vectors = principal(products)
    share = values / max(float(values.sum()), 1e-12)
    count = int(np.searchsorted(np.cumsum(share), _SHARE)) + 1
    modes = (vectors[:, :count].T @ centred) / np.sqrt(len(shapes) - 1)
    mean = carried_along(
        reference,
        middle.reshape(-1, 3),
        f"mean of {len(shapes)} noses",
        f"the mean of {len(shapes)} noses, on the mesh of {reference.name}",
    )
    shaped = modes.reshape(len(modes), -1, 3).astype(np.float32)
    curves = shape_curves(products, len(reference.vertices_mm))
    return ShapeModel(mean, shaped, share[: len(modes)], len(shapes), float(np.mean(residuals)), curves)


def _laid_on(shape: Float[np.ndarray, "v 3"], other: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"]:
    """A shape turned and moved, not scaled, onto another (W. Kabsch 1976): how a head lay in a scanner is no shape."""
    middle, aim = shape.mean(axis=0), other.mean(axis=0)
    u, _, vt = np.linalg.svd((shape - middle).T @ (other - aim))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return (shape - middle) @ turn + aim


def save_shape_model(model: ShapeModel, folder: Path) -> None:
    """Writes a model as `shape_model.json`, `modes.npz` and the anatomy in `mean`.

    Raises:
        SurfaceError: if `mean` there is something else.
        DiskFull: if there is no room.
    """
    save_anatomy(model.mean, folder / MEAN)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, modes_mm=model.modes_mm)
    write_bytes(folder / MODES, buffer.getvalue())
    told = {
        "schema": SCHEMA,
        "patients": model.patients,
        "share": model.share.tolist(),
        "residual_mm": model.residual_mm,
        "mean_digest": model.mean.digest,
        "curves": {name: values.tolist() for name, values in vars(model.curves).items()} if model.curves else None,
    }
    write_json(folder / DESCRIPTION, told)


def load_shape_model(folder: Path) -> ShapeModel:
    """Reads what `save_shape_model` wrote; nothing in it is executed.

    Raises:
        InputError: if the folder holds no whole shape model.
        SurfaceError: if its mean cannot be used.
    """
    path = folder / DESCRIPTION
    if not path.is_file():
        raise InputError(f"a shape model in {folder}", f"no {DESCRIPTION} there", "make one: naris anatomy shape-model")
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        if told["schema"] not in (SCHEMA, _WITHOUT_CURVES):
            raise ValueError(f"schema {told['schema']}")
        mean = load_anatomy(str(folder / MEAN))
        with zipfile.ZipFile(folder / MODES) as stored:
            if sum(entry.file_size for entry in stored.infolist()) > _MOST_BYTES:
                raise ValueError("modes of more than 2 GB")
        with np.load(folder / MODES, allow_pickle=False) as stored:
            modes = stored["modes_mm"]
        share = np.array([float(value) for value in told["share"]])
        if modes.shape != (len(share), len(mean.vertices_mm), 3) or not np.isfinite(modes).all():
            raise ValueError(f"modes of shape {modes.shape}")
        if told["mean_digest"] != mean.digest:
            raise ValueError("modes of another mean")
        numbers = int(told["patients"]), float(told["residual_mm"])
        return ShapeModel(mean, modes.astype(np.float32), share, *numbers, _curves(told.get("curves")))
    except (
        *(OSError, EOFError, ValueError, OverflowError, LookupError, TypeError),
        *(zipfile.BadZipFile, zlib.error),
    ) as error:
        raise InputError(f"a whole shape model in {folder}", f"{error}", "make it again") from error


def _curves(told: Mapping[str, Sequence[float]] | None) -> ShapeCurves | None:
    """The curves as they were written; a model that was made before there were any has none."""
    if told is None:
        return None
    return ShapeCurves(
        **{field.name: np.array([float(value) for value in told[field.name]]) for field in fields(ShapeCurves)}
    )
