"""How far the tables are from what they stand for: statistics over random arguments between the nodes."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.progress import SILENT, Progress
from coslobe.tables import cap, lobe, lobe_cap, product, weights
from coslobe.tables.grid import MAX_EXPONENT
from coslobe.tables.quadtree import shadow_leaves
from coslobe.tables.store import LobeTables

TRIPLES = 100_000

PAPER = {
    "mean": 7.1379e-4,
    "variance": 1.2091e-8,
    "median": 0.0,
    "note": "Sec. 4.1; the sampling behind these numbers is not stated, and no sampling can have all three: "
    "a mean and a median differ by at most one standard deviation",
}


def contract_triples(rng: np.random.Generator, n: int) -> tuple[NDArray, NDArray, NDArray]:
    """Both exponents log-uniform in [1, 1e5], alpha uniform up to six joint lobe widths, at most pi."""
    e1, e2 = 10 ** rng.uniform(0, 5, n), 10 ** rng.uniform(0, 5, n)
    return e1, e2, rng.uniform(0, 1, n) * np.minimum(np.pi, 6 * np.sqrt(1 / (e1 + 1) + 1 / (e2 + 1)))


def decade_triples(rng: np.random.Generator, n: int) -> tuple[NDArray, NDArray, NDArray]:
    """Exponents from the paper's intervals [0, 1], [1, 10], ..., equally often and uniform in each."""
    low = np.array([0, 1, 1e1, 1e2, 1e3, 1e4])
    high = np.append(low[1:], MAX_EXPONENT)
    which = rng.integers(len(low), size=(2, n))
    e1, e2 = low[which] + rng.uniform(0, 1, (2, n)) * (high - low)[which]
    return e1, e2, rng.uniform(0, np.pi, n)


def linear_triples(rng: np.random.Generator, n: int) -> tuple[NDArray, NDArray, NDArray]:
    """Exponents uniform in [0, 1e5], alpha uniform in [0, pi]."""
    return rng.uniform(0, MAX_EXPONENT, n), rng.uniform(0, MAX_EXPONENT, n), rng.uniform(0, np.pi, n)


SAMPLINGS: dict[str, Callable[[np.random.Generator, int], tuple[NDArray, NDArray, NDArray]]] = {
    "contract": contract_triples,
    "per_decade": decade_triples,
    "linear": linear_triples,
}
RANGES = (10.0, 100.0, 1000.0)  # exponents of Fig. 4


def report(tables: LobeTables) -> dict[str, Any]:
    """Errors of the integrals in the sampling of the contract: 1e5 triples, seed 0."""
    rng = np.random.default_rng(0)
    e1, e2, alpha = contract_triples(rng, TRIPLES)
    error = _product_errors(tables, e1, e2, alpha)
    depth = rng.uniform(0, 1, 2000)
    solved = np.array([cap.best_exponent(d) for d in depth])
    return {
        "product_error": {name: _statistics(error[name]) for name in ("l2", "energy")},
        "integral_error": _statistics(tables.integral.lookup(e1) - lobe.integral(e1)),
        "cap_error": _statistics(
            cap.l2_distance(depth, tables.cap.exponent(depth)) - cap.l2_distance(depth, solved)
        ),
        "lobe_cap_error": _lobe_cap_error(tables, rng),
        "weights_error": _weights_error(tables, rng),
    }


