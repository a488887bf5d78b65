"""The same scene in Mitsuba 3: camera, units, BRDF normalisation, light."""

import numpy as np
import PIL.Image
import pytest

from coslobe.core.errors import CoslobeError
from coslobe.evaluate.crosscheck import image_shift, render_with_mitsuba, write_ply
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.errors import compare
from coslobe.evaluate.occlusion import mesh_occluders
from coslobe.evaluate.sampling import strata
from coslobe.render.assets import Assets
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.scene import Scene
from coslobe.spheresets.mesh import load_mesh

MATERIALS = {
    "lambert": {"lambert": {"albedo": [0.8, 0.5, 0.3]}},
    "phong": {"phong": {"kd": [0.3, 0.2, 0.1], "ks": [0.4, 0.3, 0.5], "exponent": 30}},
    "phong_1975": {"phong_1975": {"kd": [0.3, 0.2, 0.1], "ks": [0.4, 0.3, 0.5], "exponent": 30}},
    "lafortune": {
        "lafortune": {
            "kd": 0.1,
            "lobes": [
                {"rho": [0.9, 0.7, 0.4], "c": [-1, -1, 0.8], "exponent": 12},
                {"rho": 0.3, "c": [0.9, 0.9, 1], "exponent": 5},
            ],
        }
    },
}


def scene(
    material: str, width: int, height: int, samples: int, objects: dict, materials=None, **camera
) -> Scene:
    """Nothing in it is symmetric, so that a flip of any axis shows."""
    look_at = {"origin": [-1.1, 1.9, 2.6], "target": [0.15, 0.35, 0.1], "up": [0.1, 1, 0.05]}
    return Scene.model_validate(
        {
            "camera": {"look_at": look_at, "fov": 38.0, **camera},
            "image": {"width": width, "height": height, "samples": samples},
            "materials": materials or {"m": MATERIALS[material]},
            "lights": {
                "key": {"sphere": {"center": [0.5, 2.2, -1.6], "radius": 0.4, "radiance": [30, 20, 25]}}
            },
            "objects": objects,
        }
    )


GROUND = {"plane": {"size": 60.0}, "material": "m", "transform": {"rotate_x": 5, "translate": [0, 0.05, 0]}}


def reference(frame: Scene, assets: Assets, samples: int) -> np.ndarray:
    gbuffer = trace_gbuffer(frame, assets)
    estimate = direct_light(frame, gbuffer, mesh_occluders(frame, assets), strata(samples), (0,))
    return gbuffer.image(estimate.radiance)


@pytest.mark.parametrize(
    ("material", "fov_axis"),
    [("lambert", "x"), ("phong", "x"), ("phong", "y"), ("phong_1975", "x"), ("lafortune", "x")],
)
def test_the_mean_radiance_of_an_unoccluded_plane_is_the_same(material, fov_axis):
    """Within 0.3 %, per channel; the statistical error of either side is below 0.1 %."""
    pytest.importorskip("mitsuba", reason="mitsuba is not installed")
    frame = scene(material, 48, 32, 4, {"ground": GROUND}, fov_axis=fov_axis)
    assets = Assets(None)
    theirs = render_with_mitsuba(frame, assets, 256 if material == "lambert" else 48)
    ours = reference(frame, assets, 64)
    assert (ours > 0).all()
    np.testing.assert_allclose(ours.mean(axis=(0, 1)), theirs.mean(axis=(0, 1)), rtol=3e-3)


