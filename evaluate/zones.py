"""Where a picture is lit, in penumbra, or in umbra: by the share of its light that the true meshes leave."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.occlusion import Occluders, light_spheres, mesh_occluders
from coslobe.evaluate.sampling import Strata

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Scene

ZONES = ("lit", "penumbra", "umbra")

ROUNDING = 1e-9  # of a share: both sums see the same directions, so nothing else can differ


def irradiance_share(
    scene: "Scene",
    gbuffer: "GBuffer",
    assets: "Assets",
    grid: Strata,
    seed: tuple[int, ...],
    progress: Progress = SILENT,
    name: str = "zones",
) -> NDArray:
    """Irradiance over what it would be without any occluder: float64 [n], 0 where no light could arrive.

    All lights and colours together. Both are path-traced in the same directions, so that a point that
    nothing shadows has exactly 1.
    """
    from coslobe.render.scene import Material

    white = Material.model_validate({"lambert": {"albedo": 1}})
    nothing = Occluders(light_spheres(scene)[np.empty(0, int)])
    scene = scene.model_copy(update={"materials": dict.fromkeys(scene.materials, white)})
    arriving, unblocked = (
        direct_light(scene, gbuffer, occluders, grid, seed, progress, name).radiance.sum(axis=1)
        for occluders in (mesh_occluders(scene, assets), nothing)
    )
    return np.divide(arriving, unblocked, out=np.zeros_like(arriving), where=unblocked > 0)


def zones(share: NDArray, hit: NDArray) -> dict[str, NDArray]:
    """The pixels of each of `ZONES`, bool [h, w], from shares [h, w] and the pixels that show a surface.

    A pixel whose samples lie in different zones is in penumbra.
    """
    lit, dark = share >= 1 - ROUNDING, share <= ROUNDING
    return dict(zip(ZONES, (hit & lit, hit & ~lit & ~dark, hit & dark), strict=True))
