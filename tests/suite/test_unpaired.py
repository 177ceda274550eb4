"""Two samples of runs that are no pairs: rates, gaps and ranks against scipy and statsmodels."""

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats import proportion

from suite.differences import exact_test, gap, rank_test, unpaired_rates_apart
from suite.statistics import means

RNG = np.random.default_rng(3)


@pytest.mark.parametrize(("counts", "sizes"), [((3, 9), (12, 15)), ((0, 0), (5, 7)), ((4, 0), (4, 6))])
def test_rates_of_other_runs(counts, sizes):
    one, other = (np.repeat([1.0, 0.0], [n, total - n])[None] for n, total in zip(counts, sizes, strict=True))
    found = unpaired_rates_apart(one, other)
    low, high = proportion.confint_proportions_2indep(counts[0], sizes[0], counts[1], sizes[1], method="agresti-caffo")
    value = counts[0] / sizes[0] - counts[1] / sizes[1]
    assert (found.value, found.low, found.high) == pytest.approx((value, max(min(low, value), -1), min(max(high, value), 1)))
    table = [[n, total - n] for n, total in zip(counts, sizes, strict=True)]
    assert exact_test(one, other) == pytest.approx(stats.fisher_exact(table).pvalue)


def test_unpaired_gaps_of_huge_numbers_have_degrees_of_freedom():
    values = RNG.lognormal(size=(2, 1, 9))
    small, large = (gap(means(factor * values[0]), means(factor * values[1]), paired=False) for factor in (1.0, 1e150))
    assert large.freedom == pytest.approx(small.freedom)
    assert large.p == pytest.approx(small.p)


def test_ranks_are_tested_exactly_where_they_can_be():
    one, other = RNG.standard_normal(7), RNG.standard_normal(9) + 1
    assert rank_test(one, other) == pytest.approx(stats.mannwhitneyu(one, other, method="exact").pvalue)
    tied = np.round(one), np.round(other)
    assert rank_test(*tied) == pytest.approx(stats.mannwhitneyu(*tied, method="asymptotic").pvalue)
    same = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    assert rank_test(*same) == pytest.approx(1 / 3)  # 2 of the 6 ways to choose two of four


def test_what_differs_by_rounding_alone_is_no_difference_however_sure():
    values = RNG.lognormal(size=(1, 9))
    found = [gap(means(values), means(values + apart), paired=True).p[0] for apart in (1e-9, 1e-3)]
    assert found[0] == 1
    assert found[1] < 1e-6
