"""Texture coordinates and tangent frames at the points that are seen."""

import numpy as np
import pytest
from PIL import Image

from coslobe.core.errors import InvalidInput
from coslobe.render.assets import Assets
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.scene import Scene
from coslobe.render.surface import perpendicular, vertex_tangents
from coslobe.render.vertices import vertex_points
from coslobe.spheresets.mesh import Mesh, load_mesh

BRUSHED = {"lafortune": {"lobes": [{"rho": 1, "c": [-1, -0.5, 0.8], "exponent": 10}]}}


def globe(columns=48, rows=24):
    """Positions, uv and triangles of a unit sphere: u eastwards from -z, where the seam is, v northwards."""
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    index = np.arange(u.size).reshape(u.shape)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1)[columns:], np.stack([a, c, d], 1)[:-columns]])
    return on_globe(uv), uv, faces


def on_globe(uv):
    around, up = 2 * np.pi * uv[:, 0], np.pi * (uv[:, 1] - 0.5)
    return np.stack([-np.sin(around) * np.cos(up), np.sin(up), -np.cos(around) * np.cos(up)], axis=1)


def write_obj(path, vertices, uv, faces):
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in uv]
    lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines) + "\n")


def scene(material, obj, eye=(0.3, 0.5, 3.0)) -> Scene:
    return Scene.model_validate(
        {
            "camera": {"look_at": {"origin": eye, "target": [0, 0, 0]}, "fov": 45},
            "image": {"width": 40, "height": 40},
            "materials": {"m": material},
            "lights": {},
            "objects": {"o": {**obj, "material": "m"}},
        }
    )


@pytest.fixture
def ramps(tmp_path):
    """A picture of 0 to 1 along u, another along v, as materials' numbers."""
    size = 256
    ramp = ((np.arange(size) + 0.5) / size * 255).round().astype(np.uint8)
    Image.fromarray(np.tile(ramp, (size, 1))).save(tmp_path / "u.png")
    Image.fromarray(np.tile(ramp[::-1, None], (1, size))).save(tmp_path / "v.png")
    return {
        "phong": {
            "kd": 0,
            "ks": 1,
            "exponent": {"texture": str(tmp_path / "u.png")},
        }
    }, {"phong": {"kd": 0, "ks": 1, "exponent": {"texture": str(tmp_path / "v.png")}}}


def looked_up(material, obj, points=trace_gbuffer, **view):
    of = scene(material, obj, **view)
    gbuffer = points(of, Assets(None))
    (source,) = of.materials["m"].pictures
    return gbuffer, gbuffer.texels[source]


def test_textures_lie_over_the_square_of_a_plane(ramps):
    """u along x, v away from +z; the same at 1 cell and at many."""
    for resolution in (1, 7):
        plane = {"plane": {"size": 2.0, "resolution": resolution}}
        for material, expected in zip(
            ramps, (lambda p: p[:, 0] / 2 + 0.5, lambda p: 0.5 - p[:, 2] / 2), strict=True
        ):
            gbuffer, found = looked_up(material, plane, eye=[0.1, 3, 1])
            truth = expected(gbuffer.position)
            inner = np.abs(truth - 0.5) < 0.495  # beyond, the texture wraps
            np.testing.assert_allclose(found[inner], truth[inner], atol=0.003)  # 8 bits


def test_textures_lie_on_meshes_across_seams(tmp_path, ramps):
    vertices, uv, faces = globe()
    write_obj(tmp_path / "globe.obj", vertices, uv, faces)
    obj = {"mesh": str(tmp_path / "globe.obj"), "occludes": False, "transform": {"rotate_y": 180}}
    eye = [0.3, 0.5, -3.0]
    gbuffer, u = looked_up(ramps[0], {**obj, "transform": {}}, eye=eye)  # the seam in the middle
    p = gbuffer.position / np.linalg.norm(gbuffer.position, axis=1, keepdims=True)
    expected = np.arctan2(-p[:, 0], -p[:, 2]) / (2 * np.pi) % 1
    clear = (np.abs(expected - 0.5) < 0.495) & (np.abs(p[:, 1]) < 0.9)
    assert clear.sum() > 300
    np.testing.assert_allclose(u[clear], expected[clear], atol=0.01)  # triangles of 7.5 degrees
    assert np.count_nonzero(expected[clear] < 0.1) > 20
    assert np.count_nonzero(expected[clear] > 0.9) > 20
    _, v = looked_up(ramps[1], {**obj, "transform": {}}, eye=eye)
    np.testing.assert_allclose(v[clear], np.arcsin(p[clear, 1]) / np.pi + 0.5, atol=0.01)


