"""cells.cl against its twin."""

import numpy as np
import pytest

from coslobe.render import cells, mask
from coslobe.render.methods.cosine_lobes import SMOOTH_ROWS, kernel_defines, kernel_units
from coslobe.render.scene import Mask
from coslobe.tables import quadtree

pytestmark = pytest.mark.filterwarnings("ignore:Kernel .* retrieved more than once")

WRAPPERS = """
__kernel void glossy_many(__global const uint *lit, __global const uint *whole,
                          __global const float *arguments, __global const int *flags, __global float *out)
{
    const int i = get_global_id(0);
    ru some[NR], all[NR];
    for (int k = 0; k < NR; k++) {
        some[k] = RU_LOAD(i * NR + k, lit);
        all[k] = RU_LOAD(i * NR + k, whole);
    }
    __global const float *p = arguments + 8 * i;
    const float3 n = vload3(0, p + 1), r = vload3(0, p + 4);
    vstore2(glossy_sums(some, all, p[0], n, r, p[7], flags[2 * i], flags[2 * i + 1]), i, out);
}
__kernel void diffuse_many(__global const uint *lit, __constant uint *disk, __global const float *arguments,
                           __global float *out)
{
    const int i = get_global_id(0);
    ru some[NR];
    for (int k = 0; k < NR; k++)
        some[k] = RU_LOAD(i * NR + k, lit);
    vstore2(diffuse_cells(some, disk, arguments[4 * i], vload3(0, arguments + 4 * i + 1)), i, out);
}
"""


def program(device, depth):
    units = [*kernel_units("accurate"), ("wrappers", WRAPPERS)]
    return device.build(units, kernel_defines(device.info.vector_width, Mask(depth=depth), 1))


@pytest.mark.parametrize("depth", [2, 5])
def test_diffuse_sums(device, depth):
    """Random bits, since columns that mirror each other are summed together; horizons across lights."""
    rng = np.random.default_rng(depth)
    n, rows = 500, 2**depth
    x = quadtree.cell_centres(rows)
    disk = x**2 + x[:, None] ** 2 <= 1
    lit = disk & (rng.random((n, rows, rows)) < rng.random((n, 1, 1)))
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    arguments = np.column_stack([10 ** rng.uniform(-2, 0.2, n), normal]).astype(np.float32)
    bits = np.stack([mask.pack(cell) for cell in lit])
    inputs = [device.upload(array) for array in (bits, mask.pack(disk), arguments)]
    out = device.allocate(n * 8)
    device.launch(program(device, depth).diffuse_many, n, None, *inputs, out)
    expected = np.array(
        [
            cells.diffuse_sums(seen, disk, h, np.array(m))
            for seen, (h, *m) in zip(lit, arguments.astype(float), strict=True)
        ]
    )
    # Sums of up to 812 floats of order 1, each within a few roundings.
    np.testing.assert_allclose(device.download(out, (n, 2), np.float32), expected, rtol=2e-6, atol=1e-4)


@pytest.mark.parametrize("depth", [2, 5])
def test_glossy_sums(device, depth):
    """Lobes as sharp and as far off as they come, straight shadow edges, small and large lights."""
    rng = np.random.default_rng(depth)
    n, rows = 1500, 2**depth
    h = 10 ** rng.uniform(-2.5, 0.2, n)
    e = np.minimum(10 ** rng.uniform(-1, 5, n), (rows / h) ** 2)
    off, azimuth = rng.uniform(0, 1, n) * (h + 4 / np.sqrt(e + 1)), rng.uniform(0, 2 * np.pi, n)
    off = np.minimum(off, 1.5)
    axis = np.stack([np.sin(off) * np.cos(azimuth), np.sin(off) * np.sin(azimuth), np.cos(off)], axis=1)
    normal = rng.normal(size=(n, 3)) * [1, 1, 0] + [0, 0, 1]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    x = quadtree.cell_centres(rows)
    edge = rng.uniform(0, 2 * np.pi, (n, 1, 1))
    disk = np.broadcast_to(x**2 + x[:, None] ** 2 <= 1, (n, rows, rows))
    lit = disk & (x * np.cos(edge) + x[:, None] * np.sin(edge) < rng.uniform(-0.7, 0.7, (n, 1, 1)))
    # Lights that the horizon does not cut are wholly above it.
    above = normal[:, 2] > 1.01 * h * np.hypot(normal[:, 0], normal[:, 1])
    flags = np.stack([rng.random(n) < 0.7, ~above | (rng.random(n) < 0.3)], axis=1).astype(np.int32)
    arguments = np.column_stack([h, normal, axis, e]).astype(np.float32)
    bits = [np.stack([mask.pack(cell) for cell in masks]) for masks in (lit, disk)]
    out = device.allocate(n * 8)
    device.launch(
        program(device, depth).glossy_many, n, None, *map(device.upload, (*bits, arguments, flags)), out
    )
    found = device.download(out, (n, 2), np.float32)
    expected = np.empty((n, 2))
    for i, (width, *vectors, exponent) in enumerate(arguments.astype(float)):
        m, a = np.array(vectors).reshape(2, 3)
        cosine, cut = flags[i].astype(bool)
        expected[i] = cells.glossy_sums(lit[i], disk[i], width, m, a, exponent, cosine=cosine, cut=cut)
    seen = expected[:, 0] > 1e-20
    share, exact = (sums[seen, 1] / sums[seen, 0] for sums in (found, expected))
    # Polynomials are allowed 6e-5; 4e-7 e (1 - cos) is what rounding makes of powers.
    rounding = 4e-7 * (e * (1 - np.cos(off + h)))[seen]
    assert np.all(np.abs(share - exact) <= 2e-4 + rounding)
    np.testing.assert_allclose(found[seen], expected[seen], rtol=3e-3, atol=1e-20)
    smooth = (flags[:, 1] == 0) & ((e + 4) * h**5 < SMOOTH_ROWS)
    assert 0.1 < smooth.mean() < 0.9
