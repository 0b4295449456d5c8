"""A network that learns: its weights, its optimiser, the running average of its weights, one step at a time."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Shaped
from torch import Tensor, nn
from torch.nn import functional

from naris.core.provenance import digest, plain
from naris.errors import CheckpointError
from naris.model import two_layer
from naris.model.checkpoint import Checkpoint, Subject, Tensors
from naris.model.compact import Compact
from naris.model.localizer import build, config_json, load_weights, name_of, weights_of
from naris.model.losses import Losses, Targets, compact_loss
from naris.train.config import Precision, TrainConfig
from naris.train.data import Lesson
from naris.train.optimiser import Optimiser

PARTS = Losses._fields
"""The parts of the loss that are recorded: total, region, pose, covariance, choice, domain."""

_log = logging.getLogger(__name__)
_WARM = 1 / 6
_FIRST, _LAST = 0.1, 0.002  # learning rate at the start and the end of a cycle, as shares of the highest
_NETWORK, _AVERAGE, _OPTIMISER = "network.", "average.", "optimiser."


def rate(config: TrainConfig, done: float) -> float:
    """The learning rate as a share of the highest, at a share `done` (0…1) of the training."""
    return cycle(done) if config.adam.cycle else 1.0


def cycle(done: float) -> float:
    """A rate that rises over the first sixth and falls along a cosine (L. Smith 2018), as a share of the highest."""
    if done < _WARM:
        return _FIRST + (1 - _FIRST) * done / _WARM
    fall = (1 + np.cos(np.pi * min((done - _WARM) / (1 - _WARM), 1.0))) / 2
    return float(_LAST + (1 - _LAST) * fall)


def resolved_precision(config: TrainConfig) -> str:
    """`float32` or `bfloat16`: the latter where asked, or for `auto` where the processor computes in it."""
    return resolved(config.precision)


def resolved(precision: Precision) -> str:
    """As `resolved_precision`."""
    if precision != "auto":
        return precision
    checks = [getattr(torch.cpu, name, None) for name in ("_is_avx512_bf16_supported", "_is_amx_tile_supported")]
    return "bfloat16" if any(check is not None and check() for check in checks) else "float32"


class Learner:
    """Changes its network with every `step`.

    Args:
        config: how to learn.
        subject: what the network is for.
        positions_mm: (N, 3) some camera positions, for the network's unit of length.
        precision: `float32` or `bfloat16`.
        start: a trained network of the same shape to begin with, instead of random weights. Its units of length are
            kept, so that its pose head knows what it knew.

    Raises:
        CheckpointError: if `start` has another shape, or speaks of other regions or another frame.
    """

    def __init__(
        self,
        config: TrainConfig,
        subject: Subject,
        positions_mm: Float[np.ndarray, "n 3"],
        precision: str,
        start: Checkpoint | None = None,
    ) -> None:
        self.config, self.subject, self.precision = config, subject, precision
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.network = build(config.network, len(subject.regions.names))
        if start is not None:
            check_start(start, config, subject)
            load_weights(self.network, start.weights)
        if isinstance(self.network, Compact):
            self.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
            if start is None:
                self.network.position_mean_mm[:] = torch.from_numpy(positions_mm.mean(axis=0))
                self.network.position_scale_mm[:] = torch.from_numpy(np.maximum(positions_mm.std(axis=0), 1.0))
            for layer in self._frozen():
                layer.requires_grad_(False)
        self.optimiser = Optimiser(self.network, config, precision)
        self.average = [value.clone() for value in _numbers(self.network)] if config.average else []
        self.steps = 0

    def step(self, lesson: Lesson, done: float) -> list[float]:
        """Learn from one lesson at a share `done` of the training; the parts of the loss (`PARTS`)."""
        self.network.train()
        for layer in self._frozen():
            layer.eval()  # its norms keep the means that they know, too
        losses = self._losses(lesson)
        losses.total.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step(rate(self.config, done))
        self.steps += 1
        if self.average:
            decay = min(self.config.average, self.steps / (self.steps + 20))
            with torch.no_grad():
                torch._foreach_lerp_(self.average, _numbers(self.network), 1 - decay)
        return [float(part.detach()) for part in losses]

    def checkpoint(self, training: Mapping[str, Any]) -> Checkpoint:
        """The weights that are kept in the end (the average, if there is one), not calibrated yet."""
        weights = weights_of(self.network)
        if self.average:
            names = [name for name, value in self.network.state_dict().items() if value.is_floating_point()]
            weights |= {
                name: value.clone().contiguous().numpy() for name, value in zip(names, self.average, strict=True)
            }
        network = self.config.network
        return Checkpoint(name_of(network), config_json(network), self.subject, weights, training=dict(training))

    def state(self) -> Tensors:
        """Everything that the next step depends on."""
        tensors = {_NETWORK + name: value for name, value in weights_of(self.network).items()}
        tensors |= {f"{_AVERAGE}{i}": value.contiguous().numpy() for i, value in enumerate(self.average)}
        tensors |= {_OPTIMISER + name: value for name, value in self.optimiser.state().items()}
        return tensors

    def restore(self, tensors: Mapping[str, Shaped[np.ndarray, "..."]], steps: int) -> None:
        """The reverse of `state`.

        Raises:
            CheckpointError: if the tensors are not those of this network and optimiser.
        """
        prefix = _NETWORK
        load_weights(self.network, {n.removeprefix(prefix): v for n, v in tensors.items() if n.startswith(prefix)})
        prefix = _OPTIMISER
        try:
            self.optimiser.restore({n.removeprefix(prefix): v for n, v in tensors.items() if n.startswith(prefix)})
            for i, mean in enumerate(self.average):
                mean.copy_(torch.from_numpy(np.array(tensors[f"{_AVERAGE}{i}"])))
        except (LookupError, ValueError, RuntimeError) as error:
            raise CheckpointError("the state of this training", f"another one ({error})", "start anew") from error
        self.steps = steps

    def _frozen(self) -> list[nn.Module]:
        return self.network.first_layers(self.config.frozen) if isinstance(self.network, Compact) else []

    def _losses(self, lesson: Lesson) -> Losses:
        images, region = torch.from_numpy(lesson.images), torch.from_numpy(lesson.region.astype(np.int64))
        if not isinstance(self.network, Compact):
            loss = functional.cross_entropy(self.network(two_layer.to_input(images)), region)
            zero = torch.zeros(())
            return Losses(loss, loss, zero, zero, zero, zero)
        with torch.autocast("cpu", torch.bfloat16, enabled=self.precision == "bfloat16"):
            output = self.network(images)
        strange = len(images) - len(region)
        pose = torch.from_numpy(lesson.pose.astype(np.float32))
        targets = Targets(
            torch.cat([region, region.new_zeros(strange)]),
            torch.cat([pose[:, :3, 3], pose.new_zeros(strange, 3)]),
            torch.cat([pose[:, :3, :3], torch.eye(3).expand(strange, 3, 3)]),
            torch.arange(len(images)) < len(region),
        )
        network = self.network
        return compact_loss(output, targets, network.position_mean_mm, network.position_scale_mm, self.config.loss)


def check_start(start: Checkpoint, config: TrainConfig, subject: Subject) -> None:
    """See that a training of `config` on `subject` can begin with these weights.

    The anatomy may be another, and so may the borders of its regions: that is told in a notice, as regions of the same
    names may lie elsewhere.

    Raises:
        CheckpointError: if not.
    """
    wanted = (name_of(config.network), config_json(config.network), subject.regions.names, subject.frame)
    given = (start.network, start.config, start.subject.regions.names, start.subject.frame)
    for what, one, other in zip(("network", "configuration", "regions", "frame"), wanted, given, strict=True):
        if plain(one) != plain(other):
            raise CheckpointError(
                f"a model to start from with the {what} {plain(one)}",
                f"{plain(other)}",
                "start from another model or from none",
            )
    if start.subject.regions.digest != subject.regions.digest:
        _log.warning("the model to start from knows regions of the same names with other borders")


def start_told(start: Checkpoint) -> dict[str, Any]:
    """What a model remembers of the one that it began as."""
    return {"anatomy": start.subject.anatomy, "weights": digest(start.weights), "training": start.training}


def _numbers(network: nn.Module) -> list[Tensor]:
    """Parameters and buffers that can be averaged."""
    return [value for value in network.state_dict().values() if value.is_floating_point()]


def settings_json(config: TrainConfig) -> dict[str, Any]:
    """The settings as they are recorded."""
    return asdict(config)
