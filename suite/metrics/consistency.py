"""Whether an estimator's covariance agrees with its errors."""

import numpy as np

from suite.case import Card, Truth
from suite.estimator import Estimate
from suite.linalg import Array
from suite.metrics.metric import Contributions, Metric


def nees(case: Card, truth: Truth, estimate: Estimate) -> Contributions:
    """Normalised estimation error squared over the state dimension [T, R]; infinite where the covariance is singular."""
    error = np.moveaxis(estimate.mean - truth.x, 1, -1)
    cov = np.moveaxis(estimate.cov, (1, 2), (-2, -1))
    return {"state": mahalanobis(error, cov) / error.shape[-1]}


def mahalanobis(error: Array, cov: Array) -> Array:
    """eᵀ P⁻¹ e for errors [..., n] and covariances [..., n, n].

    Components are brought to unit variance first: they differ in unit and size. NaN stays NaN; a covariance that is
    not positive definite in floating point gives infinity.
    """
    with np.errstate(all="ignore"):
        scale = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
        unit = error / scale
        correlation = cov / (scale[..., :, None] * scale[..., None, :])
    known = np.isfinite(error).all(-1) & np.isfinite(cov).all((-2, -1))
    sound = known & np.isfinite(correlation).all((-2, -1)) & np.isfinite(unit).all(-1)
    out = np.where(known, np.inf, np.nan)
    safe = np.where(sound[..., None, None], correlation, np.eye(error.shape[-1]))
    values, directions = np.linalg.eigh(safe)
    rounding = error.shape[-1] * np.finfo(float).eps * values[..., -1]
    positive = sound & (values[..., 0] > rounding)
    along = np.einsum("...ij,...i->...j", directions, np.where(sound[..., None], unit, 0.0))
    distance = (along**2 / np.where(values > 0, values, 1.0)).sum(-1)
    return np.where(positive, distance, out)


NEES = Metric(
    name="nees",
    title="Normalised estimation error squared",
    unit="",
    better=1.0,
    formula=r"\mathrm{NEES} = \frac{1}{R\,T\,n_x} \sum_{r,k} \left( \hat x_k - x_k \right)^{\top} P_k^{-1} "
    r"\left( \hat x_k - x_k \right)",
    words="Mean of the squared error measured by the filter's own covariance, divided by the dimension of the state: 1 for "
    "a filter that knows its errors, above 1 for one that is too sure of itself, below 1 for one that is too cautious.",
    reference="Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, "
    "section 5.4",
    fn=nees,
)
METRICS = (NEES,)
