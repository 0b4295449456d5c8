"""Fit the probability of a registration (`naris.register.confidence`) on simulated trials, and write it.

    python docs/make_confidence.py       # about a quarter of an hour; writes src/naris/register/confidence.json

Virtual patients with views drawn as those of `naris bench register`, but of other seeds: from nothing and from the true
region, with noise a to d; and as many registered to another patient, which are all wrong. A logistic regression with
a small ridge, weighted so that other patients count a third.
"""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

import naris
from naris.anatomy.builtin.variation import virtual_patient
from naris.bench.trials import Trial, drawn_trials
from naris.core.atomic import write_json
from naris.core.pose import distance
from naris.register import confidence
from naris.register import register as registration
from naris.register.map import RegistrationMap, registration_map
from naris.register.register import RegisterConfig, register
from naris.register.starts import NOTHING, in_region

OUT = Path(__file__).parents[1] / "src" / "naris" / "register" / confidence.FITTED
SEED, PATIENTS, VIEWS, RIDGE = 3_000_000, 10, 8, 1e-2
OTHERS_SHARE = 1 / 3


def main() -> None:
    """Trials, then the fit."""
    rows, right, weight = [], [], []
    begun, last = time.perf_counter(), None
    for number in range(PATIENTS):
        nose = virtual_patient(SEED, number)
        at, trials = registration_map(nose), drawn_trials(nose, VIEWS, SEED + number)
        for view, trial in enumerate(trials):
            for noise in "abcd":
                for evidence, good in _both(at, trial, noise, view):
                    rows.append(evidence.features)
                    right.append(good)
                    weight.append(1.0)
                if last is not None:
                    evidence, _ = _one(last, trial, noise, NOTHING, view)
                    rows.append(evidence.features)
                    right.append(False)
                    weight.append(2 * OTHERS_SHARE)
        last = at
        print(f"{number + 1} of {PATIENTS} patients, {time.perf_counter() - begun:.0f} s", file=sys.stderr)
    x, y, w = np.array(rows), np.array(right, dtype=float), np.array(weight)
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


def _both(at: RegistrationMap, trial: Trial, noise: str, seed: int) -> list[tuple[confidence.Evidence, bool]]:
    regions = at.anatomy.region_set()
    region = regions.names[int(regions.label(trial.anatomy_T_camera.position_mm))]
    return [_one(at, trial, noise, belief, seed) for belief in (NOTHING, in_region(regions, region))]


def _one(at, trial, noise, belief, seed):  # noqa: ANN001, ANN202
    kept = []

    def keep(evidence: confidence.Evidence) -> float:
        kept.append(evidence)
        return 0.5

    registration.probability = keep
    result = register(at, trial.observation(noise), belief, RegisterConfig(seed=seed))
    off_mm, off_rad = distance(result.best, trial.anatomy_T_camera)
    return kept[0], bool(off_mm <= 2.0 and np.rad2deg(off_rad) <= 5.0)


def _fitted(x: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, float]:
    """On standardised features, told for those as they come."""
    middle, size = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-6)
    z = np.column_stack([(x - middle) / size, np.ones(len(x))])

    def loss(beta: np.ndarray) -> tuple[float, np.ndarray]:
        s = z @ beta
        value = w @ (np.logaddexp(0, s) - y * s) / w.sum() + 0.5 * RIDGE * beta[:-1] @ beta[:-1] / 10
        slope = z.T @ (w * (1 / (1 + np.exp(-s)) - y)) / w.sum()
        slope[:-1] += RIDGE * beta[:-1] / 10
        return float(value), slope

    beta = minimize(loss, np.zeros(z.shape[1]), jac=True, method="L-BFGS-B").x
    weights = beta[:-1] / size
    return weights, float(beta[-1] - weights @ middle)


if __name__ == "__main__":
    main()
