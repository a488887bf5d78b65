"""The same scene in Mitsuba 3: an independent renderer for camera, units, BRDFs and light.

Mitsuba is optional (`pip install coslobe[mitsuba]`). What it cannot express is refused: meshes that do
not occlude, anisotropic materials, and textures other than a plain albedo. Planes occlude in Mitsuba, in
coslobe they never do: a scene is comparable when no plane stands between a light and a point. Mitsuba
averages over random positions in each pixel where coslobe takes the centre or `image.samples` positions:
edges differ unless there are many.
"""

import json
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import CoslobeError
from coslobe.render.fields import Texture

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.scene import Material, Object, Scene, SphereLight
    from coslobe.spheresets.mesh import Mesh

LOBE_SUM = "coslobe_lobe_sum"


def render_with_mitsuba(
    scene: "Scene", assets: "Assets", samples: int, *, seed: int = 0, variant: str = "scalar_rgb"
) -> NDArray:
    """Direct light by Mitsuba's `direct` integrator, one light sample per camera sample: float64 [h, w, 3].

    The variant `llvm_ad_rgb` is ten times faster, but an unsuitable libLLVM ends the process: 15 does,
    19 works.

    Raises
    ------
    CoslobeError
        Mitsuba is not installed, or cannot express the scene.
    """
    mitsuba = load_mitsuba(variant)
    with tempfile.TemporaryDirectory(prefix="coslobe-mitsuba-") as folder:
        loaded = mitsuba.load_dict(mitsuba_scene(mitsuba, scene, assets, samples, Path(folder)))
        image = mitsuba.render(loaded, spp=samples, seed=seed)
        return np.array(image, dtype=np.float64).reshape(scene.image.height, scene.image.width, 3)


def load_mitsuba(variant: str) -> Any:
    """The module `mitsuba` in one variant, with coslobe's BSDF.

    Raises
    ------
    CoslobeError
        Mitsuba is not installed, or the variant does not load.
    """
    try:
        import mitsuba

        mitsuba.set_variant(variant)
    except ImportError as error:
        raise CoslobeError(
            f"Mitsuba ({variant}) cannot be loaded ({error})", "pip install 'coslobe[mitsuba]'"
        ) from error
    _register_lobe_sum(mitsuba)
    return mitsuba


def mitsuba_scene(
    mitsuba: Any, scene: "Scene", assets: "Assets", samples: int, folder: Path
) -> dict[str, Any]:
    """The scene as a dictionary for `mitsuba.load_dict`; meshes are written as PLY files into `folder`.

    Transforms are Mitsuba's own objects, made by the module `mitsuba`, whose variant must be set.
    """
    look_at = scene.camera.look_at
    result: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0, "hide_emitters": True},
        "sensor": {
            "type": "perspective",
            "fov": scene.camera.fov,
            "fov_axis": scene.camera.fov_axis,
            "near_clip": 1e-4,
            "far_clip": 1e6,
            "to_world": mitsuba.ScalarTransform4f().look_at(
                list(look_at.origin), list(look_at.target), list(look_at.up)
            ),
            "film": {
                "type": "hdrfilm",
                "width": scene.image.width,
                "height": scene.image.height,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": "independent", "sample_count": samples},
        },
    }
    for name, light in scene.lights.items():
        result[f"light {name}"] = _emitter(light.sphere)
    for name, obj in scene.objects.items():
        if obj.visible:
            shape = _shape(mitsuba, name, obj, assets, folder)
            result[f"object {name}"] = {**shape, "bsdf": _bsdf(mitsuba, scene.materials[obj.material])}
    return result


def _emitter(sphere: "SphereLight") -> dict[str, Any]:
    emission = _rgb(tuple(sphere.emission()))
    if sphere.radius == 0:
        return {"type": "point", "position": list(sphere.center), "intensity": emission}
    emitter = {"type": "area", "radiance": emission}
    return {"type": "sphere", "center": list(sphere.center), "radius": sphere.radius, "emitter": emitter}


def _shape(mitsuba: Any, name: str, obj: "Object", assets: "Assets", folder: Path) -> dict[str, Any]:
    matrix = obj.transform.matrix()
    if obj.plane is not None:
        half = obj.plane.size / 2
        # Mitsuba's rectangle spans x and y in [-1, 1]; here it lies in x and z.
        square = np.array([[half, 0, 0, 0], [0, 0, 1, 0], [0, -half, 0, 0], [0, 0, 0, 1]])
        return {"type": "rectangle", "to_world": mitsuba.ScalarTransform4f(matrix @ square)}
    if not obj.occludes:
        raise CoslobeError(
            f"objects.{name}: Mitsuba has no surfaces that do not occlude", "leave out `occludes: false`"
        )
    path = folder / f"{name}.ply"
    write_ply(path, assets.mesh(obj), matrix)
    return {"type": "ply", "filename": str(path), "face_normals": obj.normals == "flat"}


