"""Metrics of pictures against closed forms, their noise floors against statistics, and FLIP's worker."""

import numpy as np
import pytest

from coslobe.core.errors import CoslobeError
from coslobe.evaluate.flip import exposures, flip_maps
from coslobe.evaluate.metrics import (
    METRICS,
    Before,
    below_noise,
    error_maps,
    measure,
    noise_floor,
    perfect,
)
from coslobe.evaluate.reference import Reference
from coslobe.render.images import linear

SHAPE = (24, 24)
ALL = np.ones(SHAPE, bool)


def reference(radiance, variance=0.0) -> Reference:
    """A reference of one radiance, with the same variance everywhere, in which all pixels show object 0."""
    full = np.broadcast_to(np.asarray(radiance, np.float64), (*SHAPE, 3))
    return Reference(full, np.full((*SHAPE, 3), variance), np.ones(SHAPE), np.zeros(SHAPE, int))


def measured(image, truth: Reference, before=None, region=ALL, flip=None, **options):
    full = np.broadcast_to(np.asarray(image, np.float64), (*SHAPE, 3))
    return measure(error_maps(full, truth, flip, before, "picture"), region, "picture", **options)


def test_equal_pictures():
    errors = measured(0.3, reference(0.3))
    assert errors["psnr"] is None  # without end
    assert errors["ssim"] == pytest.approx(1)
    assert {errors[name] for name in ("relative_rmse", "mean_abs", "bias", "max_abs", "local_max")} == {0}
    assert errors["flip"] is None
    assert errors["temporal"] is None
    assert set(errors) == set(METRICS)


def test_psnr_and_ssim_of_flat_pictures():
    """In sRGB, 0.5 beside 0.6: psnr = -20 log10(0.1); ssim is its luminance term, as nothing varies."""
    errors = measured(linear(0.6), reference(linear(0.5)))
    c1 = 0.01**2
    assert errors["psnr"] == pytest.approx(20, abs=1e-6)
    assert errors["ssim"] == pytest.approx((2 * 0.3 + c1) / (0.25 + 0.36 + c1), rel=1e-6)


def test_a_place_stands_out_by_its_neighbourhood():
    """5 x 5 pixels off by 1 give 1 there; a single one gives 1/25."""
    image = np.full((*SHAPE, 3), 2.0)
    image[10:15, 10:15] += 1
    truth = reference(2.0)
    assert measured(image, truth)["local_max"] == pytest.approx(0.5)
    image = np.full((*SHAPE, 3), 2.0)
    image[3, 3] += 1
    assert measured(image, truth)["local_max"] == pytest.approx(0.5 / 25)


def test_temporal_error_is_that_of_the_change():
    """A constant offset does not flicker; one that comes with a frame does."""
    before = Before(np.full((*SHAPE, 3), 1.5), reference(1.0))
    assert measured(2.5, reference(2.0), before)["temporal"] == pytest.approx(0)
    assert measured(2.0, reference(2.0), before)["temporal"] == pytest.approx(0.25)


def test_a_region_is_measured_alone_and_in_units_that_are_given():
    image = np.full((*SHAPE, 3), 1.0)
    image[:, 12:] = 3.0
    truth = reference(1.0)
    left = np.zeros(SHAPE, bool)
    left[:, :12] = True
    assert measured(image, truth, region=left)["relative_rmse"] == 0
    assert measured(image, truth, region=~left)["relative_rmse"] == pytest.approx(2)
    assert measured(image, truth, region=~left, scale=4.0)["relative_rmse"] == pytest.approx(0.5)
    assert set(measured(image, truth, region=np.zeros(SHAPE, bool)).values()) == {None}


def test_values_that_are_not_finite_raise():
    image = np.ones((*SHAPE, 3))
    image[2, 3, 1] = np.inf
    with pytest.raises(CoslobeError, match=r"picture: 1 values are not finite, the first at \[2, 3, 1\]"):
        measured(image, reference(1.0))


