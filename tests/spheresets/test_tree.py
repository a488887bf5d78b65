"""Levels, parents, and the bounding hierarchy's one promise: children lie inside."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coslobe.spheresets.tree import bounding_hierarchy, enclosing_spheres, level_counts, parents


@pytest.mark.parametrize(
    ("count", "levels", "expected"),
    [
        (1, None, [1]),
        (4, None, [4]),
        (5, None, [4, 5]),
        (64, None, [4, 16, 64]),
        (100, None, [4, 16, 64, 100]),
        (100, 2, [64, 100]),
        (100, 1, [100]),
        (100, 9, [4, 16, 64, 100]),
    ],
)
def test_levels(count, levels, expected):
    assert level_counts(count, levels) == expected


@st.composite
def sphere_sets(draw):
    """Up to 300 spheres: clusters, copies, concentric, collinear, tiny and huge ones, near or far from 0."""
    count = draw(st.sampled_from([1, 2, 3, 4, 5]) | st.integers(1, 300))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    spread = draw(st.sampled_from([0.0, 1e-9, 1.0, 1e6]))
    offset = draw(st.sampled_from([0.0, 1e6]))
    centers = offset + spread * rng.normal(size=(count, 3)).round(draw(st.integers(0, 3)))
    centers = centers * draw(st.sampled_from([(1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (1.0, 1.0, 1e-3)]))
    spheres = np.column_stack([centers, 10.0 ** rng.uniform(-8, draw(st.sampled_from([1, 8])), count)])
    return spheres[rng.integers(count, size=count)] if draw(st.booleans()) else spheres


@given(sphere_sets())
def test_every_child_lies_inside_its_parent(spheres):
    order, hierarchy = bounding_hierarchy(spheres)
    np.testing.assert_array_equal(np.sort(order), np.arange(len(spheres)))
    m = len(hierarchy.radii)
    numbered = np.concatenate([np.column_stack([hierarchy.centers, hierarchy.radii]), spheres[order]])
    on_device = numbered.astype(np.float32).astype(np.float64)
    children = [
        np.arange(first, first + count)
        for first, count in zip(hierarchy.first_child, hierarchy.child_count, strict=True)
    ]
    # Every number but the root's is the child of exactly one node, of a lower number.
    np.testing.assert_array_equal(np.sort(np.concatenate(children)), np.arange(1, m + len(spheres)))
    for node, members in enumerate(children):
        assert members.min() > node
        for held in (numbered, on_device):
            gap = np.linalg.norm(held[members, :3] - held[node, :3], axis=1)
            assert (gap + held[members, 3] <= held[node, 3]).all()


def test_arrays_are_ready_for_the_device():
    _, hierarchy = bounding_hierarchy(np.random.default_rng(0).random((100, 4)))
    for array in vars(hierarchy).values():
        assert array.flags.c_contiguous
    assert hierarchy.first_child.dtype == hierarchy.child_count.dtype == np.int32


def test_enclosing_spheres_are_nearly_the_smallest():
    pair = np.array([[0.0, 0, 0, 1], [4, 0, 0, 1]])
    nested = np.array([[0.0, 0, 0, 2], [0.5, 0, 0, 0.1]])
    tetrahedron = np.column_stack([[[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.zeros(4)])
    for group, smallest in ((pair, 3.0), (nested, 2.0), (tetrahedron, np.sqrt(3))):
        radius = enclosing_spheres(group[None])[0, 3]
        assert smallest * (1 - 1e-12) <= radius < smallest * 1.03


def test_a_parent_is_the_sphere_that_holds_the_child():
    above = np.array([[0.0, 0, 0, 1], [3, 0, 0, 1]])
    children = np.array([[0.5, 0, 0, 0.1], [2.5, 0, 0, 0.1], [9, 0, 0, 0.1], [1.4, 0, 0, 0.1]])
    np.testing.assert_array_equal(parents(children, above), [0, 1, 1, 0])


def test_parents_are_found_in_blocks(monkeypatch):
    rng = np.random.default_rng(0)
    above, children = rng.random((7, 4)), rng.random((100, 4))
    whole = parents(children, above)
    monkeypatch.setattr("coslobe.spheresets.tree.BLOCK", 9)
    np.testing.assert_array_equal(parents(children, above), whole)
