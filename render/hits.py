"""The nearest surface behind every ray, object by object; what did not move is not traced again."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.render.camera import KEPT_BANDS, Part, Rays, bands, camera_rays, turned
from coslobe.render.raycaster import near_rays

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.scene import Object, Scene


@dataclass(frozen=True, eq=False)
class Layer:
    """What the rays hit of one object, as if it were alone.

    Attributes
    ----------
    ray : int32 [m]
        Increasing.
    t : float64 [m]
        Distance from the camera's origin.
    triangle : int32 [m] or None
        Of the mesh; a plane has none: its points follow from t.
    uv : float32 [m, 2] or None
        Barycentric, of the triangle's second and third corner.
    """

    ray: NDArray
    t: NDArray
    triangle: NDArray | None = None
    uv: NDArray | None = None


@dataclass(frozen=True, eq=False)
class Hits:
    """The nearest surface behind each of n rays.

    Attributes
    ----------
    rays : Rays
    layers : dict
        Of the objects that can be seen, by index in the order of the scene file.
    object : int32 [n]
        Index of the nearest object; -1 where nothing is hit.
    t : float64 [n]
        Distance along the ray; inf where nothing is hit.
    """

    rays: Rays
    layers: dict[int, Layer]
    object: NDArray
    t: NDArray

    def of(self, index: int) -> NDArray:
        """Which entries of an object's layer are the nearest hits of their rays."""
        return np.flatnonzero(self.object[self.layers[index].ray] == index)


class Tracer:
    """Traces the objects of scene after scene, and keeps what it found until a ray or the object moves."""

    def __init__(self, assets: "Assets") -> None:
        self._assets = assets
        self._kept: dict[Part, tuple[tuple, dict[tuple, Layer]]] = {}

    def hits(self, scene: "Scene", part: Part) -> Hits:
        """What the rays of `part` of the picture hit. Each object is traced in its own frame.

        So meshes need one acceleration structure for all frames and instances.
        """
        rays = camera_rays(scene, part)
        view = (scene.camera, scene.image)
        seen, known = self._kept.get(part, (view, {}))
        if seen != view:
            known = {}
        layers, found = {}, {}
        for index, obj in enumerate(scene.objects.values()):
            if obj.visible:
                key = (obj.plane, obj.mesh, obj.transform)
                layers[index] = found[key] = known[key] if key in known else self._trace(obj, rays)
        if len(bands(scene.image)) <= KEPT_BANDS:
            self._kept[part] = (view, found)
        return nearest(rays, layers)

    def _trace(self, obj: "Object", rays: Rays) -> Layer:
        trace = _hit_mesh if obj.plane is None else _hit_plane
        return trace(obj, self._assets, rays)


def nearest(rays: Rays, layers: dict[int, Layer]) -> Hits:
    """The nearest of the objects behind each ray; of several at one distance the first."""
    t = np.full(len(rays.pixel), np.inf)
    objects = np.full(len(t), -1, np.int32)
    for index, layer in layers.items():
        if len(layer.ray) == len(t):  # as of a ground that fills the picture
            objects[layer.t < t] = index
            np.minimum(t, layer.t, out=t)
        else:
            nearer = np.flatnonzero(layer.t < t[layer.ray])
            ray = layer.ray[nearer]
            t[ray] = layer.t[nearer]
            objects[ray] = index
    return Hits(rays, layers, objects, t)


def _hit_plane(obj: "Object", assets: "Assets", rays: Rays) -> Layer:
    """The square y = 0 of the object's frame, intersected in closed form."""
    assert obj.plane is not None
    matrix = obj.transform.matrix()
    inverse = np.linalg.inv(matrix[:3, :3])
    origin = inverse @ (rays.origin - matrix[:3, 3])
    x, y, z = turned(inverse @ rays.frame.T, rays.local)
    half = obj.plane.size / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -origin[1] / y
        inside = (t > 0) & (np.abs(origin[0] + t * x) <= half) & (np.abs(origin[2] + t * z) <= half)
    ray = np.flatnonzero(inside).astype(np.int32)
    return Layer(ray, t[ray])


def _hit_mesh(obj: "Object", assets: "Assets", rays: Rays) -> Layer:
    """A triangle mesh, intersected by Embree in the object's frame."""
    caster = assets.raycaster(obj)
    matrix, scale = obj.transform.matrix(), obj.transform.scale
    candidates = near_rays(caster.hull, matrix, rays)
    inverse = np.linalg.inv(matrix[:3, :3])
    origin = inverse @ (rays.origin - matrix[:3, 3])
    local = rays.local if len(candidates) == len(rays.pixel) else np.take(rays.local, candidates, axis=1)
    t, triangle, uv = caster.nearest(origin, turned(scale * inverse @ rays.frame.T, local))
    hit = np.flatnonzero(np.isfinite(t))
    return Layer(candidates[hit].astype(np.int32), t[hit] * scale, triangle[hit], uv[hit])
