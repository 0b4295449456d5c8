"""What a model said about pictures whose truth is known, as one file of plain arrays (npz, nothing that executes)."""

from __future__ import annotations

import hashlib
import json
import logging
import zipfile
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from naris.core.atomic import write_bytes
from naris.core.pose import CAMERA, Pose, fingerprints
from naris.core.provenance import digest
from naris.dataset.layout import RegionLabels
from naris.dataset.read import Dataset
from naris.errors import DatasetError
from naris.model.checkpoint import Checkpoint, Subject, check_regions
from naris.model.localizer import Localizer, Outputs, open_localizer, weighed
from naris.render.viewpoints import FREE

SCHEMA = "naris.predictions/1"
_MANNER = 4  # grows when the same model comes to say something else of the same pictures: what was kept is stale
_log = logging.getLogger(__name__)
_OPTIONAL = ("out_of_domain", "hypotheses", "weights", "covariance")


@dataclass(frozen=True, eq=False)
class Said:
    """What a model said about N pictures, beside the truth.

    Attributes:
        regions: names of the K regions and which of them touch.
        log_probabilities: (N, K).
        region: (N,) the truth.
        anatomy_T_camera: (N,) the truth.
        position, trajectory: (N,) numbers; pictures that share one are near-copies. `FREE` (−1) shares with nobody.
        out_of_domain: (N,) or None.
        hypotheses: (N, M) poses, best first, or None.
        weights: (N, M) or None.
        covariance: (N, M, 6, 6) of the twist (mm, rad) in the camera frame, or None.
        seed: of the training.
        identity: of the model and the pictures.
    """

    regions: RegionLabels
    log_probabilities: Float[np.ndarray, "n k"]
    region: Int[np.ndarray, "n"]
    anatomy_T_camera: Pose
    position: Int[np.ndarray, "n"]
    trajectory: Int[np.ndarray, "n"]
    out_of_domain: Float[np.ndarray, "n"] | None = None
    hypotheses: Pose | None = None
    weights: Float[np.ndarray, "n m"] | None = None
    covariance: Float[np.ndarray, "n m 6 6"] | None = None
    seed: int = 0
    identity: str = ""

    def __len__(self) -> int:
        return len(self.region)

    @property
    def answer(self) -> Int[np.ndarray, "n"]:
        """The most probable region of each picture."""
        return self.log_probabilities.argmax(axis=1)


def export(
    model: Path | Checkpoint | Localizer, dataset: Dataset, out: Path | None = None, *, threads: int | None = None
) -> Said:
    """Ask a model about every picture of a data set, or read what it said before.

    Of pictures of another anatomy, the same in name and frame or not, only the regions are kept, with a notice: a pose
    in one anatomy is no error of a pose in another. Where one of the two is unknown, they are taken for the same.

    Args:
        model: made for the region set of the data set.
        dataset: with the truth.
        out: an npz file. If it holds what this model said about these pictures it is read; else it is written.
        threads: for torch meanwhile; None leaves its number.

    Raises:
        RegionError: if the model names other regions than the data set.
        DatasetError: if a picture lies in no region, or the poses stand in another frame than those of the model.
        CheckpointError, ImageError, DiskFull: as they are read and written.
    """
    localizer = model if isinstance(model, Localizer) else open_localizer(model)
    check_regions(localizer.checkpoint, dataset.regions)
    if dataset.labels.min() < 0:
        raise DatasetError("pictures that all lie in regions", "one that lies in none", "leave it out")
    _tell_known_views(localizer.checkpoint, dataset)
    has_poses = _same_anatomy(localizer.checkpoint.subject, dataset)
    images = dataset.images()
    truth = [images, dataset.labels, dataset.anatomy_T_camera.matrix]
    identity = digest([_MANNER, has_poses, *truth, _weights_digest(localizer.checkpoint)])
    if out is not None and out.is_file() and (known := read_said(out)).identity == identity:
        return known
    said = _said(localizer, localizer.outputs(images, threads), dataset, identity)
    if not has_poses:
        said = replace(said, hypotheses=None, weights=None, covariance=None)
    if out is not None:
        _write(out, said)
    return said


