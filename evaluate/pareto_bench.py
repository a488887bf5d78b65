"""What renderers have in common that are compared: scenes in several materials, and their points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe import configs
from coslobe.core.errors import CoslobeError
from coslobe.evaluate.embree_front import Embree
from coslobe.render.assets import Assets
from coslobe.render.gbuffer import GBuffer, trace_gbuffer
from coslobe.render.plan import select_frames
from coslobe.render.scene import Scene, load_scene

MATERIALS = {
    "lambert": (),
    "phong 50": ("materials.ground={phong: {kd: 0.3, ks: 0.4, exponent: 50}}",),
    "phong 1000": ("materials.ground={phong: {kd: 0.3, ks: 0.4, exponent: 1000}}",),
}
"""Of the ground in the scene that is taken where none is given."""

KNOWN_POINTS = 1 << 16  # errors are means over this many points, picked at random
KNOWN_SPHERES = 1 << 13  # and those against the same spheres over fewer

CONTACT = 0.02
"""Points nearer to a mesh than this part of its longest side are in contact with it."""


@dataclass(frozen=True)
class Bench:
    """What all renderers share.

    Attributes
    ----------
    path, overrides : Path, tuple of str
        The scene file, and changes to it.
    materials : dict
        Further changes, by the name of a material.
    frame : int
    ground_only : bool
        Meshes are hidden from the camera.
    assets : Assets
    gbuffer : GBuffer
        The points.
    known, few : int [m], int [k]
        Those whose errors are measured, and those of them that are also held against the same spheres.
    apart : bool [m]
        Those of them that are not in contact with a mesh.
    """

    path: Path
    overrides: tuple[str, ...]
    materials: Mapping[str, tuple[str, ...]]
    frame: int
    ground_only: bool
    assets: Assets
    gbuffer: GBuffer
    known: NDArray
    few: NDArray
    apart: NDArray

    def scene(self, material: str, count: int | None = None) -> Scene:
        """With one of the materials, and so many spheres for every mesh whose set is not read from a file."""
        return scene_at(self.path, (*self.overrides, *self.materials[material]), self.frame, count)


def set_up(path: Path | None, overrides: tuple[str, ...], frames: str | None, assets: Assets) -> Bench:
    """The points of a scene file's first frame of `frames`; without a file, of the plane under a bunny.

    Raises
    ------
    CoslobeError
        The scene shows no surface or has no light, or a file cannot be used.
    """
    ground_only = path is None
    materials = MATERIALS if path is None else {"scene": ()}
    path = path or configs.path("pareto")
    frame = select_frames(frames, load_scene(path, overrides).frames)[0]
    scene = scene_at(path, overrides, frame)
    gbuffer = trace_gbuffer(_without_meshes(scene) if ground_only else scene, assets)
    n = len(gbuffer.position)
    if n == 0 or not scene.lights:
        raise CoslobeError(
            f"{path}: frame {frame} shows no surface or has no light", "choose another --frames"
        )
    chosen = np.random.default_rng(0).permutation(n)
    known, few = np.sort(chosen[:KNOWN_POINTS]), np.sort(chosen[:KNOWN_SPHERES])
    meshes = [obj for obj in scene.objects.values() if obj.visible and obj.occludes and obj.mesh is not None]
    longest = max(
        (np.ptp(assets.mesh(obj).vertices, axis=0).max() * obj.transform.scale for obj in meshes), default=0.0
    )
    apart = np.ones(len(known), bool)
    if meshes:
        apart = Embree(scene, assets).distance(gbuffer.position[known]) > CONTACT * longest
    return Bench(path, overrides, materials, frame, ground_only, assets, gbuffer, known, few, apart)


def _without_meshes(scene: Scene) -> Scene:
    hidden = {
        name: obj if obj.plane is not None else obj.model_copy(update={"visible": False})
        for name, obj in scene.objects.items()
    }
    return scene.model_copy(update={"objects": hidden})


def scene_at(path: Path, overrides: Sequence[str], frame: int, count: int | None = None) -> Scene:
    """One frame of a scene file, one sample per pixel, `count` spheres for every mesh whose set is fitted."""
    one_sample = "image.samples=1"  # points, not pixels, are compared
    scene = load_scene(path, (*overrides, one_sample)).at(frame)
    if count is None:
        return scene
    counts = tuple(f"objects.{name}.spheres.count={count}" for name in fitted(scene))
    return load_scene(path, (*overrides, one_sample, *counts)).at(frame)


def fitted(scene: Scene) -> list[str]:
    """Objects that block light by spheres that are fitted."""
    return [
        name
        for name, obj in scene.objects.items()
        if obj.occludes and obj.mesh is not None and obj.spheres.file is None
    ]
