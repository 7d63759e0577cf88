import pytest
from scipy.special import chdtri

from tactopose_drake.core.posterior.chi_square import chi_square_limit


@pytest.mark.parametrize("freedom", [1, 2, 3, 9, 15, 30, 200, 5000])
@pytest.mark.parametrize("chance", [0.8, 0.5, 0.2, 0.05, 1e-3, 1e-6, 1e-12])
def test_limits_are_scipys(freedom: int, chance: float) -> None:
    assert chi_square_limit(freedom, chance) == pytest.approx(float(chdtri(freedom, chance)), rel=1e-12)
