"""The same scene in Mitsuba 3: camera, units, BRDF normalisation, light."""

import os
import subprocess
import sys

import numpy as np
import PIL.Image
import pytest
import trimesh

from coslobe.core.errors import CoslobeError
from coslobe.evaluate.crosscheck import (
    acceptance,
    estimate_with_mitsuba,
    image_shift,
    render_with_mitsuba,
    write_ply,
    z_scores,
)
from coslobe.evaluate.direct import direct_light, direct_sources
from coslobe.evaluate.errors import compare
from coslobe.evaluate.integration import Estimate, integrate, uniform
from coslobe.evaluate.mitsuba_export import export_frames
from coslobe.evaluate.occlusion import mesh_occluders, sphere_occluders
from coslobe.evaluate.paths import BouncedLight
from coslobe.evaluate.sampling import strata
from coslobe.render.assets import Assets
from coslobe.render.camera import camera_rays
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.scene import Scene, load_scene
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
    [("lambert", "x"), ("phong", "x"), ("phong", "y"), ("phong_1975", "x")],
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


def same_rays(frame: Scene, assets: Assets, samples: int, *, bounces=1, occluders="mesh") -> Estimate:
    """Our estimate for every camera ray, in the order of the rays; one sample per pixel."""
    gbuffer = trace_gbuffer(frame, assets)
    blockers = {"mesh": mesh_occluders, "spheres": sphere_occluders}[occluders](frame, assets)
    sources = [*direct_sources(frame, gbuffer, blockers)]
    if bounces > 1:
        sources.append(BouncedLight(frame, assets, gbuffer, blockers, bounces))
    choice = uniform(strata(samples), len(sources), len(gbuffer.position))
    found, _ = integrate(sources, gbuffer.material, choice, (0,), "test")
    order = camera_rays(frame).pixel
    image = np.zeros((2, len(order), 3))
    image[:, gbuffer.pixel] = found.radiance, found.variance
    return Estimate(*image[:, order])


BUNNY = {
    "mesh": "sample:bunny",
    "material": "m",
    "transform": {"rotate_y": 30, "rotate_z": 4, "scale": 1.1, "translate": [0, 0.1, 0]},
}


@pytest.mark.parametrize(
    ("material", "bounces", "samples"),
    [("lambert", 1, 128), ("phong", 1, 96), ("lafortune", 1, 64), ("lambert", 3, 192)],
)
def test_every_pixel_is_that_of_mitsuba(material, bounces, samples):
    """Meshes and a plane, by z-tests along the same rays; what differs in truth is one pixel at most.

    That is a pixel of an edge that single precision puts on the other side.
    """
    pytest.importorskip("mitsuba", reason="mitsuba is not installed")
    frame = scene(material, 20, 15, 1, {"ground": GROUND, "bunny": BUNNY})
    assets = Assets(None)
    ours = same_rays(frame, assets, 256, bounces=bounces)
    theirs = estimate_with_mitsuba(frame, assets, samples, bounces=bounces)
    assert acceptance(z_scores(ours, theirs)) >= 0.995
    # and the test has teeth: a light that is brighter by 5 %, or points in another order, are noticed
    brighter = Estimate(1.05 * ours.radiance, ours.variance)
    right, wrong = (np.clip(z_scores(found, theirs), -5, 5) for found in (ours, brighter))
    assert np.mean(wrong**2) > 1.3 * np.mean(right**2)
    mirrored = Estimate(ours.radiance[::-1], ours.variance[::-1])
    assert acceptance(z_scores(mirrored, theirs)) < 0.9


