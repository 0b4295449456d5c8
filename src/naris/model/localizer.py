"""A trained network at work: pictures in, what it says about them out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from scipy.special import expit
from torch import nn

from naris.core.anatomy import RegionSet
from naris.core.camera import middle_square
from naris.core.pose import CAMERA, Pose
from naris.core.provenance import plain
from naris.core.results import Prediction
from naris.errors import CheckpointError
from naris.model import two_layer
from naris.model.checkpoint import Checkpoint, Subject, Tensors, load_checkpoint
from naris.model.compact import COMPACT, Compact, CompactConfig
from naris.model.losses import covariance_of
from naris.model.standing import region_shares
from naris.model.two_layer import TWO_LAYER, TwoLayer, TwoLayerConfig

NetworkConfig = TwoLayerConfig | CompactConfig
_BATCH = 64
_STRANGEST = 0.99


@dataclass(frozen=True, eq=False)
class Outputs:
    """What a network says about N pictures, before its word is weighed.

    Attributes:
        logits: (N, K).
        embedding: (N, E).
        domain_logit: (N,) or None.
        poses: (N, M, 4, 4) hypotheses `anatomy_T_camera`, best first, or None.
        weights: (N, M) of the hypotheses, or None.
        covariance: (N, M, 6, 6) of their twists (mm, rad) in the camera frame, or None.
    """

    logits: Float32[np.ndarray, "n k"]
    embedding: Float32[np.ndarray, "n e"]
    domain_logit: Float32[np.ndarray, "n"] | None = None
    poses: Float[np.ndarray, "n m 4 4"] | None = None
    weights: Float[np.ndarray, "n m"] | None = None
    covariance: Float[np.ndarray, "n m 6 6"] | None = None


@dataclass(frozen=True, eq=False)
class Localizer:
    """A checkpoint with its network ready to be asked; make one with `open_localizer`.

    Attributes:
        checkpoint: what was read.
        network: in evaluation mode.
    """

    checkpoint: Checkpoint
    network: nn.Module

    @property
    def input_px(self) -> int:
        """Edge of the square pictures that the network takes."""
        return input_px(network_config(self.checkpoint))

    def outputs(self, images: UInt8[np.ndarray, "n h w 3"], threads: int | None = None) -> Outputs:
        """What the network says about RGB pictures, of which it sees the square in the middle (`fitted`)."""
        with limited(threads):
            return run(self.network, fitted(images, self.input_px))

    def predict(self, images: UInt8[np.ndarray, "n h w 3"], threads: int | None = None) -> list[Prediction]:
        """What the network says, weighed: calibrated, and less sure of a picture that is out of its world."""
        return predictions(self.outputs(images, threads), self.checkpoint)


def open_localizer(
    path: Path | Checkpoint, *, regions: RegionSet | None = None, network: str | None = None
) -> Localizer:
    """A localizer from a file or a checkpoint that was read.

    Raises:
        CheckpointError, RegionError: as `naris.model.checkpoint.load_checkpoint`, and for weights that do not fit.
    """
    checkpoint = path if isinstance(path, Checkpoint) else load_checkpoint(path, regions=regions, network=network)
    module = build(network_config(checkpoint), len(checkpoint.subject.regions.names))
    load_weights(module, checkpoint.weights)
    return Localizer(checkpoint, module.eval())


def build(config: NetworkConfig, regions: int) -> nn.Module:
    """A network with weights drawn from torch's generator."""
    return TwoLayer(regions, config) if isinstance(config, TwoLayerConfig) else Compact(regions, config)


def name_of(config: NetworkConfig) -> str:
    """`two-layer` or `compact`."""
    return TWO_LAYER if isinstance(config, TwoLayerConfig) else COMPACT


def input_px(config: NetworkConfig) -> int:
    """Edge of the square pictures that a network of this configuration takes."""
    return config.input_px


