"""How far a network's word may be trusted: an honest temperature, its two answers in one, and what is usual to it.

**Temperature** (C. Guo et al., "On calibration of modern neural networks", ICML 2017): one number that the logits are
divided by, chosen so that on pictures kept apart the stated probabilities have the highest likelihood.

**Pool** (logarithmic opinion pool: C. Genest, J. Zidek, "Combining probability distributions", Statistical Science
1986): a network with a pose head has said twice where the camera is. What its poses say about the regions
(`naris.model.standing`) is multiplied in, raised to a power that is fitted together with the temperature, on the same
pictures: p ∝ softmax(logits / temperature) · share ^ power. Of the pools that are as good as the best one within a
standard error, the one that leans most on the poses is taken (the one-standard-error rule: L. Breiman et al.,
"Classification and Regression Trees", 1984): pictures kept apart still resemble those of the training, and of the two
answers it is the pose that holds better where no training view was near.

**Usual pictures** (K. Lee et al., "A simple unified framework for detecting out-of-distribution samples", NeurIPS
2018): the distance of a picture's embedding from the nearest region's mean, measured with the covariance that all
regions share. It is turned into a score with the distances of pictures kept apart: 0 up to their 95th percentile, 0.5
at their 99.5th, 1 at twice that excess. A network with a domain head has its logit scored alike; the worse one counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.optimize import minimize

from naris.errors import CheckpointError

_USUAL, _RARE = 95.0, 99.5
_SHRINKAGE = 0.1
_TEMPERATURES = np.exp(np.linspace(np.log(0.2), np.log(10.0), 400))
_HOTTEST, _POWER = 100.0, 3.0
_LEANINGS = 20
_TAKEN_OVER = 0.1  # power that shares must gain as the head loses all of its part: shares that know nothing gain none


@dataclass(frozen=True, eq=False)
class Scale:
    """A number that grows with strangeness, and its size on usual pictures: 95th and 99.5th percentile."""

    usual: float
    rare: float

    @staticmethod
    def of(values: Float[np.ndarray, "n"]) -> Scale:
        usual, rare = np.percentile(values, [_USUAL, _RARE])
        return Scale(float(usual), float(max(rare, usual + 1e-6)))

    def score(self, values: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """0 for the usual, 0.5 for the rare, at most 1."""
        return np.clip((values - self.usual) / (self.rare - self.usual) / 2, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Usual:
    """What pictures of the training's world look like to the network.

    Attributes:
        mean: (K, E) of each region's embeddings.
        whitening: (E, E) that makes their shared covariance the identity: distance = |(x − mean) @ whitening|.
        distance: scale of the distance to the nearest mean.
        domain: scale of minus the domain logit, None without that head.
    """

    mean: Float32[np.ndarray, "k e"]
    whitening: Float32[np.ndarray, "e e"]
    distance: Scale
    domain: Scale | None = None

    def distances(self, embedding: Float32[np.ndarray, "n e"]) -> Float[np.ndarray, "n"]:
        """From each embedding to the nearest region's mean, in standard deviations."""
        whitening = self.whitening.astype(np.float64)
        white, mean = embedding @ whitening, self.mean @ whitening
        return np.stack([np.linalg.norm(white - centre, axis=1) for centre in mean], axis=1).min(axis=1)

    def out_of_domain(
        self, embedding: Float32[np.ndarray, "n e"], domain_logit: Float32[np.ndarray, "n"] | None
    ) -> Float[np.ndarray, "n"]:
        """0 for a usual picture … 1 for one that is surely not."""
        score = self.distance.score(self.distances(embedding))
        if self.domain is not None and domain_logit is not None:
            score = np.maximum(score, self.domain.score(-domain_logit.astype(np.float64)))
        return score


@dataclass(frozen=True, eq=False)
class Calibration:
    """How a network's word is weighed.

    Attributes:
        temperature: that logits are divided by; 1 where nothing was kept apart to fit it.
        pictures: kept apart for the fit; 0 if there were none.
        usual: None if it was not fitted.
        power: of the regions' shares by the poses; 0 where these do not count.
    """

    temperature: float = 1.0
    pictures: int = 0
    usual: Usual | None = None
    power: float = 0.0

    def log_probabilities(
        self, logits: Float32[np.ndarray, "n k"], shares: Float[np.ndarray, "n k"] | None = None
    ) -> Float[np.ndarray, "n k"]:
        """Natural logarithms of the stated probabilities.

        Args:
            logits: of the region head.
            shares: of the regions by the poses; None where they are not known, so that the head's word stands alone.
        """
        log_p = log_softmax(logits.astype(np.float64) / self.temperature)
        return log_p if shares is None or self.power == 0 else log_softmax(log_p + self.power * np.log(shares))

    def arrays(self) -> dict[str, Float32[np.ndarray, "..."]]:
        """The part that is stored as tensors."""
        return {} if self.usual is None else {"mean": self.usual.mean, "whitening": self.usual.whitening}

    def to_json(self) -> dict[str, Any]:
        """The part that is stored as text."""
        usual, scales = self.usual, {}
        if usual is not None:
            scales["distance"] = [usual.distance.usual, usual.distance.rare]
            if usual.domain is not None:
                scales["domain"] = [usual.domain.usual, usual.domain.rare]
        found = {"temperature": self.temperature, "pictures": self.pictures, "scales": scales}
        return found | ({"power": self.power} if self.power else {})

    @staticmethod
    def from_stored(content: Mapping[str, Any], arrays: Mapping[str, Float32[np.ndarray, "..."]]) -> Calibration:
        """The reverse of `to_json` and `arrays`.

        Raises:
            CheckpointError: if they do not fit together.
        """
        try:
            scales = {name: Scale(*map(float, pair)) for name, pair in dict(content["scales"]).items()}
            usual = None
            if scales:
                usual = Usual(arrays["mean"], arrays["whitening"], scales["distance"], scales.get("domain"))
            power = float(content.get("power", 0.0))
            return Calibration(float(content["temperature"]), int(content["pictures"]), usual, power)
        except (KeyError, TypeError, ValueError) as error:
            raise CheckpointError("a calibration in the checkpoint", f"{error!r}", "train the model again") from error