def test_vertices_have_their_own_texture_coordinates(tmp_path, ramps):
    vertices, uv, faces = globe()
    write_obj(tmp_path / "globe.obj", vertices, uv, faces)
    mesh = load_mesh(tmp_path / "globe.obj")
    _, found = looked_up(ramps[1], {"mesh": str(tmp_path / "globe.obj"), "occludes": False}, vertex_points)
    inner = np.abs(mesh.uv[:, 1] - 0.5) < 0.49
    np.testing.assert_allclose(found[inner], mesh.uv[inner, 1], atol=0.003)


@pytest.mark.parametrize("suffix", ["obj", "glb", "ply"])
def test_files_bring_texture_coordinates(tmp_path, suffix):
    vertices, uv, faces = globe(8, 4)
    write_obj(tmp_path / "a.obj", vertices, uv, faces)
    if suffix != "obj":
        import trimesh

        trimesh.load(tmp_path / "a.obj", process=False).export(tmp_path / f"a.{suffix}")
    mesh = load_mesh(tmp_path / f"a.{suffix}")
    assert mesh.uv is not None
    used = np.unique(mesh.faces)
    np.testing.assert_allclose(on_globe(mesh.uv[used]), mesh.vertices[used], atol=1e-6)


def test_tangents_follow_u():
    vertices, uv, faces = globe()
    tangents = vertex_tangents(Mesh(vertices, faces, vertices, "globe", "", uv))
    east = np.stack([-np.cos(2 * np.pi * uv[:, 0]), 0 * uv[:, 0], np.sin(2 * np.pi * uv[:, 0])], axis=1)
    between = np.abs(np.einsum("ij,ij->i", tangents, east))[np.abs(uv[:, 1] - 0.5) < 0.4]
    # At the seam a vertex has triangles on one side only, 3.75 degrees off.
    assert between.min() > np.cos(np.radians(4))


def test_mirrored_texture_coordinates_do_not_cancel():
    """Two triangles on both sides of x = 0, u = |x|: the line is the same, the direction is not."""
    vertices = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3]])
    uv = np.stack([np.abs(vertices[:, 0]), vertices[:, 1]], axis=1)
    tangents = vertex_tangents(Mesh(vertices, faces, vertices, "book", "", uv))
    np.testing.assert_allclose(np.abs(tangents[:, 0]), 1, atol=1e-12)


def test_frames_are_perpendicular_to_shading_normals(tmp_path):
    vertices, uv, faces = globe()
    write_obj(tmp_path / "globe.obj", vertices, uv, faces)
    obj = {
        "mesh": str(tmp_path / "globe.obj"),
        "occludes": False,
        "transform": {"rotate_z": 30, "scale": 1.1},
    }
    given = {"lafortune": {**BRUSHED["lafortune"], "tangent": [0, 2, 0]}}
    for material in (BRUSHED, given):
        gbuffer = trace_gbuffer(scene(material, obj), Assets(None))
        x, n = gbuffer.tangent, gbuffer.shading_normal
        np.testing.assert_allclose(np.linalg.norm(x, axis=1), 1, atol=1e-12)
        np.testing.assert_allclose(np.einsum("ij,ij->i", x, n), 0, atol=1e-12)
        up = np.array([-0.5, np.sqrt(3) / 2, 0])  # the turned y of the object
        lies = np.abs(np.einsum("ij,ij->i", np.cross(n, perpendicular(np.tile(up, (len(n), 1)), n)), x))
        clear = np.abs(n @ up) < 0.8
        # Along the meridian where the tangent is given; along the parallels where u gives it.
        np.testing.assert_allclose(lies[clear], 1.0 if material is BRUSHED else 0.0, atol=3e-3)


def test_no_frame_where_none_is_needed():
    gbuffer = trace_gbuffer(
        scene({"phong": {"kd": 1, "ks": 1, "exponent": 2}}, {"plane": {"size": 1}}), Assets(None)
    )
    assert gbuffer.tangent is None
    assert not gbuffer.texels


def test_where_the_given_tangent_is_the_normal_any_frame_will_do():
    n = np.array([[0, 1.0, 0], [0.6, 0, 0.8]])
    x = perpendicular(3 * n, n)
    np.testing.assert_allclose(np.einsum("ij,ij->i", x, n), 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(x, axis=1), 1, atol=1e-12)


@pytest.mark.parametrize("kind", ["texture", "anisotropy"])
def test_a_mesh_without_texture_coordinates_is_refused_in_words(kind, ramps):
    material = ramps[0] if kind == "texture" else BRUSHED
    bunny = {"mesh": "sample:bunny", "occludes": False}
    with pytest.raises(
        InvalidInput, match=r"objects\.o: .*bunny has no texture coordinates.* material m needs"
    ):
        trace_gbuffer(scene(material, bunny), Assets(None))
