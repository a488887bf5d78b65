"""The error numbers against values worked out by hand."""

import numpy as np
import pytest

from coslobe.core.errors import CoslobeError
from coslobe.evaluate.errors import compare, within_noise, without_noise

REFERENCE = np.array([[1.0, 2.0, 3.0], [2.0, 2.0, 2.0]])  # mean 2, sum 12
IMAGE = np.array([[1.5, 2.0, 3.0], [2.0, 1.0, 2.0]])  # differences 0.5 and -1
VARIANCE = np.full((2, 3), 0.04)


def test_numbers_by_hand():
    errors = compare(IMAGE, REFERENCE, VARIANCE)
    assert errors.relative_rmse == pytest.approx(np.sqrt((0.25 + 1) / 6) / 2)
    assert errors.mean_abs == pytest.approx((1.5 / 6) / 2)
    assert errors.bias == pytest.approx(-0.5 / 12)
    assert errors.max_abs == pytest.approx(1 / 2)
    assert errors.noise == pytest.approx(0.2 / 2)
    assert errors.pixels == 2
    assert not within_noise(errors.relative_rmse, errors.noise)


def test_equal_images_have_no_error():
    errors = compare(REFERENCE, REFERENCE, VARIANCE)
    assert (errors.relative_rmse, errors.mean_abs, errors.bias, errors.max_abs) == (0, 0, 0, 0)
    assert within_noise(errors.relative_rmse, errors.noise)


def test_noise_predicts_the_error_of_a_perfect_image():
    rng = np.random.default_rng(0)
    truth = rng.uniform(1, 3, (20000, 3))
    sigma = rng.uniform(0.01, 0.2, truth.shape)
    errors = compare(truth, truth + sigma * rng.normal(size=truth.shape), sigma**2)
    assert errors.relative_rmse == pytest.approx(errors.noise, rel=0.02)  # 60,000 values: 0.3 % expected
    assert within_noise(errors.relative_rmse, errors.noise)


def test_noise_can_be_taken_off():
    rng = np.random.default_rng(1)
    truth = rng.uniform(1, 3, (20000, 3))
    image = truth + 0.05 * rng.normal(size=truth.shape)
    reference = truth + 0.1 * rng.normal(size=truth.shape)
    errors = compare(image, reference, np.full_like(truth, 0.01))
    assert without_noise(errors.relative_rmse, errors.noise) == pytest.approx(0.05 / 2, rel=0.05)
    assert without_noise(0.1, 0.2) == 0


def test_a_black_reference_gives_no_ratio_but_no_failure():
    black = np.zeros((2, 3))
    assert compare(black, black, black).relative_rmse == 0
    assert compare(IMAGE, black, black).relative_rmse is None


def test_no_pixels():
    nothing = np.zeros((0, 3))
    errors = compare(nothing, nothing, nothing)
    assert errors.pixels == 0
    assert errors.relative_rmse is None


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("which", ["image", "reference", "variance"])
def test_values_that_are_not_finite_raise(bad, which):
    arrays = {"image": IMAGE.copy(), "reference": REFERENCE.copy(), "variance": VARIANCE.copy()}
    arrays[which][1, 2] = bad
    with pytest.raises(CoslobeError, match=r"frame 3.*not finite.*\[1, 2\]"):
        compare(**arrays, what="frame 3")


def test_a_scale_takes_the_place_of_the_mean():
    black = np.zeros_like(REFERENCE)
    errors = compare(black + 0.1, black, VARIANCE, scale=2.0)
    assert errors.relative_rmse == pytest.approx(0.05)
    assert errors.bias == pytest.approx(0.05)
    assert errors.noise == pytest.approx(0.1)
