"""Figs 10, 13, 14, 17 and 18: rendered scenes and how fast they are."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.errors import compare, without_noise
from coslobe.evaluate.occlusion import mesh_occluders
from coslobe.evaluate.paper_figures.bench import Bench, by_estimator
from coslobe.evaluate.paper_figures.figure import PaperFigure, Quantity, Rebuilt
from coslobe.evaluate.sampling import strata
from coslobe.render.gbuffer import GBuffer
from coslobe.render.scene import Scene

SAMPLES = 256
ESTIMATORS = ("paper", "accurate")
THRESHOLD_17 = 0.001
RATE_14 = 13.73
RATES_17 = (15.9, 10.1, 4.75)
SECONDS_18 = 6.25
RATE_TEXT = (
    "Rates are of shading alone, all kernels by the device's clock; the paper's are of whole frames on a "
    "Core 2 Duo T7500 of 2007."
)


def _rates(
    bench: Bench, scene: Scene, gbuffer: GBuffer, published: float, note: str = "", threshold: float = 0.0
) -> list[Quantity]:
    """Shading rates of both estimators beside the paper's."""
    thresholds = {"paper": threshold, "accurate": 0.0}
    return [
        Quantity(
            f"shading rate{note}, estimator {name}",
            1 / bench.seconds(by_estimator(scene, name, thresholds[name]), gbuffer),
            published,
            ".4g",
            "frames / s",
        )
        for name in ESTIMATORS
    ]


def _figure_10(bench: Bench, folder: Path) -> Rebuilt:
    pictures, quantities = [], []
    truth = None
    for mode in ("aggressive", "conservative"):
        for frame in range(3):
            scene = bench.scene(f"fig10_{mode}", frame)
            gbuffer = bench.points(scene)
            if truth is None:  # neither mode nor depth changes what is true
                truth = bench.same_spheres(scene, gbuffer, SAMPLES // 4)
            radiance = bench.picture(scene, gbuffer)[0]
            label = f"{mode}, depth {scene.shading.mask.depth}"
            path = bench.show(folder / f"figure10_{mode}_{frame}.png", gbuffer, radiance)
            pictures.append((label, path))
            found = compare(radiance, truth.radiance, truth.variance, label)
            quantities.append(Quantity(f"bias of the light, {label}", found.bias, None, "percent"))
    text = (
        "Cells that are touched count as free above and as covered below, so that coarse masks of the "
        "first kind lose shadow and of the second kind widen it; at depth 5 both are close to the truth."
    )
    return Rebuilt(pictures, text, quantities)


def _figure_13(bench: Bench, folder: Path) -> Rebuilt:
    scene = bench.scene("fig13")
    gbuffer = bench.points(scene)
    mesh = direct_light(scene, gbuffer, mesh_occluders(scene, bench.assets), strata(SAMPLES), (0,))
    pictures = [("path traced, true meshes", bench.show(folder / "figure13_a.png", gbuffer, mesh.radiance))]
    some = np.arange(0, len(gbuffer), 8)
    part = gbuffer.some(some)
    spheres = bench.same_spheres(scene, part, SAMPLES)
    quantities = []
    for name in ESTIMATORS:
        radiance = bench.picture(by_estimator(scene, name), gbuffer)[0]
        path = bench.show(folder / f"figure13_{name}.png", gbuffer, radiance)
        pictures.append((f"estimator {name}, mask depth 5", path))
        for against, picture, truth in (
            ("the true meshes", radiance, mesh),
            ("the same spheres", radiance[some], spheres),
        ):
            found = compare(picture, truth.radiance, truth.variance, name)
            rest = None
            if found.relative_rmse is not None and found.noise is not None:
                rest = without_noise(found.relative_rmse, found.noise)
            quantities.append(
                Quantity(f"relative RMSE against {against}, estimator {name}", rest, None, "percent")
            )
    text = (
        "The paper gives no number; ours are relative RMSE without the reference's noise, against rays "
        "that test the true meshes and, on every 8th point, against rays that test the same spheres."
    )
    return Rebuilt(pictures, text, quantities)


def _figure_14(bench: Bench, folder: Path) -> Rebuilt:
    scene = bench.scene("fig14")
    gbuffer = bench.points(scene)
    path = bench.show(folder / "figure14.png", gbuffer, bench.picture(scene, gbuffer)[0])
    quantities = [
        Quantity("points", len(gbuffer), 65536, ",.0f"),
        *_rates(bench, scene, gbuffer, RATE_14),
    ]
    return Rebuilt([("a Lafortune material by textures", path)], RATE_TEXT, quantities)


def _figure_17(bench: Bench, folder: Path) -> Rebuilt:
    pictures: list[tuple[str, Path]] = []
    quantities: list[Quantity] = []
    for frame, letter in enumerate("abc"):
        scene = bench.scene("fig17", frame)
        gbuffer = bench.points(scene)
        path = bench.show(folder / f"figure17_{letter}.png", gbuffer, bench.picture(scene, gbuffer)[0])
        height = scene.objects["bunny"].transform.translate[1]
        pictures.append((f"({letter}) bunny at height {height:g}", path))
        if not frame:
            quantities.append(Quantity("points", len(gbuffer), 16384, ",.0f"))
        quantities += _rates(bench, scene, gbuffer, RATES_17[frame], f" ({letter})", THRESHOLD_17)
    text = (
        f"The plane as seen from beneath the bunny; the paper's estimator with t_i = {THRESHOLD_17}, as "
        f"in the paper. Heights and sizes are ours. {RATE_TEXT}"
    )
    return Rebuilt(pictures, text, quantities)


def _figure_18(bench: Bench, folder: Path) -> Rebuilt:
    scene = bench.scene("fig18")
    gbuffer = bench.points(scene)
    path = bench.show(folder / "figure18.png", gbuffer, bench.picture(scene, gbuffer)[0])
    quantities = [Quantity("points", len(gbuffer), 480000, ",.0f")]
    quantities += [
        Quantity(
            f"seconds of shading, estimator {name}",
            bench.seconds(by_estimator(scene, name), gbuffer),
            SECONDS_18,
            ".3g",
            "s",
        )
        for name in ESTIMATORS
    ]
    return Rebuilt([("two bunnies of 512 spheres in a box", path)], RATE_TEXT, quantities)


FIGURES: Sequence[PaperFigure] = (
    PaperFigure(
        10,
        "Masks that are too coarse",
        "Shadows with masks of depth 2, 3 and 5: above aggressive, where cells covered in part are ignored, "
        "below conservative, where they are kept.",
        _figure_10,
    ),
    PaperFigure(
        13,
        "Soft shadows beside path tracing",
        "Five objects on a plane, path traced and by the method with mask depth 5; hardly distinguishable.",
        _figure_13,
    ),
    PaperFigure(
        14,
        "A material that varies over the surface",
        "A Lafortune model with textures, 65,536 points, one light and no occluder, at 13.73 frames per "
        "second.",
        _figure_14,
    ),
    PaperFigure(
        17,
        "A bunny rises over a plane",
        "Shadows get smoother with the distance, and slower with the shadowed area: 16,384 points, 64 "
        "spheres, diffuse, mask depth 5, t_i = 0.001, at 15.9, 10.1 and 4.75 frames per second.",
        _figure_17,
    ),
    PaperFigure(
        18,
        "Two bunnies in a box",
        "A hard case for masks, with self-shadowing: 480,000 points, 1,024 spheres, two lobes, one light, in "
        "6.25 s.",
        _figure_18,
    ),
)
