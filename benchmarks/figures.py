"""Errors on the scenes of the paper's figures: the sections of docs/accuracy.md that `accuracy.py` adds.

Run alone, it prints them: `python benchmarks/figures.py`.
"""

import numpy as np
from numpy.typing import NDArray

from coslobe import configs
from coslobe.core.device import Device, select
from coslobe.evaluate.direct import Estimate, direct_light
from coslobe.evaluate.errors import compare, without_noise
from coslobe.evaluate.lobe_sums import integrate_lobe_sums
from coslobe.evaluate.occlusion import mesh_occluders, sphere_occluders
from coslobe.evaluate.sampling import strata
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.gbuffer import GBuffer, trace_gbuffer
from coslobe.render.methods import create_method
from coslobe.render.scene import Scene, load_scene
from coslobe.tables import store

CONTACT = 0.02  # receivers nearer to a mesh than this are in contact with it
UNIT = ("shading.paper.light_lobes=unit", "shading.paper.products=l2")
SMALL = {"fig13": (256, 192), "fig15": (128, 128), "fig17": (128, 128), "fig18": (160, 120)}
SAMPLES = 1024


def percent(value: float | None) -> str:
    """Two significant digits."""
    return "-" if value is None else f"{100 * value:.2g} %"


class Bench:
    """Scenes, points and pictures on one device."""

    def __init__(self, device: Device) -> None:
        self.assets = Assets(device)
        self._method = create_method("cosine_lobes", device)

    def scene(self, figure: str, frame: int = 0, overrides: tuple[str, ...] = ()) -> Scene:
        """A figure's scene at the size that is measured here."""
        size = () if figure not in SMALL else tuple(
            f"image.{side}={n}" for side, n in zip(("width", "height"), SMALL[figure], strict=True)
        )  # fmt: skip
        return load_scene(configs.path(figure), (*size, *overrides)).at(frame)

    def picture(self, scene: Scene, gbuffer: GBuffer, layers: tuple[str, ...] = ()) -> tuple[NDArray, dict]:
        """Radiance of the points, and layers."""
        shading = self._method.shade(scene, gbuffer, world_blockers(scene, self.assets), layers)
        return shading.radiance.astype(np.float64), shading.layers

    def points(self, scene: Scene) -> GBuffer:
        """What the camera sees."""
        return trace_gbuffer(scene, self.assets)

    def same_spheres(self, scene: Scene, gbuffer: GBuffer, samples: int = SAMPLES) -> Estimate:
        """The reference with the same spheres."""
        return direct_light(scene, gbuffer, sphere_occluders(scene, self.assets), strata(samples), (0,))


def by_estimator(scene: Scene, estimator: str, threshold: float = 0.0) -> Scene:
    """The scene with another estimator."""
    shading = scene.shading.model_copy(update={"estimator": estimator, "threshold": threshold})
    return scene.model_copy(update={"shading": shading})


def figure_15(bench: Bench) -> list[str]:
    """Rows: estimator; mean absolute difference over mean, maximum over maximum."""
    rows = []

    def row(name: str, found: NDArray, expected: NDArray) -> None:
        difference = np.abs(found - expected)
        mean, most = difference.mean() / expected.mean(), difference.max() / expected.max()
        rows.append(f"| {name} | {percent(mean)} | {percent(most)} |")
        print(rows[-1], flush=True)

    scene = bench.scene("fig15")
    gbuffer = bench.points(scene)
    some = gbuffer.some(np.arange(0, len(gbuffer.position), 8))
    tables = store.cached()
    for name, overrides in (("L2 products, amplitude 1", UNIT), ("energy-conserving", ())):
        of_scene = bench.scene("fig15", 0, overrides)
        sums = integrate_lobe_sums(of_scene, some, sphere_occluders(of_scene, bench.assets), tables)
        row(f"lobe sums integrated numerically, {name}", bench.picture(of_scene, some)[0], sums)
    truth = bench.same_spheres(scene, gbuffer, 4096).radiance
    for name, of_scene in (
        ("paper, amplitude 1 and L2", bench.scene("fig15", 0, UNIT)),
        ("paper, energy-conserving", scene),
        ("accurate", by_estimator(scene, "accurate")),
    ):
        row(f"same spheres, path traced: {name}", bench.picture(of_scene, gbuffer)[0], truth)
    return rows


def figures_13_17_18(bench: Bench) -> list[str]:
    """Rows: figure; relative RMSE of both estimators against the same spheres, noise taken off; umbra."""
    rows = []
    for figure, frame, label in (
        ("fig13", 0, "13"),
        ("fig17", 0, "17 (a)"),
        ("fig17", 1, "17 (b)"),
        ("fig17", 2, "17 (c)"),
        ("fig18", 0, "18"),
    ):
        scene = bench.scene(figure, frame)
        gbuffer = bench.points(scene)
        truth = bench.same_spheres(scene, gbuffer)
        dark = ~truth.radiance.any(axis=1)
        cells = [label]
        brightest = 0.0
        for estimator in ("paper", "accurate"):
            image = bench.picture(by_estimator(scene, estimator), gbuffer)[0]
            found = compare(image, truth.radiance, truth.variance)
            assert found.relative_rmse is not None
            assert found.noise is not None
            cells += [percent(without_noise(found.relative_rmse, found.noise))]
            lit = image[dark].max(initial=0.0) / truth.radiance.mean()
            brightest = max(brightest, float(lit))
        rows.append("| " + " | ".join([*cells, f"{dark.sum():,}", percent(brightest)]) + " |")
        print(rows[-1], flush=True)
    return rows


