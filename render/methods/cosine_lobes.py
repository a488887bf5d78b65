"""The method of the product: sphere sets, bit masks and lobe integrals in one OpenCL kernel."""

import time
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.core.progress import SILENT, Progress
from coslobe.render import layout
from coslobe.render.assets import Blockers
from coslobe.render.gbuffer import GBuffer
from coslobe.render.groups import Groups, clusters, group
from coslobe.render.mask import ROUNDING, disk_tree
from coslobe.render.materials import pack_materials
from coslobe.render.methods.base import Shading
from coslobe.render.points import PointBuffers
from coslobe.render.scene import Mask, Paper, Scene
from coslobe.render.visible import Visible
from coslobe.tables import layout as tables_layout
from coslobe.tables import lobe_cap, store, weights
from coslobe.tables.quadtree import disk

# The program, in order of dependence; the estimator's units go before the last.
UNITS = (
    *(
        "stages.cl",
        "vector.cl",
        "points.cl",
        "elementary.cl",
        "lobe.cl",
        "lobe_cap.cl",
        "mask.cl",
        "leaves.cl",
    ),
    *("blockers.cl", "lists.cl", "lights.cl", "materials.cl", "wide.cl"),
)
ESTIMATORS = {
    "accurate": ("cells.cl", "accurate.cl"),
    "paper": ("cells.cl", "tables.cl", "products.cl", "paper.cl"),
}
KERNEL = "shade.cl"

# Half-angles beyond 60 degrees do not fit a plane; they are sampled by an equal-area map instead.
COS2_WIDE = 0.25
WIDE_RINGS = 32
WIDE_SECTORS = 64

# Up to this tangent of the light's half-angle, bit counts alone give the diffuse term, as if all cells
# weighed the same. Measured on the bunny's shadow: 0.08 % error instead of 0.07 % at h = 0.14; at 0.38 it
# would be 0.25 % instead of 0.11 %.
LARGEST_MOMENT_H = 0.2

# A lobe in penumbra has a mask of its own, of this many lobe widths around its axis, where that is smaller
# than the light's. A light that reaches into it by fewer cells is left to its own mask. A smaller window has
# finer cells, but less of the lobe: 2.5 widths leave 4 % of it out, 3 leave 1 %.
WINDOW = 3.0
FEWEST_CELLS = 16

# Up to this (e + 4) h^5, polynomials stand for a lobe along a mask's rows: 6e-5 of the lit share at worst.
SMOOTH_ROWS = 0.3

# A penumbra's lobe is not worth the light's cells where it adds less than this part of what a white diffuse
# surface would add under the same light: below, its shadow is left out.
NEGLIGIBLE_LOBE = 1e-4


def kernel_units(estimator: str) -> list[tuple[str, str]]:
    """(name, source) of the program: the shared structs, then the kernel files in order."""
    folder = files("coslobe.render.kernels")
    names = (*UNITS, *ESTIMATORS[estimator], KERNEL)
    return [("layout", layout.declarations())] + [(name, (folder / name).read_text()) for name in names]


def points_at_once(vector_width: int) -> int:
    """Points per work-item: as many as vectors have lanes, but one on GPUs, whose lanes are work-items."""
    return vector_width if vector_width > 4 else 1


def near_room(local_bytes: int) -> int:
    """Spheres that the lists of a work-group hold together on a device with so much local memory."""
    return layout.LARGE_NEAR_ROOM if local_bytes >= layout.LARGE_LOCAL_MEMORY else layout.NEAR_ROOM


def kernel_defines(
    vector_width: int,
    mask: Mask,
    max_lobes: int,
    *,
    anisotropic: bool = False,
    irradiance: bool = False,
    leaves: bool = False,
    work: bool = False,
    paper: Paper = Paper(),
    near_room: int = layout.NEAR_ROOM,
    stage: str = "FUSED",
) -> dict[str, int | float | str]:
    """Compile-time constants of one program variant; `stage` as in stages.cl."""
    rows = 2**mask.depth
    row_width = min(vector_width, rows)
    first, last = ROUNDING[mask.mode]
    return {
        "VW": vector_width,
        "ROWS": rows,
        "MASK_DEPTH": mask.depth,
        "RW": row_width,
        "PW": points_at_once(vector_width),
        "NEAR_ROOM": near_room,
        "NR": rows // row_width,
        "FIRST": f"({first}f)",
        "LAST": f"({last}f)",
        "DISK_CELLS": float(disk(rows).sum()),
        "MAX_LOBES": max_lobes,
        "ANISOTROPIC": int(anisotropic),
        "IRRADIANCE": int(irradiance),
        "LEAVES": int(leaves),
        "WORK": int(work),
        "STAGE": stage,
        "UNIT_LIGHTS": int(paper.light_lobes == "unit"),
        "L2_PRODUCTS": int(paper.products == "l2"),
        "CAPS": lobe_cap.CAPS,
        "ANGLES": lobe_cap.ANGLES,
        "SMALLEST_CAP": lobe_cap.SMALLEST_CAP,
        "INNER": lobe_cap.INNER,
        "OUTER": lobe_cap.OUTER,
        "CAPS_PER_LOG": float(lobe_cap.CAPS_PER_LOG),
        "COS2_WIDE": COS2_WIDE,
        "WIDE_RINGS": WIDE_RINGS,
        "WIDE_SECTORS": WIDE_SECTORS,
        "LARGEST_MOMENT_H": LARGEST_MOMENT_H,
        "NEGLIGIBLE_LOBE": NEGLIGIBLE_LOBE,
        "WINDOW": WINDOW,
        "SMOOTH_ROWS": SMOOTH_ROWS,
        "FEWEST_CELLS": float(FEWEST_CELLS),
        **tables_layout.defines(),
    }


