"""Errors on the scenes of the paper's figures: the sections of docs/accuracy.md that `accuracy.py` adds.

Run alone, it prints them: `python benchmarks/figures.py`.
"""

import numpy as np

from coslobe import configs
from coslobe.core.device import Device, select
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.errors import compare, without_noise
from coslobe.evaluate.occlusion import mesh_occluders
from coslobe.evaluate.paper_figures.bench import Bench, by_estimator
from coslobe.evaluate.paper_figures.lobe_sums import UNIT, Difference, difference, measure_lobe_sums
from coslobe.evaluate.paper_figures.thresholds import measure_savings
from coslobe.evaluate.sampling import strata
from coslobe.render.scene import Scene, load_scene

CONTACT = 0.02  # receivers nearer to a mesh than this are in contact with it
SMALL = {"fig13": (256, 192), "fig15": (128, 128), "fig17": (128, 128), "fig18": (160, 120)}
SAMPLES = 1024


def percent(value: float | None) -> str:
    """Two significant digits."""
    return "-" if value is None else f"{100 * value:.2g} %"


def small(bench: Bench, figure: str, frame: int = 0, overrides: tuple[str, ...] = ()) -> Scene:
    """A figure's scene at the size that is measured here."""
    width, height = SMALL[figure]
    return bench.scene(figure, frame, (f"image.width={width}", f"image.height={height}", *overrides))


def figure_15(bench: Bench) -> list[str]:
    """Rows: estimator; mean absolute difference over mean, maximum over maximum."""
    rows = []

    def row(name: str, found: Difference) -> None:
        rows.append(f"| {name} | {percent(found.mean)} | {percent(found.largest)} |")
        print(rows[-1], flush=True)

    scene = small(bench, "fig15")
    gbuffer = bench.points(scene)
    some = gbuffer.some(np.arange(0, len(gbuffer), 8))
    for name, overrides in (("L2 products, amplitude 1", UNIT), ("energy-conserving", ())):
        row(
            f"lobe sums integrated numerically, {name}",
            measure_lobe_sums(bench, overrides, some).difference,
        )
    truth = bench.same_spheres(scene, gbuffer, 4096).radiance
    for name, of_scene in (
        ("paper, amplitude 1 and L2", small(bench, "fig15", 0, UNIT)),
        ("paper, energy-conserving", scene),
        ("accurate", by_estimator(scene, "accurate")),
    ):
        row(f"same spheres, path traced: {name}", difference(bench.picture(of_scene, gbuffer)[0], truth))
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
        scene = small(bench, figure, frame)
        gbuffer = bench.points(scene)
        truth = bench.same_spheres(scene, gbuffer, SAMPLES)
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

    scene = small(bench, "fig13")
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
        truth = bench.same_spheres(scene, gbuffer, SAMPLES)
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
        found = measure_savings(bench, frame)
        none, some = (products.mean() for products in found.products)
        rows.append(
            f"| {frame} | {none:.1f} | {some:.1f} | {percent(found.saved)} | {percent(found.change)} |"
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
