"""Fit the probability of a registration (`naris.register.confidence`) on simulated trials, and write it.

    python docs/make_confidence.py       # about twenty minutes; writes src/naris/register/confidence.json

Virtual patients with views drawn as those of `naris bench register`, but of other seeds: from nothing, every second one
from the true region, with noise a to d; every second one to another patient, which are all wrong; and every fifth
with noise that is said to be less or more than it is. A logistic regression with a small ridge.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

import naris
from naris.anatomy.builtin.variation import virtual_patient
from naris.bench.trials import NOISES, Noise, Trial, drawn_trials
from naris.core.atomic import write_json
from naris.core.pose import distance
from naris.register import confidence
from naris.register import register as registration
from naris.register.map import RegistrationMap, registration_map
from naris.register.observation import Observation
from naris.register.register import RegisterConfig, register
from naris.register.starts import NOTHING, Belief, in_region

OUT = Path(__file__).parents[1] / "src" / "naris" / "register" / confidence.FITTED
SEED, PATIENTS, VIEWS, RIDGE = 3_000_000, 18, 10, 1e-3
OTHER_WEIGHT, MISTOLD_WEIGHT = 2 / 3, 1 / 3
MISTOLD = (0.6, 1.7)
"""What the deviations of the noise are multiplied with where they are told wrong."""


class Row(NamedTuple):
    """One registration for the fit."""

    evidence: confidence.Evidence
    right: bool
    weight: float


def main() -> None:
    """Trials, then the fit."""
    done: list[Row] = []
    begun, last = time.perf_counter(), None
    for number in range(PATIENTS):
        nose = virtual_patient(SEED, number)
        at, trials = registration_map(nose), drawn_trials(nose, VIEWS, SEED + number)
        for view, trial in enumerate(trials):
            for noise in NOISES:
                done += rows(at, last, trial, noise, view)
        last = at
        print(f"{number + 1} of {PATIENTS} patients, {time.perf_counter() - begun:.0f} s", file=sys.stderr)
    evidence, right, weight = zip(*done, strict=True)
    x, y, w = np.array([one.features for one in evidence]), np.array(right, dtype=float), np.array(weight)
    weights, bias = _fitted(x, y, w)
    write_json(
        OUT,
        {
            "schema": "naris.confidence/1",
            "naris": naris.__version__,
            "made_by": "docs/make_confidence.py",
            "seed": SEED,
            "patients": PATIENTS,
            "trials": len(y),
            "right": float(y.mean()),
            "config": asdict(RegisterConfig()),
            "weights": weights.tolist(),
            "bias": bias,
        },
    )


def rows(at: RegistrationMap, last: RegistrationMap | None, trial: Trial, noise: Noise, view: int) -> Iterator[Row]:
    """All that is registered of one view: its evidence, whether it was right, and what it weighs."""
    seen = trial.observation(noise)
    yield one(at, seen, NOTHING, trial, view)
    if view % 2 == 0:
        regions = at.anatomy.region_set()
        region = regions.names[int(regions.label(trial.anatomy_T_camera.position_mm))]
        yield one(at, seen, in_region(regions, region), trial, view)
    elif last is not None:
        evidence, _, _ = one(last, seen, NOTHING, trial, view)
        yield Row(evidence, False, OTHER_WEIGHT)
    if view % 5 == 3:
        for factor in MISTOLD:
            told = replace(
                seen, radial=factor * seen.radial, isotropic=factor * seen.isotropic, smooth=factor * seen.smooth
            )
            yield one(at, told, NOTHING, trial, view)._replace(weight=MISTOLD_WEIGHT)


def one(at: RegistrationMap, seen: Observation, belief: Belief, trial: Trial, seed: int) -> Row:
    """One registration, judged by the truth."""
    kept = []

    def keep(evidence: confidence.Evidence) -> float:
        kept.append(evidence)
        return 0.5

    registration.probability = keep
    result = register(at, seen, belief, RegisterConfig(seed=seed))
    off_mm, off_rad = distance(result.best, trial.anatomy_T_camera)
    return Row(kept[0], bool(off_mm <= 2.0 and np.rad2deg(off_rad) <= 5.0), 1.0)


def _fitted(x: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, float]:
    """On standardised features, told for those as they come."""
    middle, size = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-6)
    z = np.column_stack([(x - middle) / size, np.ones(len(x))])

    def loss(beta: np.ndarray) -> tuple[float, np.ndarray]:
        s = z @ beta
        value = w @ (np.logaddexp(0, s) - y * s) / w.sum() + 0.5 * RIDGE * beta[:-1] @ beta[:-1]
        slope = z.T @ (w * (1 / (1 + np.exp(-s)) - y)) / w.sum()
        slope[:-1] += RIDGE * beta[:-1]
        return float(value), slope

    beta = minimize(loss, np.zeros(z.shape[1]), jac=True, method="L-BFGS-B").x
    weights = beta[:-1] / size
    return weights, float(beta[-1] - weights @ middle)


if __name__ == "__main__":
    main()
