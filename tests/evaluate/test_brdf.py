"""The reference's BRDFs: reciprocal, with the albedos of closed forms, conserving energy."""

import numpy as np
import pytest
from scipy.special import roots_legendre

from coslobe.evaluate.brdf import Lobe, brdf_terms
from coslobe.render.gbuffer import GBuffer
from coslobe.render.scene import Material
from coslobe.render.surface import perpendicular
from coslobe.tables.lobe import product_integral

MATERIALS = {
    "lambert": {"lambert": {"albedo": [0.8, 0.5, 0.1]}},
    "phong": {"phong": {"kd": [0.3, 0.2, 0.1], "ks": [0.1, 0.4, 0.6], "exponent": 17}},
    "phong_1975": {"phong_1975": {"kd": [0.1, 0.2, 0.1], "ks": [0.1, 0.3, 0.2], "exponent": 9}},
    "off-specular": {"lafortune": {"kd": 0.1, "lobes": [{"rho": 0.5, "c": [-1, -1, 0.6], "exponent": 6}]}},
    "retro-reflective": {"lafortune": {"kd": 0.2, "lobes": [{"rho": 0.4, "c": [1, 1, 0.9], "exponent": 3}]}},
    "anisotropic": {
        "lafortune": {
            "kd": [0.1, 0, 0],
            "lobes": [
                {"rho": [0.3, 0.2, 0.1], "c": [-1.1, -0.4, 0.8], "exponent": 5},
                {"rho": 0.1, "c": [-0.2, 0.9, 0.1], "exponent": 1.5},
            ],
        }
    },
}


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def points(normal, view, tangent) -> GBuffer:
    n = len(normal)
    zeros = np.zeros(n, np.int32)
    return GBuffer(
        position=np.zeros((n, 3)),
        geometric_normal=normal,
        shading_normal=normal,
        view=view,
        object=zeros,
        material=zeros,
        pixel=np.arange(n),
        depth=np.ones(n),
        triangle=zeros,
        weights=np.full((n, 3), 1 / 3),
        width=n,
        height=1,
        samples=1,
        tangent=tangent,
    )


def reflected(material, gbuffer, light):
    """Sums of a BRDF's terms for one or more directions [n, s, 3]: with the cosine and without, [n, s, 3]."""
    with_cosine = without = 0.0
    height = np.maximum(np.einsum("nc,nsc->ns", gbuffer.shading_normal, light), 0)
    for term in brdf_terms(material, gbuffer, np.arange(len(gbuffer.position))):
        value = term.values(tuple(np.moveaxis(light, -1, 0)))[..., None] * term.colour[:, None]
        with_cosine = with_cosine + value * (height[..., None] if term.cosine else height[..., None] > 0)
        without = without + value
    return with_cosine, without


@pytest.mark.parametrize("name", [name for name in MATERIALS if name != "phong_1975"])
def test_brdfs_are_reciprocal(name):
    rng = np.random.default_rng(0)
    n = 200
    normal = unit(rng.normal(size=(n, 3)))
    view, light = (unit(rng.normal(size=(n, 3)) + 1.5 * normal) for _ in range(2))
    tangent = perpendicular(rng.normal(size=(n, 3)), normal)
    material = Material.model_validate(MATERIALS[name])
    there = reflected(material, points(normal, view, tangent), light[:, None])[1]
    back = reflected(material, points(normal, light, tangent), view[:, None])[1]
    np.testing.assert_allclose(there, back, rtol=1e-12, atol=1e-15)
    assert np.ptp(there[..., 0]) > 0 or name == "lambert"