def figure_13_mesh(bench: Bench) -> list[str]:
    """Rows: part of the picture; relative RMSE and bias of `accurate` against the true meshes."""
    import open3d

    scene = bench.scene("fig13")
    gbuffer = bench.points(scene)
    truth = direct_light(scene, gbuffer, mesh_occluders(scene, bench.assets), strata(SAMPLES), (0,))
    image = bench.picture(scene, gbuffer)[0]
    meshes = open3d.t.geometry.RaycastingScene()
    names = list(scene.objects)
    for obj in scene.objects.values():
        if obj.occludes:
            mesh, matrix = bench.assets.mesh(obj), obj.transform.matrix()
            placed = (mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)
            tensor = open3d.core.Tensor.from_numpy
            meshes.add_triangles(tensor(placed), tensor(mesh.faces.astype(np.uint32)))
    positions = open3d.core.Tensor.from_numpy(gbuffer.position.astype(np.float32))
    away = meshes.compute_distance(positions).numpy() > CONTACT
    ground = gbuffer.object == names.index("ground")
    bunny = gbuffer.object == names.index("bunny")
    parts = {
        "whole picture": np.ones(len(ground), bool),
        "ground": ground,
        f"ground farther than {CONTACT} from the meshes": ground & away,
        "objects": ~ground,
        "bunny": bunny,
    }
    rows = []
    for name, chosen in parts.items():
        found = compare(image[chosen], truth.radiance[chosen], truth.variance[chosen])
        # Relative to the mean of the whole picture, as the eye takes it; parts have means of their own.
        assert found.relative_rmse is not None
        rows.append(f"| {name} | {percent(found.relative_rmse)} | {percent(found.bias)} |")
        print(rows[-1], flush=True)
    return rows


def temporal(bench: Bench) -> list[str]:
    """Rows: RMS of the change of the error from frame to frame, over the mean; its part that is noise."""
    file = load_scene(configs.path("bunny"), ("image.width=64", "image.height=64", "sequence.frames=60"))
    changes, noise, mean = [], [], []
    before = None
    for frame in range(60):
        scene = file.at(0)
        center = file.at(12).lights["key"].sphere.center
        start = scene.lights["key"].sphere
        t = frame / 59
        moved = tuple((1 - t) * a + t * b for a, b in zip(start.center, center, strict=True))
        light = scene.lights["key"].model_copy(update={"sphere": start.model_copy(update={"center": moved})})
        scene = scene.model_copy(update={"lights": {"key": light}})
        gbuffer = bench.points(scene)
        truth = bench.same_spheres(scene, gbuffer)
        error = bench.picture(scene, gbuffer)[0] - truth.radiance
        mean.append(truth.radiance.mean())
        if before is not None:
            changes.append(np.mean((error - before[0]) ** 2))
            noise.append(np.mean(truth.variance + before[1]))
        before = error, truth.variance
    scale = float(np.mean(mean))
    total, noisy = np.sqrt(np.mean(changes)) / scale, np.sqrt(np.mean(noise)) / scale
    row = f"| {percent(total)} | {percent(noisy)} | {percent(without_noise(total, noisy))} |"
    print(row, flush=True)
    return [row]


def figure_16(bench: Bench) -> list[str]:
    """Rows: frame; products per point at t_i = 0 and 0.001, share saved, mean change."""
    rows = []
    for frame in (0, 1):
        scene = bench.scene("fig16", frame)
        gbuffer = bench.points(scene)
        images, products = [], []
        for threshold in (0.0, 0.001):
            image, layers = bench.picture(by_estimator(scene, "paper", threshold), gbuffer, ("products",))
            images.append(image)
            products.append(float(layers["products"].mean()))
        change = np.abs(images[1] - images[0]).mean() / images[0].mean()
        saved = 1 - products[1] / products[0]
        rows.append(
            f"| {frame} | {products[0]:.1f} | {products[1]:.1f} | {percent(saved)} | {percent(change)} |"
        )
        print(rows[-1], flush=True)
    return rows


def sections(device: Device) -> list[str]:
    """Markdown lines."""
    bench = Bench(device)
    return [
        "## Fig. 15: the paper's own comparison",
        "",
        "The paper holds its products against numerical integration of the same lobe sums and finds a mean",
        "difference of 3.04 % of the mean and a largest of 7.8 % of the maximum.",
        "",
        "| against | mean difference / mean | largest / maximum |",
        "|---|---|---|",
        *figure_15(bench),
        "",
        "## Figs 13, 17 and 18: both estimators against the same spheres",
        "",
        "Relative RMSE without the reference's noise. *Umbra*: points that no sample of the reference finds",
        "lit, and the brightest of them in our pictures, in units of the picture's mean.",
        "",
        "| figure | paper | accurate | umbra | brightest there |",
        "|---|---|---|---|---|",
        *figures_13_17_18(bench),
        "",
        "## Fig. 13 against the true meshes, 256 spheres each",
        "",
        "| part | relative RMSE | bias |",
        "|---|---|---|",
        *figure_13_mesh(bench),
        "",
        "## A light that moves, 60 frames",
        "",
        "RMS of what changes in the error from one frame to the next, over the mean.",
        "",
        "| change | reference's noise | rest |",
        "|---|---|---|",
        *temporal(bench),
        "",
        "## Fig. 16: what a threshold saves",
        "",
        "| frame | products per point, t_i = 0 | t_i = 0.001 | saved | mean change |",
        "|---|---|---|---|---|",
        *figure_16(bench),
        "",
    ]


if __name__ == "__main__":
    print("\n".join(sections(Device(select()))))
