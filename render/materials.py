"""Materials of the scene file as what the kernel evaluates: a diffuse term and lobes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coslobe.render.layout import LOBE, MATERIAL

if TYPE_CHECKING:
    from coslobe.render.scene import Material


@dataclass(frozen=True)
class PackedMaterials:
    """Materials as the kernel reads them.

    Attributes
    ----------
    materials : MATERIAL [max(n, 1)]
    lobes : LOBE [max(m, 1)]
        Of all materials, one after another.
    exponents : float64 [k]
        The distinct exponents of the lobes, to which their slices refer.
    max_lobes : int
        The most lobes of one material.
    anisotropic : bool
        Whether a lobe needs a tangent.
    """

    materials: NDArray
    lobes: NDArray
    exponents: NDArray
    max_lobes: int
    anisotropic: bool


@dataclass(frozen=True)
class Lobe:
    """rho max(cx vx lx + cy vy ly + cz vz lz, 0)^exponent in the tangent frame, Lafortune et al. 1997.

    Attributes
    ----------
    rho : float64 [3]
        In 1/sr, for `c` as it is.
    c : float64 [3]
    exponent : float
    cosine : bool
        False: the lobe stands for BRDF times cosine.
    """

    rho: NDArray
    c: NDArray
    exponent: float
    cosine: bool = True


MIRROR = np.array([-1.0, -1.0, 1.0])  # the lobe around the mirrored view


def diffuse_and_lobes(material: "Material") -> tuple[NDArray, list[Lobe]]:
    """The diffuse BRDF [3] in 1/sr, and the lobes that are not black.

    Normalised as in Mitsuba: Lambert is albedo / pi; the modified Phong is kd / pi plus the lobe
    ks (n + 2) / (2 pi) max(r.l, 0)^n.
    """
    if material.lambert is not None:
        return np.asarray(material.lambert.albedo) / np.pi, []
    assert material.phong is not None
    phong = material.phong
    lobe = Lobe(np.asarray(phong.ks) * (phong.exponent + 2) / (2 * np.pi), MIRROR, phong.exponent)
    return np.asarray(phong.kd) / np.pi, [lobe] if lobe.rho.any() else []


def pack_materials(materials: Sequence["Material"]) -> PackedMaterials:
    """The structs of a scene's materials, in their order."""
    packed = np.zeros(max(len(materials), 1), MATERIAL)
    lobes: list[Lobe] = []
    for entry, material in zip(packed, materials, strict=False):
        entry["kd"], own = diffuse_and_lobes(material)
        entry["first_lobe"], entry["n_lobes"] = len(lobes), len(own)
        lobes += own
    exponents, slices = np.unique([lobe.exponent for lobe in lobes], return_inverse=True)
    entries = np.zeros(max(len(lobes), 1), LOBE)
    for entry, lobe, index in zip(entries, lobes, slices, strict=False):
        scale = np.abs(lobe.c).max()
        c = lobe.c / scale
        entry["rho"] = lobe.rho * scale**lobe.exponent
        entry["c"], entry["deficit"] = c, (1 - c) * (1 + c)
        entry["exponent"], entry["slice"], entry["cosine"] = lobe.exponent, index, lobe.cosine
    anisotropic = any(lobe.c[0] != lobe.c[1] for lobe in lobes)
    most = int(packed["n_lobes"].max())
    return PackedMaterials(packed, entries, np.asarray(exponents, np.float64), most, anisotropic)


def bound_lobe(
    entry: NDArray, view: ArrayLike, normal: ArrayLike, tangent: ArrayLike
) -> tuple[NDArray, NDArray]:
    """Axis [n, 3] and colour [n, 3] of one packed lobe at points: the kernel's twin.

    `view`, `normal` and `tangent` are unit vectors [n, 3].
    """
    v, n, x = (np.asarray(a, np.float64) for a in (view, normal, tangent))
    frame = np.stack([x, np.cross(n, x), n], axis=1)
    local = np.einsum("nij,nj->ni", frame, v)
    w = np.einsum("nij,ni->nj", frame, entry["c"].astype(np.float64) * local)
    lost = (entry["deficit"].astype(np.float64) * local**2).sum(axis=1)
    with np.errstate(divide="ignore"):
        amplitude = np.exp(0.5 * entry["exponent"] * np.log1p(-np.minimum(lost, 1)))
    return w / np.linalg.norm(w, axis=1, keepdims=True), entry["rho"] * amplitude[:, None]
