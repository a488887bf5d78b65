"""All tables together: build, verify against exact cases, keep in one file."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe.core import cache
from coslobe.core.errors import CoslobeError, InvalidInput
from coslobe.core.files import atomic_path
from coslobe.core.progress import SILENT, Progress
from coslobe.tables import cap, integral, lobe, lobe_cap, product, weights
from coslobe.tables.grid import exponent_nodes

FORMAT = "coslobe-tables/1"


@dataclass(frozen=True)
class LobeTables:
    """The tables that rendering needs; none depends on a scene."""

    product: product.ProductTable
    integral: integral.IntegralTable
    cap: cap.CapTable
    lobe_cap: lobe_cap.LobeCapTable
    weights: weights.WeightTable


def build(progress: Progress = SILENT) -> LobeTables:
    """Build and verify all tables; seconds, not hours, because every integral is one-dimensional."""
    with progress.task("building tables", 5) as advance:
        product_table = product.build()
        advance(note="product")
        integral_table = integral.build()
        advance(note="integral")
        cap_table = cap.build()
        advance(note="cap")
        lobe_cap_table = lobe_cap.build()
        advance(note="lobe over cap")
        weight_table = weights.build(product_table, cap_table)
        advance(note="weights of shadows")
    tables = LobeTables(product_table, integral_table, cap_table, lobe_cap_table, weight_table)
    verify(tables)
    return tables


def verify(tables: LobeTables) -> None:
    """Raise CoslobeError where a table contradicts a case that is known exactly, naming the case."""
    for case, holds in _exact_cases(tables):
        if not holds:
            raise CoslobeError(
                f"lobe tables: {case} does not hold", "rebuild them: coslobe tables build --force"
            )


def _exact_cases(tables: LobeTables) -> Iterator[tuple[str, bool]]:
    for name, array in _arrays(tables).items():
        yield f"{name} is finite", bool(np.isfinite(array).all())
    e1, e2, alpha, nodes = tables.product.at_nodes()
    larger, total = np.maximum(e1, e2), e1 + e2
    yield (
        "the product of coaxial lobes has exponent e1 + e2",
        np.allclose(nodes.exponent[:, :1], total, atol=1e-4, rtol=1e-4),
    )
    yield (
        "a coaxial product integrates to 2 pi / (e1 + e2 + 1)",
        np.allclose(nodes.integral[:, :1], lobe.integral(total), rtol=1e-5),
    )
    yield (
        "a product's exponent is at least that of either lobe",
        bool((nodes.exponent >= larger - 1e-5 * np.maximum(larger, 1)).all()),
    )
    # Samples only: between them interpolation may ripple by as much as its error.
    falling = np.diff(nodes.integral, axis=1) <= 1e-5 * nodes.integral[:, :1]
    yield "a product's integral falls with the angle", bool(falling.all())
    here, there = (slice(None, None, 7), slice(None, None, 5))
    one = tables.product.lookup(e1[here], e2[here], alpha[here, there])
    two = tables.product.lookup(e2[here], e1[here], alpha[here, there])
    same = np.allclose(one.axis_angle + two.axis_angle, alpha[here, there], atol=1e-9) and all(
        np.allclose(a, b, rtol=1e-9) for a, b in zip(one[1:], two[1:], strict=True)
    )
    yield "a product does not depend on the order of its lobes", same
    yield (
        "a lobe integrates to 2 pi / (e + 1)",
        np.allclose(tables.integral.values, lobe.integral(tables.integral.exponents), rtol=1e-9),
    )
    yield "a small cap's exponent times its depth is 0.9613", bool(abs(tables.cap.values[0] - 0.9613) < 1e-4)
    yield "a hemisphere is the lobe of exponent 0", bool(tables.cap.values[-1] == 0)
    e = exponent_nodes(lobe_cap.EXPONENTS)
    depth = 1 - np.cos(1.0)
    inside = 2 * np.pi * -np.expm1((e + 1) * np.log1p(-depth)) / (e + 1)
    coaxial = tables.lobe_cap.lookup(e, np.zeros_like(e), np.ones_like(e)).integral
    yield "a lobe over a coaxial cap has its closed form", np.allclose(coaxial, inside, rtol=2e-3)
    covered = [np.ones((1, 1, 1), bool)]
    part = weights.shadow_parts(tables.product, tables.cap, covered, tangent=1.0)[0, 0]
    root = tables.weights.lookup(5, sine2=0.5)[0]
    yield "a covered light is dark", bool(abs(part * root - 1) < 1e-3)


def _arrays(tables: LobeTables) -> dict[str, NDArray]:
    return {
        "product": tables.product.values,
        "integral_exponents": tables.integral.exponents,
        "integral": tables.integral.values,
        "cap": tables.cap.values,
        "lobe_cap": tables.lobe_cap.values,
        "weights": tables.weights.values,
    }


def save(path: Path, tables: LobeTables) -> None:
    """Write one .npz file, atomically; the same tables give the same bytes."""
    arrays = _arrays(tables)
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        np.savez(
            file, allow_pickle=False, format=np.array(FORMAT), checksum=np.array(_checksum(arrays)), **arrays
        )


def load(path: Path) -> LobeTables:
    """Read and verify a file of `save`.

    Raises
    ------
    InvalidInput
        The file is missing, damaged, or not a table file of this version.
    """
    hint = "write a new one: coslobe tables build --force"
    try:
        with np.load(path, allow_pickle=False) as archive:
            content = {name: archive[name] for name in archive.files}
    except Exception as error:  # zipfile, zlib and NumPy each have their own errors for damaged files
        raise InvalidInput(f"{path}: table file cannot be read ({error})", hint) from error
    if str(content.pop("format", "")) != FORMAT:
        raise InvalidInput(f"{path}: not a table file of format {FORMAT}", hint)
    checksum = str(content.pop("checksum", ""))
    shapes = {
        "product": (product.EXPONENTS * (product.EXPONENTS + 1) // 2, product.ANGLES, 3),
        "integral_exponents": content.get("integral", np.empty(0)).shape,
        "integral": content.get("integral", np.empty(0)).shape,
        "cap": (cap.SAMPLES,),
        "lobe_cap": (lobe_cap.EXPONENTS, lobe_cap.CAPS, lobe_cap.ANGLES, 4),
        "weights": (len(weights.MASK_DEPTHS), weights.SAMPLES, weights.LEVELS),
    }
    if {name: array.shape for name, array in content.items()} != shapes or _checksum(content) != checksum:
        raise InvalidInput(f"{path}: table file is damaged", hint)
    tables = LobeTables(
        product.ProductTable(content["product"]),
        integral.IntegralTable(content["integral_exponents"], content["integral"]),
        cap.CapTable(content["cap"]),
        lobe_cap.LobeCapTable(content["lobe_cap"]),
        weights.WeightTable(content["weights"]),
    )
    verify(tables)
    return tables


def _checksum(arrays: dict[str, NDArray]) -> str:
    hasher = hashlib.sha256()
    for name in sorted(arrays):
        hasher.update(name.encode() + np.ascontiguousarray(arrays[name]).tobytes())
    return hasher.hexdigest()


def cached_path() -> Path:
    """Where the cache keeps the tables: named by the source that builds them, so that they never go stale."""
    return cache.entry("tables", cache.digest(FORMAT, cache.code_digest("tables")), ".npz")


def cached(progress: Progress = SILENT, *, force: bool = False) -> LobeTables:
    """The tables from the cache, built on first use; a damaged file is replaced, with a line that says so."""
    path = cached_path()
    if path.exists() and not force:
        try:
            return load(path)
        except CoslobeError as error:
            progress.say(f"{error}; building new tables")
    else:
        progress.say("building the lobe tables (once)")
    tables = build(progress)
    save(path, tables)
    return tables
