"""How far a registration can be believed: a probability learnt on trials, and a refusal.

The probability is a logistic regression on what `features` makes of the evidence, fitted on simulated trials in virtual
patients (`naris.bench.trials`), never on those that a benchmark reports.
"""

from __future__ import annotations

import json
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np
from jaxtyping import Float

from naris.register.evidence import MOST_MARGIN, Evidence
from naris.register.observation import Observation

FITTED = "confidence.json"
_MOST_ROUGH = 30.0
_LEAST_EXPLAINED = 0.6
_LOOSE_MM, _LOOSE_DEG = 1.5, 4.0
_MISFITS, _SPREADS = (
    (0.3, 2.7),
    (0.6, 1.5),
)  # better than that is no better, nor is worse worse: a line goes on for ever
_LEAST_WAVES = 0.1
_FAR_BETTER = 0.4
"""Of the noise that was said: neighbours then share what is left, as they do where walls are another patient's."""
_HARDLY = 0.02  # of the trials that explained less than `_LEAST_EXPLAINED` none was right


def features(evidence: Evidence) -> Float[np.ndarray, "f"]:
    """For the regression, each of the order of 1."""
    margin = min(evidence.margin, MOST_MARGIN)
    log_margin = np.log1p(max(margin, 0.0))
    explained, excess = 10 * (evidence.explained - 0.95), np.clip(evidence.excess, -0.5, 3.0)
    cloud, several, through = float(evidence.cloud), float(evidence.views > 1), 10 * evidence.through
    untried = float(not evidence.again)
    return np.array(
        [
            log_margin,
            margin / MOST_MARGIN,
            np.clip(evidence.rough_margin, -_MOST_ROUGH, 2 * _MOST_ROUGH) / _MOST_ROUGH,
            np.log(evidence.sd_mm + 0.01),
            np.log(evidence.sd_deg + 0.1),
            np.log(evidence.within / (1 - evidence.within)),
            explained,
            np.log(np.clip(evidence.misfit, *_MISFITS)),
            excess,
            evidence.agreement,
            np.log(evidence.astray + 0.05),
            np.log(evidence.scatter + 0.05),
            np.log1p(evidence.dents),
            float(evidence.free),
            min(evidence.clearance_mm, 4.0),
            # Beside a cloud, likelihoods are those of another model, and ranges from few points.
            cloud,
            cloud * log_margin,
            cloud * 10 * np.log(np.clip(evidence.spread, *_SPREADS)),
            cloud * 10 * evidence.kinship,
            np.clip(evidence.surprise, -10.0, 0.0) / 10,
            np.log1p(max(evidence.surprise, 0.0)),
            cloud * explained,
            cloud * excess,
            cloud * np.log(evidence.waves + _LEAST_WAVES),
            cloud * np.log(evidence.ripples + _LEAST_WAVES),
            through,
            cloud * through,
            # Several views leave no rival and little loose; what they cost is told by more rays.
            several,
            np.log(evidence.views),
            several * log_margin,
            several * explained,
            several * excess,
            # From a pose few are solved, and none once more: that no rival was found says less.
            untried,
            untried * log_margin,
        ]
    )


def refusal(evidence: Evidence, chance: float, least: float) -> str | None:
    """Why the pose should not be used, the heaviest reason first; None where it may be."""
    if evidence.explained < _LEAST_EXPLAINED:
        return (
            f"no pose explains what was seen: {evidence.explained:.0%} of the rays fit the best one; "
            "another patient, another scale or other noise than was said"
        )
    if chance >= least:
        return None
    if evidence.cloud and evidence.spread < _FAR_BETTER:
        return (
            f"the points lie {1 / max(evidence.spread, 0.01):.0f} times nearer to the walls than their noise was said "
            f"to be (probability {chance:.2f}): say the noise as it is"
        )
    if evidence.margin < 6.0:
        return f"several poses fit alike (probability {chance:.2f}): give another view, or more of them"
    if evidence.sd_mm > _LOOSE_MM or evidence.sd_deg > _LOOSE_DEG:
        return (
            f"the view leaves the pose loose, see its deviations (probability {chance:.2f}): "
            "give a view with more shape"
        )
    return f"the pose is not sure enough: probability {chance:.2f} where {least:.2f} is asked"


def probability(evidence: Evidence) -> float:
    """Of being within 2 mm and 5° of the truth, in an anatomy and with noise as in the simulated trials."""
    weights, bias, of_few = _fitted()
    sure = float(features(evidence) @ weights + bias)
    sure += evidence.few * float(of_few @ (sure, 1.0))
    if evidence.plain:
        # Sharing nothing makes no pose surer: noise of each pixel hides what other walls share.
        sure = min(sure, float(np.array(_file()["plain"]) @ (sure, shared(evidence), 1.0)))
    chance = float(1 / (1 + np.exp(-np.clip(sure, -30, 30))))
    return min(chance, _HARDLY) if evidence.explained < _LEAST_EXPLAINED else chance


def shared(evidence: Evidence) -> float:
    """How much of the noise that was said neighbours have in common."""
    return evidence.kinship * min(evidence.spread, 1.0)


def covariance_factor(observation: Observation) -> float:
    """What a covariance by the equations is to be multiplied with for errors of right poses to be as large as it says.

    The equations know nothing of dents in the costs, and take what a smooth error leaves out for noise of each ray.
    """
    factors = _file()["covariance"]
    if observation.is_cloud:
        return float(factors["points" if observation.views == 1 else "points_several"])
    return float(factors["depth" if observation.views == 1 else "several"])


def _fitted() -> tuple[Float[np.ndarray, "f"], float, Float[np.ndarray, "2"]]:
    """Weights and bias of the log odds; and, times `Evidence.few`, the slope and shift that few points take off."""
    return np.array(_file()["weights"]), float(_file()["bias"]), np.array(_file()["few"])


@lru_cache(maxsize=1)
def _file() -> dict[str, Any]:
    return dict(json.loads(resources.files("naris.register").joinpath(FITTED).read_text(encoding="utf-8")))
