"""leaves.cl against its twin, and the layer that shows it."""

import numpy as np
import pytest

from coslobe.render import mask
from coslobe.render.methods.cosine_lobes import kernel_defines, kernel_units
from coslobe.render.scene import Mask
from coslobe.tables import quadtree

pytestmark = pytest.mark.filterwarnings("ignore:Kernel .* retrieved more than once")

WRAPPERS = """
__kernel void leaves_many(__global const uint *bits, __constant uint *disk, __global uint *trees,
                          __global int *counts)
{
    const int i = get_global_id(0);
    ru m[NR];
    for (int k = 0; k < NR; k++) m[k] = RU_LOAD(i * NR + k, bits);
    uint tree[TREE_ROWS];
    counts[i] = shadow_leaves(m, disk, tree);
    for (int r = 0; r < TREE_ROWS; r++) trees[i * TREE_ROWS + r] = tree[r];
}
"""


def tree_of(leaves):
    """The twin's leaves in the layout of the device."""
    rows = leaves[-1].shape[-1]
    levels = []
    for level in reversed(leaves):
        first_columns = np.zeros((len(level), rows), bool)
        first_columns[:, :: rows // len(level)] = level
        levels.append(mask.pack(first_columns))
    return np.concatenate(levels)


@pytest.mark.parametrize("depth", [2, 3, 4, 5])
def test_leaves(device, depth):
    rng = np.random.default_rng(0)
    n, rows = 300, 2**depth
    cells = rng.random((n, rows, rows)) < rng.choice([0.1, 0.7, 0.97, 1.0], (n, 1, 1))
    block = rows // 4
    cells[: n // 2] = (rng.random((n // 2, 4, 4)) < 0.8).repeat(block, 1).repeat(block, 2)  # whole blocks
    bits = np.stack([mask.pack(c) for c in cells])
    needed = ("vector.cl", "leaves.cl")
    units = [*(unit for unit in kernel_units("accurate") if unit[0] in needed), ("wrappers", WRAPPERS)]
    program = device.build(units, kernel_defines(device.info.vector_width, Mask(depth=depth), 0))
    trees, counts = device.allocate(n * (2 * rows - 1) * 4), device.allocate(n * 4)
    disk = device.upload(mask.disk_tree(rows))
    device.launch(program.leaves_many, n, None, device.upload(bits), disk, trees, counts)
    found = device.download(trees, (n, 2 * rows - 1), np.uint32)
    leaves = quadtree.shadow_leaves(cells)
    expected = np.stack([tree_of([level[i] for level in leaves]) for i in range(n)])
    np.testing.assert_array_equal(found, expected)
    totals = sum(level.sum(axis=(1, 2)) for level in leaves)
    np.testing.assert_array_equal(device.download(counts, (n,), np.int32), totals)
    assert len(np.unique(totals)) > 3
