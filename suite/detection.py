"""Sequential detection of manoeuvres: log-likelihood ratios, Wald's thresholds, the repeated test and CUSUM."""

import numpy as np

from suite.linalg import Array
from suite.modes import LARGEST, log_odds


def log_likelihood_ratio(logp: Array, loglik: Array, nominal: int) -> Array:
    """Log of p(y_k | a manoeuvre, y_1..y_{k-1}) / p(y_k | the nominal mode, y_1..y_{k-1}) [R], always finite.

    logp[M, R]: predicted log-probabilities of the modes; loglik[M, R]: log of the likelihoods p(y_k | r_k, y_1..y_{k-1}),
    which may lack a factor that is common to all modes. The manoeuvre's is the mean over the other modes by their predicted
    probabilities (the marginalised likelihood ratio; Ru, Jilkov, Li and Bashi, 2009), so the ratio is that of the posterior
    odds of a manoeuvre to the predicted odds. It is 0 where a side has no predicted probability or y_k is impossible on
    both, and plus or minus LARGEST where on one. A likelihood of NaN counts as zero.
    """
    joint = np.fmax(logp + loglik, -np.inf)
    with np.errstate(invalid="ignore"):  # impossible on both sides
        return np.nan_to_num(log_odds(joint, nominal) - log_odds(logp, nominal))


def log_ratio(above: Array, below: Array) -> Array:
    """Difference of two log-likelihoods [R], always finite: 0 where both are zero, plus or minus LARGEST where one is."""
    equal = above == below
    return np.clip(np.subtract(above, below, out=np.zeros_like(above), where=~equal), -LARGEST, LARGEST)


def observed(llr: Array, y: Array) -> Array:
    """Log-likelihood ratios [R] where anything of y[m, R] was observed, elsewhere 0: also where rounding says otherwise."""
    return np.where(np.isnan(y).all(0), 0.0, llr)


def wald(false_alarm: float, miss: float) -> tuple[float, float]:
    """Lower and upper threshold of the sequential probability ratio test for the probabilities of its two errors (Wald, 1945).

    At the lower one, log(miss / (1 - false_alarm)), it accepts that nothing happened, at the upper one, log((1 - miss) /
    false_alarm), that something did. The errors a', b' that it then makes satisfy a' <= false_alarm / (1 - miss),
    b' <= miss / (1 - false_alarm) and a' + b' <= false_alarm + miss, because the sum may overshoot a threshold but never
    falls short of it. Raises ValueError unless both are above 0 and their sum is below 1.
    """
    if not (min(false_alarm, miss) > 0 and false_alarm + miss < 1):
        raise ValueError(f"false_alarm and miss must be above 0 and their sum below 1, got {false_alarm} and {miss}")
    return float(np.log(miss / (1 - false_alarm))), float(np.log((1 - miss) / false_alarm))


def sprt(previous: Array, llr: Array, lower: float) -> Array:
    """Statistic [R] of the sequential test that is repeated for as long as it accepts that nothing happened.

    The sum of log-likelihood ratios since the present test began; where it reaches the lower threshold a new test begins at 0
    (Page, 1954; Basseville and Nikiforov, 1993, section 2.2). A low threshold gives the sum time to recover from chance, and
    makes it slower to notice what begins in the middle of a test.
    """
    total = previous + llr
    return np.where(total <= lower, 0.0, total)


def cusum(previous: Array, llr: Array) -> Array:
    """Page's cumulative sum g_k = max(0, g_{k-1} + s_k) [R] (Page, 1954): the repeated test whose lower threshold is 0.

    Where the ratios are those of independent measurements, the mean time to a false alarm of g_k >= h is at least exp(h)
    (Lorden, 1971).
    """
    return sprt(previous, llr, 0.0)
