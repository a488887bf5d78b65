"""Device functions against their float64 twins, each on every OpenCL device."""

import numpy as np
import pytest

from coslobe.render import mask, unshadowed
from coslobe.render.methods.cosine_lobes import kernel_defines, kernel_units
from coslobe.render.own_spheres import own_radius
from coslobe.render.scene import Mask
from coslobe.tables import lobe, lobe_cap, quadtree, store

pytestmark = pytest.mark.filterwarnings("ignore:Kernel .* retrieved more than once")

WRAPPERS = """
/* Point l of the vector whose last one is that of the work-item. */
#define BESIDE(l) max(i - (PW - 1) + (l), 0)
__kernel void splat_many(__global const float *spheres, __global const float *h, __global uint *bits)
{
    const int i = get_global_id(0);
    ru m[NR];
    for (int k = 0; k < NR; k++) m[k] = 0;
    const float ox = spheres[4 * i], oy = spheres[4 * i + 1], oz = spheres[4 * i + 2], r = spheres[4 * i + 3];
    const float d2 = ox * ox + oy * oy + oz * oz;
    splat_sphere(m, h[i], ox, oy, oz, fmax(d2 - r * r, 0.0f), fmin(r * r, d2));
    for (int k = 0; k < NR; k++) RU_STORE(m[k], i * NR + k, bits);
}
__kernel void horizon_many(__global const float *n, __global const float *h, __global uint *bits)
{
    const int i = get_global_id(0);
    ru m[NR];
    for (int k = 0; k < NR; k++) m[k] = 0;
    splat_horizon(m, h[i], (float3)(n[3 * i], n[3 * i + 1], n[3 * i + 2]));
    for (int k = 0; k < NR; k++) RU_STORE(m[k], i * NR + k, bits);
}
__kernel void near_light_many(__global const float *spheres, __global const float *h,
                              __global const float *light, __global uint *bits)
{
    const int i = get_global_id(0);
    ru all[NR], m[NR];
    for (int k = 0; k < NR; k++) { all[k] = 0; m[k] = 0; }
    const float ox = spheres[4 * i], oy = spheres[4 * i + 1], oz = spheres[4 * i + 2], r = spheres[4 * i + 3];
    const float d2 = ox * ox + oy * oy + oz * oz, rho2 = fmin(r * r, d2);
    splat_sphere(all, h[i], ox, oy, oz, fmax(d2 - r * r, 0.0f), rho2);
    const float3 centre = (float3)(light[4 * i], light[4 * i + 1], light[4 * i + 2]);
    splat_near_light(m, all, h[i], ox, oy, oz, rho2, centre, light[4 * i + 3]);
    for (int k = 0; k < NR; k++) RU_STORE(m[k], i * NR + k, bits);
}
__kernel void moments_many(__global const uint *bits, __global const float *h, __global float *out)
{
    const int i = get_global_id(0);
    ru m[NR];
    for (int k = 0; k < NR; k++) m[k] = RU_LOAD(i * NR + k, bits);
    const float3 v = bit_moments(m, h[i]);
    out[3 * i] = v.x; out[3 * i + 1] = v.y; out[3 * i + 2] = v.z;
}
__kernel void lobe_many(__global const float *q, __global const float *e, __global float *out)
{
    const int i = get_global_id(0);
    CAT(vstore, RW)(lobe_rows((rf)(q[i]), e[i]), i, out);
}
__kernel void own_radius_many(__global const float *radius, __global const float *outside,
                              __global const float *height, __global const float *distance,
                              __global float *out)
{
    const int i = get_global_id(0);
    const vf v = own_radius((vf)(radius[i]), (vf)(outside[i]), (vf)(height[i]), (vf)(distance[i]));
    float lanes[VW];
    VF_STORE(v, lanes);
    const float one = own_radius_1(radius[i], outside[i], height[i], distance[i]);
    out[i] = fabs(one - lanes[VW - 1]) <= 1e-6f ? one : NAN;
}
__kernel void lambert_many(__global const float *cosine, __global const float *q, __global float *out)
{
    const int i = get_global_id(0);
    pf c, q2;
    for (int l = 0; l < PW; l++) {
        LANE(c, l) = cosine[BESIDE(l)];
        LANE(q2, l) = q[BESIDE(l)];
    }
    pf all = lambert_sphere(c, q2);
    out[i] = LANE(all, PW - 1);
}
__kernel void frame_many(__global const float *axis, __global const float *turn, __global float *out)
{
    const int i = get_global_id(0);
    float3 t, u;
    frame_around((float3)(axis[3 * i], axis[3 * i + 1], axis[3 * i + 2]), turn[i], &t, &u);
    out[6 * i] = t.x; out[6 * i + 1] = t.y; out[6 * i + 2] = t.z;
    out[6 * i + 3] = u.x; out[6 * i + 4] = u.y; out[6 * i + 5] = u.z;
}
__kernel void lobe_cap_many(__global const float4 *slices, __global const float *arguments,
                            __global float *out)
{
    const int i = get_global_id(0);
    pf v[11];
    for (int l = 0; l < PW; l++)
        for (int k = 0; k < 11; k++)
            LANE(v[k], l) = arguments[11 * BESIDE(l) + k];
    const pf3 r = {v[2], v[3], (pf)(0.0f)}, n = {v[4], v[5], v[6]}, a = {v[7], v[8], v[9]};
    const pf chord = sin(0.5f * v[10]);
    pf all = lobe_over_cap(slices, TO_PI(v[0]), v[1], r, n, a, sin(v[10]), 2.0f * chord * chord, (pi)(1));
    out[i] = LANE(all, PW - 1);
}
"""


