"""Materials of the scene file as what the kernel evaluates: a diffuse term and lobes."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coslobe.core.errors import InvalidInput
from coslobe.render.fields import LARGEST, Source, Texture
from coslobe.render.layout import LOBE, MATERIAL

if TYPE_CHECKING:
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Material
    from coslobe.render.visible import Visible

# Textures make exponents that differ from point to point, and a point takes the nearest of some slices of the
# lobe-over-cap table. Slices scaled to a lobe's width differ where lobes are broad: by 0.36 % of the highest
# value for 1 % of the exponent below 10, and less and less beyond. Spaced by this step in `_spread`, the
# nearest is off by at most 0.1 %.
SLICE_STEP = 0.0035
BROAD = 30.0


@dataclass(frozen=True)
class PackedMaterials:
    """Materials as the kernel reads them.

    Attributes
    ----------
    materials : MATERIAL [max(n, 1)]
        One of each material, and of a material with textures one for each point that shows it.
    lobes : LOBE [max(m, 1)]
        Of all of them; a material's own are its `lobe_step` apart.
    index : int32 [points]
        The entry of `materials` that each point has.
    exponents : float64 [k]
        The exponents at which slices are needed; lobes refer to the slice of the nearest.
    max_lobes : int
        The most lobes of one material.
    """

    materials: NDArray
    lobes: NDArray
    index: NDArray
    exponents: NDArray
    max_lobes: int


@dataclass(frozen=True)
class Lobe:
    """rho max(cx vx lx + cy vy ly + cz vz lz, 0)^exponent in the tangent frame, Lafortune et al. 1997.

    Attributes
    ----------
    rho : float64 [3] or [n, 3]
        In 1/sr, for `c` as it is.
    c : float64 [3] or [n, 3]
    exponent : float64 [] or [n]
    cosine : bool
        False: the lobe stands for BRDF times cosine.
    """

    rho: NDArray
    c: NDArray
    exponent: NDArray
    cosine: bool = True


MIRROR = np.array([-1.0, -1.0, 1.0])  # the lobe around the mirrored view


@dataclass(frozen=True)
class Values:
    """The numbers of one material at the points that show it: constants, or one value per point.

    Attributes
    ----------
    name : str
        Of the material, for errors.
    texels : dict
        As in `GBuffer`.
    points : int [n]
        Which of all points show the material.
    """

    name: str
    texels: Mapping[Source, NDArray]
    points: NDArray

    def number(self, value: float | tuple[float, ...] | Texture) -> NDArray[np.float64]:
        """A number [] or [n], or a colour [3] or [n, 3], of any sign."""
        if not isinstance(value, Texture):
            return np.asarray(value, np.float64)
        return value.offset + value.scale * self.texels[value.source][self.points]

    def positive(self, value: float | tuple[float, ...] | Texture) -> NDArray[np.float64]:
        """The same, refusing negative values of textures.

        Raises
        ------
        InvalidInput
        """
        number = self.number(value)
        if isinstance(value, Texture) and np.any(number < 0):
            raise InvalidInput(
                f"materials.{self.name}: {value.texture} with scale {value.scale:g} and offset "
                f"{value.offset:g} gives {number.min():g}; must be >= 0",
                "change scale or offset",
            )
        return number


def diffuse_and_lobes(material: "Material", values: Values) -> tuple[NDArray, list[Lobe]]:
    """The diffuse BRDF [3] or [n, 3] in 1/sr, and the lobes that are not black.

    Normalised as in Mitsuba: Lambert is albedo / pi; the modified Phong is kd / pi plus the lobe
    ks (n + 2) / (2 pi) max(r.l, 0)^n. The paper's Phong (24) is BRDF times cosine:
    kd (n.l) + ks max(r.l, 0)^n.
    """
    positive = values.positive
    lobes: list[Lobe] = []
    if material.lambert is not None:
        diffuse = positive(material.lambert.albedo) / np.pi
    elif material.phong is not None:
        diffuse = positive(material.phong.kd) / np.pi
        n = positive(material.phong.exponent)
        rho = positive(material.phong.ks) * (n[..., None] + 2) / (2 * np.pi)
        lobes = [Lobe(rho, MIRROR, n)]
    elif material.phong_1975 is not None:
        diffuse = positive(material.phong_1975.kd)
        ks, n = positive(material.phong_1975.ks), positive(material.phong_1975.exponent)
        lobes = [Lobe(ks, MIRROR, n, cosine=False)]
    else:
        assert material.lafortune is not None
        diffuse = positive(material.lafortune.kd) / np.pi
        for lobe in material.lafortune.lobes:
            c = np.stack(np.broadcast_arrays(*(values.number(component) for component in lobe.c)), axis=-1)
            lobes.append(Lobe(positive(lobe.rho), c, positive(lobe.exponent)))
    return diffuse, [lobe for lobe in lobes if lobe.rho.any()]


def pack_materials(materials: Mapping[str, "Material"], gbuffer: "GBuffer | Visible") -> PackedMaterials:
    """The structs of a scene's materials at the points of `gbuffer`.

    Raises
    ------
    InvalidInput
        A texture gives values that its material cannot have.
    """
    blocks, lobe_blocks = [np.zeros(0, MATERIAL)], [np.zeros(0, LOBE)]
    first = np.zeros(len(materials), np.int32)
    rank = np.zeros(len(gbuffer.material), np.int32)  # among the points of a material with textures
    n_materials = n_lobes = 0
    for number, (name, material) in enumerate(materials.items()):
        varying = bool(material.pictures)
        points = np.flatnonzero(gbuffer.material == number) if varying else np.zeros(1, np.int64)
        diffuse, own = diffuse_and_lobes(material, Values(name, gbuffer.texels, points))
        first[number] = n_materials
        if varying:
            rank[points] = np.arange(len(points))
        block = np.zeros(len(points), MATERIAL)
        block["kd"], block["n_lobes"] = diffuse, len(own)
        block["first_lobe"], block["lobe_step"] = n_lobes + np.arange(len(points)), len(points)
        entries = np.zeros((len(own), len(points)), LOBE)
        for entry, lobe in zip(entries, own, strict=True):
            _fill(entry, lobe, name)
        blocks.append(block)
        lobe_blocks.append(entries.ravel())
        n_materials, n_lobes = n_materials + len(block), n_lobes + entries.size
    index = first[gbuffer.material] + rank if len(first) else rank
    packed, lobes = (_not_empty(np.concatenate(parts)) for parts in (blocks, lobe_blocks))
    exponents, lobes["slice"][:n_lobes] = _slices(lobes["exponent"][:n_lobes])
    return PackedMaterials(packed, lobes, index, exponents, int(packed["n_lobes"].max()))


def _fill(entries: NDArray, lobe: Lobe, name: str) -> None:
    """The structs of one lobe, with c scaled to a largest component of 1, which its colour makes up for."""
    scale = np.abs(lobe.c).max(axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        c = np.where(scale > 0, lobe.c / scale, MIRROR)
        # A power of `scale` alone may leave the range of numbers in either direction.
        power = np.where(scale == 1, 0.0, lobe.exponent[..., None] * np.log(scale))
        log_rho = np.where(scale > 0, np.log(lobe.rho) + power, -np.inf)
    if np.any(log_rho > np.log(LARGEST)):
        size = np.max(log_rho) / np.log(10)
        raise InvalidInput(
            f"materials.{name}: rho |c|^exponent = 10^{size:.0f} is too large",
            "scale c to a largest component of 1",
        )
    entries["rho"] = np.exp(log_rho)
    entries["c"], entries["deficit"] = c, (1 - c) * (1 + c)
    entries["exponent"], entries["cosine"] = lobe.exponent, lobe.cosine


def _slices(exponents: NDArray) -> tuple[NDArray, NDArray]:
    """The exponents of the slices that are needed, and which of them serves each of `exponents` [m]."""
    distinct, index = np.unique(exponents.astype(np.float64), return_inverse=True)
    if len(distinct) < 2:
        return distinct, index
    low, high = _spread(distinct[[0, -1]])
    n = int(np.ceil((high - low) / SLICE_STEP)) + 1
    if len(distinct) <= n:
        return distinct, index
    ratio = np.exp(np.linspace(low, high, n))
    nodes = ((BROAD + 0.5) * ratio - 0.5) / (1 - ratio)
    return nodes, np.rint((_spread(distinct) - low) / (high - low) * (n - 1)).astype(np.int32)[index]


def _spread(exponent: NDArray) -> NDArray:
    """A coordinate in which equal steps change a slice by equal amounts."""
    return np.log((exponent + 0.5) / (exponent + BROAD + 0.5))


def _not_empty(structs: NDArray) -> NDArray:
    """A device buffer must hold something."""
    return structs if len(structs) else np.zeros(1, structs.dtype)


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
