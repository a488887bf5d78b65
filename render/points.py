"""Points to be shaded as the kernel reads them: from a G-buffer, or made on the device from what rays hit."""

from importlib.resources import files
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device, Launch
from coslobe.render import layout
from coslobe.render.camera import half_extent, sample_pattern
from coslobe.render.gbuffer import GBuffer
from coslobe.render.hits import Layer
from coslobe.render.mask import turns
from coslobe.render.scene import Object
from coslobe.render.visible import Visible
from coslobe.spheresets.mesh import Mesh


class PointBuffers:
    """Points on one device. What did not change stays there: points, what single objects show, meshes."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._kept: WeakKeyDictionary[Any, tuple[NDArray, Any, NDArray]] = WeakKeyDictionary()
        self._inputs: WeakKeyDictionary[Any, list[Any]] = WeakKeyDictionary()
        self._kernels: dict[str, Any] = {}
        self._alive: list[Any] = []  # arguments of launches: a kernel keeps its last ones only

    def build(self, points: GBuffer | Visible) -> None:
        """Build the program that such points need, where it is not built yet."""
        from pyopencl import Kernel

        if isinstance(points, Visible) and self._device.has_doubles and not self._kernels:
            source = (files("coslobe.render.kernels") / "visible.cl").read_text()
            program = self._device.build([("layout", layout.point_rows()), ("visible.cl", source)], {})
            names = ("points_on_plane", "points_on_mesh")
            self._kernels = {name: Kernel(program, name) for name in names}

    def upload(self, points: GBuffer | Visible, material: NDArray) -> tuple[Any, NDArray, list[Launch]]:
        """A buffer of `layout.POINT_ROWS`, the origin [3] of its positions, and the launches that fill it.

        `material` is the index of each point's struct, int32 [n].
        """
        known = self._kept.get(points)
        if known is not None and np.array_equal(known[0], material):
            return known[1], known[2], []
        self.build(points)
        launches: list[Launch] = []
        if isinstance(points, GBuffer):
            origin = middle(points)
            buffer = self._device.upload(pack_points(points, material, origin))
        elif self._kernels:
            origin = points.origin
            buffer, launches = self._computed(points, material)
        else:
            origin = points.origin
            buffer = self._device.upload(pack_points(points.gbuffer, material, origin))
        self._kept[points] = (material, buffer, origin)
        return buffer, origin, launches

    def _computed(self, points: Visible, material: NDArray) -> tuple[Any, list[Launch]]:
        """The points made on the device, one launch per object."""
        device, hits, image = self._device, points.hits, points.scene.image
        stride = layout.padded(len(points))
        buffer = device.allocate(len(layout.POINT_ROWS) * stride * 4)
        number = np.zeros(1, np.int32)
        if not points.complete:
            number = np.cumsum(hits.object >= 0, dtype=np.int32) - np.int32(1)
        objects, numbers, camera, materials = (
            device.upload(array) for array in (hits.object, number, _camera(points), material)
        )
        width = image.width
        (pixels,) = self._once(hits.rays, lambda rays: [rays.pixel // width << 16 | rays.pixel % width])
        launches, self._alive = [], []
        for index, obj in enumerate(points.scene.objects.values()):
            layer = hits.layers.get(index)
            if layer is None or len(layer.ray) == 0:
                continue
            ray, *found = self._once(layer, _layer_arrays)
            scalars = (points.complete, index, image.samples)
            arguments = [np.int32(len(layer.ray)), ray, pixels, objects, numbers]
            arguments += [*(np.int32(value) for value in scalars), camera, materials, buffer]
            arguments += [np.int32(len(points)), np.int32(stride)]
            if obj.mesh is None:
                arguments += [_normal(obj, hits.rays.origin), *found]
            else:
                mesh = self._once(points.assets.mesh(obj), _mesh_arrays)
                arguments += [device.upload(_placing(obj, points.origin)), *found, *mesh]
                arguments += [np.int32(obj.normals == "flat")]
            kernel = self._kernels["points_on_plane" if obj.mesh is None else "points_on_mesh"]
            n_items = -(-len(layer.ray) // layout.WORK_GROUP) * layout.WORK_GROUP
            launches.append(device.launch(kernel, n_items, layout.WORK_GROUP, *arguments))
            self._alive.append(arguments)
        return buffer, launches

    def _once(self, thing: Any, arrays: Any) -> list[Any]:
        """The arrays of something that never changes, on the device as long as it lives."""
        if thing not in self._inputs:
            self._inputs[thing] = [self._device.upload(array) for array in arrays(thing)]
        return self._inputs[thing]


def _layer_arrays(layer: Layer) -> list[NDArray]:
    if layer.triangle is None or layer.uv is None:
        return [layer.ray, layer.t]
    return [layer.ray, layer.triangle, layer.uv]


def _mesh_arrays(mesh: Mesh) -> list[NDArray]:
    return [mesh.faces, mesh.vertices, mesh.normals]


def _camera(points: Visible) -> NDArray:
    """The camera as visible.cl reads it, with its origin relative to the points'."""
    camera, image, rays = points.scene.camera, points.scene.image, points.hits.rays
    wide, high = half_extent(camera.fov, camera.fov_axis, image.width, image.height)
    right, up, forward = rays.frame
    vectors = [
        2 * wide / image.width * right,
        -2 * high / image.height * up,
        forward - wide * right + high * up,
    ]
    return np.concatenate([*vectors, rays.origin - points.origin, sample_pattern(image.samples).ravel()])


def _normal(plane: Object, eye: NDArray) -> NDArray:
    """Its unit normal on the side of `eye`, float32 [4]."""
    matrix = plane.transform.matrix()
    normal = np.linalg.inv(matrix[:3, :3])[1]
    normal /= np.linalg.norm(normal) * (1 if normal @ (eye - matrix[:3, 3]) >= 0 else -1)
    return np.append(normal, 0).astype(np.float32)


def _placing(obj: Object, origin: NDArray) -> NDArray:
    """The object's matrix by rows of four, relative to `origin`, and the inverse of its linear part."""
    matrix = obj.transform.matrix()
    matrix[:3, 3] -= origin
    return np.concatenate([matrix[:3].ravel(), np.linalg.inv(matrix[:3, :3]).ravel()])


def middle(gbuffer: GBuffer) -> NDArray:
    """The median of the positions [3], so that float32 serves scenes far from the origin."""
    every = -(-len(gbuffer) // 4096)  # a few thousand of them tell as much
    return np.median(gbuffer.position[::every], axis=0)


def pack_points(gbuffer: GBuffer, material: NDArray, origin: NDArray) -> NDArray[np.float32]:
    """Rows `layout.POINT_ROWS` of 4-byte numbers, padded: the twin of kernels/visible.cl."""
    n = len(gbuffer)
    packed = np.empty((len(layout.POINT_ROWS), layout.padded(n)), np.float32)
    packed[:3, :n] = (gbuffer.position - origin).T
    packed[3:6, :n] = gbuffer.geometric_normal.T
    packed[6:9, :n] = gbuffer.shading_normal.T
    packed[9, :n] = turns(gbuffer.pixel, gbuffer.width)
    packed[10:].view(np.int32)[:, :n] = material, gbuffer.object
    packed[:, n:] = packed[:, n - 1 : n]
    return packed