def program(device, depth=5, mode="centre"):
    units = [*kernel_units("accurate"), ("wrappers", WRAPPERS)]
    return device.build(units, kernel_defines(device.info.vector_width, Mask(depth=depth, mode=mode), 1))


def run(device, kernel, inputs, shape, dtype):
    """Launch over shape[0] work-items; float inputs go to the device as float32."""
    out = device.allocate(int(np.prod(shape)) * np.dtype(dtype).itemsize)
    buffers = [
        device.upload(np.asarray(array, np.float32 if array.dtype == float else array.dtype))
        for array in inputs
    ]
    device.launch(kernel, shape[0], None, *buffers, out)
    return device.download(out, shape, dtype)


def test_own_radius(device):
    rng = np.random.default_rng(10)
    n = 5000
    radius, outside = rng.uniform(0.05, 1, n), rng.choice([0.0, 0.02, 0.3], n)
    distance = radius * rng.uniform(0.1, 3, n)
    height = distance * rng.uniform(-1, 1, n)
    inputs = [v.astype(np.float32).astype(float) for v in (radius, outside, height, distance)]
    found = run(device, program(device).own_radius_many, inputs, (n,), np.float32)
    expected = own_radius(*inputs)
    edge = np.abs(inputs[3] - inputs[0] - inputs[1] * np.clip(0.25 - inputs[2] / inputs[0], 0, 1)) < 1e-5
    edge |= np.abs(inputs[2] + inputs[0]) < 1e-5  # on the rule's own steps either answer is right
    np.testing.assert_allclose(found[~edge], expected[~edge], atol=2e-5)
    assert 0.1 < np.mean(expected == 0) < 0.9


def random_spheres(rng, n):
    """Centres and radii of blockers of all kinds around a light along the third axis, float64 [n, 4]."""
    direction = rng.normal(size=(n, 3))
    towards = rng.random(n) < 0.7
    direction[towards] = [0, 0, 1] + rng.normal(size=(towards.sum(), 3)) * 10 ** rng.uniform(
        -2, 0.3, (towards.sum(), 1)
    )
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    distance = 10 ** rng.uniform(-2, 2, n)
    radius = distance * 10 ** rng.uniform(-2.5, 0.5, n)  # above 1: the point is inside
    return (
        np.concatenate([direction * distance[:, None], radius[:, None]], axis=1)
        .astype(np.float32)
        .astype(float)
    )


def disagreement(found, spheres, h, rows):
    """Cells that differ from the cone test with a centre more than 1 % of a cell away from the outline."""
    wrong = 0
    for bits, (x, y, z, r), half in zip(mask.unpack(found, rows), spheres, h, strict=True):
        centre = np.array([x, y, z])
        expected = mask.covered_by_sphere(rows, half, centre, r)
        along = mask.directions(rows, half) @ centre
        tangent = np.sqrt(max(centre @ centre - r * r, 0))
        rho = min(r, np.linalg.norm(centre))
        slack = 0.01 * (2 * half / rows) * rho + 2e-6 * np.linalg.norm(centre)
        wrong += np.count_nonzero((bits != expected) & (np.abs(along - tangent) > slack))
    return wrong


@pytest.mark.parametrize("depth", [2, 3, 4, 5])
def test_splat_of_spheres_of_all_kinds(device, depth):
    rng = np.random.default_rng(depth)
    n, rows = 4000, 2**depth
    spheres, h = random_spheres(rng, n), 10 ** rng.uniform(-3, np.log10(1.7), n)
    found = run(device, program(device, depth).splat_many, [spheres, h], (n, rows), np.uint32)
    assert disagreement(found, spheres, h.astype(np.float32).astype(float), rows) == 0


