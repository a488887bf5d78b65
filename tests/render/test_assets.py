"""Planes as grids, and the world's blockers."""

import numpy as np
import pytest

from coslobe.core.errors import NoDevice
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.plane import locate, plane_mesh
from coslobe.render.scene import Object, Plane, load_scene


@pytest.mark.parametrize("resolution", [1, 2, 5])
def test_a_plane_is_a_grid_that_faces_up(resolution: int):
    mesh = plane_mesh(Plane(size=3, resolution=resolution))
    assert mesh.vertices.shape == ((resolution + 1) ** 2, 3)
    assert mesh.faces.shape == (2 * resolution**2, 3)
    assert mesh.faces.dtype == np.int32
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    twice_area = np.cross(b - a, c - a)
    np.testing.assert_allclose(twice_area[:, 1] / 2, 9 / len(mesh.faces))  # equal triangles, together 3 x 3
    np.testing.assert_array_equal(twice_area[:, [0, 2]], 0)
    np.testing.assert_array_equal(mesh.normals, np.tile([0, 1, 0], (len(mesh.vertices), 1)))
    np.testing.assert_array_equal(mesh.bounds, [[-1.5, 0, -1.5], [1.5, 0, 1.5]])
    assert len(np.unique(mesh.faces)) == len(mesh.vertices)


def test_blockers_follow_their_object(tiny_scene):
    change = "objects.cube.transform={scale: 2, rotate_z: 90, translate: [1, 0, 0]}"
    scene = load_scene(tiny_scene, [change, "animation=[]"]).at(0)
    blockers = world_blockers(scene, Assets(None))
    # (0, 0.2, 0) is doubled, turned onto -x, moved by 1.
    np.testing.assert_allclose(blockers.centers, [[0.6, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(blockers.radii, [0.5])
    np.testing.assert_allclose(blockers.outside, [0.1])
    assert blockers.owner.tolist() == [1]  # the cube is the scene's second object
    assert blockers.owner.dtype == np.int32


@pytest.mark.parametrize("change", ["objects.cube.visible=false", "objects.cube.occludes=false"])
def test_what_is_hidden_or_only_receives_blocks_nothing(tiny_scene, change):
    scene = load_scene(tiny_scene, [change]).at(0)
    blockers = world_blockers(scene, Assets(None))
    assert blockers.centers.shape == (0, 3)
    assert blockers.radii.shape == blockers.outside.shape == blockers.owner.shape == (0,)


def test_files_are_loaded_once(tiny_scene):
    cube = load_scene(tiny_scene).at(0).objects["cube"]
    moved = load_scene(tiny_scene).at(3).objects["cube"]
    assets = Assets(None)
    assert assets.mesh(cube) is assets.mesh(moved)
    assert assets.spheres(cube) is assets.spheres(moved)
    assert assets.raycaster(cube) is assets.raycaster(moved)


def test_spheres_of_another_mesh_are_mentioned(tiny_scene):
    from coslobe.core.progress import Progress

    class Listener(Progress):
        def say(self, text: str) -> None:
            said.append(text)

    said: list[str] = []
    mesh = tiny_scene.parent / "cube.obj"
    mesh.write_text(mesh.read_text() + "# changed\n")
    world_blockers(load_scene(tiny_scene).at(0), Assets(None, Listener()))
    assert len(said) == 1
    assert "cube.spheres.json" in said[0]


def test_fitting_needs_a_device(tiny_scene):
    scene = load_scene(tiny_scene, ["objects.cube.spheres={count: 4}"]).at(0)
    with pytest.raises(NoDevice):
        world_blockers(scene, Assets(None))


def test_sources_of_spheres_are_told(tiny_scene, device):
    cube = load_scene(tiny_scene).at(0).objects["cube"]
    assert Assets(device).spheres_source(cube) == f"read from {tiny_scene.parent / 'cube.spheres.json'}"
    cube = load_scene(tiny_scene, ["objects.cube.spheres={count: 5}"]).at(0).objects["cube"]
    assert Assets(device).spheres_source(cube) == "5, to be fitted"
    Assets(device).spheres(cube)
    assert Assets(device).spheres_source(cube) == "5, cached"


def test_contents_do_not_depend_on_where_files_lie(tiny_scene, tmp_path):
    import shutil

    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(tiny_scene.parent, elsewhere)
    contents = [
        Assets(None).contents(load_scene(folder / "tiny.yaml").at(0).objects["cube"])
        for folder in (tiny_scene.parent, elsewhere)
    ]
    assert contents[0] == contents[1]
    assert Assets(None).contents(Object(plane=Plane(size=1), material="m")) == {}


@pytest.mark.parametrize("resolution", [1, 4])
def test_a_place_on_the_square_is_found_in_its_triangles(resolution):
    plane = Plane(size=3, resolution=resolution)
    mesh = plane_mesh(plane)
    x, z = np.random.default_rng(0).uniform(-1.5, 1.5, (2, 500))
    triangle, weights = locate(plane, x, z)
    assert weights.min() > -1e-12
    found = np.einsum("nk,nkd->nd", weights, mesh.vertices[mesh.faces[triangle]])
    np.testing.assert_allclose(found, np.stack([x, 0 * x, z], axis=1), atol=1e-12)
