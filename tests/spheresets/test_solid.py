"""What is inside a mesh, also where the mesh is not perfect; distances; surface samples."""

import numpy as np
import pytest
import trimesh

from coslobe.core.errors import InvalidInput
from coslobe.spheresets.line_samples import draw_lines
from coslobe.spheresets.samples import draw_points
from coslobe.spheresets.solid import Solid

BALL = trimesh.creation.icosphere(subdivisions=4)  # its volume is 0.3 % below the ball's


def cut(part, keep):
    """The triangles of `part` whose centers satisfy `keep`."""
    part = part.copy()
    part.update_faces(keep(part.triangles_center))
    return part


def test_unit_coordinates(mesh_of):
    mesh = mesh_of(trimesh.creation.torus(1, 0.3).apply_translation([10, 20, 30]))
    solid = Solid(mesh)
    np.testing.assert_allclose(solid.lower, -solid.upper)
    assert np.linalg.norm(solid.upper - solid.lower) == pytest.approx(1)
    np.testing.assert_allclose(solid.center + solid.size * solid.vertices, mesh.vertices)


def test_signed_distance_of_a_ball(mesh_of):
    solid = Solid(mesh_of(BALL))
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (2000, 3))
    expected = np.linalg.norm(points, axis=1) - 1 / solid.size
    # the icosphere lies up to 0.003 radii below the ball
    np.testing.assert_allclose(solid.signed_distance(points), expected, atol=0.003 / solid.size)


def test_surface_samples_are_uniform_by_area(mesh_of):
    """Very unequal triangles: a cube of which one face is cut into 2,000."""
    box = trimesh.creation.box()
    fine = cut(box, lambda c: c[:, 0] > 0.49).subdivide().subdivide().subdivide().subdivide().subdivide()
    rest = cut(box, lambda c: c[:, 0] < 0.49)
    solid = Solid(mesh_of(fine, rest))
    points = solid.sample_surface(60_000, np.random.default_rng(3)) * solid.size
    on_face = (np.abs(points[:, :, None] - [-0.5, 0.5]) < 1e-6).sum(0)
    # strata leave less than the binomial deviation of sqrt(60000 * 5 / 36) = 91
    np.testing.assert_allclose(on_face, 10_000, atol=300)
    right = points[np.abs(points[:, 0] - 0.5) < 1e-6][:, 1:]
    assert np.abs(right.mean(0)).max() < 4 * np.sqrt(1 / 12 / 10_000)


def test_rays_of_first_hits(mesh_of):
    solid = Solid(mesh_of(trimesh.creation.box()))
    half = 0.5 / solid.size
    origins = np.array([[0.01, 0.02, 1.0], [0.9, 0.9, 1.0]])
    distance, face, weights = solid.first_hit(origins, np.array([0.0, 0.0, -1.0]))
    assert distance[0] == pytest.approx(1 - half, rel=1e-6)
    assert np.isinf(distance[1])
    point = np.einsum("k,kd->d", weights[0], solid.vertices[solid.faces[face[0]]])
    np.testing.assert_allclose(point, [0.01, 0.02, half], atol=1e-6)


def test_triangles_without_area_are_refused(mesh_of):
    line = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], process=False)
    with pytest.raises(InvalidInput, match="zero area"):
        Solid(mesh_of(line))


def test_point_samples_are_labelled_and_close_together(mesh_of):
    solid = Solid(mesh_of(BALL))
    points = draw_points(solid, (0.0067, 0.02), 1, 5000, np.random.default_rng(4))
    flat = points.batches.transpose(0, 2, 1).reshape(-1, 4)
    radius = np.linalg.norm(flat[:, :3], axis=1) * solid.size
    far = np.abs(radius - 1) > 0.004  # not between icosphere and ball
    np.testing.assert_array_equal(flat[far, 3] == 1, radius[far] < 1)
    depth = 1 / solid.size - np.linalg.norm(points.interior, axis=1)
    np.testing.assert_allclose(points.depth, depth, atol=2e-3)
    # Each chunk of a batch covers a small part of the solid, and each batch all of it.
    chunks = points.batches[0, :3].reshape(3, -1, 128)
    assert np.median(np.ptp(chunks, axis=2).max(0)) < 0.4
    assert np.ptp(points.batches[0, :3], axis=1).min() > 0.55


def test_lines_measure_projected_area(mesh_of):
    """A ball's projected area is pi r^2 from everywhere."""
    solid = Solid(mesh_of(BALL))
    lines = draw_lines(solid, np.random.default_rng(5))
    expected = (1 / solid.size) ** 2 / 0.5**2  # of the disc of diameter 1 that the lines cross
    assert lines.hit.mean() == pytest.approx(expected, rel=0.003 + 4 * 0.0016 / expected)
    np.testing.assert_allclose((lines.origins * lines.directions).sum(1), 0, atol=1e-12)