def fit_temperature(logits: Float32[np.ndarray, "n k"], regions: Int[np.ndarray, "n"]) -> float:
    """The temperature of highest likelihood, from 0.2 to 10."""
    rows = np.arange(len(regions))
    wide = logits.astype(np.float64)
    losses = [-log_softmax(wide / t)[rows, regions].mean() for t in _TEMPERATURES]
    return float(_TEMPERATURES[int(np.argmin(losses))])


def fit_pool(
    logits: Float32[np.ndarray, "n k"], shares: Float[np.ndarray, "n k"], regions: Int[np.ndarray, "n"]
) -> tuple[float, float]:
    """Temperature (0.2 to 100) and power (0 to 3) of the pool that leans most on the shares, among those whose
    likelihood is the highest or within a standard error of it (paired by picture).

    The likelihood has one summit only. If that is not found, the temperature of the head alone.
    """
    rows = np.arange(len(regions))
    said = np.stack([logits.astype(np.float64), np.log(shares)])
    said -= said.max(axis=2, keepdims=True)

    def loss(scale: Float[np.ndarray, "2"]) -> tuple[float, Float[np.ndarray, "2"]]:
        log_p = log_softmax(np.tensordot(scale, said, axes=1))
        expected = (said * np.exp(log_p)).sum(axis=2) - said[:, rows, regions]
        return float(-log_p[rows, regions].mean()), expected.mean(axis=1)

    def each(scale: Float[np.ndarray, "2"]) -> Float[np.ndarray, "n"]:
        return np.asarray(-log_softmax(np.tensordot(scale, said, axes=1))[rows, regions])

    coldest, hottest = 1 / _TEMPERATURES[0], 1 / _HOTTEST
    found = minimize(loss, np.array([1.0, 0.0]), jac=True, bounds=[(hottest, coldest), (0.0, _POWER)])
    if not found.success:
        return fit_temperature(logits, regions), 0.0
    best, chosen = each(found.x), found.x
    # With the head's part held at less and less of the best one, the power that is best beside it.
    for head in found.x[0] * np.linspace(1, 0, _LEANINGS + 1)[1:]:
        head = max(head, hottest)
        beside = minimize(
            lambda power, head=head: loss(np.array([head, power.item()]))[0],
            chosen[1:],
            bounds=[(0.0, _POWER)],
        )
        scale = np.array([head, beside.x[0]])
        behind = each(scale) - best
        taken_over = scale[1] - found.x[1] >= _TAKEN_OVER * (1 - head / found.x[0])
        if not (beside.success and taken_over) or behind.mean() > behind.std() / np.sqrt(len(behind)):
            break
        chosen = scale
    return float(1 / chosen[0]), float(chosen[1])


def fit_usual(
    embedding: Float32[np.ndarray, "n e"],
    regions: Int[np.ndarray, "n"],
    kept: Float32[np.ndarray, "m e"],
    kept_domain_logit: Float32[np.ndarray, "m"] | None = None,
) -> Usual:
    """Means and covariance of embeddings with known regions; scales from pictures that are not among them.

    The covariance is shrunk a little towards a multiple of the identity, as there may be few pictures.
    """
    present = np.unique(regions)
    mean = np.stack([embedding[regions == k].mean(axis=0, dtype=np.float64) for k in present])
    centred = embedding.astype(np.float64) - mean[np.searchsorted(present, regions)]
    covariance = centred.T @ centred / len(centred)
    level = np.trace(covariance) / len(covariance)
    covariance = (1 - _SHRINKAGE) * covariance + _SHRINKAGE * max(level, 1e-12) * np.eye(len(covariance))
    values, vectors = np.linalg.eigh(covariance)
    whitening = (vectors / np.sqrt(values)).astype(np.float32)
    mean = mean.astype(np.float32)
    unscaled = Usual(mean, whitening, Scale(0.0, 1.0))
    domain = None if kept_domain_logit is None else Scale.of(-kept_domain_logit.astype(np.float64))
    return Usual(mean, whitening, Scale.of(unscaled.distances(kept)), domain)


def log_softmax(logits: Float[np.ndarray, "*n k"]) -> Float[np.ndarray, "*n k"]:
    """Natural logarithms of the softmax along the last axis."""
    shifted = logits - logits.max(axis=-1, keepdims=True)
    return shifted - np.log(np.exp(shifted).sum(axis=-1, keepdims=True))
