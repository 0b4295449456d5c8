"""Logistic regression of a few features, weighted, with a small ridge."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize


def fit_logistic(
    x: Float[np.ndarray, "n f"], y: Float[np.ndarray, "n"], weight: Float[np.ndarray, "n"], ridge: float = 1e-3
) -> tuple[Float[np.ndarray, "f"], float]:
    """Weights and bias of the chance that y is 1; the ridge is on standardised features, what is told for those as
    they come."""
    middle, size = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-6)
    z = np.column_stack([(x - middle) / size, np.ones(len(x))])

    def loss(beta: np.ndarray) -> tuple[float, np.ndarray]:
        s = z @ beta
        value = weight @ (np.logaddexp(0, s) - y * s) / weight.sum() + 0.5 * ridge * beta[:-1] @ beta[:-1]
        slope = z.T @ (weight * (1 / (1 + np.exp(-s)) - y)) / weight.sum()
        slope[:-1] += ridge * beta[:-1]
        return float(value), slope

    beta = minimize(loss, np.zeros(z.shape[1]), jac=True, method="L-BFGS-B").x
    weights = beta[:-1] / size
    return weights, float(beta[-1] - weights @ middle)
