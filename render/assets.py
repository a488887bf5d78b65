"""Meshes and sphere sets in memory, each loaded or fitted once, and the blockers of a frame in the world."""

import hashlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import NoDevice
from coslobe.core.files import sha256
from coslobe.core.progress import SILENT, Progress
from coslobe.render.fields import Source
from coslobe.render.plane import plane_mesh
from coslobe.render.raycaster import RayCaster
from coslobe.render.scene import Material, Object, Scene
from coslobe.render.surface import vertex_tangents
from coslobe.render.textures import read_texels
from coslobe.spheresets.files import mismatch, read_spheres
from coslobe.spheresets.fit import cache_file, cached_spheres
from coslobe.spheresets.mesh import Mesh, load_mesh
from coslobe.spheresets.model import SphereSet

if TYPE_CHECKING:
    from collections.abc import Callable

    from coslobe.core.device import Device


class Assets:
    """The files that scenes refer to. Everything is in the object's own coordinates.

    Parameters
    ----------
    device : Device or None
        Where spheres are fitted; not needed where all sphere sets are read from files.
    progress : Progress
        Hears of fits, and of sphere files that belong to another mesh.

    Attributes
    ----------
    inputs : dict
        SHA-256 by path of every file that `contents` has looked at.
    """

    def __init__(self, device: "Device | None", progress: Progress = SILENT) -> None:
        self._device = device
        self._progress = progress
        self._made: dict[Any, Any] = {}
        self._lock = RLock()
        self.inputs: dict[str, str] = {}

    def mesh(self, obj: Object) -> Mesh:
        """The object's triangles; a plane is its grid, two triangles per cell.

        Raises
        ------
        InvalidInput
            The mesh file cannot be used.
        """
        if obj.plane is not None:
            return self._once(("plane", obj.plane), partial(plane_mesh, obj.plane))
        assert obj.mesh is not None
        return self._once(("mesh", obj.mesh), partial(self._load_mesh, obj.mesh))

    def raycaster(self, obj: Object) -> RayCaster:
        """The acceleration structure over `mesh(obj)`."""
        mesh = self.mesh(obj)
        return self._once(("raycaster", mesh.file, mesh.sha256), lambda: RayCaster(mesh.vertices, mesh.faces))

    def spheres(self, obj: Object) -> SphereSet:
        """The finest level of a mesh object's sphere set, read or fitted (and cached) as the object says.

        Raises
        ------
        InvalidInput
            The sphere file or the mesh cannot be used.
        NoDevice
            The set has to be fitted and there is no device.
        """
        return self._once(("spheres", obj.mesh, obj.spheres), lambda: self._load_spheres(obj))

    def spheres_source(self, obj: Object) -> str:
        """Where the sphere set of a mesh comes from, in words: a file, the cache, or a fit to be made."""
        spheres = obj.spheres
        if spheres.file is not None:
            return f"read from {spheres.file}"
        assert self._device is not None
        cached = cache_file(self.mesh(obj), spheres.settings(), device=self._device)
        return f"{spheres.count}, {'cached' if cached.is_file() else 'to be fitted'}"

    def contents(self, obj: Object) -> dict[str, Any]:
        """The keys of the object that name files, with the SHA-256 of what is in the files instead."""
        if obj.mesh is None:
            return {}
        mesh, spheres = self.mesh(obj), obj.spheres.model_dump()
        self.inputs[mesh.file] = mesh.sha256
        if file := obj.spheres.file:
            spheres["file"] = self._file_hash(file)
        return {"mesh": self.mesh_hash(obj), "spheres": spheres}

    def material_contents(self, material: Material) -> dict[str, Any]:
        """The material as plain data, with the SHA-256 of its pictures in the place of their paths."""
        if material.lafortune is not None and material.lafortune.fit is not None:
            self._file_hash(material.lafortune.fit)  # its numbers are in the material already
        return self._with_hashes(material.model_dump(mode="json"))

    def _with_hashes(self, data: Any) -> Any:
        if isinstance(data, list):
            return [self._with_hashes(item) for item in data]
        if not isinstance(data, dict):
            return data
        if "texture" in data:
            return data | {"texture": self._file_hash(data["texture"])}
        return {key: self._with_hashes(value) for key, value in data.items()}

    def _file_hash(self, file: str) -> str:
        """SHA-256 of a file, which becomes one of the `inputs`."""
        self.inputs[file] = self._once(("hash", file), lambda: sha256(Path(file)))
        return self.inputs[file]

    def texels(self, source: Source) -> NDArray:
        """The picture of a texture, as `read_texels` gives it.

        Raises
        ------
        InvalidInput
            The picture cannot be used.
        """
        return self._once(source, lambda: read_texels(Path(source.file), colour=source.colour))

    def tangents(self, obj: Object) -> NDArray:
        """The direction of growing u at the vertices of `mesh(obj)`."""
        mesh = self.mesh(obj)
        return self._once(("tangents", mesh.file, mesh.sha256), lambda: vertex_tangents(mesh))

    def mesh_hash(self, obj: Object) -> str:
        """SHA-256 of the mesh's arrays; the file's own would miss what glTF files refer to."""
        mesh = self.mesh(obj)
        return self._once(("hash", mesh.file), lambda: _arrays_hash(mesh))

    def _load_mesh(self, file: str) -> Mesh:
        mesh = load_mesh(file)
        if mesh.defects:
            self._progress.say(f"{file}: {', '.join(mesh.defects)}")
        return mesh

    def _load_spheres(self, obj: Object) -> SphereSet:
        mesh, spheres = self.mesh(obj), obj.spheres
        if spheres.file is not None:
            tree = read_spheres(spheres.file)
            if warning := mismatch(tree, mesh):
                self._progress.say(f"{spheres.file}: {warning}")
            return tree.finest
        if self._device is None:
            raise NoDevice(f"{mesh.file}: fitting spheres needs an OpenCL device")
        tree = cached_spheres(mesh, spheres.settings(), device=self._device, progress=self._progress)
        return tree.finest

    def _once(self, key: Any, make: "Callable[[], Any]") -> Any:
        with self._lock:  # frames are traced on another thread than they are shaded
            if key not in self._made:
                self._made[key] = make()
            return self._made[key]


