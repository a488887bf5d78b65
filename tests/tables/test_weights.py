"""The quadtree of shadow leaves, and the weights that make lobes of leaves add up to a shadow."""

from dataclasses import replace

import numpy as np
import pytest

from coslobe.core.errors import CoslobeError
from coslobe.tables import quadtree, store, weights

SINES2 = (0.0, 1e-4, 0.0147, 0.2, 0.7)


@pytest.fixture(scope="module")
def tables():
    return store.cached()


def expand(level, rows):
    """Blocks as the cells they hold."""
    size = rows // level.shape[-1]
    return level.repeat(size, -1).repeat(size, -2)


@pytest.mark.parametrize("rows", [4, 8, 32])
def test_leaves_tile_the_shadow_on_the_disk(rows):
    rng = np.random.default_rng(0)
    masks = rng.random((200, rows, rows)) < rng.choice([0.1, 0.7, 0.97], (200, 1, 1))
    masks[:40] = expand(rng.random((40, 4, 4)) < 0.7, rows)  # with whole blocks to merge
    disk = quadtree.disk(rows)
    leaves = quadtree.shadow_leaves(masks)
    covered = sum(expand(level, rows).astype(int) for level in leaves)
    assert covered.max() == 1  # leaves do not overlap
    np.testing.assert_array_equal((covered == 1) & disk, masks & disk)
    assert sum(level.sum() for level in leaves[:-1]) > 0
    lit = ~masks & disk
    for level in leaves[1:]:  # none could be larger
        size = 2 * rows // level.shape[-1]
        parents = lit.reshape(len(masks), rows // size, size, rows // size, size).any(axis=(2, 4))
        assert not (level & ~expand(parents, level.shape[-1])).any()


@pytest.mark.parametrize("rows", [4, 8, 16, 32])
def test_a_covered_disk_is_one_leaf(rows):
    """Whatever lies outside the disk; and what lies outside makes no leaf."""
    disk = quadtree.disk(rows)
    assert [int(level.sum()) for level in quadtree.shadow_leaves(disk)][:2] == [1, 0]
    assert sum(level.sum() for level in quadtree.shadow_leaves(~disk)) == 0


@pytest.mark.parametrize("sine2", SINES2)
def test_a_leaf_over_the_whole_light_takes_all_of_it(tables, sine2):
    """The umbra rule, between the samples too."""
    tangent = max(np.sqrt(sine2 / (1 - sine2)), 1e-3)
    part = weights.shadow_parts(tables.product, tables.cap, [np.ones((1, 1, 1), bool)], tangent)[0, 0]
    for depth in weights.MASK_DEPTHS:
        assert tables.weights.lookup(depth, sine2)[0] * part == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("depth", weights.MASK_DEPTHS)
@pytest.mark.parametrize("sine2", SINES2)
def test_penumbrae_of_masks_that_the_fit_did_not_see(tables, depth, sine2):
    """One lobe per leaf cannot do better than about 1.5 % of the light; amplitude 1 without weights is worse.

    Masks of 4 x 4 cells have little to say: their lobes are as wide as the light.
    """
    tangent = max(np.sqrt(sine2 / (1 - sine2)), 1e-3)
    masks = weights.random_masks(np.random.default_rng(7), 800, 2**depth)
    parts = weights.shadow_parts(tables.product, tables.cap, quadtree.shadow_leaves(masks), tangent)
    visible = weights.visible_share(masks, tangent)
    error = 1 - parts @ tables.weights.lookup(depth, sine2)[: depth + 1] - visible
    alone = 1 - parts.sum(axis=1) - visible
    assert np.sqrt(np.mean(error**2)) < (0.04 if depth == 2 else 0.025)
    assert np.abs(np.mean(error)) < 0.006
    assert np.sqrt(np.mean(alone**2)) > 1.1 * np.sqrt(np.mean(error**2))


def test_small_lights_have_a_limit(tables):
    """From the paper's dist = 10 on, 2.9 degrees, weights are those of the smallest lights within 1 %."""
    far = tables.weights.lookup(5, 1 / (1 + 4 * 10.0**2))
    np.testing.assert_allclose(far, tables.weights.lookup(5, 0.0), rtol=0.01)


def test_other_weights_are_refused(tables):
    wrong = weights.WeightTable(tables.weights.values * 1.01)
    with pytest.raises(CoslobeError, match="a covered light is dark"):
        store.verify(replace(tables, weights=wrong))


def test_a_second_build_has_the_same_bits(tables):
    again = weights.build(tables.product, tables.cap)
    assert again.values.tobytes() == tables.weights.values.tobytes()
