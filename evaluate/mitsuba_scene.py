"""The same scene for Mitsuba 3, as a dictionary.

What Mitsuba cannot express is refused: meshes that do not occlude, and anisotropic materials. Planes occlude
in Mitsuba, in coslobe they never do: a scene is comparable when no plane stands between a light and a point.
"""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import CoslobeError
from coslobe.evaluate.mitsuba_lobes import PLUGIN
from coslobe.render.assets import world_blockers
from coslobe.render.fields import Texture
from coslobe.render.images import write_exr

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.scene import Material, Object, Scene, SphereLight
    from coslobe.spheresets.mesh import Mesh

Description = dict[str, Any]
"""What `mitsuba.load_dict` takes, but with NumPy matrices [4, 4] and `LookAt` in the place of transforms."""


@dataclass(frozen=True)
class LookAt:
    """A camera's place, by Mitsuba's own convention."""

    origin: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float]


def describe(
    scene: "Scene",
    assets: "Assets",
    folder: Path,
    *,
    samples: int,
    integrator: Description,
    occluders: Literal["mesh", "spheres"] = "mesh",
) -> Description:
    """The scene; meshes and textures are written into `folder`.

    With the occluders `spheres`, the spheres of the sphere sets stand in the place of the meshes, as analytic
    spheres, and are seen: comparable are then the pixels that show a plane in both.

    Raises
    ------
    CoslobeError
        Mitsuba cannot express the scene.
    """
    look_at = scene.camera.look_at
    film = {
        "type": "hdrfilm",
        "width": scene.image.width,
        "height": scene.image.height,
        "rfilter": {"type": "box"},
        "pixel_format": "rgb",
        "component_format": "float32",
    }
    result: Description = {
        "type": "scene",
        "integrator": integrator,
        "sensor": {
            "type": "perspective",
            "fov": scene.camera.fov,
            "fov_axis": scene.camera.fov_axis,
            "near_clip": 1e-4,
            "far_clip": 1e6,
            "to_world": LookAt(look_at.origin, look_at.target, look_at.up),
            "film": film,
            "sampler": {"type": "independent", "sample_count": samples},
        },
    }
    for name, light in scene.lights.items():
        result[f"light {name}"] = _emitter(light.sphere)
    blockers = world_blockers(scene, assets) if occluders == "spheres" else None
    for index, (name, obj) in enumerate(scene.objects.items()):
        if not obj.visible:
            continue
        bsdf = {"bsdf": _bsdf(f"materials.{obj.material}", scene.materials[obj.material], assets, folder)}
        if blockers is None or obj.plane is not None:
            result[f"object {name}"] = _shape(name, obj, assets, folder) | bsdf
            continue
        for k in np.flatnonzero(blockers.owner == index):
            center, radius = blockers.centers[k].tolist(), float(blockers.radii[k])
            result[f"object {name} {k}"] = {"type": "sphere", "center": center, "radius": radius} | bsdf
    return result


def direct_integrator() -> Description:
    """Light samples only."""
    return {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0, "hide_emitters": True}


def path_integrator(bounces: int) -> Description:
    """Directions of lights and of BSDFs, up to `bounces` surfaces, without Russian roulette."""
    return {"type": "path", "max_depth": bounces + 1, "rr_depth": 1_000_000, "hide_emitters": True}


def _emitter(sphere: "SphereLight") -> Description:
    emission = _rgb(tuple(sphere.emission()))
    if sphere.radius == 0:
        return {"type": "point", "position": list(sphere.center), "intensity": emission}
    emitter = {"type": "area", "radiance": emission}
    black = {"type": "diffuse", "reflectance": _rgb((0.0, 0.0, 0.0))}
    place = {"center": list(sphere.center), "radius": sphere.radius}
    return {"type": "sphere", **place, "emitter": emitter, "bsdf": black}


def _shape(name: str, obj: "Object", assets: "Assets", folder: Path) -> Description:
    matrix = obj.transform.matrix()
    if obj.plane is not None:
        half = obj.plane.size / 2
        # Mitsuba's rectangle spans x and y in [-1, 1]; here it lies in x and z.
        square = np.array([[half, 0, 0, 0], [0, 0, 1, 0], [0, -half, 0, 0], [0, 0, 0, 1]])
        return {"type": "rectangle", "to_world": matrix @ square}
    if not obj.occludes:
        raise CoslobeError(
            f"objects.{name}: Mitsuba has no surfaces that do not occlude", "leave out `occludes: false`"
        )
    path = folder / f"{name}.ply"
    write_ply(path, assets.mesh(obj), matrix)
    return {"type": "ply", "filename": path, "face_normals": obj.normals == "flat"}


