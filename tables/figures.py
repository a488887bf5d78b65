"""Counterparts of the paper's Figures 2, 3, 4, 6, 7 and 12, drawn from the tables."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from coslobe.core.files import atomic_path
from coslobe.core.progress import SILENT, Progress
from coslobe.tables import cap, lobe, weights
from coslobe.tables.errors import RANGES
from coslobe.tables.grid import exponent_coordinate, exponent_nodes, exponent_of
from coslobe.tables.quadtree import shadow_leaves
from coslobe.tables.store import LobeTables

PRODUCTS = 10_000_000  # of Fig. 4
_BLOCK = 250_000


def draw(tables: LobeTables, folder: Path, progress: Progress = SILENT) -> list[Path]:
    """Write one PNG per figure into `folder`; the files written.

    Raises
    ------
    CoslobeError
        The folder cannot be written.
    """
    files = []
    with progress.task("drawing", len(DRAWINGS)) as advance:
        for name in DRAWINGS:
            files.append(draw_one(name, tables, folder))
            advance(note=name)
    return files


def draw_one(name: str, tables: LobeTables, folder: Path) -> Path:
    """Write one of `DRAWINGS` into `folder`; the file written. Errors as in `draw`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4.6), layout="constrained")
    figure.supxlabel(DRAWINGS[name](figure, tables), fontsize=8, x=0.02, ha="left")
    file = folder / f"{name}.png"
    with atomic_path(file) as temporary:
        figure.savefig(temporary, dpi=110, metadata={"Software": None})
    return file


def _integral(figure: Any, tables: LobeTables) -> str:
    value, error = figure.subplots(1, 2)
    e = exponent_of(np.linspace(0, exponent_coordinate(1e5), 4000))[1:]
    value.loglog(e, tables.integral.lookup(e), color="C0", label="table")
    value.loglog(e, lobe.integral(e), "k:", label="2π / (e + 1)")
    value.set(xlabel="exponent e", ylabel="integral of the lobe [sr]")
    value.legend()
    relative = np.abs(tables.integral.lookup(e) / lobe.integral(e) - 1)
    error.loglog(e, np.maximum(relative, 1e-12), color="C3", linewidth=0.6)
    error.set(xlabel="exponent e", ylabel="relative error of the table", ylim=(1e-9, 1))
    return (
        "Paper, Fig. 2: the integral varies little at high exponents, which allows a sparser sampling.\n"
        "Here: 128 linear samples per interval as in the paper; linear interpolation against the closed form."
    )


def _error_map(figure: Any, tables: LobeTables) -> str:
    rows = figure.subplots(2, 4, sharex="row", sharey="row")
    mesh = None
    for row, (largest, label) in zip(rows, ((1e5, "full range"), (2.0, "low exponents")), strict=True):
        e = exponent_of(np.linspace(0, exponent_coordinate(largest), 90))
        for axes, degrees in zip(row, (15, 45, 90, 135), strict=True):
            e1, e2 = np.meshgrid(e, e)
            alpha = np.full(e1.shape, np.radians(degrees))
            found = tables.product.lookup(e1, e2, alpha)
            error = np.abs(
                found.scale_l2 * lobe.integral(found.exponent) - lobe.product_integral(e1, e2, alpha)
            )
            mesh = axes.pcolormesh(
                e, e, np.log10(np.maximum(error, 1e-6)), cmap="gray_r", vmin=-6, vmax=0, rasterized=True
            )
            if largest > 10:
                axes.set_xscale("symlog", linthresh=1)
                axes.set_yscale("symlog", linthresh=1)
                axes.set_title(f"α = {degrees}°", fontsize=9)
            axes.tick_params(labelsize=7)
        row[0].set_ylabel(f"{label}\ne2", fontsize=8)
    for axes in rows[1]:
        axes.set_xlabel("e1", fontsize=8)
    figure.colorbar(mesh, ax=rows, label="log10 |∫cr - ∫c1 c2| [sr]")
    return (
        "Paper, Fig. 3: white is a low error, black a high one; about 50 % for e1, e2 < 1 and α near π/2.\n"
        "Here: the same for the L2 scale, as in the paper; the energy-conserving scale has no such region."
    )


def _distribution(figure: Any, tables: LobeTables) -> str:
    axes = figure.subplots()
    edges = np.concatenate([[0], np.geomspace(1e-20, 2 * np.pi, 500)])
    for largest, style in zip(RANGES, ("--", ":", "-"), strict=True):
        rng = np.random.default_rng(0)
        counts = np.zeros(len(edges) - 1)
        for _ in range(0, PRODUCTS, _BLOCK):
            e1, e2 = rng.uniform(0, largest, (2, _BLOCK))
            values = tables.product.lookup(e1, e2, rng.uniform(0, np.pi, _BLOCK)).integral
            counts += np.histogram(np.minimum(values, edges[-1]), edges)[0]
        share = 100 * np.cumsum(counts) / PRODUCTS
        axes.plot(edges[1:], share, style, color="k", label=f"exponents in [0, {largest:g}]")
    axes.axvline(1e-3, color="C3", linewidth=0.8)
    axes.text(8e-4, 3, "ti = 0.001 (Fig. 17)", color="C3", fontsize=8, ha="right")
    axes.set(
        xscale="log", xlabel="integral of the product [sr]", ylabel="products not above it [%]", ylim=(0, 101)
    )
    axes.set_xlim(1e-12, 2 * np.pi)
    axes.legend(loc="lower right")
    return (
        "Paper, Fig. 4: even a small threshold avoids many products, the more the higher the exponents.\n"
        f"Here: {PRODUCTS:,} products per curve; exponents and α in [0, π] uniform, seed 0."
    )


