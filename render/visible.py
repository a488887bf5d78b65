"""What a camera sees in frame after frame: the points to be shaded, computed as far as anybody asks."""

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coslobe.render.camera import KEPT_BANDS, Part, bands
from coslobe.render.fields import Source
from coslobe.render.gbuffer import GBuffer, corners, resolve
from coslobe.render.hits import Hits, Tracer
from coslobe.render.surface import surface

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.scene import Scene

THUMBNAIL = 32  # pixels along the longer side, from which the points' middle is taken


class Visible:
    """The shaded points of a part of a picture; samples that hit nothing are left out.

    The arrays of a `GBuffer` that only some frames need are computed when they are asked for; positions and
    normals for shading are computed on the device (see points.py).

    Attributes
    ----------
    hits : Hits
    ray : int32 [n]
        Of each point.
    object, material : int32 [n]
        Indices in the order of the scene file.
    origin : float64 [3]
        A place amid the picture's points, which positions can be related to.
    """

    def __init__(self, scene: "Scene", assets: "Assets", hits: Hits, origin: NDArray) -> None:
        self.scene, self.assets, self.hits, self.origin = scene, assets, hits, origin
        seen = np.flatnonzero(hits.object >= 0)
        self.complete = len(seen) == len(hits.object)  # every ray hits something
        self.ray = seen.astype(np.int32)
        self.object = hits.object if self.complete else hits.object[seen]
        names = list(scene.materials)
        of_object = np.array([names.index(obj.material) for obj in scene.objects.values()], np.int32)
        self.material = of_object[self.object] if len(of_object) else self.object

    def __len__(self) -> int:
        return len(self.ray)

    def on(self, index: int) -> tuple[NDArray, NDArray, NDArray]:
        """Which points lie on an object [m], their triangles [m] and the weights of the corners [m, 3]."""
        if index not in self.hits.layers:
            return np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, 3))
        layer, entries = self.hits.layers[index], self.hits.of(index)
        obj = list(self.scene.objects.values())[index]
        ray = layer.ray[entries]
        here = ray if self.complete else np.searchsorted(self.ray, ray)
        return here, *corners(obj, self.hits, layer, entries)

    @cached_property
    def gbuffer(self) -> GBuffer:
        """Everything that is known of the points, on the host; without texels and tangents."""
        return resolve(self.scene, self.assets, self.hits)

    @property
    def shading_normal(self) -> NDArray:
        """Unit vectors on the viewer's side, float64 [n, 3]."""
        return self.gbuffer.shading_normal

    @cached_property
    def _surface(self) -> tuple[dict[Source, NDArray], NDArray | None]:
        return surface(self, self.scene, self.assets)

    @property
    def texels(self) -> dict[Source, NDArray]:
        """As in `GBuffer`."""
        return self._surface[0]

    @property
    def tangent(self) -> NDArray | None:
        """As in `GBuffer`."""
        return self._surface[1]


class Viewer:
    """Finds the visible points of scene after scene; what did not move is not traced again."""

    def __init__(self, assets: "Assets") -> None:
        self._assets = assets
        self._tracer, self._thumbnails = Tracer(assets), Tracer(assets)
        self._kept: dict[Part, tuple[Any, Visible]] = {}

    def visible(self, scene: "Scene", part: Part) -> Visible:
        """The points of one part; the same object as long as nothing about them changes."""
        materials = [
            (name, one.pictures, one.anisotropic, one.tangent) for name, one in scene.materials.items()
        ]
        seen = (scene.camera, scene.image, scene.objects, materials)
        if part in self._kept and self._kept[part][0] == seen:
            return self._kept[part][1]
        hits = self._tracer.hits(scene, part)
        found = Visible(scene, self._assets, hits, self._middle(scene))
        if len(bands(scene.image)) <= KEPT_BANDS:
            self._kept[part] = (seen, found)
        return found

    def _middle(self, scene: "Scene") -> NDArray:
        """The middle of the picture's points, so that float32 serves scenes far from the origin.

        It is the median: a few points near the horizon of a large plane must not move it away from the rest.
        """
        longer = max(scene.image.width, scene.image.height)
        size = {
            side: max(THUMBNAIL * getattr(scene.image, side) // longer, 1) for side in ("width", "height")
        }
        image = scene.image.model_copy(update={**size, "samples": 1})
        small = scene.model_copy(update={"image": image})
        hits = self._thumbnails.hits(small, Part(0, image.width * image.height))
        seen = np.flatnonzero(hits.object >= 0)
        if len(seen) == 0:
            return hits.rays.origin
        return np.median(hits.rays.origin + hits.t[seen, None] * hits.rays.direction[seen], axis=0)