class CosineLobes:
    """Shades G-buffers on one device; see `render.methods.base.Method`.

    A `stage` other than "FUSED" ends the work after a part of it, to be measured; see kernels/stages.cl.
    """

    def __init__(self, device: Device, progress: Progress = SILENT, stage: str = "FUSED") -> None:
        self._device = device
        self._progress = progress
        self._stage = stage
        self._tables: store.LobeTables | None = None
        self._slices: dict[tuple[float, ...], Any] = {}
        self._paper_tables: dict[int, list[Any]] = {}
        self._points = PointBuffers(device)
        self._kernels: dict[tuple[Any, ...], Any] = {}
        self._clusters: tuple[NDArray, NDArray] | None = None

    def prepare(self, scene: Scene) -> None:
        """Load the lobe tables where the scene needs them, building them on first use."""
        lobes = any(material.lambert is None for material in scene.materials.values())
        if lobes or scene.shading.estimator == "paper":
            self._lobe_tables()

    def shade(
        self, scene: Scene, gbuffer: GBuffer | Visible, blockers: Blockers, layers: Sequence[str] = ()
    ) -> Shading:
        """Direct light at every point, from every light, through every blocker."""
        n = len(gbuffer)
        if n == 0 or not scene.lights:
            return _unlit(n, len(scene.lights), layers)
        device = self._device
        packed = pack_materials(scene.materials, gbuffer)
        start = time.perf_counter()
        irradiance = "irradiance" in layers
        work_asked = "mask_leaves" in layers or "products" in layers
        defines = kernel_defines(
            device.info.vector_width,
            scene.shading.mask,
            packed.max_lobes,
            anisotropic=gbuffer.tangent is not None,
            irradiance=irradiance,
            leaves="mask_leaves" in layers,
            work=work_asked,
            paper=scene.shading.paper,
            near_room=near_room(device.local_bytes),
            stage=self._stage,
        )
        kernel = self._kernel(scene.shading.estimator, defines)
        self._points.build(gbuffer)
        build_seconds = time.perf_counter() - start

        points, origin, before = self._points.upload(gbuffer, packed.index)
        lights = _pack_lights(scene, origin)
        groups = self._groups(scene, blockers, origin)
        eye = np.asarray(scene.camera.look_at.origin, np.float64) - origin
        at_once = points_at_once(device.info.vector_width)
        room = layout.padded(n)
        n_groups = room // layout.WORK_GROUP
        radiance = device.allocate(room * 3 * 4)
        arriving = device.allocate(room * 3 * 4 if irradiance else 16)
        work = device.allocate(room * 2 * 4 if work_asked else 16)
        stats = device.allocate(n_groups * layout.STATS.itemsize)
        nothing = device.allocate(16)
        # The kernel object keeps references to buffers only while arguments are set, so they live here.
        spheres = [device.upload(row) for row in (*groups.spheres, groups.owner, *groups.bounds)]
        launch = device.launch(
            kernel,
            room // at_once,
            layout.WORK_GROUP // at_once,
            points,
            np.int32(n),
            nothing if gbuffer.tangent is None else device.upload(gbuffer.tangent.astype(np.float32)),
            *(np.float32(v) for v in eye),
            device.upload(layout.table(packed.materials)),
            np.int32(len(packed.materials)),
            device.upload(layout.table(packed.lobes)),
            np.int32(len(packed.lobes)),
            self._slice_buffer(packed.exponents),
            *self._paper_buffers(scene),
            device.upload(lights),
            np.int32(len(lights)),
            np.float32(scene.shading.threshold),
            *spheres,
            np.int32(groups.n_groups),
            device.upload(disk_tree(2**scene.shading.mask.depth)),
            device.local(2 * 4 * len(lights)),
            radiance,
            stats,
            arriving,
            work,
        )
        result = device.download(radiance, (n, 3), np.float32)
        counts = device.download(stats, (n_groups,), layout.STATS)
        found = {}
        if work_asked:
            found["products"], found["mask_leaves"] = device.download(work, (n, 2), np.uint32).T
        if irradiance:
            found["irradiance"] = device.download(arriving, (n, 3), np.float32)
        return Shading(
            result,
            sum(one.seconds for one in (*before, launch)),
            build_seconds,
            _summary(counts, n, len(lights), int(np.count_nonzero(groups.spheres[3] > 0))),
            {name: found[name] for name in layers},
        )

    def _kernel(self, estimator: str, defines: dict[str, Any]) -> Any:
        """The kernel of one program variant."""
        from pyopencl import Kernel

        key = (estimator, *defines.items())
        if key not in self._kernels:
            self._kernels[key] = Kernel(self._device.build(kernel_units(estimator), defines), "shade")
        return self._kernels[key]

    def _groups(self, scene: Scene, blockers: Blockers, origin: NDArray) -> Groups:
        """All blockers of the frame, the emitters too where there are several lights."""
        centers, radii = blockers.centers - origin, blockers.radii
        outside, owner = blockers.outside, blockers.owner
        if len(scene.lights) > 1:
            spheres = [light.sphere for light in scene.lights.values()]
            emitters = np.array([sphere.center for sphere in spheres], np.float64) - origin
            centers = np.concatenate([centers, emitters])
            radii = np.concatenate([radii, [sphere.radius for sphere in spheres]])
            outside = np.concatenate([outside, np.zeros(len(spheres))])
            owner = np.concatenate([owner, [layout.emitter_owner(j) for j in range(len(spheres))]])
        same = np.stack([owner, radii])  # where only positions differ, objects have moved as wholes
        if self._clusters is None or not np.array_equal(self._clusters[0], same):
            self._clusters = same, clusters(centers, owner)
        return group(self._clusters[1], centers, radii, outside, owner, self._device.info.vector_width)

    def _slice_buffer(self, exponents: NDArray) -> Any:
        """The lobe-over-cap table at the scene's exponents, on the device."""
        key = tuple(exponents)
        if key not in self._slices:
            if not key:
                self._slices[key] = self._device.allocate(16)
            else:
                self._slices = {key: self._device.upload(self._lobe_tables().lobe_cap.slice(exponents))}
        return self._slices[key]

    def _paper_buffers(self, scene: Scene) -> list[Any]:
        """Products, caps and the mask's weights on the device, which the paper's estimator reads."""
        if scene.shading.estimator != "paper":
            return [self._device.allocate(16)] * 3
        depth = scene.shading.mask.depth
        if depth not in self._paper_tables:
            samples = tables_layout.samples(self._lobe_tables())
            own = samples["weights"][weights.MASK_DEPTHS.index(depth)]
            # Rows of products are read in eights.
            arrays = (np.append(samples["product"], np.zeros(8, np.float32)), samples["cap"], own)
            self._paper_tables = {depth: [self._device.upload(array) for array in arrays]}
        return self._paper_tables[depth]

    def _lobe_tables(self) -> store.LobeTables:
        if self._tables is None:
            self._tables = store.cached(self._progress)
        return self._tables