def _exponent(figure: Any, tables: LobeTables) -> str:
    e = exponent_nodes(200)[1:]
    e1, e2 = np.meshgrid(e, e)
    mesh, both = None, figure.subplots(1, 2, sharey=True)
    for axes, degrees in zip(both, (1, 30), strict=True):
        found = tables.product.lookup(e1, e2, np.full(e1.shape, np.radians(degrees)))
        shown = np.where(found.integral > 0, np.log10(np.maximum(found.exponent, 1e-3)), np.nan)
        mesh = axes.pcolormesh(e, e, shown, cmap="viridis", vmin=-2, vmax=5.5, rasterized=True)
        lines = axes.contour(e, e, shown, levels=np.arange(-1, 6), colors="w", linewidths=0.7)
        axes.clabel(lines, fmt=lambda v: f"$10^{{{v:.0f}}}$", fontsize=7)
        axes.set(
            xscale="log", yscale="log", xlim=(0.1, 1e5), ylim=(0.1, 1e5), xlabel="e1", title=f"α = {degrees}°"
        )
    both[0].set_ylabel("e2")
    figure.colorbar(mesh, ax=both, label="log10 of the product's exponent er")
    lowest = np.nanmin(tables.product.at_nodes()[3].exponent - np.maximum(*tables.product.at_nodes()[:2]))
    return (
        "Paper, Fig. 6: er is greater than or equal to e1 and e2; the surface is not a plane.\n"
        f"Here: smallest er - max(e1, e2) over all samples {lowest:.1e}; white: negligible products."
    )


def _cap(figure: Any, tables: LobeTables) -> str:
    profile, exponent = figure.subplots(1, 2)
    angle = np.linspace(0, np.pi / 2, 400)
    for k, degrees in enumerate((10, 30, 60)):
        depth = 1 - np.cos(np.radians(degrees))
        e = float(tables.cap.exponent(depth))
        values = lobe.evaluate(1 - np.cos(angle), e)
        profile.plot(np.degrees(angle), values, color=f"C{k}", label=f"α_cap = {degrees}°, e = {e:.3g}")
        energy = float(tables.cap.energy_amplitude(depth))
        profile.plot(np.degrees(angle), energy * values, ":", color=f"C{k}")
        profile.plot([0, degrees, degrees, 90], [1, 1, 0, 0], color=f"C{k}", linewidth=0.7, alpha=0.6)
    profile.set(xlabel="angle from the cap's axis [°]", ylabel="cap and lobe", ylim=(0, 1.15))
    profile.legend(fontsize=8)
    alpha = np.geomspace(1e-3, np.pi / 2 * 0.999, 400)
    depth = 2 * np.sin(alpha / 2) ** 2
    exponent.loglog(np.degrees(alpha), tables.cap.exponent(depth), color="k")
    nodes = np.degrees(np.arccos(1 - np.linspace(0, 1, cap.SAMPLES)[1:-1:40]))
    exponent.loglog(nodes, tables.cap.exponent(1 - np.cos(np.radians(nodes))), "k.", markersize=4)
    exponent.set(xlabel="half-angle α_cap [°]", ylabel="exponent of the cap's lobe")
    return (
        "Paper, Fig. 7 and (32): a sphere seen as a cap of half-angle α_cap is fitted by a lobe.\n"
        "Here: those lobes (solid) and energy-conserving ones (dotted); the exponent, every 40th sample."
    )


def _weights(figure: Any, tables: LobeTables) -> str:
    weight, share = figure.subplots(1, 2)
    depth = weights.MASK_DEPTHS[-1]
    dist = np.geomspace(0.29, 20, 300)
    for level, values in enumerate(tables.weights.lookup(depth, 1 / (1 + 4 * dist**2)).T):
        weight.plot(dist, values, color=f"C{level}", label=f"leaves of depth {level}")
    weight.set(xscale="log", xlabel="dist of the unit square", ylabel="weight w", ylim=(0.5, 2.0))
    weight.legend(fontsize=8)
    masks = weights.random_masks(np.random.default_rng(0), 400, 2**depth)
    tangent = 0.12
    parts = weights.shadow_parts(tables.product, tables.cap, shadow_leaves(masks), tangent)
    lobes = 1 - parts @ tables.weights.lookup(depth, tangent**2 / (1 + tangent**2))
    share.plot(weights.visible_share(masks, tangent), lobes, "k.", markersize=3)
    share.plot([0, 1], [0, 1], color="C3", linewidth=0.8)
    share.set(xlabel="visible share of the light", ylabel="the same by lobes of leaves")
    return (
        "Paper, Fig. 12: lobes of leaves overlap, the more the nearer the square; weights set by hand.\n"
        "Here: weights by the umbra rule and least squares; 400 random masks under a light of 7° half-angle."
    )


DRAWINGS: dict[str, Callable[[Any, LobeTables], str]] = {
    "figure02_integral": _integral,
    "figure03_error": _error_map,
    "figure04_distribution": _distribution,
    "figure06_exponent": _exponent,
    "figure07_cap": _cap,
    "figure12_weights": _weights,
}
