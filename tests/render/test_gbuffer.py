"""Points behind the pixels, against plain intersections in float64."""

import numpy as np
import pytest

from coslobe.render.assets import Assets
from coslobe.render.camera import camera_rays
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.raycaster import RayCaster
from coslobe.render.scene import load_scene


@pytest.mark.parametrize("distance", [3.0, 1e3, 1e6])
def test_hits_lie_on_their_rays_however_far_the_camera_is(distance):
    """A telephoto lens: Embree's float32 has digits for the mesh, but not for the way to it."""
    rng = np.random.default_rng(0)
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.2], [0.0, 1.0, -0.1]])
    origin = distance * np.array([0.1, -0.2, 1.0])
    weights = rng.dirichlet([2.0, 2.0, 2.0], 200)
    targets = weights @ corners
    length = np.linalg.norm(targets - origin, axis=1)
    t, triangle, uv = RayCaster(corners, np.array([[0, 1, 2]])).nearest(
        origin, ((targets - origin) / length[:, None]).T
    )
    assert np.all(triangle == 0)
    np.testing.assert_allclose(t, length, atol=1e-5)
    np.testing.assert_allclose(uv, weights[:, 1:], atol=1e-5)


def triangles(scene, assets):
    """Corners and their normals in the world [m, 3, 3], objects and numbers of all triangles."""
    parts = []
    for index, obj in enumerate(scene.objects.values()):
        mesh, matrix = assets.mesh(obj), obj.transform.matrix()
        corners = mesh.vertices[mesh.faces] @ matrix[:3, :3].T + matrix[:3, 3]
        normals = mesh.normals[mesh.faces] @ np.linalg.inv(matrix[:3, :3])
        if obj.normals == "flat":
            normals = np.repeat(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), 3, 0)
            normals = normals.reshape(-1, 3, 3)
        parts.append((corners, normals, np.full(len(corners), index), np.arange(len(corners))))
    return [np.concatenate(column) for column in zip(*parts, strict=True)]


def plainly_traced(scene, assets):
    """t, the nearest triangle's row and weights [n, 3] by Moller and Trumbore's test of all triangles."""
    corners = triangles(scene, assets)[0]
    rays = camera_rays(scene)
    a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(rays.direction[:, None], e2)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = np.einsum("nmk,mk->nm", p, e1)
        s = rays.origin - a
        u = np.einsum("nmk,mk->nm", p, s) / determinant
        q = np.cross(s, e1)
        v = np.einsum("nk,mk->nm", rays.direction, q) / determinant
        t = np.einsum("mk,mk->m", e2, q) / determinant
    t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
    row = t.argmin(axis=1)
    one = np.arange(len(t)), row
    return t[one], row, np.stack([1 - u[one] - v[one], u[one], v[one]], axis=1)


@pytest.mark.parametrize(
    "changes",
    [
        [],
        ["objects.cube.normals=flat", "image.samples=4", "objects.ground.plane.resolution=3"],
        ["objects.cube.transform={scale: 0.7, rotate_x: 20, rotate_z: 33, translate: [0.2, 0.3, -0.1]}"],
        ["objects.ground.transform={rotate_x: 25, scale: 2, translate: [0, 0.1, 0]}", "camera.fov=75"],
        [
            "objects.cube.transform.translate=[1000, 0, 0]",
            "objects.ground.transform.translate=[1000, 0, 0]",
            "camera.look_at={origin: [999, 1.2, 1.5], target: [1000, 0.2, 0]}",
        ],
    ],
    ids=["plain", "flat", "turned", "tilted", "far from the origin"],
)
def test_points_are_where_plain_intersections_are(tiny_scene, changes):
    scene, assets = (
        load_scene(tiny_scene, ["image.width=60", "image.height=50", *changes]).at(2),
        Assets(None),
    )
    found = trace_gbuffer(scene, assets)
    t, row, weights = plainly_traced(scene, assets)
    corners, normals, objects, numbers = triangles(scene, assets)
    expected = np.flatnonzero(np.isfinite(t))
    pixel = camera_rays(scene).pixel
    assert np.setxor1d(pixel[expected], found.pixel).size == 0
    assert len(found) == len(expected)
    row, weights, t = row[expected], weights[expected], t[expected]
    # An edge between two triangles may belong to either; on all else Embree's float32 agrees.
    same = (found.object == objects[row]) & (found.triangle == numbers[row])
    assert same.mean() > 0.99
    position = np.einsum("nk,nkd->nd", weights, corners[row])
    np.testing.assert_allclose(found.depth, t, atol=1e-5)
    np.testing.assert_allclose(found.position, position, atol=1e-5)
    np.testing.assert_allclose(found.weights[same], weights[same], atol=1e-5)
    geometric = np.cross(corners[row][:, 1] - corners[row][:, 0], corners[row][:, 2] - corners[row][:, 0])
    shading = np.einsum("nk,nkd->nd", weights, normals[row])
    view = scene.camera.look_at.origin - position
    for normal, known, side, atol in (
        (geometric, found.geometric_normal, view, 1e-9),
        (shading, found.shading_normal, found.geometric_normal, 1e-5),  # of Embree's weights
    ):
        normal *= np.where(np.einsum("ij,ij->i", normal, side) < 0, -1, 1)[:, None]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        np.testing.assert_allclose(known[same], normal[same], atol=atol)
    np.testing.assert_allclose(found.view, view / np.linalg.norm(view, axis=1, keepdims=True), atol=1e-5)
    names = list(scene.materials)
    of_object = [names.index(obj.material) for obj in scene.objects.values()]
    np.testing.assert_array_equal(found.material, np.take(of_object, found.object))