def network_config(checkpoint: Checkpoint) -> NetworkConfig:
    """The configuration of a checkpoint's network.

    Raises:
        CheckpointError: if naris has no such network.
    """
    kinds = {TWO_LAYER: TwoLayerConfig, COMPACT: CompactConfig}
    try:
        kind = kinds[checkpoint.network]
        return kind(**{k: tuple(v) if isinstance(v, list) else v for k, v in checkpoint.config.items()})
    except (KeyError, TypeError) as error:
        raise CheckpointError(
            f"a model with one of the networks {sorted(kinds)}",
            f"{checkpoint.network!r} with {checkpoint.config}",
            "use the version of naris that made it",
        ) from error


def weights_of(network: nn.Module) -> Tensors:
    """Copies of all parameters and buffers by name."""
    return {name: value.detach().clone().contiguous().numpy() for name, value in network.state_dict().items()}


def load_weights(network: nn.Module, weights: Tensors) -> None:
    """Put weights into a network.

    Raises:
        CheckpointError: if names or shapes differ.
    """
    own = {name: (tuple(value.shape), value.numpy().dtype) for name, value in network.state_dict().items()}
    given = {name: (value.shape, value.dtype) for name, value in weights.items()}
    if own != given:
        odd = sorted(name for name in own.keys() | given.keys() if own.get(name) != given.get(name))
        raise CheckpointError(
            f"the {len(own)} tensors of the network", f"others in {', '.join(odd[:3])}", "check which model this is"
        )
    network.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in weights.items()})


def run(network: nn.Module, images: UInt8[np.ndarray, "n s s 3"]) -> Outputs:
    """What a network in evaluation mode says about pictures of its own size, in float32."""
    with torch.inference_mode():
        parts = [_run_part(network, torch.from_numpy(images[i : i + _BATCH])) for i in range(0, len(images), _BATCH)]
    return Outputs(
        np.concatenate([part.logits for part in parts]),
        np.concatenate([part.embedding for part in parts]),
        _joined([part.domain_logit for part in parts]),
        _joined([part.poses for part in parts]),
        _joined([part.weights for part in parts]),
        _joined([part.covariance for part in parts]),
    )


def predictions(outputs: Outputs, checkpoint: Checkpoint) -> list[Prediction]:
    """One prediction a picture."""
    regions, frame = checkpoint.subject.regions, checkpoint.subject.frame
    log_probabilities, out_of_domain = weighed(outputs, checkpoint)
    found = []
    for i, log_p in enumerate(log_probabilities):
        has_pose = outputs.poses is not None and outputs.weights is not None and outputs.covariance is not None
        found.append(
            Prediction(
                regions.name,
                regions.names,
                log_p,
                hypotheses=Pose(outputs.poses[i], frame, CAMERA) if outputs.poses is not None and has_pose else None,
                weights=outputs.weights[i] if outputs.weights is not None else None,
                covariance=outputs.covariance[i] if outputs.covariance is not None else None,
                out_of_domain=None if out_of_domain is None else float(out_of_domain[i]),
            )
        )
    return found


def weighed(outputs: Outputs, checkpoint: Checkpoint) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n"] | None]:
    """Log-probabilities as they should be stated, and the out-of-domain scores if the network can judge.

    Where no usual pictures were kept apart to say what a score means, the word of the network's domain head stands as
    it is: the score is the probability that it gives to a stranger. A network without that head then judges nothing.

    A picture with score s is with probability 1 − s one that the network knows; if it is not, every region is
    equally likely: p = (1 − s) · p_known + s / K, where p_known is what the calibration makes of the region head and of
    the poses. Here s is 0.99 at most, so that the order of the regions, which is all that is left to go by, is not
    lost.
    """
    calibration = checkpoint.calibration
    log_p = calibration.log_probabilities(outputs.logits, shares(outputs, checkpoint.subject))
    if calibration.usual is not None:
        strange = calibration.usual.out_of_domain(outputs.embedding, outputs.domain_logit)
    elif outputs.domain_logit is not None:
        strange = expit(-outputs.domain_logit.astype(np.float64))
    else:
        return log_p, None
    with np.errstate(divide="ignore"):
        share = np.minimum(strange, _STRANGEST)
        known = np.log1p(-share)[:, None] + log_p
        unknown = np.broadcast_to(np.log(share / log_p.shape[1])[:, None], log_p.shape)
    return np.logaddexp(known, unknown), strange


