"""What changes the weights: Adam, and Muon for the matrices inside a network.

Muon (K. Jordan et al., "Muon: an optimizer for hidden layers in neural networks", 2024) replaces the update of a weight
matrix by the nearest matrix whose singular values are alike, so that rare directions of the gradient move as far as the
common ones. The compact network reaches in half of the steps what Adam reaches, for a tenth more work in each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, Shaped
from torch import Tensor, nn

from naris.model.checkpoint import Tensors
from naris.train.config import Adam, Muon

_QUINTIC = (3.4445, -4.7750, 2.0315)  # of Jordan et al.: takes singular values of 0…1 to about 1 in five steps
_TURNS = 5
_RMS = 0.2  # root mean square of an update at learning rate 1, as Adam's are (J. Liu et al. 2025, equation 4)


@runtime_checkable
class Rates(Protocol):
    """Settings of a training, of which the optimisers read these."""

    @property
    def adam(self) -> Adam: ...

    @property
    def muon(self) -> Muon | None: ...


@runtime_checkable
class Deep(Protocol):
    """A network that tells which of its weights Muon is for."""

    def inner_weights(self) -> list[Tensor]: ...


class Optimiser:
    """The optimisers of a network's weights as one.

    Args:
        network: whose weights.
        config: with the settings.
        precision: that the products inside Muon are computed in, `float32` or `bfloat16`.
    """

    def __init__(self, network: nn.Module, config: Rates, precision: str) -> None:
        kind = torch.optim.AdamW if config.adam.decoupled else torch.optim.Adam
        inner = network.inner_weights() if config.muon is not None and isinstance(network, Deep) else []
        inner = [weight for weight in inner if weight.requires_grad]
        known = {id(weight) for weight in inner}
        outer = [weight for weight in network.parameters() if weight.requires_grad and id(weight) not in known]
        self._parts: list[torch.optim.Optimizer] = [kind(_groups(outer, config), config.adam.learning_rate, fused=True)]
        if config.muon is not None and inner:
            kept = torch.bfloat16 if precision == "bfloat16" else torch.float32
            muon = config.muon
            self._parts.append(_Muon(inner, muon.learning_rate, muon.momentum, muon.weight_decay, kept))
        self._highest = [part.param_groups[0]["lr"] for part in self._parts]

    def step(self, share: float) -> None:
        """Change the weights at this share of the highest learning rates, and forget the gradients."""
        for part, highest in zip(self._parts, self._highest, strict=True):
            for group in part.param_groups:
                group["lr"] = highest * share
            part.step()
            part.zero_grad()

    def state(self) -> Tensors:
        """What the next step depends on, by `<part>.<weight>.<name>`."""
        return {
            f"{number}.{index}.{name}": value.contiguous().numpy()
            for number, part in enumerate(self._parts)
            for index, values in part.state_dict()["state"].items()
            for name, value in values.items()
        }

    def restore(self, tensors: Mapping[str, Shaped[np.ndarray, "..."]]) -> None:
        """The reverse of `state`.

        Raises:
            LookupError, ValueError, RuntimeError: if the tensors are those of another optimiser.
        """
        contents = [part.state_dict() for part in self._parts]
        for content in contents:
            content["state"] = {}
        for path, value in tensors.items():
            number, index, name = path.split(".")
            contents[int(number)]["state"].setdefault(int(index), {})[name] = torch.from_numpy(np.array(value))
        for part, content in zip(self._parts, contents, strict=True):
            part.load_state_dict(content)
            _match_layouts(part)


class _Muon(torch.optim.Optimizer):
    """See the head of this file; torch's own is for plain matrices only."""

    def __init__(
        self, weights: Iterable[Tensor], lr: float, momentum: float, weight_decay: float, kept: torch.dtype
    ) -> None:
        super().__init__(list(weights), {"lr": lr, "momentum": momentum, "weight_decay": weight_decay})
        self._kept = kept

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> None:  # type: ignore[override]
        """One step with Nesterov's momentum and decoupled decay."""
        for group in self.param_groups:
            for weight in group["params"]:
                if weight.grad is None:
                    continue
                state = self.state[weight]
                if not state:
                    state["momentum"] = torch.zeros_like(weight)
                momentum = state["momentum"].lerp_(weight.grad, 1 - group["momentum"])
                update = weight.grad.lerp(momentum, group["momentum"])
                weight.mul_(1 - group["lr"] * group["weight_decay"])
                weight.add_(self._orthogonal(update), alpha=-group["lr"])

    def _orthogonal(self, update: Tensor) -> Tensor:
        """Of a matrix, or of a convolution (O, I, H, W) as the matrix (O, H · W · I) that lies so in memory."""
        matrix = update.movedim(1, -1).flatten(1) if update.ndim > 2 else update
        scale = _RMS * max(matrix.shape) ** 0.5
        turned = orthogonal(matrix.to(self._kept)).to(update.dtype) * scale
        return turned.unflatten(1, update.movedim(1, -1).shape[1:]).movedim(-1, 1) if update.ndim > 2 else turned


def orthogonal(matrix: Float[Tensor, "n m"]) -> Float[Tensor, "n m"]:
    """About U Vᵀ of a matrix U S Vᵀ: singular values between 0.7 and 1.2 by Newton and Schulz's iteration (Jordan)."""
    a, b, c = _QUINTIC
    x = matrix.mT if matrix.shape[0] > matrix.shape[1] else matrix
    x = x / (x.norm() + 1e-7)
    for _ in range(_TURNS):
        gram = x @ x.mT
        x = torch.addmm(x, torch.addmm(gram, gram, gram, beta=b, alpha=c), x, beta=a)
    return x.mT if matrix.shape[0] > matrix.shape[1] else x


def _groups(weights: Sequence[Tensor], config: Rates) -> list[dict[str, Any]]:
    """Decoupled decay leaves norms and biases alone; the published L2 is on everything, as torch's Adam does."""
    decay = config.adam.weight_decay
    if not config.adam.decoupled:
        return [{"params": list(weights), "weight_decay": decay}]
    flat = [weight for weight in weights if weight.ndim <= 1]
    deep = [weight for weight in weights if weight.ndim > 1]
    return [{"params": deep, "weight_decay": decay}, {"params": flat, "weight_decay": 0.0}]


def _match_layouts(part: torch.optim.Optimizer) -> None:
    """Fused kernels walk through memory: the moments must lie as the weights do."""
    for weight, values in part.state.items():
        for name, value in values.items():
            if value.shape == weight.shape:
                values[name] = torch.empty_like(weight).copy_(value)