def test_splat_where_the_quadratic_degenerates(device):
    """Caps whose edge contains the frame's first axis, where the leading coefficient vanishes."""
    rng = np.random.default_rng(0)
    n = 2000
    angle = rng.uniform(0.05, 1.5, n)
    azimuth = rng.uniform(0, 2 * np.pi, n)
    tilt = rng.choice([-1e-7, 0, 1e-7, 1e-4], n)
    # The angle between centre and first axis equals the cap's half-angle, up to `tilt`.
    centre = np.stack(
        [
            np.cos(angle + tilt),
            np.sin(angle + tilt) * np.cos(azimuth),
            np.sin(angle + tilt) * np.sin(azimuth),
        ],
        axis=1,
    )
    spheres = np.concatenate([centre, np.sin(angle)[:, None]], axis=1).astype(np.float32).astype(float)
    h = np.full(n, 0.4)
    found = run(device, program(device).splat_many, [spheres, h], (n, 32), np.uint32)
    assert disagreement(found, spheres, h.astype(np.float32).astype(float), 32) == 0


def test_aggressive_and_conservative_masks_enclose_the_centred_one(device):
    rng = np.random.default_rng(7)
    spheres, h = random_spheres(rng, 2000), np.full(2000, 0.2)
    cover = {}
    for mode in ("aggressive", "centre", "conservative"):
        bits = run(device, program(device, 5, mode).splat_many, [spheres, h], (2000, 32), np.uint32)
        cover[mode] = mask.unpack(bits, 32)
    assert not np.any(cover["aggressive"] & ~cover["centre"])
    assert not np.any(cover["centre"] & ~cover["conservative"])
    assert cover["aggressive"].sum() < cover["centre"].sum() < cover["conservative"].sum()


def test_horizon(device):
    rng = np.random.default_rng(2)
    n = 3000
    normals = rng.normal(size=(n, 3)) * [1, 1, 0.2]
    normals[:30, 0] = 0
    normals[30:40, :2] = 0
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32).astype(float)
    h = 10 ** rng.uniform(-3, 0.2, n).astype(np.float32).astype(float)
    found = mask.unpack(run(device, program(device).horizon_many, [normals, h], (n, 32), np.uint32), 32)
    for bits, normal, half in zip(found, normals, h, strict=True):
        height = mask.directions(32, half) @ normal
        clear = np.abs(height) > 0.01 * (2 * half / 32) * np.linalg.norm(normal[:2]) + 1e-6
        np.testing.assert_array_equal(bits[clear], (height < 0)[clear])


@pytest.mark.parametrize("offset", [0, 0.4])
def test_blockers_that_reach_into_the_light(device, offset):
    """Only where the ray meets the sphere before the light does it block; the light may be off the axis."""
    rng = np.random.default_rng(4)
    n = 500
    d, radius = 2.0, 0.5
    sine = radius / d
    h = np.full(n, sine / np.sqrt(1 - sine**2))
    centre = rng.normal(size=(n, 3)) * 0.4 + [0, 0, 1.9]
    r = rng.uniform(0.05, 0.6, n)
    spheres = np.concatenate([centre, r[:, None]], axis=1).astype(np.float32).astype(float)
    centre_of_light = np.array([offset, -offset / 2, np.sqrt(d * d - 1.25 * offset**2)])
    light = np.tile([*centre_of_light, radius**2], (n, 1))
    found = mask.unpack(
        run(device, program(device).near_light_many, [spheres, h, light], (n, 32), np.uint32), 32
    )
    blocked_somewhere = 0
    for bits, (x, y, z, size), half in zip(found, spheres, h, strict=True):
        directions = mask.directions(32, half)
        along = directions @ [x, y, z]
        tau = x * x + y * y + z * z - size * size
        meets = (along > 0) & (along**2 >= max(tau, 0))
        entry = along - np.sqrt(np.maximum(along**2 - max(tau, 0), 0))
        towards_light = directions @ centre_of_light
        beyond = towards_light**2 - (d * d - radius**2)
        disk = beyond > 1e-3
        light_entry = towards_light - np.sqrt(np.maximum(beyond, 0))
        expected = meets & (entry < light_entry)
        clear = disk & (np.abs(along**2 - tau) > 2e-3) & (np.abs(entry - light_entry) > 1e-4)
        np.testing.assert_array_equal(bits[clear], expected[clear])
        blocked_somewhere += expected[disk].any()
    assert 0 < blocked_somewhere < n  # the case occurs both ways