def shares(outputs: Outputs, subject: Subject) -> Float[np.ndarray, "n k"] | None:
    """What the poses say about the regions; None without poses, or where the borders are not known."""
    if subject.borders is None or outputs.poses is None or outputs.weights is None or outputs.covariance is None:
        return None
    return region_shares(subject.borders, outputs.poses, outputs.weights, outputs.covariance)


def squared(images: UInt8[np.ndarray, "n h w 3"]) -> UInt8[np.ndarray, "n s s 3"]:
    """The largest square in the middle of each picture; `Intrinsics.squared` is its camera."""
    height, width = images.shape[1:3]
    left, top, edge = middle_square(width, height)
    if width == height:
        return images
    return np.ascontiguousarray(images[:, top : top + edge, left : left + edge])


def fitted(images: UInt8[np.ndarray, "n h w 3"], size_px: int) -> UInt8[np.ndarray, "n {size_px} {size_px} 3"]:
    """Pictures as a network sees them, in training and at work: the square in the middle, resized and never squeezed.

    Resized by area where it shrinks, so that nothing is skipped, else bilinear.
    """
    images = squared(images)
    if images.shape[1:3] == (size_px, size_px):
        return images
    how = cv2.INTER_AREA if images.shape[1] > size_px else cv2.INTER_LINEAR
    out = np.empty((len(images), size_px, size_px, 3), np.uint8)
    for picture, into in zip(images, out, strict=True):
        into[:] = cv2.resize(picture, (size_px, size_px), interpolation=how)
    return out


@contextmanager
def limited(threads: int | None) -> Iterator[None]:
    """Torch's number of threads inside the block (it is one for the whole process); None leaves it."""
    before = torch.get_num_threads()
    torch.set_num_threads(threads or before)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _run_part(network: nn.Module, images: torch.Tensor) -> Outputs:
    if isinstance(network, TwoLayer):
        embedding = network.embedding(two_layer.to_input(images))
        return Outputs(network.fc3(embedding).numpy(), embedding.numpy())
    if not isinstance(network, Compact):
        raise TypeError(f"no such network: {type(network).__name__}")
    said = network(images)
    order = said.hypothesis_logits.argsort(dim=1, descending=True)
    weights = said.hypothesis_logits.softmax(dim=1).gather(1, order)
    rows = torch.arange(len(order))[:, None]
    poses = np.zeros((*order.shape, 4, 4))
    poses[..., :3, :3] = _orthonormal(said.rotation[rows, order].double().numpy())
    position = said.position[rows, order] * network.position_scale_mm + network.position_mean_mm
    poses[..., :3, 3], poses[..., 3, 3] = position.numpy(), 1.0
    covariance = covariance_of(said.factor[rows, order].double()).numpy()
    double = weights.double().numpy()
    return Outputs(
        said.region_logits.numpy(),
        said.embedding.numpy(),
        said.domain_logit.numpy(),
        poses,
        double / double.sum(axis=1, keepdims=True),
        covariance,
    )


def _orthonormal(rotation: Float[np.ndarray, "n m 3 3"]) -> Float[np.ndarray, "n m 3 3"]:
    """The nearest rotations in double precision: those of the network are orthonormal to float32 only."""
    u, _, v = np.linalg.svd(rotation)
    return u @ v


def _joined(parts: list[np.ndarray | None]) -> np.ndarray | None:
    whole = [part for part in parts if part is not None]
    return np.concatenate(whole) if whole else None


def config_json(config: NetworkConfig) -> dict[str, object]:
    """A network configuration as a checkpoint stores it."""
    return dict(plain(config))
