"""The paper's estimator at one point in float64: the twin of kernels/paper.cl.

Equation numbers are those of Meunier et al. 2009. Directions are unit vectors in any common frame.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coslobe.render.scene import Paper
from coslobe.tables.quadtree import shadow_leaves
from coslobe.tables.store import LobeTables
from coslobe.tables.weights import leaf_lobes


class Cap(NamedTuple):
    """A light as a point sees it: unit vector [3] to its centre, sine of the half-angle, up to 60 degrees."""

    axis: NDArray
    sine: float

    @property
    def depth(self) -> float:
        """1 - cosine of the half-angle."""
        return self.sine**2 / (1 + np.sqrt(1 - self.sine**2))

    @property
    def tangent(self) -> float:
        """Tangent of the half-angle."""
        return self.sine / np.sqrt(1 - self.sine**2)


class Reflectance(NamedTuple):
    """A lobe max(axis.l, 0)^exponent; without `cosine` it stands for BRDF times cosine."""

    axis: NDArray
    exponent: float
    cosine: bool = True


@dataclass(frozen=True)
class Term:
    """Light times one part of the reflectance: scale max(axis.l, 0)^exponent, and its integral `whole`.

    `light_amplitude` is what the scale owes to the light's lobe.
    """

    axis: NDArray
    exponent: float
    scale: float
    cosine: bool
    whole: float
    light_amplitude: float


class Shadows(NamedTuple):
    """Lobes of shadow leaves: directions [k, 3], exponents [k], and amplitudes [k] that hold the weights."""

    directions: NDArray
    exponent: NDArray
    amplitude: NDArray


def moment(axis: NDArray, exponent: float, normal: NDArray, cosine: bool) -> float:
    """Integral of a lobe of scale 1, with the cosine to `normal`: 2 pi / (e + 2) (n.p)."""
    return 2 * np.pi / (exponent + 2) * float(normal @ axis) if cosine else 2 * np.pi / (exponent + 1)


def diffuse_term(tables: LobeTables, light: Cap, normal: NDArray, options: Paper) -> Term:
    """The light's lobe (31) with the cosine."""
    e = float(tables.cap.exponent(light.depth))
    scale = 1.0 if options.light_lobes == "unit" else light.sine**2 * (e + 2) / 2
    return Term(light.axis, e, scale, True, scale * moment(light.axis, e, normal, True), scale)


def lobe_term(
    tables: LobeTables, light: Cap, lobe: Reflectance, normal: NDArray, options: Paper, *, cut: bool
) -> Term:
    """The product of the light's lobe with one of the reflectance (15); `cut`: the horizon crosses the light.

    With lights of conserved energy it holds for lobes that are not sharper than the light's.
    """
    e = float(tables.cap.exponent(light.depth))
    cosine = float(np.clip(lobe.axis @ light.axis, -1, 1))
    alpha = float(np.arctan2(np.linalg.norm(np.cross(light.axis, lobe.axis)), cosine))
    product = tables.product.lookup(e, lobe.exponent, alpha)
    across = lobe.axis - cosine * light.axis
    length = np.linalg.norm(across)
    axis = light.axis
    if length > 0:
        axis = np.cos(product.axis_angle) * light.axis + np.sin(product.axis_angle) * across / length
    exponent = float(product.exponent)
    amplitude = 1.0
    if options.light_lobes == "energy":
        half_angle = float(np.arcsin(light.sine))
        cap = tables.lobe_cap.lookup(lobe.exponent, alpha, half_angle)
        mean = cap.along_lobe * lobe.axis + cap.towards_cap * (light.axis - cosine * lobe.axis)
        exact = float(cap.integral)
        if lobe.cosine:
            exact *= max(float(mean @ (lobe.axis if cut else normal)), 0.0)
        unit = float(product.scale_energy) * moment(axis, exponent, axis if cut else normal, lobe.cosine)
        amplitude = exact / unit if unit > 0 else 0.0
    scale = amplitude * float(product.scale_l2 if options.products == "l2" else product.scale_energy)
    whole = scale * moment(axis, exponent, normal, lobe.cosine)
    return Term(axis, exponent, scale, lobe.cosine, whole, amplitude)


def shadows(
    tables: LobeTables, light: Cap, blocked: NDArray, first: NDArray, second: NDArray
) -> Shadows | None:
    """The lobes of a mask's leaves (39); None where the light is covered.

    `blocked` bool [rows, rows]; `first` and `second` are the mask's axes along columns and rows.
    """
    leaves = shadow_leaves(blocked)
    if leaves[0].any():
        return None
    frame = np.stack([first, second, light.axis])
    weights = tables.weights.lookup(len(leaves) - 1, light.sine**2)
    parts = []
    for depth, level in enumerate(leaves):
        lobes = leaf_lobes(tables.cap, light.tangent, depth)
        amplitude = weights[depth] * lobes.amplitude[level]
        parts.append((lobes.directions[level] @ frame, np.full(len(amplitude), lobes.exponent), amplitude))
    directions, exponent, amplitude = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Shadows(directions, exponent, amplitude)


def taken(tables: LobeTables, term: Term, shadow: Shadows, normal: NDArray, options: Paper) -> float:
    """What shadow lobes take from a term: products in the order of Sec. 5.4."""
    cosine = np.clip(shadow.directions @ term.axis, -1, 1)
    chord = np.linalg.norm(shadow.directions - term.axis, axis=1)
    alpha = 2 * np.arcsin(np.minimum(chord / 2, 1))
    product = tables.product.lookup(term.exponent, shadow.exponent, alpha)
    integral = product.integral
    if options.products == "l2":
        integral = product.scale_l2 * 2 * np.pi / (product.exponent + 1)
    if term.cosine:
        sine = np.maximum(np.sqrt(1 - cosine**2), 1e-12)
        along_term = np.where(sine > 1e-9, np.sin(alpha - product.axis_angle) / sine, 0.5)
        along_leaf = np.where(sine > 1e-9, np.sin(product.axis_angle) / sine, 0.5)
        height = along_term * float(normal @ term.axis) + along_leaf * (shadow.directions @ normal)
        integral = integral * height * (product.exponent + 1) / (product.exponent + 2)
    return term.scale * float((shadow.amplitude * integral).sum())