def _arrays_hash(mesh: Mesh) -> str:
    digest = hashlib.sha256()
    for array in (mesh.vertices, mesh.faces, mesh.normals, mesh.uv):
        digest.update(b"" if array is None else array.tobytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Blockers:
    """The spheres that block light in one frame, in world units.

    Attributes
    ----------
    centers : float64 [n, 3]
    radii : float64 [n]
    outside : float64 [n]
        Largest distance of each sphere outside its mesh.
    owner : int32 [n]
        Index of the sphere's object in the order of the scene file.
    """

    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    outside: NDArray[np.float64]
    owner: NDArray[np.int32]


def world_blockers(scene: Scene, assets: Assets) -> Blockers:
    """The spheres of all visible, occluding meshes of `scene`, placed in the world. Errors as in `Assets`."""
    parts = [Blockers(np.empty((0, 3)), np.empty(0), np.empty(0), np.empty(0, np.int32))]
    for index, obj in enumerate(scene.objects.values()):
        if not (obj.visible and obj.occludes):
            continue
        spheres, matrix, scale = assets.spheres(obj), obj.transform.matrix(), obj.transform.scale
        centers = spheres.centers @ matrix[:3, :3].T + matrix[:3, 3]
        owner = np.full(len(centers), index, np.int32)
        parts.append(Blockers(centers, spheres.radii * scale, spheres.outside * scale, owner))
    return Blockers(
        np.concatenate([part.centers for part in parts]),
        np.concatenate([part.radii for part in parts]),
        np.concatenate([part.outside for part in parts]),
        np.concatenate([part.owner for part in parts]),
    )