def _unlit(n: int, lights: int, layers: Sequence[str]) -> Shading:
    """What there is to see without a point or without a light."""
    dark = {name: np.zeros((n, 3) if name == "irradiance" else n, np.float32) for name in layers}
    nothing = _summary(np.zeros(1, layout.STATS), n, lights, 0)
    return Shading(np.zeros((n, 3), np.float32), 0.0, 0.0, nothing, dark)


def _pack_lights(scene: Scene, origin: NDArray) -> NDArray:
    packed = np.empty(len(scene.lights), layout.LIGHT)
    for entry, light in zip(packed, scene.lights.values(), strict=True):
        entry["center"] = np.asarray(light.sphere.center, np.float64) - origin
        entry["radius"] = light.sphere.radius
        entry["radiance"] = light.sphere.emission()
    return packed


def _summary(counts: NDArray, n: int, n_lights: int, spheres: int) -> dict[str, Any]:
    """Shares of (point, light) pairs by what they needed, and the work per pair; of `spheres` with emitters.

    Tested are the spheres in the lists that points look through; the others were culled for whole tiles.
    """
    pairs = n * n_lights
    share = {name: float(counts[name].sum()) / max(pairs, 1) for name in counts.dtype.names or ()}
    tested = min(share["listed"], float(spheres))  # where there is no list, groups are looked through
    return {
        "pairs": pairs,
        "fully_lit": share["lit"],
        "penumbra": share["partial"],
        "fully_dark": share["dark"],
        "below_horizon": share["below"],
        "spheres": spheres,
        "spheres_tested_per_pair": tested,
        "spheres_culled_per_pair": spheres - tested,
        "spheres_splatted_per_pair": share["splats"],
        "products_per_pair": share["products"],
        "leaves_per_pair": share["leaves"],
    }
