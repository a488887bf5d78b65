"""elementary.cl and points.cl: functions of vectors, and how points find what is theirs."""

import numpy as np
import pytest

from coslobe.render.methods.cosine_lobes import kernel_defines, kernel_units
from coslobe.render.scene import Mask

pytestmark = pytest.mark.filterwarnings("ignore:Kernel .* retrieved more than once")

WRAPPERS = """
inline void store(pf v, __global float *out)
{
    for (int l = 0; l < PW; l++)
        out[l] = LANE(v, l);
}
#define OF_ROWS(F) \\
    __kernel void F##_many(__global const float *x, __global float *y) \\
    { const int i = get_global_id(0) * RW; CAT(vstore, RW)(F(RF_LOAD(x + i)), 0, y + i); }
#define OF_POINTS(F) \\
    __kernel void F##_many(__global const float *x, __global float *y) \\
    { const int i = get_global_id(0) * PW; store(F(PF_LOAD(x + i)), y + i); }
OF_ROWS(ln_rows) OF_ROWS(log_rows) OF_ROWS(exp_rows) OF_ROWS(angle_rows)
OF_POINTS(ln_points) OF_POINTS(log_points) OF_POINTS(exp_points) OF_POINTS(angle_points)
__kernel void look_up_many(__global const float *rows, const int count, __global const int *columns,
                           __global float *found, __global int *kinds)
{
    const int i = get_global_id(0);
    __local table_t table;
    table.rows = rows;
    table.count = count;
    pi chosen;
    for (int l = 0; l < PW; l++)
        INT_LANE(chosen, l) = columns[i * PW + l];
    kinds[i] = kind_of(chosen);
    store(look_up(&table, 1, chosen, kinds[i]), found + i * PW);
}
__kernel void columns_many(__global const float4 *rows, __global float *out)
{
    const int i = get_global_id(0);
    float4 own[PW];
    for (int l = 0; l < PW; l++)
        own[l] = rows[i * PW + l];
    pf columns[4];
    columns_of(own, columns);
    for (int k = 0; k < 4; k++)
        store(columns[k], out + (4 * i + k) * PW);
}
__kernel void store_many(__global const float *rows, const int count, __global float *out)
{
    const int i = get_global_id(0) * PW;
    store3(load3(rows + i, count), out + 3 * i);
}
"""

LOGARITHM = np.array([1e-6, 0.3, 0.5, 0.7071, 0.70711, 0.99999, 1.0, 1.00001, 1.41421, 1.41422, 2.0, 3e7])
FUNCTIONS = {
    "ln": (np.log, LOGARITHM, lambda x, y: 2e-7 * np.abs(y) + 1e-7 * np.minimum(x, 1)),
    "log": (
        lambda q: np.log1p(-q),
        [0, 1e-9, 1e-4, 0.2, 0.29, 0.3, 0.9, 0.9999],
        lambda _, y: 3e-7 * np.abs(y),
    ),
    "exp": (
        np.exp,
        [-87.0, -60, -1, -0.3466, -0.3465, 0, 0.3, 1, 40, 80],
        lambda x, y: 1.5e-7 * (1 + np.abs(x)) * y,
    ),
    "angle": (
        lambda q: 2 * np.arcsin(np.sqrt(q / 2)),
        [0, 1e-12, 1e-3, 0.9, 1, 1.1, 2],
        lambda _, y: 3e-7 * y,
    ),
}


def defines(device, depth=5):
    return kernel_defines(device.info.vector_width, Mask(depth=depth), 1)


def program(device, depth=5):
    return device.build([*kernel_units("accurate"), ("wrappers", WRAPPERS)], defines(device, depth))


@pytest.mark.parametrize("depth", [2, 5])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_elementary_functions(device, name, depth):
    """Of rows and of points, whose vectors differ for small masks. Errors are a few roundings."""
    function, edges, tolerance = FUNCTIONS[name]
    low, high = min(edges), max(edges)
    between = np.random.default_rng(0).uniform(low, high, 4096 - len(edges))
    x = np.concatenate([edges, between]).astype(np.float32)
    expected = function(x.astype(float))
    for kind in ("rows", "points"):
        width = defines(device, depth)["RW" if kind == "rows" else "PW"]
        out = device.allocate(x.nbytes)
        kernel = getattr(program(device, depth), f"{name}_{kind}_many")
        device.launch(kernel, len(x) // width, None, device.upload(x), out)
        found = device.download(out, x.shape, np.float32)
        assert np.all(np.abs(found - expected) <= tolerance(x.astype(float), expected))


def test_exponential_vanishes_where_floats_do(device):
    x = np.full(64, -1e9, np.float32)
    x[1::2] = -89
    out = device.allocate(x.nbytes)
    device.launch(program(device).exp_rows_many, 64 // defines(device)["RW"], None, device.upload(x), out)
    assert not device.download(out, x.shape, np.float32).any()


def test_columns_of_a_table(device):
    """One column for all points, neighbours, and scattered ones."""
    rng = np.random.default_rng(1)
    width, count = defines(device)["PW"], 100
    table = rng.random((3, count)).astype(np.float32)
    lanes = np.arange(width)
    columns = np.stack([0 * lanes + 7, lanes, lanes + 50, lanes[::-1], lanes * 3, (lanes > 0) + 0]).astype(
        np.int32
    )
    found, kinds = device.allocate(columns.size * 4), device.allocate(len(columns) * 4)
    inputs = device.upload(table), np.int32(count), device.upload(columns)
    device.launch(program(device).look_up_many, len(columns), None, *inputs, found, kinds)
    np.testing.assert_array_equal(device.download(found, columns.shape, np.float32), table[1][columns])
    np.testing.assert_array_equal(
        device.download(kinds, (len(columns),), np.int32), [0, 1, 1, 2, 2, 2] if width > 1 else 0
    )


def test_transposing_rows_of_four(device):
    width = defines(device)["PW"]
    rows = np.random.default_rng(2).random((5, width, 4)).astype(np.float32)
    out = device.allocate(rows.nbytes)
    device.launch(program(device).columns_many, len(rows), None, device.upload(rows), out)
    found = device.download(out, (len(rows), 4, width), np.float32)
    np.testing.assert_array_equal(found, rows.transpose(0, 2, 1))


def test_storing_vectors(device):
    """Rows of x, y and z become one vector after another, and nothing beyond the last is written."""
    n = 4 * defines(device)["PW"]
    rows = np.random.default_rng(3).random((3, n)).astype(np.float32)
    out = device.upload(np.full(3 * n + 4, -1, np.float32))
    device.launch(program(device).store_many, 4, 1, device.upload(rows), np.int32(n), out)
    found = device.download(out, (3 * n + 4,), np.float32)
    np.testing.assert_array_equal(found[: 3 * n].reshape(n, 3), rows.T)
    assert np.all(found[3 * n :] == -1)
