"""Figs 8, 9, 11 and 12: splatted spheres, quadtree, lobes of leaves, and weights, as one point has them."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate.paper_figures.bench import Bench
from coslobe.evaluate.paper_figures.figure import PaperFigure, Quantity, Rebuilt, new_plot, save_plot
from coslobe.evaluate.paper_figures.mask_view import MaskView, busiest_view, shadow_lobes
from coslobe.tables import figures
from coslobe.tables.quadtree import blocks_of_disk, shadow_leaves

FINE = 192  # cells along a side of outlines and of sums of lobes
WIDE = 4.0  # half sides of the square that Fig. 8 (a) shows
SPHERES, DEPTH = 3, 2  # of Fig. 9
DISTS = (1.0, 4.0, 10.0)  # of the unit square in Fig. 12
SHADOW, SPLIT, FREE = "#3f9b57", "#d2503e", "#f3d35e"  # the paper's green, red and yellow


def _figure_8(bench: Bench, folder: Path) -> Rebuilt:
    view, position = busiest_view(bench)
    plot = new_plot(10.5, 3.7)
    panels = plot.subplots(1, 3)
    titles = ("(a) all spheres, the light and its square", "(b) those that meet the light", "(c) splatted")
    for axes, title, scale in zip(panels, titles, (WIDE, 1.1, 1.1), strict=True):
        _square(axes, title, scale)
    for index, meets in enumerate(view.meets):
        _outline(panels[0], view, index, WIDE, "#c4562f" if meets else "0.6")
        if meets:
            _outline(panels[1], view, index, 1.1, "#c4562f")
            _outline(panels[2], view, index, 1.1, "#c4562f")
    panels[2].imshow(view.blocked, extent=(-1, 1, -1, 1), origin="lower", cmap="Greys", vmax=1.6)
    where = ", ".join(f"{x:.2f}" for x in position)
    text = (
        f"The point ({where}) of the ground of Fig. 15's scene, which has most leaves there. The square "
        "circumscribes the light's disk; cells count as covered by their centres, exactly, without "
        "ellipses. Masks are turned per pixel."
    )
    return Rebuilt(
        [("spheres before the light", save_plot(plot, folder / "figure08_splatting.png"))],
        text,
        [
            Quantity("spheres of the scene", len(view.radii), None, ".0f"),
            Quantity("spheres that are splatted", int(view.meets.sum()), None, ".0f"),
            Quantity("cells of the mask that are covered", float(view.blocked.mean()), None, "percent"),
        ],
    )


def _figure_9(bench: Bench, folder: Path) -> Rebuilt:
    view, _ = busiest_view(bench)
    chosen = three_spheres(view)
    few = np.any([view.covered(index, len(view.blocked)) for index in chosen], axis=0)
    plot = new_plot(10.5, 3.2)
    panels = plot.subplots(1, DEPTH + 2)
    for depth in range(DEPTH + 1):
        _square(panels[depth], f"{SPHERES} spheres, depth {depth}", 1.05)
        _quadtree(panels[depth], few, depth, last=depth == DEPTH)
        for index in chosen:
            _outline(panels[depth], view, index, 1.05, "k")
    _square(panels[-1], "all spheres, depth 5", 1.05)
    _quadtree(panels[-1], view.blocked, len(view.leaves) - 1, last=True)
    counts = [int(level.sum()) for level in view.leaves]
    text = (
        "Red blocks are subdivided, green ones are shadow leaves, yellow ones cast no shadow. Here no "
        "tree is built: the mask is bits, and blocks of four are joined upwards. What lies off the "
        "light's disk counts as covered where blocks are joined and is no leaf itself (white)."
    )
    return Rebuilt(
        [("the quadtree", save_plot(plot, folder / "figure09_quadtree.png"))],
        text,
        [Quantity(f"shadow leaves of depth {depth}", n, None, ".0f") for depth, n in enumerate(counts)],
    )


def _figure_11(bench: Bench, folder: Path) -> Rebuilt:
    from matplotlib.patches import Circle

    view, _ = busiest_view(bench)
    plot = new_plot(10.5, 3.7)
    mask, spheres, lobes = plot.subplots(1, 3)
    _square(mask, "the mask's leaves", 1.1)
    _leaves(mask, view.blocked)
    _square(spheres, "a bounding sphere of each leaf", 1.1)
    for depth, level in enumerate(view.leaves):
        side = 2 / len(level)
        for row, column in np.argwhere(level):
            centre = (-1 + (column + 0.5) * side, -1 + (row + 0.5) * side)
            spheres.add_patch(Circle(centre, side / np.sqrt(2), fill=False, edgecolor=f"C{depth}"))
    weights = bench.tables.weights.lookup(len(view.leaves) - 1, view.cap.sine**2)
    total = shadow_lobes(bench.tables, view.leaves, view.cap.tangent, weights, FINE)
    _square(lobes, "the sum of their lobes, weighted", 1.1)
    shown = lobes.imshow(total, extent=(-1, 1, -1, 1), origin="lower", cmap="magma", vmin=0)
    plot.colorbar(shown, ax=lobes, shrink=0.8)
    count = sum(int(level.sum()) for level in view.leaves)
    text = (
        f"The mask of Fig. 8 has {count} shadow leaves, each with one lobe: its exponent is that of the "
        "cap through the corners of a leaf at the centre. The sum is what the mask takes from the light, "
        "smooth where the mask is not."
    )
    return Rebuilt(
        [("leaves, spheres and lobes", save_plot(plot, folder / "figure11_leaf_lobes.png"))],
        text,
        [
            Quantity("shadow leaves, and lobes", count, None, ".0f"),
            Quantity("mean of the lobes over covered cells", _mean_over(total, view.blocked), None, ".3f"),
            Quantity("mean of the lobes over free cells", _mean_over(total, ~view.blocked), None, ".3f"),
        ],
    )


def _figure_12(bench: Bench, folder: Path) -> Rebuilt:
    view, _ = busiest_view(bench)
    depth = len(view.leaves) - 1
    plot = new_plot(10.5, 3.5)
    panels = plot.subplots(1, len(DISTS))
    quantities = []
    shown = None
    for axes, dist in zip(panels, DISTS, strict=True):
        tangent = 1 / (2 * dist)
        total = shadow_lobes(bench.tables, view.leaves, tangent, np.ones(depth + 1), FINE)
        weight = bench.tables.weights.lookup(depth, 1 / (1 + 4 * dist**2))
        _square(axes, f"dist {dist:g}, weights of 1", 1.1)
        shown = axes.imshow(total, extent=(-1, 1, -1, 1), origin="lower", cmap="magma", vmin=0, vmax=2)
        quantities += [
            Quantity(
                f"overlap: mean of unweighted lobes over covered cells, dist {dist:g}",
                _mean_over(total, view.blocked),
                None,
                ".3f",
            ),
            Quantity(f"weight of the deepest leaves, dist {dist:g}", float(weight[depth]), None, ".3f"),
        ]
    plot.colorbar(shown, ax=panels, shrink=0.8)
    text = (
        "The lobes of one and the same mask, not yet weighted, with the square at three distances: near "
        "squares are seen under wider angles. The paper sets weights by hand for 12 distances; here the "
        "umbra rule and least squares over random masks set them, for any."
    )
    return Rebuilt(
        [
            ("overlap of one mask's lobes", save_plot(plot, folder / "figure12_overlap.png")),
            ("the weights", figures.draw_one("figure12_weights", bench.tables, folder)),
        ],
        text,
        quantities,
    )


def three_spheres(view: MaskView) -> list[int]:
    """The spheres that cover most of the square: each adds most to those before it."""
    covered = {
        int(index): view.covered(int(index), len(view.blocked)) for index in np.flatnonzero(view.meets)
    }
    chosen: list[int] = []
    union = np.zeros_like(view.blocked)
    for _ in range(min(SPHERES, len(covered))):
        left = [index for index in covered if index not in chosen]
        chosen.append(max(left, key=lambda index: int((covered[index] & ~union).sum())))
        union |= covered[chosen[-1]]
    return chosen


def _square(axes: Any, title: str, scale: float) -> None:
    """The frame of a panel: the mask's square and the light's disk."""
    from matplotlib.patches import Circle, Rectangle

    axes.set(xlim=(-scale, scale), ylim=(-scale, scale), aspect="equal", xticks=[], yticks=[])
    axes.set_title(title, fontsize=9)
    axes.add_patch(Rectangle((-1, -1), 2, 2, fill=False, edgecolor="k", linewidth=1, zorder=4))
    axes.add_patch(Circle((0, 0), 1, fill=False, edgecolor="C0", linewidth=1.2, zorder=4))


def _outline(axes: Any, view: MaskView, index: int, scale: float, colour: str) -> None:
    covered = view.covered(index, FINE, scale)
    if covered.any() and not covered.all():
        x = (np.arange(FINE) + 0.5) * 2 * scale / FINE - scale
        axes.contour(x, x, covered.astype(float), levels=[0.5], colors=[colour], linewidths=0.8)


def _quadtree(axes: Any, blocked: NDArray, depth: int, *, last: bool) -> None:
    """The leaves of a tree `depth` deep; unless it is the `last`, touched ones are subdivided next."""
    above = np.zeros((1, 1), bool)  # blocks that a larger one holds already
    levels = zip(shadow_leaves(blocked), blocks_of_disk(len(blocked)), strict=True)
    for level, (leaves, inside) in enumerate(list(levels)[: depth + 1]):
        side = len(blocked) // len(leaves)
        touched = blocked.reshape(len(leaves), side, len(leaves), side).any(axis=(1, 3))
        split = touched & inside & ~leaves & ~above
        if level == depth:
            _blocks(axes, split, FREE if last else SPLIT)
        free = inside & ~above & ~leaves & ~split
        _blocks(axes, leaves, SHADOW)
        _blocks(axes, free, FREE)
        above = (above | leaves | free | ~inside).repeat(2, 0).repeat(2, 1)


def _leaves(axes: Any, blocked: NDArray) -> None:
    for depth, level in enumerate(shadow_leaves(blocked)):
        _blocks(axes, level, f"C{depth}")


def _blocks(axes: Any, chosen: NDArray, colour: str) -> None:
    from matplotlib.patches import Rectangle

    side = 2 / len(chosen)
    for row, column in np.argwhere(chosen):
        corner = (-1 + column * side, -1 + row * side)
        axes.add_patch(Rectangle(corner, side, side, facecolor=colour, edgecolor="k", linewidth=0.4))


def _mean_over(values: NDArray, cells: NDArray) -> float | None:
    """Mean of values [FINE, FINE] over the cells of a mask that divides it evenly."""
    fine = cells.repeat(len(values) // len(cells), 0).repeat(len(values) // len(cells), 1)
    return float(values[fine].mean()) if fine.any() else None


FIGURES = (
    PaperFigure(
        8,
        "Spheres before a light",
        "(a) A unit square is placed by the light's cone, (b) blockers that cannot matter are clipped, "
        "(c) the others are splatted onto the square.",
        _figure_8,
    ),
    PaperFigure(
        9,
        "The quadtree",
        "Three spheres and depth 2: red leaves are subdivided, yellow ones not considered, green shadow "
        "leaves frozen.",
        _figure_9,
    ),
    PaperFigure(
        11,
        "Lobes of shadow leaves",
        "From a mask (left) one bounding sphere per shadow leaf and the lobes that belong to them (right).",
        _figure_11,
    ),
    PaperFigure(
        12,
        "Overlap and weights",
        "The overlap of lobes varies with the square's distance, for one and the same mask; so do the "
        "weights.",
        _figure_12,
    ),
)
