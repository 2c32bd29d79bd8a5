from __future__ import annotations

import pytest
from scipy.special import chdtri as chi2_of_tail

from fmfts.common.chi2 import quantile, survival


@pytest.mark.parametrize("degrees_of_freedom", range(1, 25))
@pytest.mark.parametrize("probability", [0.9, 0.05, 1e-3, 1e-6, 1e-9])
def test_quantile_agrees_with_scipy(degrees_of_freedom: int, probability: float) -> None:
    value = quantile(probability, degrees_of_freedom)
    assert value == pytest.approx(chi2_of_tail(degrees_of_freedom, probability), rel=1e-7)
    assert survival(value, degrees_of_freedom) == pytest.approx(probability, rel=1e-6)


@pytest.mark.parametrize(("probability", "freedom"), [(1e-9, 0), (0.0, 3), (1.5, 3), (float("nan"), 3)])
def test_invalid_chi2_is_refused(probability: float, freedom: int) -> None:
    with pytest.raises(ValueError, match="degrees of freedom"):
        quantile(probability, freedom)


@pytest.mark.parametrize(("probability", "freedom"), [(1e-200, 200), (1e-306, 5), (1e-300, 2)])
def test_tail_search_ends_below_the_smallest_double(probability: float, freedom: int) -> None:
    assert survival(quantile(probability, freedom), freedom) == pytest.approx(probability, rel=1e-6)
