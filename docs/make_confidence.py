"""Fit the probability of a registration (`naris.register.confidence`) on simulated trials, and write it.

    python docs/make_confidence.py            # about an hour; writes src/naris/register/confidence.json
    python docs/make_confidence.py 0 2        # the even patients of it alone, for two at once; then the first line

What each patient came to is kept in out/confidence, by the sources of the search, and not done again; another way to
make a probability of it needs seconds. Digests of that are in the file, for whoever makes a patient's again.

The trials are told in `confidence_rows.py`. A logistic regression with a small ridge, in two steps (`_fit`); what few
points take off (`_of_few`); what neighbours in depth without a smooth error share (`_of_plain`, alone by the trials
whose pixels are off by themselves); and covariances by the equations are held against the errors of right poses.
"""

from __future__ import annotations

import hashlib
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
from confidence_rows import ALL, PATIENTS, SEED, of_patient
from scipy.optimize import minimize

import naris
from naris.bench.fits import trials
from naris.bench.register import search_digest, solver_digest
from naris.bench.trials import FREE_POINTS
from naris.cli.console import console_for
from naris.core.atomic import write_json
from naris.evaluate.logistic import fit_logistic
from naris.evaluate.score import auroc, reliability
from naris.register import confidence
from naris.register.evidence import Evidence
from naris.register.register import RegisterConfig

ROOT = Path(__file__).parents[1]
OUT = ROOT / "src" / "naris" / "register" / confidence.FITTED
RIDGE, _LEAST_RIDGE = 1e-3, 1e-6
_RARE = ("few", "better", "shot", "better shot", "prior")
_OF_STARTS = dict.fromkeys(("none", "region", "views"), 1.0)
_OF_STARTS |= dict.fromkeys((*_RARE, "understated", "overstated", "pose"), 1 / 3)
_OF_OTHERS = dict.fromkeys(("", " views", *(f" {one}" for one in _RARE)), 1 / 3) | {" pose": 1 / 6}
WEIGHTS = {
    f"{kind} {noise}": weight
    for of, weights in (("", _OF_STARTS), ("other", _OF_OTHERS))
    for kind, weight in ((of + start, weight) for start, weight in weights.items())
    for noise in ALL
} | {"other d": 2 / 3, f"other {FREE_POINTS}": 2 / 3}
"""Other patients are rarer in use than here; single clouds of them are hard to tell, and count twice for it. From a
pose the same is seen as from nothing, once more."""
_OF_GRAIN, _OF_OTHERS_GRAIN = 1.0, 1 / 3
"""Of trials that are not there, which count for depth without a smooth error alone."""
_OTHERS, _MOST_OF_OTHERS = 2.0, 2 / 3
"""How much more they count, and at most, where it is learnt what speaks for a pose. How sure that makes is told with
the weights above. Of what was tried the answers for patients left out had the least log loss with this. With more, more
others are refused who are seen as clouds, and right is told from wrong less well."""
_GROUPS = 6
_TRIALS = (
    "naris.bench.trials",
    "naris.bench.problems",
    "naris.register.map",
    "naris.register.noise",
    "naris.register.observation",
    "naris.anatomy.builtin.variation",
)
_OF_COVARIANCE = {
    "depth": ("none b", "none c"),
    "several": ("views b", "views c"),
    "points": ("none d", f"none {FREE_POINTS}"),
    "points_several": ("views d", f"views {FREE_POINTS}", f"shot {FREE_POINTS}"),
}


def main(part: int = 0, parts: int = 1) -> None:
    """Trials of every `parts`-th patient, then the fit if all are there."""
    columns = trials(
        part,
        parts,
        PATIENTS,
        _kept,
        lambda number: [row.to_json() for row in of_patient(number)],
        console_for(set()).progress,
    )
    if columns is None:
        return
    of, kind, evidence, right, normalised = columns
    x = np.array([confidence.features(Evidence(**one)) for one in evidence])
    y, w = right.astype(float), np.array([WEIGHTS.get(one, 0.0) for one in kind])
    few = np.array([one["few"] for one in evidence])
    shared = np.array([confidence.shared(Evidence(**one)) if one["plain"] else np.nan for one in evidence])
    weights, bias = _fit(kind, x, y, w)
    write_json(
        OUT,
        {
            "schema": "naris.confidence/1",
            "naris": naris.__version__,
            "made_by": "docs/make_confidence.py",
            "solver": solver_digest(),
            "seed": SEED,
            "patients": PATIENTS,
            "trials": len(y),
            "right": float(y.mean()),
            "config": asdict(RegisterConfig()),
            "rows": [hashlib.sha256(_kept(number).read_bytes()).hexdigest()[:12] for number in range(PATIENTS)],
            "weights": weights.tolist(),
            "bias": bias,
            "few": _of_few(x @ weights + bias, few, y, w).tolist(),
            "plain": _of_plain(kind, x @ weights + bias, shared, y, w).tolist(),
            "covariance": _of_covariance(kind, right, normalised),
            "left_out": _of_left_out(of, kind, (x, few, shared), y, w),
        },
    )