def read_said(path: Path) -> Said:
    """What was exported before; nothing in the file is executed.

    Raises:
        DatasetError: if it is no such file, or a truncated one.
    """
    try:
        with np.load(BytesIO(path.read_bytes()), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        about: dict[str, Any] = json.loads(arrays["about"].item())
        if about["schema"] != SCHEMA:
            raise ValueError(f"schema {about['schema']}")
        frame = about["frame"]
        hypotheses = Pose(arrays["hypotheses"], frame, CAMERA) if "hypotheses" in arrays else None
        return Said(
            RegionLabels.from_json(about["regions"]),
            arrays["log_probabilities"],
            arrays["region"],
            Pose(arrays["anatomy_T_camera"], frame, CAMERA),
            arrays["position"],
            arrays["trajectory"],
            arrays.get("out_of_domain"),
            hypotheses,
            arrays.get("weights"),
            arrays.get("covariance"),
            int(about["seed"]),
            str(about["identity"]),
        )
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise DatasetError(
            f"exported predictions in {path.name}", f"something else ({error})", "evaluate the model again"
        ) from error


def _tell_known_views(checkpoint: Checkpoint, dataset: Dataset) -> None:
    """A notice where the model learned from pictures at the very poses of these."""
    known = set(checkpoint.training.get("data", {}).get("views", ()))
    shared = sum(one in known for one in fingerprints(dataset.anatomy_T_camera)) if known else 0
    if shared:
        _log.warning(
            "%d of the %d pictures stand at poses that the model learned from: the figures say how well it remembers",
            shared,
            len(dataset),
        )


def _same_anatomy(subject: Subject, dataset: Dataset) -> bool:
    """Whether poses of the model can be compared with those of the data set."""
    frame = dataset.anatomy_T_camera.target
    if subject.frame != frame:
        raise DatasetError(
            f"pictures with poses in the frame {subject.frame!r} of the model",
            f"poses in the frame {frame!r}",
            "evaluate on pictures of the anatomy that the model was trained on",
        )
    digests = (subject.anatomy_digest, dataset.anatomy_digest)
    if None in digests or digests[0] == digests[1]:
        return True
    _log.warning(
        "the pictures are of another anatomy (%s) than the model knows (%s): pose errors are left out",
        dataset.anatomy_name or "without a name",
        subject.anatomy,
    )
    return False


def _said(localizer: Localizer, outputs: Outputs, dataset: Dataset, identity: str) -> Said:
    log_probabilities, strange = weighed(outputs, localizer.checkpoint)
    frame = localizer.checkpoint.subject.frame
    settings = localizer.checkpoint.training.get("settings", {})
    return Said(
        dataset.regions,
        log_probabilities,
        dataset.labels,
        dataset.anatomy_T_camera,
        dataset.views.position,
        dataset.views.trajectory,
        strange,
        None if outputs.poses is None else Pose(outputs.poses, frame, CAMERA),
        outputs.weights,
        outputs.covariance,
        int(settings.get("seed", 0)),
        identity,
    )


def _write(path: Path, said: Said) -> None:
    about = {
        "schema": SCHEMA,
        "regions": said.regions.to_json(),
        "frame": said.anatomy_T_camera.target,
        "seed": said.seed,
        "identity": said.identity,
    }
    arrays = {
        "about": np.array(json.dumps(about)),
        "log_probabilities": said.log_probabilities,
        "region": said.region,
        "anatomy_T_camera": said.anatomy_T_camera.matrix,
        "position": said.position,
        "trajectory": said.trajectory,
    }
    for name in _OPTIONAL:
        value = getattr(said, name)
        if value is not None:
            arrays[name] = value.matrix if isinstance(value, Pose) else value
    buffer = BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_bytes(path, buffer.getvalue())


def _weights_digest(checkpoint: Checkpoint) -> str:
    hasher = hashlib.sha256(json.dumps(checkpoint.calibration.to_json(), sort_keys=True).encode())
    for name in sorted(checkpoint.weights):
        hasher.update(name.encode() + np.asarray(checkpoint.weights[name]).tobytes())
    return hasher.hexdigest()


def clusters(said: Said, by: str) -> Int[np.ndarray, "n"]:
    """The number 0, 1, … of each picture's `position` or `trajectory`; free pictures each have their own."""
    number = said.position if by == "position" else said.trajectory
    free = number == FREE
    own = np.where(free, number.max(initial=0) + 1 + np.arange(len(number)), number)
    return np.unique(own, return_inverse=True)[1]