def test_the_noise_floor_is_what_a_perfect_picture_shows():
    """Pictures of the true radiance, drawn against noisy references, meet each floor on average."""
    rng = np.random.default_rng(0)
    sigma, tries = 0.05, 60
    found = {name: [] for name in ("relative_rmse", "mean_abs", "ssim", "psnr", "bias")}
    for _ in range(tries):
        noise = sigma * rng.normal(size=SHAPE)[..., None]
        seen = Reference(0.5 + np.repeat(noise, 3, -1), np.full((*SHAPE, 3), sigma**2), np.ones(SHAPE), None)
        errors = measured(0.5, seen)
        for name, values in found.items():
            values.append(errors[name])
    truth = reference(0.5, sigma**2)
    drawn = error_maps(perfect(truth, 3), truth, None, None, "drawn")
    floor = noise_floor(drawn, ALL, "drawn", None)
    for name in ("relative_rmse", "mean_abs"):  # 576 pixels: 3 %, and their mean over 60 far less
        assert floor[name] == pytest.approx(np.mean(found[name]), rel=0.1)
    assert 1 - floor["ssim"] == pytest.approx(1 - np.mean(found["ssim"]), rel=0.15)
    assert floor["psnr"] == pytest.approx(np.mean(found["psnr"]), abs=0.8)
    assert floor["bias"] == pytest.approx(np.std(found["bias"]), rel=0.35)  # a deviation from 60 draws


@pytest.mark.parametrize(
    ("metric", "value", "floor", "below"),
    [
        ("relative_rmse", 0.0105, 0.01, True),
        ("relative_rmse", 0.012, 0.01, False),
        ("bias", -0.0019, 0.001, True),
        ("bias", -0.0021, 0.001, False),
        ("psnr", 50.0, 50.5, True),
        ("psnr", 45.0, 50.0, False),
        ("ssim", 0.999, 0.999, True),
        ("ssim", 0.99, 0.999, False),
        ("flip", None, 0.1, False),
    ],
)
def test_what_is_below_the_noise(metric, value, floor, below):
    assert below_noise(metric, value, floor) is below


def test_exposures_are_those_of_flip_itself():
    """For a single picture, FLIP's own rule; the numbers are what flip-evaluator 1.7 chooses."""
    radiance = np.linspace(0, 1, 4096)[:, None] ** 4 * np.array([3.0, 2.0, 1.0])
    start, stop, count = exposures([radiance])
    from flip_evaluator import nbflip

    picture = radiance.reshape(64, 64, 3).astype(np.float32)
    chosen = nbflip.evaluate(picture, picture, True, False, False, True, {})[2]
    assert start == pytest.approx(chosen["startExposure"], abs=2e-3)
    assert stop == pytest.approx(min(chosen["stopExposure"], start + 3), abs=2e-3)
    assert count == min(chosen["numExposures"], 3)


def test_a_black_sequence_has_no_exposures():
    assert exposures([np.zeros((9, 3))]) is None
    assert exposures([np.zeros((0, 3))]) is None


def test_flip_sees_what_differs_and_survives_black():
    rng = np.random.default_rng(1)
    picture = rng.random((20, 30, 3))
    other = picture.copy()
    other[:, 20:] *= 1.5
    black = np.zeros_like(picture)
    same, changed, dark = flip_maps([(picture, picture), (picture, other), (black, black)], (-1.0, 1.0, 2))
    assert same.shape == (20, 30)
    assert same.max() == 0
    assert dark.max() == 0
    assert changed[:, 25:].mean() > 10 * changed[:, :10].mean()


def test_a_worker_that_fails_is_an_error():
    with pytest.raises(CoslobeError, match="FLIP failed"):
        flip_maps([(np.zeros((4, 4, 3)), np.zeros((4, 4, 3)))], (1.0, 0.0, 2))
