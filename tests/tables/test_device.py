"""tables.cl against its float64 twins, on every OpenCL device.

Tolerance: 1e-5 relative where a value is above 1e-20 of its peak, absolute (1e-5 of that share) below.
"""

from importlib.resources import files

import numpy as np
import pytest

from coslobe.tables import errors, layout, lobe, product, store

WRAPPERS = """
__kernel void product_many(__global const float *table, __global const float *x, __global float *out)
{
    const int i = get_global_id(0);
    const ProductLobe p = product_lobe(table, x[3 * i], x[3 * i + 1], x[3 * i + 2]);
    out[5 * i] = p.axis_angle; out[5 * i + 1] = p.exponent; out[5 * i + 2] = p.scale_l2;
    out[5 * i + 3] = p.scale_energy; out[5 * i + 4] = p.integral;
}
__kernel void integral_many(__global const float *table, __global const float *x, __global float *out)
{
    const int i = get_global_id(0);
    out[i] = table_integral(table, x[i]);
}
__kernel void cap_many(__global const float *table, __global const float *x, __global float *out)
{
    const int i = get_global_id(0);
    float amplitude;
    out[2 * i] = cap_lobe(table, x[i], &amplitude);
    out[2 * i + 1] = amplitude;
}
"""


@pytest.fixture(scope="module")
def tables():
    return store.cached()


def evaluate(device, kernel, table, arguments, columns):
    """Values of one wrapper; arguments float32 [n, k]."""
    source = (files("coslobe.render.kernels") / "tables.cl").read_text()
    program = device.build([("tables.cl", source), ("wrappers", WRAPPERS)], layout.defines())
    n = len(arguments)
    buffers = [device.upload(table), device.upload(arguments)]
    out = device.allocate(4 * n * columns)
    device.launch(getattr(program, kernel), n, None, *buffers, out)
    return device.download(out, (n, columns), np.float32).astype(float)


def triples():
    rng = np.random.default_rng(0)
    parts = [draw(rng, 4000) for draw in errors.SAMPLINGS.values()]
    parts.append((*10 ** rng.uniform(4, 6.5, (2, 2000)), 10 ** rng.uniform(-4, -1, 2000)))  # above the range
    parts.append((*rng.uniform(0, 1, (2, 2000)), rng.uniform(0, 3.1, 2000)))
    parts.append((*rng.choice([0, 1, 1e5], (2, 500)), rng.choice([0, 0.001, np.pi], 500)))
    return np.concatenate([np.stack(part, axis=1) for part in parts]).astype(np.float32)


def test_products(device, tables):
    arguments = triples()
    e1, e2, alpha = arguments.astype(float).T
    found = evaluate(device, "product_many", layout.samples(tables)["product"], arguments, 5)
    twin = tables.product.lookup(e1, e2, alpha)
    peak = lobe.integral(e1 + e2)
    # The last angle is a step to 0, which float32 may place on either side.
    inside = np.abs(alpha / product.largest_angle(e1, e2) - 1) > 1e-6
    assert inside.mean() > 0.95
    for column, name, largest in ((2, "scale_l2", 1.0), (3, "scale_energy", 1.0), (4, "integral", peak)):
        error = np.abs(found[:, column] - getattr(twin, name)) / np.maximum(
            getattr(twin, name), product.NEGLIGIBLE * largest
        )
        worst = np.argmax(np.where(inside, error, 0))
        assert error[worst] <= 1e-5, (name, arguments[worst], error[worst])
    counted = inside & (twin.integral > product.NEGLIGIBLE * peak)
    # An exponent of 0 has no relative error: 1/2 is what the table's logarithm is shifted by.
    error = np.abs(found[:, 1] - twin.exponent)[counted] / (twin.exponent[counted] + product.SHIFT)
    assert error.max() <= 1e-5
    np.testing.assert_allclose(found[counted, 0], twin.axis_angle[counted], rtol=1e-5, atol=1e-7)


def test_integrals(device, tables):
    rng = np.random.default_rng(1)
    e = np.concatenate([10 ** rng.uniform(-3, 7, 5000), [0, 1, 10, 1e2, 1e3, 1e4, 1e5, 1e6]]).astype(
        np.float32
    )
    found = evaluate(device, "integral_many", layout.samples(tables)["integral"], e[:, None], 1)[:, 0]
    np.testing.assert_allclose(found, tables.integral.lookup(e), rtol=1e-5)


def test_caps(device, tables):
    rng = np.random.default_rng(2)
    depth = np.concatenate([10 ** rng.uniform(-12, 0, 5000), [1, 1.5, 0, -1]]).astype(np.float32)
    found = evaluate(device, "cap_many", layout.samples(tables)["cap"], depth[:, None], 2)
    np.testing.assert_allclose(found[:, 1], tables.cap.energy_amplitude(depth), rtol=1e-5)
    # Absolute near the hemisphere, where the exponent goes through 0.
    np.testing.assert_allclose(found[:, 0], tables.cap.exponent(depth), rtol=1e-5, atol=1e-5)
