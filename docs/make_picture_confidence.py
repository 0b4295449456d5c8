"""Fit the probability of a registration from a picture alone on simulated trials, and write it.

    python docs/make_picture_confidence.py          # writes src/naris/register/confidence_pictures.json
    python docs/make_picture_confidence.py 0 2      # the even patients alone, for two at once; then the first line

What each patient came to is kept in out/confidence, by the solver's sources and the network's weights.

The trials are those of `naris.bench.pictures` in other patients, who were never seen by the network: each picture from
nothing, from the true region, and to another patient, some along the way, and some pictures of other things. A logistic
regression with a small ridge; and covariances by the equations are held against the errors of right poses.
"""

from __future__ import annotations

import sys
from itertools import chain
from pathlib import Path

import numpy as np

import naris
from naris.anatomy.builtin.variation import virtual_patient
from naris.bench.fits import trials
from naris.bench.pictures import (
    ALONG,
    ALONG_OTHER,
    NONE,
    OTHER,
    PICTURE_SOLVER,
    REGION,
    STRANGE,
    registered,
    registered_along,
    shots,
    shots_along,
)
from naris.bench.register import search_digest
from naris.cli.console import console_for
from naris.core.atomic import write_json
from naris.core.provenance import file_digest
from naris.evaluate.logistic import fit_logistic
from naris.evaluate.score import auroc, reliability
from naris.locate.depth import DEPTH_WEIGHTS, open_depth
from naris.register import picture

ROOT = Path(__file__).parents[1]
OUT = ROOT / "src" / "naris" / "register" / picture.FITTED
SEED, PATIENTS, VIEWS, VIEWS_ALONG, RIDGE, GROUPS = 3_000_000, 24, 10, 8, 3e-3, 6
WEIGHTS = {NONE: 1.0, REGION: 1.0, OTHER: 1.0, STRANGE: 1.0, ALONG: 1.0, ALONG_OTHER: 1.0}
"""As often wrong for another reason as one is likely to see: right ones are few, so nothing is made to count less."""


def main(part: int = 0, parts: int = 1) -> None:
    """Trials of every `parts`-th patient, then the fit if all are there."""
    columns = trials(part, parts, PATIENTS, _kept, of_patient, console_for(set()).progress)
    if columns is None:
        return
    of, kind, features, right, normalised = columns
    x, y, w = features, right.astype(float), np.array([WEIGHTS[one] for one in kind])
    _tell_left_out(of, kind, x, y, w)
    weights, bias = fit_logistic(x, y, w, RIDGE)
    write_json(
        OUT,
        {
            "schema": "naris.confidence/1",
            "naris": naris.__version__,
            "made_by": "docs/make_picture_confidence.py",
            "solver": search_digest(PICTURE_SOLVER),
            "depth_network": file_digest(DEPTH_WEIGHTS),
            "seed": SEED,
            "patients": PATIENTS,
            "trials": len(y),
            "right": float(y[kind == NONE].mean()),
            "weights": weights.tolist(),
            "bias": bias,
            "covariance": float(np.mean(normalised[right & (kind == NONE)])),
        },
    )


def of_patient(number: int) -> list[list[object]]:
    """Kind, features, whether it was right, and the squared error over the covariance by the equations."""
    nose, other = (virtual_patient(SEED, k % PATIENTS) for k in (number, number - 1))
    kept: list[picture.PictureEvidence] = []

    def keep(evidence: picture.PictureEvidence) -> float:
        kept.append(evidence)
        return 0.5

    factor = picture.covariance_factor()
    picture.probability = keep
    seed, estimator = SEED + number, open_depth()
    done = chain(
        registered(shots(nose, other, VIEWS, seed), estimator, seed),
        registered_along(shots_along(nose, other, VIEWS_ALONG, seed), estimator, seed),
    )
    return [[one.kind, kept[-1].features, one.right, factor * one.normalised if one.right else 0.0] for one in done]


def _kept(number: int) -> Path:
    """Where the rows of a patient are kept; other sources, other rows."""
    made_by = f"{search_digest(PICTURE_SOLVER)}-{file_digest(DEPTH_WEIGHTS)[:12]}"
    return ROOT / "out" / "confidence" / made_by / f"{SEED}-{number}.json"


def _tell_left_out(of: np.ndarray, kind: np.ndarray, x: np.ndarray, y: np.ndarray, w: np.ndarray) -> None:
    """What the benchmark would say of patients that were not fitted on, some groups in turn."""
    said = np.zeros(len(y))
    for group in range(GROUPS):
        left_out = of % GROUPS == group
        weights, bias = fit_logistic(x[~left_out], y[~left_out], w[~left_out], RIDGE)
        said[left_out] = 1 / (1 + np.exp(-(x[left_out] @ weights + bias)))
    for name in (NONE, REGION, ALONG):
        some = kind == name
        accepted = some & (said >= 0.8)
        wrong = 1 - y[accepted].mean() if accepted.any() else 0.0
        print(
            f"{name}: right {y[some].mean():.3f}, AUROC {auroc(said[some], y[some] > 0)}, ECE "
            f"{reliability(said[some], y[some] > 0).ece:.3f}, accepted {accepted.sum() / some.sum():.3f}, wrong "
            f"{wrong:.4f}",
            file=sys.stderr,
        )
    for name in (OTHER, ALONG_OTHER, STRANGE):
        print(f"{name}: refused {(said[kind == name] < 0.8).mean():.4f}", file=sys.stderr)


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:3]))
