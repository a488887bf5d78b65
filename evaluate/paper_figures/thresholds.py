"""Figs 5 and 16: thresholds below which products are left out."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate.paper_figures.bench import Bench, by_estimator
from coslobe.evaluate.paper_figures.figure import PaperFigure, Quantity, Rebuilt
from coslobe.evaluate.pictures import write_heat_map
from coslobe.render.gbuffer import GBuffer

CHOSEN = 0.001  # t_i of Figs 16 and 17
FRAME_RATES = ((14.93, 17.27), (15.18, 15.38))  # of Fig. 16, at t_i = 0 and CHOSEN, for both places
SAVED = 0.5  # "about 50 %"
PLACES = ("highlight on the shadow", "highlight away from it")


@dataclass(frozen=True)
class Savings:
    """One frame of Fig. 16 at t_i = 0 and at 0.001.

    Attributes
    ----------
    gbuffer : GBuffer
    radiance : pair of float64 [n, 3]
    products : pair of [n]
        Lobe products per point.
    """

    gbuffer: GBuffer
    radiance: tuple[NDArray, NDArray]
    products: tuple[NDArray, NDArray]

    @property
    def saved(self) -> float:
        """The share of products that the threshold leaves out."""
        return 1 - float(self.products[1].mean() / self.products[0].mean())

    @property
    def change(self) -> float:
        """Mean absolute difference of the pictures over the mean."""
        return float(np.abs(self.radiance[1] - self.radiance[0]).mean() / self.radiance[0].mean())


def measure_savings(bench: Bench, frame: int) -> Savings:
    """What a threshold of 0.001 leaves out in a frame of Fig. 16."""
    scene = bench.scene("fig16", frame)
    gbuffer = bench.points(scene)
    (none, all_products), (some, fewer) = (
        bench.picture(by_estimator(scene, "paper", threshold), gbuffer, ("products",))
        for threshold in (0.0, CHOSEN)
    )
    return Savings(gbuffer, (none, some), (all_products["products"], fewer["products"]))


def _figure_5(bench: Bench, folder: Path) -> Rebuilt:
    pictures, quantities, first = [], [], None
    for frame in range(3):
        scene = bench.scene("fig05", frame)
        gbuffer = bench.points(scene)
        radiance, layers = bench.picture(scene, gbuffer, ("products",))
        first = radiance if first is None else first
        name = f"t_i = {scene.shading.threshold:g}"
        pictures.append((name, bench.show(folder / f"figure05_{frame}.png", gbuffer, radiance)))
        quantities.append(
            Quantity(f"products per point at {name}", float(layers["products"].mean()), None, ".1f")
        )
        if frame:
            change = float(np.abs(radiance - first).mean() / first.mean())
            quantities.append(Quantity(f"mean change of the picture at {name}", change, None, "percent"))
    text = "The thin lobes of penumbrae go first: at 0.001 hardly a change, at 0.05 shadows break into steps."
    return Rebuilt(pictures, text, quantities)


def _figure_16(bench: Bench, folder: Path) -> Rebuilt:
    pictures: list[tuple[str, Path]] = []
    quantities = []
    for frame, place in enumerate(PLACES):
        savings = measure_savings(bench, frame)
        most = float(savings.products[0].max())
        scene = bench.scene("fig16", frame)
        for k, threshold in enumerate((0.0, CHOSEN)):
            label = f"{place}, t_i = {threshold:g}"
            stem = folder / f"figure16_{frame}_{k}"
            pictures.append(
                (label, bench.show(stem.with_suffix(".png"), savings.gbuffer, savings.radiance[k]))
            )
            colours = stem.with_name(f"{stem.name}_products.png")
            image = savings.gbuffer.image(savings.products[k].astype(np.float64)[:, None])[..., 0]
            write_heat_map(colours, image, most)
            mean = savings.products[k].mean()
            pictures.append((f"{label}: {mean:.1f} products per point, 0 to {most:.0f}", colours))
            rate = 1 / bench.seconds(by_estimator(scene, "paper", threshold), savings.gbuffer)
            quantities.append(
                Quantity(f"shading rate, {label}", rate, FRAME_RATES[frame][k], ".4g", "frames / s")
            )
        quantities += [
            Quantity(f"products saved, {place}", savings.saved, SAVED, "percent"),
            Quantity(f"mean change of the picture, {place}", savings.change, None, "percent"),
        ]
    text = (
        "False colours count lobe products per point, on one scale per place. Rates here are of shading "
        "alone; the paper's are of whole frames on a laptop of 2007. There are fewer products than in "
        "the paper to begin with: lobes sharper than the light's take their shadow from the mask's "
        "cells."
    )
    return Rebuilt(pictures, text, quantities)


FIGURES = (
    PaperFigure(
        5,
        "Too high a threshold",
        "One scene at several thresholds t_i. The penumbra needs many thin lobes and the umbra few thick "
        "ones; where t_i is too high, shadows become aliased.",
        _figure_5,
    ),
    PaperFigure(
        16,
        "Products that a threshold saves",
        "4,096 points, one light, a bunny of 64 spheres, with t_i = 0 and with one that changes nothing "
        "that can be seen; products in false colours. About 50 % of the products go, worth 2 frames per "
        "second.",
        _figure_16,
    ),
)