def write_ply(path: Path, mesh: "Mesh", matrix: NDArray) -> None:
    """A binary PLY file of a mesh, its normals and texture coordinates, transformed by `matrix` [4, 4]."""
    linear = matrix[:3, :3]
    normals = mesh.normals @ np.linalg.inv(linear)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    vertices = mesh.vertices @ linear.T + matrix[:3, 3]
    faces = np.empty(len(mesh.faces), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"], faces["corners"] = 3, mesh.faces
    names, columns = ["x", "y", "z", "nx", "ny", "nz"], [vertices, normals]
    if mesh.uv is not None:
        names, columns = [*names, "u", "v"], [*columns, mesh.uv]
    properties = "".join(f"property float {name}\n" for name in names)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{properties}"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    data = np.hstack(columns).astype("<f4")
    path.write_bytes(header.encode() + data.tobytes() + faces.tobytes())


def _bsdf(name: str, material: "Material", assets: "Assets", folder: Path) -> Description:
    if material.anisotropic:
        raise CoslobeError(
            f"{name}: anisotropic, which the BSDF that is given to Mitsuba is not",
            "leave it out or set c_x = c_y",
        )
    albedo = material.lambert.albedo if material.lambert else None
    if isinstance(albedo, Texture) and (albedo.scale, albedo.offset) == (1, 0):
        picture = folder / f"{name}{Path(albedo.texture).suffix}".replace(" ", "_")
        shutil.copyfile(albedo.texture, picture)
        reflectance = _bitmap(picture)
        one_sided: Description = {"type": "diffuse", "reflectance": reflectance}
    elif albedo is not None and not isinstance(albedo, Texture):
        one_sided = {"type": "diffuse", "reflectance": _rgb(albedo)}
    else:
        textures: Description = {}

        def plain(value: Any) -> Any:
            """The value itself, or the name of a texture that holds offset + scale * texel."""
            if not isinstance(value, Texture):
                return value
            key = f"texture_{len(textures)}"
            texels = value.offset + value.scale * assets.texels(value.source)
            colours = texels if texels.ndim == 3 else np.repeat(texels[..., None], 3, axis=-1)
            path = folder / f"{name} {key}.exr".replace(" ", "_")
            write_exr(path, {"beauty": colours}, {})
            textures[key] = _bitmap(path) | {"raw": True}
            return key

        terms = _terms(material, plain)
        one_sided = {"type": PLUGIN, "terms": json.dumps(terms), **textures}
    return {"type": "twosided", "bsdf": one_sided}


def _bitmap(path: Path) -> Description:
    return {"type": "bitmap", "filename": path, "to_uv": np.diag([1.0, -1.0, 1.0, 1.0])}  # v runs down there


def _terms(material: Any, plain: Any) -> list[Description]:
    """Terms of `mitsuba_lobes`; factors of colours are left to textures where these are, as 1."""
    mirror, constant = [-1.0, -1.0, 1.0], [0.0, 0.0, 1.0]  # v_z l_z to the power of 0

    def scaled(colour: Any, factor: float) -> Any:
        if isinstance(colour, Texture):
            update = {"scale": factor * colour.scale, "offset": factor * colour.offset}
            return plain(colour.model_copy(update=update))
        return [factor * part for part in colour]

    def term(
        colour: Any, c: Any, exponent: Any = 0.0, *, cosine: bool = True, normalised: bool = False
    ) -> Description:
        return {"colour": colour, "c": c, "exponent": exponent, "cosine": cosine, "normalised": normalised}

    if material.lambert is not None:
        return [term(scaled(material.lambert.albedo, 1 / np.pi), constant)]
    if material.phong is not None:
        phong = material.phong
        specular = term(scaled(phong.ks, 1.0), mirror, plain(phong.exponent), normalised=True)
        return [term(scaled(phong.kd, 1 / np.pi), constant), specular]
    if material.phong_1975 is not None:
        old = material.phong_1975
        specular = term(scaled(old.ks, 1.0), mirror, plain(old.exponent), cosine=False)
        return [term(scaled(old.kd, 1.0), constant), specular]
    assert material.lafortune is not None
    lobes = [
        term(scaled(lobe.rho, 1.0), [plain(part) for part in lobe.c], plain(lobe.exponent))
        for lobe in material.lafortune.lobes
    ]
    return [term(scaled(material.lafortune.kd, 1 / np.pi), constant), *lobes]


def _rgb(colour: tuple[float, ...]) -> Description:
    return {"type": "rgb", "value": list(colour)}


def for_mitsuba(mitsuba: Any, value: Any) -> Any:
    """A description as `mitsuba.load_dict` takes it; the variant must be set."""
    if isinstance(value, dict):
        return {key: for_mitsuba(mitsuba, part) for key, part in value.items()}
    if isinstance(value, LookAt):
        transform = mitsuba.ScalarTransform4f()
        return transform.look_at(list(value.origin), list(value.target), list(value.up))
    if isinstance(value, np.ndarray):
        return mitsuba.ScalarTransform4f(value)
    return str(value) if isinstance(value, Path) else value
