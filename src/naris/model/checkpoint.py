"""The file of a trained network: safetensors, which holds numbers and text and executes nothing.

The text (`naris` in the file's metadata) is JSON: schema, version, network and its configuration, what it was made for
(region set, anatomy, frame, camera), how it was trained, its calibration, and the SHA-256 of all tensors, so that a
damaged file is told from a whole one. Tensors are named `network.…` and `calibration.…`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Shaped
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

import naris
from naris.anatomy.regions import regions_from_json, regions_to_json
from naris.core.anatomy import Anatomy, GridRegions, RegionSet, SlabRegions
from naris.core.atomic import write_bytes
from naris.core.camera import Intrinsics
from naris.core.provenance import plain
from naris.dataset.layout import RegionLabels, intrinsics_from_json, intrinsics_to_json
from naris.errors import CheckpointError, InputError, RegionError
from naris.model.calibration import Calibration

SCHEMA = "naris.checkpoint/1"
_METADATA = "naris"
_NETWORK, _CALIBRATION = "network.", "calibration."

Tensors = dict[str, Shaped[np.ndarray, "..."]]


@dataclass(frozen=True, eq=False)
class Subject:
    """What a network was made for.

    Attributes:
        regions: the region set that it names.
        anatomy, anatomy_digest: what it knows its way in; the digest is None where unknown.
        frame: of the poses that it gives.
        intrinsics: of the pictures that it was trained on.
        borders: the region set itself, which tells in which region a position lies; None where only its names are
            known, or where it would not come back from a file as it is (a kind of one's own).

    Raises:
        CheckpointError: if the borders are not those of the regions.
    """

    regions: RegionLabels
    anatomy: str
    anatomy_digest: str | None
    frame: str
    intrinsics: Intrinsics
    borders: RegionSet | None = None

    def __post_init__(self) -> None:
        borders = self.borders
        if borders is not None and (RegionLabels.of(borders).digest, borders.frame) != (
            self.regions.digest,
            self.frame,
        ):
            raise CheckpointError(
                f"the borders of {self.regions.name!r} in the frame {self.frame!r}",
                f"others, of {borders.name!r} in {borders.frame!r}",
                "train the model again",
            )

    @staticmethod
    def of(anatomy: Anatomy, regions: RegionSet, intrinsics: Intrinsics) -> Subject:
        labels = RegionLabels.of(regions)
        borders = regions if _comes_back(regions, labels) else None
        return Subject(labels, anatomy.name, anatomy.digest, anatomy.frame, intrinsics, borders)

    def to_json(self) -> dict[str, Any]:
        return {
            "regions": self.regions.to_json(),
            "borders": None if self.borders is None else regions_to_json(self.borders),
            "anatomy": {"name": self.anatomy, "digest": self.anatomy_digest, "frame": self.frame},
            "intrinsics": intrinsics_to_json(self.intrinsics),
        }

    def identity(self) -> dict[str, Any]:
        """What tells one subject from another: borders are known by the digest of their region set."""
        return {name: value for name, value in self.to_json().items() if name != "borders"}

    @staticmethod
    def from_json(content: Mapping[str, Any]) -> Subject:
        """Raises KeyError, TypeError, ValueError or InputError where the content is not what `to_json` makes."""
        anatomy, borders = content["anatomy"], content.get("borders")
        return Subject(
            RegionLabels.from_json(content["regions"]),
            str(anatomy["name"]),
            anatomy["digest"],
            str(anatomy["frame"]),
            intrinsics_from_json(content["intrinsics"]),
            None if borders is None else regions_from_json(borders),
        )


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A trained network with everything that is needed to use it and to say where it came from.

    Attributes:
        network: `compact` or `two-layer`.
        config: its configuration as JSON.
        subject: what it was made for.
        weights: by the names of the network's parameters and buffers.
        calibration: how far it may be trusted.
        training: how it was trained, as JSON.
        version: of naris.
    """

    network: str
    config: dict[str, Any]
    subject: Subject
    weights: Tensors
    calibration: Calibration = Calibration()
    training: dict[str, Any] = field(default_factory=dict)
    version: str = naris.__version__


def _comes_back(regions: RegionSet, labels: RegionLabels) -> bool:
    """Whether a region set is the same after it was written and read."""
    if type(regions) not in (SlabRegions, GridRegions):
        return False
    try:
        return RegionLabels.of(regions_from_json(regions_to_json(regions))).digest == labels.digest
    except RegionError:
        return False


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write the file, whole or not at all.

    Raises:
        DiskFull: if there is no room.
    """
    tensors = {_NETWORK + name: value for name, value in checkpoint.weights.items()}
    tensors |= {_CALIBRATION + name: value for name, value in checkpoint.calibration.arrays().items()}
    about = {
        "naris": checkpoint.version,
        "network": {"name": checkpoint.network, "config": plain(checkpoint.config)},
        **checkpoint.subject.to_json(),
        "calibration": checkpoint.calibration.to_json(),
        "training": plain(checkpoint.training),
    }
    write_tensors(path, SCHEMA, about, tensors)


def load_checkpoint(
    path: Path, *, regions: RegionSet | RegionLabels | None = None, network: str | None = None
) -> Checkpoint:
    """Read a file and see that it is whole and, if asked, made for these regions and that network.

    Raises:
        CheckpointError: if the file is missing, truncated, damaged, something else, or holds another network.
        RegionError: if it was made for other regions.
    """
    about, tensors = read_tensors(path, SCHEMA, "a model", "train it again or fetch it again")
    try:
        checkpoint = Checkpoint(
            network=str(about["network"]["name"]),
            config=dict(about["network"]["config"]),
            subject=Subject.from_json(about),
            weights=_under(_NETWORK, tensors),
            calibration=Calibration.from_stored(about["calibration"], _under(_CALIBRATION, tensors)),
            training=dict(about["training"]),
            version=str(about["naris"]),
        )
    except (KeyError, TypeError, ValueError, InputError) as error:
        if isinstance(error, CheckpointError):
            raise
        raise CheckpointError(
            f"a complete description in {path.name}", f"one without {error}", "train it again"
        ) from error
    if network is not None and checkpoint.network != network:
        raise CheckpointError(
            f"a model with the {network} network in {path.name}",
            f"one with {checkpoint.network}",
            "name another file or another network",
        )
    if regions is not None:
        check_regions(checkpoint, regions)
    return checkpoint


def check_regions(checkpoint: Checkpoint, regions: RegionSet | RegionLabels) -> None:
    """See that a model names the regions that are asked for.

    Raises:
        RegionError: if it names others, or regions with other borders.
    """
    made_for = checkpoint.subject.regions
    if (made_for.name, made_for.names) != (regions.name, tuple(regions.names)):
        raise RegionError(
            f"a model made for the {len(regions.names)} regions of {regions.name!r}",
            f"one made for the {len(made_for.names)} of {made_for.name!r} ({made_for.names[0]}, …)",
            "train one for these regions or choose the region set that it was made for",
        )
    asked = regions.digest if isinstance(regions, RegionLabels) else RegionLabels.of(regions).digest
    if None not in (asked, made_for.digest) and asked != made_for.digest:
        raise RegionError(
            f"a model made for these borders of {regions.name!r}",
            "one made for regions of the same names with other borders",
            "train one for these regions or choose the region set that it was made for",
        )


def read_tensors(path: Path, schema: str, what: str, todo: str) -> tuple[dict[str, Any], Tensors]:
    """The JSON and the tensors of one of our safetensors files.

    Raises:
        CheckpointError: if it is missing, truncated, damaged or something else.
    """
    if not path.is_file():
        raise CheckpointError(f"{what} in the file {path}", "no such file", "check the path")
    try:
        with safe_open(path, framework="numpy") as file:
            text = (file.metadata() or {}).get(_METADATA)
            about = json.loads(text) if text else None
            tensors = {name: file.get_tensor(name) for name in file.keys()} if text else {}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError) as error:
        raise CheckpointError(
            f"{what} in {path.name}", f"a truncated file or one of another kind ({error})", todo
        ) from error
    if not isinstance(about, dict) or about.get("schema") != schema:
        found = about.get("schema") if isinstance(about, dict) else None
        raise CheckpointError(
            f"{what} of schema {schema} in {path.name}", f"{found or 'weights of other origin'}", todo
        )
    if about.get("sha256") != _digest(tensors):
        raise CheckpointError(f"{what} in {path.name} as it was written", "one whose numbers changed since", todo)
    return about, tensors


def write_tensors(path: Path, schema: str, about: Mapping[str, Any], tensors: Tensors) -> None:
    """The reverse of `read_tensors`, whole or not at all.

    Raises:
        DiskFull: if there is no room.
    """
    tensors = {name: np.asarray(value, order="C") for name, value in tensors.items()}
    content = {"schema": schema, **about, "sha256": _digest(tensors)}
    write_bytes(path, save(tensors, {_METADATA: json.dumps(content, allow_nan=False)}))


def _digest(tensors: Mapping[str, Shaped[np.ndarray, "..."]]) -> str:
    hasher = hashlib.sha256()
    for name in sorted(tensors):
        hasher.update(f"{name} {tensors[name].dtype.str} {tensors[name].shape}".encode())
        hasher.update(np.asarray(tensors[name], order="C").tobytes())
    return hasher.hexdigest()


def _under(prefix: str, tensors: Tensors) -> Tensors:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
