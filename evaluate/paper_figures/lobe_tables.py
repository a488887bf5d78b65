"""Figs 2, 3, 4, 6 and 7: what the tables of integrals, products and caps hold."""

from pathlib import Path

import numpy as np

from coslobe.evaluate.paper_figures.bench import Bench
from coslobe.evaluate.paper_figures.figure import PaperFigure, Quantity, Rebuilt
from coslobe.tables import errors, figures, lobe
from coslobe.tables.grid import exponent_coordinate, exponent_of
from coslobe.tables.store import LobeTables

WORST = 0.5  # the paper's largest error, "about 50 %"
SHARE_TRIPLES = 200_000
THRESHOLD = 1e-3
SMALL_CAP = 1e-4


def _figure_2(bench: Bench, folder: Path) -> Rebuilt:
    e = exponent_of(np.linspace(0, exponent_coordinate(1e5), 4000))
    relative = np.abs(bench.tables.integral.lookup(e) / lobe.integral(e) - 1)
    return Rebuilt(
        [("the table and its error", figures.draw_one("figure02_integral", bench.tables, folder))],
        "The table is 2 pi / (e + 1) to within what linear interpolation loses between its samples.",
        [Quantity("largest relative error of the table", float(relative.max()), None, ".2g")],
    )


def _figure_3(bench: Bench, folder: Path) -> Rebuilt:
    report = errors.full_report(bench.tables)
    quantities = []
    for name, sampling in report["samplings"].items():
        words = name.replace("_", " ")
        quantities += [
            Quantity(
                f"{key} of the error, sampling: {words}", sampling["l2"][key], errors.PAPER[key], ".5g", "sr"
            )
            for key in ("mean", "variance", "median")
        ]
    per_decade = report["samplings"]["per_decade"]
    quantities += [
        Quantity("largest error, sampling: per decade", per_decade["l2"]["max"], WORST, ".3g", "sr"),
        Quantity(
            "mean error of the energy-conserving scale, sampling: per decade",
            per_decade["energy"]["mean"],
            None,
            ".3g",
            "sr",
        ),
    ]
    samplings = "; ".join(
        f"{name.replace('_', ' ')}: {sampling['sampling'].rstrip('.')}"
        for name, sampling in report["samplings"].items()
    )
    text = (
        "Errors of the L2 products, as in the paper, which does not say how it drew its exponents and "
        "angles; no sampling can have all three of its numbers, because a mean and a median differ by at "
        f"most one standard deviation. So the same table is measured in three samplings. {samplings}."
    )
    picture = figures.draw_one("figure03_error", bench.tables, folder)
    return Rebuilt([("|integral of the product - integral of its lobe|", picture)], text, quantities)


def _figure_4(bench: Bench, folder: Path) -> Rebuilt:
    quantities = [
        Quantity(
            f"products whose integral is below {THRESHOLD:g}, exponents up to {largest:g}",
            _share_below(bench.tables, largest),
            None,
            "percent",
        )
        for largest in errors.RANGES
    ]
    return Rebuilt(
        [("distribution of integrals", figures.draw_one("figure04_distribution", bench.tables, folder))],
        f"The shares below 0.001, the threshold of Fig. 17, from {SHARE_TRIPLES:,} products each.",
        quantities,
    )


def _share_below(tables: LobeTables, largest: float) -> float:
    rng = np.random.default_rng(1)
    e1, e2 = rng.uniform(0, largest, (2, SHARE_TRIPLES))
    values = tables.product.lookup(e1, e2, rng.uniform(0, np.pi, SHARE_TRIPLES)).integral
    return float((values < THRESHOLD).mean())


def _figure_6(bench: Bench, folder: Path) -> Rebuilt:
    e1, e2, _, found = bench.tables.product.at_nodes()
    lowest = float(np.nanmin(found.exponent - np.maximum(e1, e2)))
    return Rebuilt(
        [("exponents of products", figures.draw_one("figure06_exponent", bench.tables, folder))],
        "er >= max(e1, e2) holds at every sample of the table, up to what the fit resolves.",
        [Quantity("smallest er - max(e1, e2)", lowest, 0.0, ".1e")],
    )


def _figure_7(bench: Bench, folder: Path) -> Rebuilt:
    quantities = []
    for degrees in (10, 30, 60):
        depth = 1 - np.cos(np.radians(degrees))
        exponent = float(bench.tables.cap.exponent(depth))
        quantities.append(Quantity(f"exponent of a cap of {degrees} degrees", exponent, None, ".4g"))
    limit = float(bench.tables.cap.exponent(SMALL_CAP)) * SMALL_CAP
    quantities.append(Quantity("e (1 - cos of the half-angle) of a small cap", limit, None, ".4f"))
    return Rebuilt(
        [("caps and their lobes", figures.draw_one("figure07_cap", bench.tables, folder))],
        "The best lobe of amplitude 1 carries up to 4 % more energy than its cap; the dotted ones carry "
        "as much.",
        quantities,
    )


FIGURES = (
    PaperFigure(
        2,
        "Integral of a lobe",
        "The integral over the exponent; it varies little at high exponents, which allows a sparser "
        "sampling.",
        _figure_2,
    ),
    PaperFigure(
        3,
        "Error of lobe products",
        "Absolute difference of integrals over exponents and angle: white is low, black high, about 50 % for "
        "exponents below 1 near 90 degrees. Mean 7.1379e-4, variance 1.2091e-8, median 0.",
        _figure_3,
    ),
    PaperFigure(
        4,
        "How large products are",
        "Share of 10 million random products below a value, for exponents up to 10, 100 and 1000: even a "
        "small threshold avoids many.",
        _figure_4,
    ),
    PaperFigure(
        6,
        "Exponent of a product",
        "er over e1 and e2 at a fixed angle: greater than or equal to both; the surface is not a plane.",
        _figure_6,
    ),
    PaperFigure(
        7,
        "A spherical cap as a lobe",
        "A sphere, seen from a point, is a cap of half-angle alpha_cap, whose lobe has the exponent of (32).",
        _figure_7,
    ),
)