@pytest.mark.parametrize("kind", ["lafortune", "phong"])
def test_every_pixel_beside_a_textured_ground_is_that_of_mitsuba(tmp_path, kind):
    """Scaled textures of colours and numbers, on a plane and beside a mesh with flat normals."""
    pytest.importorskip("mitsuba", reason="mitsuba is not installed")
    texels = np.random.default_rng(0).integers(0, 256, (8, 12, 3), dtype=np.uint8)
    PIL.Image.fromarray(texels).save(tmp_path / "texels.png")
    trimesh.creation.box((0.6, 0.5, 0.4)).export(tmp_path / "box.ply")
    texture = {"texture": str(tmp_path / "texels.png")}
    lobe = {"rho": {**texture, "scale": 0.9}, "c": [-1, -1, 0.9]}
    lobe["exponent"] = {**texture, "scale": 30, "offset": 3}
    lafortune = {"kd": {**texture, "scale": 0.5, "offset": 0.1}, "lobes": [lobe]}
    ground = {"plane": {"size": 6.0}, "material": "m"}
    box = {"mesh": str(tmp_path / "box.ply"), "material": "n", "normals": "flat"}
    box["transform"] = {"rotate_y": 30, "rotate_z": 4, "translate": [0, 0.6, 0]}
    phong = {"kd": {**texture, "scale": 0.4}, "ks": 0.5, "exponent": {**texture, "scale": 20, "offset": 2}}
    ground_of = {"lafortune": {"lafortune": lafortune}, "phong": {"phong": phong}}
    materials = {"m": ground_of[kind], "n": MATERIALS["phong"]}
    frame = scene("", 20, 15, 1, {"ground": ground, "box": box}, materials=materials)
    assets = Assets(None)
    theirs = estimate_with_mitsuba(frame, assets, 64)
    assert acceptance(z_scores(same_rays(frame, assets, 256), theirs)) >= 0.995


def test_every_pixel_under_analytic_spheres_is_that_of_mitsuba(ball_scene):
    """From under two balls only the ground is seen: meshes are not, and spheres do the shading."""
    pytest.importorskip("mitsuba", reason="mitsuba is not installed")
    pair = ["objects.ball.mesh=pair.ply", "objects.ball.spheres.file=pair.spheres.json"]
    camera = ["camera.look_at.origin=[0.02, 0.03, 0.0]", "camera.look_at.target=[0, 0, 0]", "camera.fov=170"]
    size = [
        "image.width=24",
        "image.height=24",
        "objects.ball.transform.translate=[0, 0.5, 0]",
        "animation=[]",
    ]
    frame = load_scene(ball_scene, [*pair, *camera, *size]).at(0)
    assets = Assets(None)
    theirs = estimate_with_mitsuba(frame, assets, 256, occluders="spheres")
    ours = same_rays(frame, assets, 256, occluders="spheres")
    assert np.mean(ours.variance.sum(axis=1) > 0) > 0.1  # penumbra
    assert acceptance(z_scores(ours, theirs)) >= 0.995
    lit = same_rays(frame.model_copy(update={"objects": {"ground": frame.objects["ground"]}}), assets, 256)
    assert acceptance(z_scores(lit, theirs)) < 0.9


def test_exported_scenes_render_on_their_own(ball_scene, tmp_path):
    """Without coslobe, from another folder; the picture is that of the dictionary."""
    mitsuba = pytest.importorskip("mitsuba", reason="mitsuba is not installed")
    scene_file = load_scene(ball_scene, ["camera.fov=41"])
    assets = Assets(None)
    (path,) = export_frames(scene_file, tmp_path / "mitsuba", frames=[1], assets=assets, samples=16)
    assert path == tmp_path / "mitsuba" / "0001" / "scene.xml"
    script = path.parent / "render.py"
    assert "coslobe." not in script.read_text()
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-I", str(script)], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert (path.parent / "scene.png").is_file()
    picture = np.array(mitsuba.Bitmap(str(path.parent / "scene.exr")), np.float64)[..., :3]
    ours = render_with_mitsuba(scene_file.at(1), assets, 64)
    assert picture.mean() == pytest.approx(ours.mean(), rel=0.02)
    errors = compare(picture.reshape(-1, 3), ours.reshape(-1, 3), np.zeros((ours[..., 0].size, 3)))
    assert errors.relative_rmse < 0.3  # noise of 16 samples


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