@pytest.mark.parametrize("name", MATERIALS)
def test_albedos_by_quadrature_are_those_of_closed_forms(name):
    """A lobe of amplitude |w|^n around w, times a cosine lobe of exponent 1 (or 0) around the normal."""
    rng = np.random.default_rng(1)
    n = 12
    normal = np.tile([0.0, 0.0, 1.0], (n, 1))
    view = unit(rng.normal(size=(n, 3)) + 1.5 * normal)
    view[:, 2] = np.abs(view[:, 2])
    tangent = perpendicular(rng.normal(size=(n, 3)), normal)
    gbuffer = points(normal, view, tangent)
    material = Material.model_validate(MATERIALS[name])
    exact = np.zeros((n, 3))
    for term in brdf_terms(material, gbuffer, np.arange(n)):
        if isinstance(term, Lobe):
            length = np.linalg.norm(term.axis, axis=1)
            angle = np.arccos(np.clip(term.axis[:, 2] / length, -1, 1))
            other = 1.0 if term.cosine else 0.0
            exact += (length**term.exponent * product_integral(term.exponent, other, angle))[
                :, None
            ] * term.colour
        else:
            exact += np.pi * term.colour
    z, weight = roots_legendre(200)
    z, weight = (z + 1) / 2, weight / 2
    turn = (np.arange(240) + 0.5) / 240 * 2 * np.pi
    rim = np.sqrt(1 - z * z)[:, None]
    light = np.stack([rim * np.cos(turn), rim * np.sin(turn), z[:, None] + 0 * turn], axis=-1).reshape(-1, 3)
    values = reflected(material, gbuffer, np.broadcast_to(light, (n, *light.shape)))[0]
    found = np.einsum("nsc,s->nc", values, np.repeat(weight, 240)) * 2 * np.pi / 240
    np.testing.assert_allclose(found, exact, rtol=1e-3)  # kinks where lobes end


@pytest.mark.parametrize("exponent", [0, 1, 20, 1000])
def test_the_modified_phong_reflects_no_more_than_it_receives(exponent):
    """kd + ks seen along the normal, and less from elsewhere, where the horizon cuts the lobe."""
    angle = np.linspace(0, np.pi / 2, 50)
    specular = (exponent + 2) / (2 * np.pi) * product_integral(float(exponent), 1.0, angle)
    assert specular[0] == pytest.approx(1, rel=1e-9)
    assert np.all(np.diff(specular) < 1e-9)


def test_a_mirror_lafortune_is_a_phong():
    rng = np.random.default_rng(2)
    n, e = 300, 50
    normal = unit(rng.normal(size=(n, 3)))
    view, light = (unit(rng.normal(size=(n, 3)) + 1.5 * normal) for _ in range(2))
    gbuffer = points(normal, view, None)
    rho = 0.4 * (e + 2) / (2 * np.pi)
    lafortune = {"kd": 0.3, "lobes": [{"rho": rho, "c": [-1, -1, 1], "exponent": e}]}
    a, b = (
        reflected(Material.model_validate(part), gbuffer, light[:, None])[1]
        for part in ({"phong": {"kd": 0.3, "ks": 0.4, "exponent": e}}, {"lafortune": lafortune})
    )
    np.testing.assert_allclose(a, b, rtol=1e-12)


@pytest.mark.parametrize("exponent", [0.5, 16600])
def test_directions_of_a_lobe_are_distributed_as_the_lobe(exponent):
    """The share (a.l)^(e + 1) lies farther from the axis than l: uniform, for every lobe."""
    from coslobe.evaluate.sampling import square_to_lobe

    rng = np.random.default_rng(3)
    axis = rng.normal(size=(3, 3))
    u, v = rng.random((2, 3, 20000))
    light = np.stack(square_to_lobe(u, v, axis, np.full(3, exponent)), axis=-1)
    np.testing.assert_allclose(np.linalg.norm(light, axis=-1), 1, atol=1e-12)
    cosine = np.einsum("nc,nsc->ns", unit(axis), light)
    share = np.sort(np.exp((exponent + 1) * np.log(cosine)), axis=1)
    # Kolmogorov and Smirnov: 1.95 / sqrt(n) is exceeded once in a thousand.
    assert np.max(np.abs(share - np.arange(20000) / 20000)) < 1.95 / np.sqrt(20000)
    across = np.einsum("nsc,nc->ns", light, perpendicular(rng.normal(size=(3, 3)), unit(axis)))
    assert np.all(np.abs(across.mean(axis=1)) < 4.5 * across.std(axis=1) / np.sqrt(20000))
