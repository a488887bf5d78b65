"""Shading at vertices: the points, the picture between them, the file."""

import numpy as np
import pytest
import trimesh

from coslobe.core.errors import CoslobeError
from coslobe.render.assets import Assets
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.images import read_exr, srgb
from coslobe.render.scene import load_scene
from coslobe.render.sequence import render_sequence
from coslobe.render.vertices import interpolate, vertex_points, write_vertices


@pytest.fixture
def scene(tiny_scene):
    return load_scene(tiny_scene, ["shading.at=vertices", "animation=[]"])


def test_every_vertex_of_the_visible_objects_is_a_point(scene):
    at, assets = scene.at(0), Assets(None)
    points = vertex_points(at, assets)
    meshes = [(obj, assets.mesh(obj)) for obj in at.objects.values()]
    assert len(points.position) == sum(len(mesh.vertices) for _, mesh in meshes)
    first = 0
    for index, (obj, mesh) in enumerate(meshes):
        own = slice(first, first + len(mesh.vertices))
        matrix = obj.transform.matrix()
        np.testing.assert_allclose(
            points.position[own], mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-12
        )
        assert (points.object[own] == index).all()
        first = own.stop
    np.testing.assert_allclose(np.linalg.norm(points.shading_normal, axis=1), 1)
    assert (np.einsum("ij,ij->i", points.shading_normal, points.view) >= 0).all()


def test_between_vertices_linear_functions_stay_linear(scene):
    """Positions are linear on each triangle, so interpolating them must give the points of the picture."""
    at, assets = scene.at(0), Assets(None)
    seen = trace_gbuffer(at, assets)
    assert len(seen.position) > 100
    found = interpolate(at, assets, seen, vertex_points(at, assets).position)
    np.testing.assert_allclose(found, seen.position, atol=1e-6)  # float32 rays of Embree


def test_the_file_holds_radiance_and_colours(scene, tmp_path):
    at, assets = scene.at(0), Assets(None)
    points = vertex_points(at, assets)
    radiance = np.random.default_rng(0).uniform(0, 2, (len(points.position), 3)).astype(np.float32)
    file = tmp_path / "vertices.ply"
    write_vertices(file, at, assets, points, radiance)
    read = trimesh.load(file, process=False)
    data = read.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(np.stack([data[f"radiance_{c}"].ravel() for c in "rgb"], axis=1), radiance)
    np.testing.assert_allclose(read.vertices, points.position, atol=1e-6)
    np.testing.assert_array_equal(read.visual.vertex_colors[:, :3], np.rint(srgb(radiance) * 255))
    triangles = sum(len(assets.mesh(obj).faces) for obj in at.objects.values())
    assert len(read.faces) == triangles


def test_radiance_that_is_not_finite_is_not_written(scene, tmp_path):
    at, assets = scene.at(0), Assets(None)
    points = vertex_points(at, assets)
    with pytest.raises(CoslobeError, match="not finite"):
        write_vertices(tmp_path / "a.ply", at, assets, points, np.full((len(points.position), 3), np.nan))
    assert not list(tmp_path.glob("*.ply"))


def test_a_fine_grid_shaded_at_its_vertices_is_the_picture(scene, tmp_path, device, tiny_scene):
    """Away from shadow edges interpolation errs by the square of the grid's cells."""
    changes = ["objects.ground.plane.resolution=64", "objects.cube.visible=false", "animation=[]"]
    pictures = {}
    for at in ("vertices", "pixels"):
        file = load_scene(tiny_scene, [*changes, f"shading.at={at}"])
        document = render_sequence(file, tmp_path / at, frames=[0], device=device)
        pictures[at] = read_exr(document["frames"][0]["file"])[0]["beauty"]
        assert (tmp_path / at / "frames" / "vertices.0000.ply").is_file() == (at == "vertices")
    assert document["frames"][0]["points"] != 65 * 65
    difference = np.abs(pictures["vertices"] - pictures["pixels"])
    assert difference.max() < 2e-3 * pictures["pixels"].max()


def test_a_frame_without_its_file_is_rendered_again(scene, tmp_path, device):
    def resumed() -> bool:
        return render_sequence(scene, tmp_path, frames=[0], device=device)["frames"][0]["resumed"]

    assert not resumed()
    assert resumed()
    (tmp_path / "frames" / "vertices.0000.ply").unlink()
    assert not resumed()
