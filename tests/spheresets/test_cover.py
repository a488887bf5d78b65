"""Outer covers: every point of the surface is inside, in the coordinates of the file too."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from coslobe.spheresets.cover import cover
from coslobe.spheresets.solid import Solid


def placed(solid: Solid, spheres):
    """As fits are written: in file coordinates, rounded to float64."""
    return solid.center + solid.size * spheres[:, :3], solid.size * spheres[:, 3]


def farthest_out(points, centers, radii) -> float:
    """Largest distance of points [n, 3] from the union, block by block."""
    gaps = [
        (np.linalg.norm(part[:, None] - centers, axis=2) - radii).min(1)
        for part in np.array_split(points, len(points) // 2000 + 1)
    ]
    return float(np.concatenate(gaps).max())


def on_triangles(mesh, rng, count: int):
    """Corners, middles of edges, and random points of every triangle."""
    corners = mesh.vertices[mesh.faces]
    weights = np.concatenate([np.eye(3), (1 - np.eye(3)) / 2, rng.dirichlet(np.ones(3), count)])
    return np.einsum("wk,nkd->nwd", weights, corners).reshape(-1, 3)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 20), st.sampled_from([0.0, 1.0, 1e5]))
def test_random_triangles_are_covered_by_any_spheres(mesh_of, seed, count, away):
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(12, 3)) + away
    mesh = mesh_of(trimesh.Trimesh(vertices, rng.integers(0, 12, (10, 3)), process=False))
    solid = Solid(mesh)
    spheres = np.column_stack([rng.uniform(-0.5, 0.5, (count, 3)), rng.uniform(1e-5, 0.3, count)])
    covered = cover(solid, spheres)
    np.testing.assert_array_equal(covered[:, :3], spheres[:, :3])
    assert (covered[:, 3] >= spheres[:, 3]).all()
    # Only the points tried here round: to an ulp of their coordinates.
    assert farthest_out(on_triangles(mesh, rng, 50), *placed(solid, covered)) <= 8e-16 * max(away, 1)


def test_spheres_that_cover_already_stay_as_they_are(ball):
    covered = cover(Solid(ball), np.array([[0, 0, 0, 0.5]]))
    np.testing.assert_allclose(covered[:, 3], 0.5, atol=1e-14)


def test_one_sphere_grows_to_the_farthest_corner(mesh_of):
    """A closed form: around a box from its center."""
    solid = Solid(mesh_of(trimesh.creation.box([1, 2, 3])))
    assert cover(solid, np.array([[0, 0, 0, 0.1]]))[0, 3] == pytest.approx(0.5, rel=1e-14)


def test_one_sphere_grows_where_two_could(mesh_of):
    """Two balls, two spheres: neither takes over the other's ball."""
    parts = [trimesh.creation.icosphere(subdivisions=3).apply_translation([x, 0, 0]) for x in (-1.2, 1.2)]
    solid = Solid(mesh_of(*parts))
    spheres = np.array([[-1.2, 0, 0, 0.8], [1.2, 0, 0, 0.9]]) / solid.size
    np.testing.assert_allclose(cover(solid, spheres)[:, 3] * solid.size, 1, atol=1e-3)