def test_textures_lie_on_a_plane_as_in_mitsuba(tmp_path):
    """A picture without symmetry: directions of u and v, texels' centres, wrapping, decoding."""
    pytest.importorskip("mitsuba", reason="mitsuba is not installed")
    texels = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    PIL.Image.fromarray(texels).save(tmp_path / "texels.png")
    ground = {"plane": {"size": 3.0}, "material": "m", "transform": {"rotate_y": 20}}
    albedo = {"texture": str(tmp_path / "texels.png")}
    frame = scene("lambert", 48, 32, 16, {"ground": ground}, materials={"m": {"lambert": {"albedo": albedo}}})
    assets = Assets(None)
    theirs, ours = render_with_mitsuba(frame, assets, 256), reference(frame, assets, 16)
    errors = compare(ours.reshape(-1, 3), theirs.reshape(-1, 3), np.zeros((ours[..., 0].size, 3)))
    assert errors.relative_rmse < 0.05  # noise at the plane's edge, mostly
    assert abs(errors.bias) < 0.003
    for flipped in (texels[::-1], texels[:, ::-1]):
        PIL.Image.fromarray(flipped).save(tmp_path / "texels.png")
        other = reference(frame, Assets(None), 16)
        assert compare(other, theirs, np.zeros_like(theirs)).relative_rmse > 0.2


def test_images_are_aligned_to_the_pixel():
    """The bunny from the side: edges within a twentieth of a pixel, and nothing mirrored."""
    pytest.importorskip("mitsuba", reason="mitsuba is not installed")
    bunny = {
        "mesh": "sample:bunny",
        "material": "m",
        "transform": {"rotate_y": 30, "rotate_z": 4, "scale": 1.1},
    }
    frame = scene("lambert", 80, 56, 16, {"ground": GROUND, "bunny": bunny})
    assets = Assets(None)
    theirs = render_with_mitsuba(frame, assets, 256)
    ours = reference(frame, assets, 32)
    right, down = image_shift(ours.sum(axis=-1), theirs.sum(axis=-1))
    assert abs(right) < 0.05
    assert abs(down) < 0.05
    errors = compare(ours.reshape(-1, 3), theirs.reshape(-1, 3), np.zeros((ours[..., 0].size, 3)))
    assert errors.relative_rmse < 0.04  # noise of 256 independent samples, mostly
    assert abs(errors.bias) < 0.003
    for flipped in (ours[::-1], ours[:, ::-1]):
        assert compare(flipped, theirs, np.zeros_like(theirs)).relative_rmse > 0.2


def test_a_shift_is_found_to_a_fraction_of_a_pixel():
    y, x = np.mgrid[:60, :80].astype(float)

    def blob(dx, dy):
        return np.exp(-((x - 40 - dx) ** 2 + (y - 25 - dy) ** 2) / 50)

    assert image_shift(blob(0.3, -0.2), blob(0, 0)) == pytest.approx((0.3, -0.2), abs=0.01)


def test_surfaces_that_do_not_occlude_are_refused(ball_scene):
    pytest.importorskip("mitsuba", reason="mitsuba is not installed")
    ball = {"mesh": str(ball_scene.parent / "ball.ply"), "material": "m", "occludes": False}
    with pytest.raises(CoslobeError, match=r"objects\.ball: Mitsuba has no surfaces that do not occlude"):
        render_with_mitsuba(scene("lambert", 4, 4, 1, {"ball": ball}), Assets(None), 1)


def test_a_missing_mitsuba_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mitsuba", None)
    with pytest.raises(CoslobeError, match="Mitsuba"):
        render_with_mitsuba(scene("lambert", 4, 4, 1, {"ground": GROUND}), Assets(None), 1)


def test_ply_files_hold_the_transformed_mesh(ball_scene, tmp_path):
    mesh = load_mesh(ball_scene.parent / "ball.ply")
    matrix = np.array([[0, 0, 2.0, 1], [0, 2.0, 0, 2], [-2.0, 0, 0, 3], [0, 0, 0, 1]])
    write_ply(tmp_path / "moved.ply", mesh, matrix)
    moved = load_mesh(tmp_path / "moved.ply")
    # float32 in the file
    np.testing.assert_allclose(moved.vertices, mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-6)
    np.testing.assert_allclose(moved.normals, mesh.normals @ matrix[:3, :3].T / 2, atol=1e-6)
    np.testing.assert_array_equal(moved.faces, mesh.faces)
