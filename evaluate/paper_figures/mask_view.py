"""What one point sees of a light: the spheres before it, the mask's cells, its leaves and their lobes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate.lobe_sums import mask_at
from coslobe.evaluate.occlusion import sphere_occluders
from coslobe.evaluate.paper_figures.bench import Bench
from coslobe.render.assets import world_blockers
from coslobe.render.gbuffer import GBuffer
from coslobe.render.mask import covered_by_sphere
from coslobe.render.paper import Cap
from coslobe.render.scene import Scene
from coslobe.tables import lobe
from coslobe.tables.quadtree import cell_centres, disk, shadow_leaves
from coslobe.tables.store import LobeTables
from coslobe.tables.weights import leaf_lobes

SCENE = "fig15"


@dataclass(frozen=True)
class MaskView:
    """The first light of a scene from one point; lengths are in half sides of the mask's square.

    Attributes
    ----------
    cap : Cap
        The light.
    centers : float64 [n, 3]
        Of the blockers, in the mask's frame: along columns, along rows, towards the light; world units.
    radii : float64 [n]
    meets : bool [n]
        Which of them cover a cell of the light's disk.
    blocked : bool [rows, rows]
        The mask's cells.
    """

    cap: Cap
    centers: NDArray
    radii: NDArray
    meets: NDArray
    blocked: NDArray

    @property
    def leaves(self) -> list[NDArray]:
        """The shadow leaves per depth, from the root: bool [2^d, 2^d]."""
        return shadow_leaves(self.blocked)

    def covered(self, index: int, rows: int, scale: float = 1.0) -> NDArray:
        """Cells of a square of `scale` times the mask's size that a blocker covers: bool [rows, rows]."""
        tangent = self.cap.tangent * scale
        return covered_by_sphere(rows, tangent, self.centers[index], float(self.radii[index]))


def view_from(bench: Bench, scene: Scene, gbuffer: GBuffer, i: int) -> MaskView:
    """The mask of point `i` for the first light."""
    cap, blocked, axes = mask_at(scene, gbuffer, i, 0, sphere_occluders(scene, bench.assets))
    blockers = world_blockers(scene, bench.assets)
    centers = (blockers.centers - gbuffer.position[i]) @ np.stack([*axes, cap.axis]).T
    rows = len(blocked)
    inside = disk(rows)
    meets = np.array(
        [
            (covered_by_sphere(rows, cap.tangent, center, float(radius)) & inside).any()
            for center, radius in zip(centers, blockers.radii, strict=True)
        ]
    )
    return MaskView(cap, centers, blockers.radii, meets, blocked)


def busiest_view(bench: Bench) -> tuple[MaskView, NDArray]:
    """The mask with most leaves on the ground of Fig. 15's scene, and its point's position [3]."""
    scene = bench.scene(SCENE)
    gbuffer = bench.points(scene)
    leaves = bench.picture(scene, gbuffer, ("mask_leaves",))[1]["mask_leaves"]
    ground = gbuffer.object == list(scene.objects).index("ground")
    i = int(np.argmax(np.where(ground, leaves, 0)))
    return view_from(bench, scene, gbuffer, i), gbuffer.position[i]


def shadow_lobes(
    tables: LobeTables, leaves: list[NDArray], tangent: float, weights: NDArray, rows: int
) -> NDArray:
    """The sum of the lobes of `leaves` over the square: float64 [rows, rows].

    `weights` [depths] is what each depth's lobes are multiplied with; `tangent` is of the light's half-angle.
    """
    x = cell_centres(rows) * tangent
    vectors = np.stack(np.broadcast_arrays(x[None, :], x[:, None], 1.0), axis=-1)
    vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
    total = np.zeros((rows, rows))
    for depth, level in enumerate(leaves):
        lobes = leaf_lobes(tables.cap, tangent, depth)
        for axis, amplitude in zip(lobes.directions[level], lobes.amplitude[level], strict=True):
            away = ((vectors - axis) ** 2).sum(axis=-1) / 2
            total += weights[depth] * amplitude * lobe.evaluate(away, lobes.exponent)
    return total