def _kept(number: int) -> Path:
    """Where the rows of a patient are kept; other sources, other rows."""
    made_by = hashlib.sha256((Path(__file__).parent / "confidence_rows.py").read_bytes()).hexdigest()[:12]
    return ROOT / "out" / "confidence" / f"{search_digest(_TRIALS)}-{made_by}" / f"{SEED}-{number}.json"


def _fit(kind: np.ndarray, x: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, float]:
    """Weights and bias: what speaks for a pose, other patients counting more; then scale and shift with `w`."""
    some = w > 0
    kind, x, y, w = kind[some], x[some], y[some], w[some]
    is_other = np.char.startswith(kind, "other")
    weights, bias = fit_logistic(x, y, np.where(is_other, np.minimum(_OTHERS * w, _MOST_OF_OTHERS), w), RIDGE)
    scale, shift = fit_logistic((x @ weights + bias)[:, None], y, w, _LEAST_RIDGE)
    return scale[0] * weights, scale[0] * bias + shift


def _of_few(sure: np.ndarray, few: np.ndarray, y: np.ndarray, w: np.ndarray) -> np.ndarray:
    """What is added to log odds times `Evidence.few`: a slope times them, and a shift."""
    some = few > 0
    sure, few, y, w = sure[some], few[some], y[some], w[some]

    def loss(added: np.ndarray) -> float:
        told = sure + few * (added[0] * sure + added[1])
        return float(w @ (np.logaddexp(0.0, told) - y * told))

    return np.asarray(minimize(loss, np.zeros(2)).x)


def _of_plain(kind: np.ndarray, sure: np.ndarray, shared: np.ndarray, y: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Of depth without a smooth error: what log odds are times, and what neighbours share is, and a shift."""
    some = np.isfinite(shared)
    w = np.where(w > 0, w, np.where(np.char.startswith(kind, "other"), _OF_OTHERS_GRAIN, _OF_GRAIN))
    slopes, shift = fit_logistic(np.stack([sure, shared], axis=1)[some], y[some], w[some], RIDGE)
    return np.array([*slopes, shift])


def _of_left_out(
    of: np.ndarray, kind: np.ndarray, seen: tuple[np.ndarray, np.ndarray, np.ndarray], y: np.ndarray, w: np.ndarray
) -> dict[str, object]:
    """What the benchmark would say of patients left out of the fit, six groups in turn; features were chosen by it."""
    x, few, shared = seen
    said = np.zeros(len(y))
    for group in range(_GROUPS):
        left_out = of % _GROUPS == group
        weights, bias = _fit(kind[~left_out], x[~left_out], y[~left_out], w[~left_out])
        sure = x @ weights + bias
        slope, shift = _of_few(sure[~left_out], few[~left_out], y[~left_out], w[~left_out])
        plain = _of_plain(*(one[~left_out] for one in (kind, sure, shared, y, w)))
        told = np.fmin(sure, np.stack([sure, shared, np.ones(len(y))], axis=1) @ plain)
        said[left_out] = 1 / (1 + np.exp(-(told + few * (slope * sure + shift))[left_out]))
    final = np.isin(kind, ["none b", "none c", "none d"])
    p, right = said[final], y[final] > 0
    first = np.argsort(-p, kind="stable")[: round(0.8 * len(p))]
    return {
        "auroc": auroc(p, right),
        "false_accept_at_80": float(1 - right[first].mean()),
        "ece": reliability(p, right).ece,
        "brier": float(np.average(np.square(said - y), weights=w)),
        "log_loss": float(np.average(-np.log(np.where(y > 0, said, 1 - said) + 1e-9), weights=w)),
        "least_probability": {
            str(least): _of_least(said >= least, final, kind, y) for least in (0.6, 0.7, 0.75, 0.8, 0.9)
        },
    }


def _of_least(accepted: np.ndarray, final: np.ndarray, kind: np.ndarray, y: np.ndarray) -> dict[str, object]:
    """How often a pose is wrong where accepted (none b, c and d together, and each kind by itself), right and accepted,
    and refused where it is another patient's."""
    kinds = sorted(set(kind.tolist()))
    own = [one for one in kinds if not one.startswith("other")]
    return {
        "wrong_of_accepted": float(1 - y[final & accepted].mean()),
        "wrong_of_accepted_by_kind": {
            one: float(1 - y[(kind == one) & accepted].mean()) for one in own if accepted[kind == one].any()
        },
        "right_and_accepted": {one: float((y * accepted)[kind == one].mean()) for one in own},
        "refused": {one: float(1 - accepted[kind == one].mean()) for one in kinds if one.startswith("other")},
    }


def _of_covariance(kind: np.ndarray, right: np.ndarray, normalised: np.ndarray) -> dict[str, float]:
    """By what is seen: the mean square of the errors of right poses over their covariances by the equations."""
    return {seen: float(np.mean(normalised[right & np.isin(kind, kinds)])) for seen, kinds in _OF_COVARIANCE.items()}


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:3]))