def write_ply(path: Path, mesh: "Mesh", matrix: NDArray) -> None:
    """A binary PLY file of a mesh with its normals, transformed by `matrix` [4, 4]."""
    linear = matrix[:3, :3]
    normals = mesh.normals @ np.linalg.inv(linear)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    vertices = mesh.vertices @ linear.T + matrix[:3, 3]
    faces = np.empty(len(mesh.faces), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"], faces["corners"] = 3, mesh.faces
    properties = "".join(f"property float {axis}\n" for axis in ("x", "y", "z", "nx", "ny", "nz"))
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{properties}"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    data = np.hstack([vertices, normals]).astype("<f4")
    path.write_bytes(header.encode() + data.tobytes() + faces.tobytes())


def _bsdf(mitsuba: Any, material: "Material") -> dict[str, Any]:
    albedo = material.lambert.albedo if material.lambert else None
    if isinstance(albedo, Texture) and (albedo.scale, albedo.offset) == (1, 0):
        v_up = mitsuba.ScalarTransform4f().scale([1, -1, 1])  # in Mitsuba's pictures v runs down
        reflectance = {"type": "bitmap", "filename": albedo.texture, "to_uv": v_up}
        one_sided: dict[str, Any] = {"type": "diffuse", "reflectance": reflectance}
    elif material.pictures or material.anisotropic:
        raise CoslobeError(
            "Mitsuba is given no textures but plain albedos, and no anisotropic materials", "leave them out"
        )
    elif albedo is not None and not isinstance(albedo, Texture):
        one_sided = {"type": "diffuse", "reflectance": _rgb(albedo)}
    else:
        one_sided = {"type": LOBE_SUM, "terms": json.dumps(_terms(material))}
    return {"type": "twosided", "bsdf": one_sided}


def _terms(material: Any) -> list[dict[str, Any]]:
    """colour max(c_x v_x l_x + c_y v_y l_y + c_z v_z l_z, 0)^exponent, with the cosine or without."""
    mirror = (-1.0, -1.0, 1.0)

    def term(colour: Any, factor: float, c: Any = mirror, exponent: Any = 0.0, *, cosine: bool = True) -> Any:
        return {"colour": [factor * part for part in colour], "c": c, "exponent": exponent, "cosine": cosine}

    constant = (0.0, 0.0, 1.0)  # v_z l_z to the power of 0
    if material.phong is not None:
        phong, n = material.phong, material.phong.exponent
        return [term(phong.kd, 1 / np.pi, constant), term(phong.ks, (n + 2) / (2 * np.pi), mirror, n)]
    if material.phong_1975 is not None:
        old = material.phong_1975
        return [term(old.kd, 1.0, constant), term(old.ks, 1.0, mirror, old.exponent, cosine=False)]
    assert material.lafortune is not None
    lobes = material.lafortune.lobes
    return [
        term(material.lafortune.kd, 1 / np.pi, constant),
        *(term(lobe.rho, 1.0, lobe.c, lobe.exponent) for lobe in lobes),
    ]


def _register_lobe_sum(mitsuba: Any) -> None:
    """Mitsuba 3 has no cosine lobes of its own: this is a BSDF of them for its plugin interface, `eval` only.

    In Mitsuba's shading frame, whose z is the normal. Its `direct` integrator samples emitters only, so that
    nothing is sampled here.
    """
    import drjit

    class LobeSum(mitsuba.BSDF):
        def __init__(self, properties: Any) -> None:
            mitsuba.BSDF.__init__(self, properties)
            self.terms = json.loads(properties["terms"])
            self.m_flags = mitsuba.BSDFFlags.GlossyReflection | mitsuba.BSDFFlags.FrontSide
            self.m_components = [self.m_flags]

        def eval(self, context: Any, interaction: Any, light: Any, active: Any = True) -> Any:
            view, value = interaction.wi, mitsuba.Color3f(0)
            for term in self.terms:
                x, y, z = term["c"]
                cosine = drjit.maximum(x * view.x * light.x + y * view.y * light.y + z * view.z * light.z, 0)
                lobe = drjit.power(cosine, term["exponent"])
                value += mitsuba.Color3f(term["colour"]) * (lobe * light.z if term["cosine"] else lobe)
            return drjit.select(active & (view.z > 0) & (light.z > 0), value, mitsuba.Color3f(0))

        def pdf(self, context: Any, interaction: Any, light: Any, active: Any = True) -> Any:
            return mitsuba.Float(0)

        def eval_pdf(self, context: Any, interaction: Any, light: Any, active: Any = True) -> Any:
            return self.eval(context, interaction, light, active), mitsuba.Float(0)

        def traverse(self, callback: Any) -> None:
            pass

    mitsuba.register_bsdf(LOBE_SUM, LobeSum)


def _rgb(colour: tuple[float, ...]) -> dict[str, Any]:
    return {"type": "rgb", "value": list(colour)}


def image_shift(image: NDArray, reference: NDArray) -> tuple[float, float]:
    """By how many pixels (right, down) `image` [h, w] is displaced against `reference`, for small shifts.

    Least squares over all inner pixels of the first-order expansion (Lucas and Kanade 1981).
    """
    mean = (image + reference) / 2
    down, right = np.gradient(mean, axis=0), np.gradient(mean, axis=1)
    inner = (slice(1, -1), slice(1, -1))
    gradient = np.stack([right[inner].ravel(), down[inner].ravel()], axis=-1)
    difference = (reference - image)[inner].ravel()
    right_by, down_by = np.linalg.lstsq(gradient, difference, rcond=None)[0].tolist()
    return right_by, down_by
