"""Numerical integration of the lobe sums of the paper's estimator: what its products alone cost (Fig. 15).

Lobes of lights, of the reflectance and of shadow leaves are those of the estimator. Their products are
integrated over directions here, where the estimator puts one lobe in the place of each.
"""

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_legendre

from coslobe.core.errors import InvalidInput
from coslobe.evaluate.occlusion import Occluders, Segments, entry_distance
from coslobe.render.mask import directions, frame_around, turns
from coslobe.render.materials import bound_lobe, pack_materials
from coslobe.render.paper import Cap, Reflectance, Shadows, Term, diffuse_term, lobe_term, shadows
from coslobe.tables import lobe
from coslobe.tables.store import LobeTables

if TYPE_CHECKING:
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Scene

RINGS, SECTORS = 32, 32


def integrate_lobe_sums(
    scene: "Scene", gbuffer: "GBuffer", occluders: Occluders, tables: LobeTables
) -> NDArray:
    """Radiance float64 [n, 3] at threshold 0, under lights that fill less than 60 degrees; slow.

    Raises
    ------
    InvalidInput
        A lobe of the reflectance is sharper than a light's, so that the estimator makes no product of them.
    """
    packed = pack_materials(scene.materials, gbuffer)
    options = scene.shading.paper
    radiance = np.zeros((len(gbuffer.position), 3))
    for i, normal in enumerate(gbuffer.shading_normal):
        material = packed.materials[packed.index[i]]
        entries = packed.lobes[material["first_lobe"] :][: material["n_lobes"]]
        tangent = frame_around(normal, 0.0)[0] if gbuffer.tangent is None else gbuffer.tangent[i]
        for number, light in enumerate(scene.lights.values()):
            cap, blocked, axes = mask_at(scene, gbuffer, i, number, occluders)
            shadow = shadows(tables, cap, blocked, *axes)
            if shadow is None or normal @ cap.axis <= -cap.sine:
                continue
            cut = bool(normal @ cap.axis < cap.sine)
            diffuse = diffuse_term(tables, cap, normal, options)
            sums = material["kd"] * _visible(cap, None, diffuse, shadow, normal, tables)
            for entry in entries:
                if options.light_lobes == "energy" and entry["exponent"] > diffuse.exponent:
                    raise InvalidInput(
                        f"a lobe of exponent {entry['exponent']:g} is sharper than a light's: no product",
                        "shading.paper.light_lobes: unit makes products of all lobes",
                    )
                axis, colour = bound_lobe(entry, gbuffer.view[i : i + 1], normal[None], tangent[None])
                reflectance = Reflectance(axis[0], float(entry["exponent"]), bool(entry["cosine"]))
                term = lobe_term(tables, cap, reflectance, normal, options, cut=cut)
                sums = sums + colour[0] * _visible(cap, reflectance, term, shadow, normal, tables)
            radiance[i] += sums * light.sphere.emission()
    return radiance


def mask_at(
    scene: "Scene", gbuffer: "GBuffer", i: int, number: int, occluders: Occluders
) -> tuple[Cap, NDArray, tuple[NDArray, NDArray]]:
    """A light as point i sees it, the blocked cells of its mask, and the mask's axes."""
    one = slice(i, i + 1)
    light = list(scene.lights.values())[number].sphere
    center, radius = np.asarray(light.center, np.float64), light.radius
    offset = center - gbuffer.position[i]
    distance = float(np.linalg.norm(offset))
    cap = Cap(offset / distance, radius / distance)
    turn = float(turns(gbuffer.pixel[one], gbuffer.width)[0])
    axes = frame_around(cap.axis, turn)
    cells = directions(2**scene.shading.mask.depth, cap.tangent) @ np.stack([*axes, cap.axis])
    vectors = tuple(part.reshape(1, -1) for part in np.moveaxis(cells, -1, 0))
    segments = Segments(
        gbuffer.position[one],
        gbuffer.geometric_normal[one],
        gbuffer.object[one],
        number,
        center,
        radius,
        (vectors[0], vectors[1], vectors[2]),
        entry_distance(gbuffer.position[one], (vectors[0], vectors[1], vectors[2]), center, radius),
        np.ones((1, len(cells) ** 2), bool),
    )
    blocked = occluders.blocked(segments).reshape(len(cells), -1)
    blocked |= (cells @ gbuffer.geometric_normal[i] < 0) | (cells @ gbuffer.shading_normal[i] < 0)
    return cap, blocked, axes


def _visible(
    cap: Cap,
    reflectance: Reflectance | None,
    term: Term,
    shadow: Shadows,
    normal: NDArray,
    tables: LobeTables,
) -> float:
    """Light times reflectance times (1 - shadow lobes), integrated."""
    light = Reflectance(cap.axis, float(tables.cap.exponent(cap.depth)), term.cosine)
    others = [light] if reflectance is None else [light, reflectance]
    whole = _integrals(light.axis[None], np.array([light.exponent]), others[1:], normal, term.cosine)[0]
    taken = _integrals(shadow.directions, shadow.exponent, others, normal, term.cosine)
    return term.light_amplitude * max(float(whole - shadow.amplitude @ taken), 0.0)


@cache
def _nodes() -> tuple[NDArray, NDArray]:
    """Gauss-Legendre nodes and weights of the rings."""
    return roots_legendre(RINGS)


def _integrals(
    axes: NDArray, exponents: NDArray, others: list[Reflectance], normal: NDArray, cosine: bool
) -> NDArray:
    """Integrals of lobes [k] times the same `others`, with the cosine or without it.

    Directions are spread as each lobe is: its share within 1 - cosine = x is 1 - (1 - x)^(e + 1).
    """
    nodes, weights = _nodes()
    depth = -np.expm1(np.log((nodes + 1) / 2) / (exponents[:, None] + 1))[..., None]
    turn = (np.arange(SECTORS) + 0.5) * 2 * np.pi / SECTORS
    rim = np.sqrt(depth * (2 - depth))
    values = np.zeros((len(axes), RINGS, SECTORS))
    for k, axis in enumerate(axes):
        t, u = frame_around(axis, 0.0)
        around = np.cos(turn)[:, None] * t + np.sin(turn)[:, None] * u
        vectors = rim[k, :, :, None] * around + (1 - depth[k])[..., None] * axis
        value = vectors @ normal if cosine else np.ones((RINGS, SECTORS))
        for other in others:
            value = value * lobe.evaluate(((vectors - other.axis) ** 2).sum(axis=-1) / 2, other.exponent)
        values[k] = value
    return 2 * np.pi / (exponents + 1) * (values.mean(axis=2) @ (weights / 2))