def full_report(tables: LobeTables, progress: Progress = SILENT) -> dict[str, Any]:
    """`report`, and the product table's errors in all samplings and relative to G in the ranges of Fig. 4.

    `exact_l2` is what the L2 fit itself misses: no table can do better with its scale. Relative errors leave
    out negligible products, below 1e-20 of the coaxial one; `share` is the share of those that are left.
    """
    samplings: dict[str, Any] = {}
    ranges: dict[str, Any] = {}
    with progress.task("measuring products", len(SAMPLINGS) + len(RANGES)) as advance:
        for name, draw in SAMPLINGS.items():
            triples = draw(np.random.default_rng(0), TRIPLES)
            error = _product_errors(tables, *triples)
            fit = lobe.product_l2(*(x[: TRIPLES // 10] for x in triples))
            error["exact_l2"] = fit.scale * lobe.integral(fit.exponent) - error["exact"][: TRIPLES // 10]
            samplings[name] = {
                "sampling": " ".join((draw.__doc__ or "").split()),
                **{key: _with_place(error[key], *triples) for key in ("l2", "energy", "exact_l2")},
            }
            advance(note=name)
        for largest in RANGES:
            rng = np.random.default_rng(0)
            e1, e2, alpha = *rng.uniform(0, largest, (2, TRIPLES)), rng.uniform(0, np.pi, TRIPLES)
            error = _product_errors(tables, e1, e2, alpha)
            visible = error["exact"] > product.NEGLIGIBLE * lobe.integral(e1 + e2)
            relative = {key: error[key][visible] / error["exact"][visible] for key in ("l2", "energy")}
            place = e1[visible], e2[visible], alpha[visible]
            statistics = {key: _with_place(r, *place) for key, r in relative.items()}
            ranges[f"0-{largest:g}"] = {"share": float(visible.mean()), **statistics}
            advance(note=f"exponents up to {largest:g}")
    return {**report(tables), "samplings": samplings, "relative": ranges, "paper": PAPER}


def _product_errors(tables: LobeTables, e1: NDArray, e2: NDArray, alpha: NDArray) -> dict[str, NDArray]:
    exact = lobe.product_integral(e1, e2, alpha)
    found = tables.product.lookup(e1, e2, alpha)
    whole = lobe.integral(found.exponent)
    return {
        "exact": exact,
        "l2": found.scale_l2 * whole - exact,
        "energy": found.scale_energy * whole - exact,
    }


def _lobe_cap_error(tables: LobeTables, rng: np.random.Generator) -> dict[str, float]:
    """|table - exact| of T relative to its largest value over the angle, where the cap meets the lobe."""
    n = 4000
    e = 10 ** rng.uniform(0, 5, n)
    alpha = 10 ** rng.uniform(-4, np.log10(1.15), n)
    first, last = lobe_cap.angle_range(e, alpha)
    theta = first + rng.uniform(0, 1, n) * (last - first)
    peak = lobe_cap.exact(e, np.zeros(n), alpha).integral
    exact = lobe_cap.exact(e, theta, alpha).integral
    return _statistics((tables.lobe_cap.lookup(e, theta, alpha).integral - exact) / peak)


def _weights_error(tables: LobeTables, rng: np.random.Generator) -> dict[str, float]:
    """|lobes - mask| of the visible share of a light in penumbra, for masks that no fit has seen."""
    depth = weights.MASK_DEPTHS[-1]
    masks = weights.random_masks(rng, 500, 2**depth)
    leaves = shadow_leaves(masks)
    errors = []
    for tangent in (0.01, 0.1, 0.3, 1.0):
        own = tables.weights.lookup(depth, tangent**2 / (1 + tangent**2))
        shadow = weights.shadow_parts(tables.product, tables.cap, leaves, tangent) @ own
        errors.append(np.maximum(1 - shadow, 0) - weights.visible_share(masks, tangent))
    return _statistics(np.concatenate(errors))


def _statistics(error: NDArray) -> dict[str, float]:
    size = np.abs(error)
    return {
        "mean": float(size.mean()),
        "variance": float(size.var()),
        "median": float(np.median(size)),
        "max": float(size.max()),
    }


def _with_place(error: NDArray, e1: NDArray, e2: NDArray, alpha: NDArray) -> dict[str, Any]:
    """Statistics, the 99th percentile, and the triple that has the largest error."""
    worst = int(np.argmax(np.abs(error)))
    place = {"e1": float(e1[worst]), "e2": float(e2[worst]), "alpha": float(alpha[worst])}
    return {**_statistics(error), "p99": float(np.quantile(np.abs(error), 0.99)), "max_at": place}