@pytest.mark.parametrize("depth", [2, 4, 5])
def test_moments_of_bits(device, depth):
    rng = np.random.default_rng(1)
    n, rows = 500, 2**depth
    cells = rng.random((n, rows, rows)) < rng.random((n, 1, 1))
    bits = np.stack([mask.pack(c) for c in cells])
    h = rng.uniform(0.01, 1, n)
    found = run(device, program(device, depth).moments_many, [bits, h], (n, 3), np.float32)
    x = quadtree.cell_centres(rows)
    expected = np.stack(
        [cells.sum(axis=(1, 2)), (cells * x).sum(axis=(1, 2)) * h, (cells * x[:, None]).sum(axis=(1, 2)) * h],
        axis=1,
    )
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=2e-4)  # sums of up to 1024 floats


def test_lobe_values(device):
    rng = np.random.default_rng(5)
    n = 20000
    e = np.concatenate([10 ** rng.uniform(-2, 5, n // 2), rng.choice([0, 1, 2, 50, 1000, 1e5], n // 2)])
    q = np.minimum(10 ** rng.uniform(-9, 0.3, n), 2).astype(np.float32).astype(float)
    e = e.astype(np.float32).astype(float)
    found = run(device, program(device).lobe_many, [q, e], (n, min(device.info.vector_width, 32)), np.float32)
    expected = lobe.evaluate(q, e)
    assert np.all(found == found[:, :1])
    large = expected > 1e-30
    # log(1 - q) is accurate to 1e-7 relative, which the exponential turns into 1e-7 times its argument.
    tolerance = 1e-6 + 4e-7 * np.abs(np.log(expected[large]))
    assert np.all(np.abs(found[large, 0] / expected[large] - 1) <= tolerance)
    assert np.all(found[expected == 0] == 0)
    assert np.all(found[~large] <= 2e-30)


def test_lambert_closed_form(device):
    rng = np.random.default_rng(6)
    n = 20000
    cosine = np.concatenate([rng.uniform(-1, 1, n - 4), [1, -1, 0, 1]])
    q = np.concatenate([10 ** rng.uniform(-8, -1e-3, n - 4), [0.5, 0.5, 0.5, 0.999999]])
    cosine, q = (v.astype(np.float32).astype(float) for v in (cosine, q))
    found = run(device, program(device).lambert_many, [cosine, q], (n,), np.float32)
    expected = unshadowed.lambert_sphere(cosine, q)
    # Relative to the whole sphere's irradiance: the horizon's part cancels in float32 for small lights.
    np.testing.assert_allclose(found / (np.pi * q), expected / (np.pi * q), atol=2e-4)
    above = cosine**2 > 1.0001 * q
    np.testing.assert_allclose(found[above], expected[above], rtol=2e-6)
    assert np.all(found >= 0)


def test_frames(device):
    rng = np.random.default_rng(8)
    axes = rng.normal(size=(1000, 3))
    axes[:2] = [[0, 0, 1], [0, 0, -1]]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turn = rng.random(1000)
    found = run(device, program(device).frame_many, [axes, turn], (1000, 6), np.float32)
    for axis, angle, vectors in zip(axes, turn, found, strict=True):
        np.testing.assert_allclose(vectors, np.concatenate(mask.frame_around(axis, angle)), atol=3e-6)
        basis = np.stack([vectors[:3], vectors[3:], axis])
        np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=2e-6)
        assert np.linalg.det(basis) == pytest.approx(1, abs=1e-5)


def test_lobe_over_cap(device):
    rng = np.random.default_rng(9)
    n = 5000
    exponents = np.array([0.7, 5.0, 50.0, 1000.0, 3e4])
    which = rng.integers(0, len(exponents), n)
    e = exponents[which]
    alpha = 10 ** rng.uniform(-3, np.log10(1.04), n)
    _, last = lobe_cap.angle_range(e, alpha)
    theta = rng.uniform(0, 1, n) * np.minimum(last, np.pi)
    azimuth = rng.uniform(0, 2 * np.pi, n)
    mirror = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(n)], axis=1)
    across = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(n)], axis=1)
    axis = np.cos(theta)[:, None] * mirror + np.sin(theta)[:, None] * across
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    slices = store.cached().lobe_cap.slice(exponents)
    arguments = np.concatenate(
        [which[:, None], e[:, None], mirror[:, :2], normal, axis, alpha[:, None]], axis=1
    )
    found = run(device, program(device).lobe_cap_many, [slices, arguments], (n,), np.float32)
    m = lobe_cap.lookup_slice(slices.astype(float), which, e, theta, alpha)
    direction = m.along_lobe[:, None] * mirror + m.towards_cap[:, None] * (
        axis - np.cos(theta)[:, None] * mirror
    )
    expected = m.integral * np.maximum(np.einsum("ij,ij->i", normal, direction), 0)
    peak = lobe_cap.scale(e, alpha)
    # Float32 rounds the axes to 6e-8, which moves theta by that much against the lobe's width.
    np.testing.assert_allclose(found / peak, expected / peak, atol=3e-5)
