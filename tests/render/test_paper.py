"""The paper's estimator: its twin, closed forms, the same lobe sums integrated, and the reference."""

import numpy as np
import pytest

from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.lobe_sums import integrate_lobe_sums, mask_at
from coslobe.evaluate.occlusion import NONE, Occluders, Spheres
from coslobe.evaluate.sampling import strata
from coslobe.render import paper
from coslobe.render.assets import Blockers
from coslobe.render.gbuffer import GBuffer
from coslobe.render.methods.cosine_lobes import CosineLobes, kernel_defines, kernel_units
from coslobe.render.scene import Mask, Paper, Scene
from coslobe.tables import layout, store

pytestmark = pytest.mark.filterwarnings("ignore:Kernel .* retrieved more than once")

ENERGY = Paper()
AS_IN_THE_PAPER = Paper(light_lobes="unit", products="l2")

WRAPPERS = """
__kernel void products_many(__global const float *table, __global const float *e1, __global const float *e2,
                            __global const float *q, __global float *out)
{
    const int i = get_global_id(0);
    rf along1, along2, exponent;
    float lanes[4][RW];
    RF_STORE(products(table, e1[i], (rf)(e2[i]), (rf)(q[i]), RW, &along1, &along2, &exponent), lanes[0]);
    RF_STORE(along1, lanes[1]); RF_STORE(along2, lanes[2]); RF_STORE(exponent, lanes[3]);
    for (int k = 0; k < 4; k++) out[4 * i + k] = lanes[k][RW - 1] == lanes[k][0] ? lanes[k][0] : NAN;
}
"""


@pytest.fixture(scope="module")
def tables():
    return store.cached()


@pytest.fixture(scope="session")
def method(device):
    return CosineLobes(device)


EYE = np.array([-2.0, 1.5, 2.5])
KEY = ([1.0, 2.2, 0.6], 0.3, 30.0)
MATT, GLOSSY = 0, 1


def scene(lights, *, phong=None, **shading) -> Scene:
    """A white matt and a glossy material, and the given (centre, radius, radiance) lights."""
    phong = phong or {"kd": 0.2, "ks": 0.5, "exponent": 50}
    spheres = [{"center": list(c), "radius": r, "radiance": radiance} for c, r, radiance in lights]
    return Scene.model_validate(
        {
            "camera": {"look_at": {"origin": list(EYE), "target": [0, 0, 0]}, "fov": 40},
            "image": {"width": 8, "height": 8},
            "shading": shading,
            "materials": {"matt": {"lambert": {"albedo": 1}}, "glossy": {"phong": phong}},
            "lights": {f"light{j}": {"sphere": sphere} for j, sphere in enumerate(spheres)},
            "objects": {},
        }
    )


def paper_scene(lights, options=ENERGY, **keys) -> Scene:
    return scene(lights, estimator="paper", paper=options.model_dump(), **keys)


def points(position, normal=(0.0, 1.0, 0.0), *, material=MATT) -> GBuffer:
    position = np.atleast_2d(np.asarray(position, np.float64))
    n = len(position)
    normals = np.broadcast_to(normal, (n, 3)) / np.linalg.norm(normal, axis=-1, keepdims=True)
    view = EYE - position
    distance = np.linalg.norm(view, axis=1)
    zeros = np.zeros(n, np.int32)
    return GBuffer(
        position, normals, normals, view / distance[:, None], zeros, zeros + material,
        np.arange(n, dtype=np.int32), distance, zeros, np.tile([1.0, 0.0, 0.0], (n, 1)), n, 1, 1,
    )  # fmt: skip


def plane_grid(n=24, size=3.0):
    x = (np.arange(n) + 0.5) / n * size - size / 2
    return np.stack([np.repeat(x, n), np.zeros(n * n), np.tile(x, n)], axis=1)


def blockers(*spheres) -> Blockers:
    array = np.asarray(spheres, np.float64).reshape(-1, 4)
    n = len(array)
    return Blockers(array[:, :3], array[:, 3], np.zeros(n), np.full(n, 5, np.int32))


def random_blockers(rng, n=40):
    centre = rng.uniform([-0.5, 0.2, -0.5], [0.5, 1.0, 0.5], (n, 3))
    return blockers(*np.concatenate([centre, rng.uniform(0.03, 0.15, (n, 1))], axis=1))


def occluders(blocking):
    n = len(blocking.radii)
    parts = (blocking.centers, blocking.radii, blocking.outside, blocking.owner, np.full(n, NONE, np.int32))
    return Occluders(Spheres(*parts))


@pytest.mark.parametrize("options", [ENERGY, AS_IN_THE_PAPER], ids=["energy", "l2"])
def test_rows_of_products(device, tables, options):
    """Tolerance: 2e-5, and 1e-6 of the coaxial product, since near right angles logarithms lose digits."""
    rng = np.random.default_rng(0)
    n = 4000
    e1, e2 = 10 ** rng.uniform(-1, 5, n), 10 ** rng.uniform(0, 5, n)
    reach = np.minimum(6 * np.sqrt(1 / (e1 + 1) + 1 / (e2 + 1)), 3.0)
    q = 2 * np.sin(reach * rng.uniform(0, 1, n) / 2) ** 2
    q[:20] = 0
    arrays = [x.astype(np.float32) for x in (e1, e2, q)]
    needed = ("vector.cl", "points.cl", "elementary.cl", "lobe.cl", "tables.cl", "products.cl")
    units = [*(unit for unit in kernel_units("paper") if unit[0] in needed), ("wrappers", WRAPPERS)]
    program = device.build(units, kernel_defines(device.info.vector_width, Mask(), 0, paper=options))
    out = device.allocate(n * 16)
    table = device.upload(layout.samples(tables)["product"])
    device.launch(program.products_many, n, None, table, *map(device.upload, arrays), out)
    found = device.download(out, (n, 4), np.float32)
    e1, e2, q = (x.astype(float) for x in arrays)
    alpha = 2 * np.arcsin(np.sqrt(q / 2))
    twin = tables.product.lookup(e1, e2, alpha)
    integral = twin.integral
    if options.products == "l2":
        integral = twin.scale_l2 * 2 * np.pi / (twin.exponent + 1)
    coaxial = 2 * np.pi / (e1 + e2 + 1)
    assert np.all(np.abs(found[:, 0] - integral) <= 2e-5 * integral + 1e-6 * coaxial)
    np.testing.assert_allclose(found[:, 3] + 0.5, twin.exponent + 0.5, rtol=2e-5)
    axis = found[:, 1] + found[:, 2] * np.cos(alpha), found[:, 2] * np.sin(alpha)
    np.testing.assert_allclose(axis[0], np.cos(twin.axis_angle), atol=2e-6)
    np.testing.assert_allclose(axis[1], np.sin(twin.axis_angle), atol=2e-6)


@pytest.mark.parametrize("options", [ENERGY, AS_IN_THE_PAPER], ids=["energy", "as-in-the-paper"])
@pytest.mark.parametrize("depth", [2, 5])
def test_points_match_the_twin(method, tables, options, depth):
    """Radiance of both terms from masks that the twin rasterises itself.

    A cell whose centre lies on an outline may fall to either side: a few points differ by a cell's share.
    """
    rng = np.random.default_rng(1)
    normals = np.concatenate([np.tile([0.0, 1.0, 0.0], (81, 1)), rng.normal(size=(40, 3))])  # horizons, too
    at = points(np.concatenate([plane_grid(9), rng.uniform(-1, 1, (40, 3))]), normals, material=GLOSSY)
    blocking = random_blockers(rng)
    kd, ks, exponent = 0.5, 0.2, 60.0
    of = paper_scene([KEY], options, phong={"kd": kd, "ks": ks, "exponent": exponent}, mask={"depth": depth})
    found = method.shade(of, at, blocking).radiance[:, 0]
    expected = np.zeros(len(found))
    for i, normal in enumerate(at.shading_normal):
        cap, blocked, axes = mask_at(of, at, i, 0, occluders(blocking))
        shadow = paper.shadows(tables, cap, blocked, *axes)
        if shadow is None or normal @ cap.axis <= -cap.sine:
            continue
        mirror = 2 * (at.view[i] @ normal) * normal - at.view[i]
        cut = bool(normal @ cap.axis < cap.sine)
        lobe = paper.lobe_term(tables, cap, paper.Reflectance(mirror, exponent), normal, options, cut=cut)
        diffuse = paper.diffuse_term(tables, cap, normal, options)
        for colour, term in ((kd / np.pi, diffuse), (ks * (exponent + 2) / (2 * np.pi), lobe)):
            left = term.whole - paper.taken(tables, term, shadow, normal, options)
            expected[i] += KEY[2] * colour * max(left, 0.0)
    assert 0.1 < np.mean(expected == 0) < 0.9
    error = np.abs(found - expected) / expected.max()
    assert np.quantile(error, 0.9) < 2e-4
    assert error.max() < (0.2 if depth == 2 else 0.01)


def test_unoccluded_light_is_that_of_the_accurate_estimator(method):
    """The amplitude of lights conserves the energy of every product, diffuse and glossy."""
    rng = np.random.default_rng(2)
    at = points(plane_grid(16), material=GLOSSY)
    for exponent in (0.0, 20.0, 5000.0):
        phong = {"kd": 0.2, "ks": 0.5, "exponent": exponent}
        light = [(rng.uniform([-1, 1, -1], [1, 3, 1]), 10 ** rng.uniform(-2, -0.3), 5.0)]
        found = method.shade(paper_scene(light, phong=phong), at, blockers()).radiance
        exact = method.shade(scene(light, phong=phong), at, blockers()).radiance
        np.testing.assert_allclose(found, exact, rtol=1e-5, atol=1e-6 * exact.max())


def test_light_lobes_of_amplitude_one_are_a_little_brighter(method):
    """Theory, section 3: by 4 % in the limit of small lights, where their lobe has e (1 - cos) = 0.9613."""
    at = points(plane_grid(4, 0.1))
    light = [([0, 3, 0], 0.01, 1e4)]
    unit = method.shade(paper_scene(light, Paper(light_lobes="unit")), at, blockers()).radiance
    exact = method.shade(scene(light), at, blockers()).radiance
    np.testing.assert_allclose(unit / exact, 1 / 0.9613, rtol=1e-3)


@pytest.mark.parametrize("depth", [2, 5])
@pytest.mark.parametrize("options", [ENERGY, AS_IN_THE_PAPER], ids=["energy", "as-in-the-paper"])
def test_a_covered_light_is_exactly_dark(method, depth, options):
    """By one sphere, by one that just covers the light, and by many that do so together."""
    at = points(plane_grid(8, 0.2), material=GLOSSY)
    of = paper_scene([([0, 3, 0], 0.3, 10.0)], options, mask={"depth": depth})
    assert np.all(method.shade(of, at, blockers([0, 1.5, 0, 0.4])).radiance == 0)
    pieces = [[x, 1.0, z, 0.06] for x in np.linspace(-0.4, 0.4, 13) for z in np.linspace(-0.4, 0.4, 13)]
    assert np.all(method.shade(of, at, blockers(*pieces)).radiance == 0)
    below = points([[0, 0, 0]], material=GLOSSY)
    assert np.all(method.shade(of, below, blockers([0, 1.5, 0, 0.15])).radiance == 0)


def test_light_half_below_the_horizon(method):
    """Against the closed form: the cells below it take the negative part of the cosine."""
    height = np.linspace(-0.29, 0.4, 60)
    at = points(np.stack([0 * height, -height, 0 * height], axis=1))
    lights = [([2.0, 0, 0], 0.3, 1.0)]
    found = method.shade(paper_scene(lights), at, blockers()).radiance
    exact = method.shade(scene(lights), at, blockers()).radiance
    # A lobe has more of its energy near its axis than a disk: 8 % less where only half of the light is above.
    assert np.max(np.abs(found - exact)) < 0.05 * exact.max()
    assert np.all(found >= 0)


def test_products_integrate_the_lobe_sums(method, tables):
    """Fig. 15: what one lobe in the place of each product costs. The paper has 3 % (at worst 8 %)."""
    at = points(plane_grid(10), material=GLOSSY)
    blocking = random_blockers(np.random.default_rng(3))
    for options in (ENERGY, AS_IN_THE_PAPER):
        of = paper_scene([KEY], options, phong={"kd": 0.3, "ks": 0.3, "exponent": 50})
        found = method.shade(of, at, blocking).radiance
        expected = integrate_lobe_sums(of, at, occluders(blocking), tables)
        error = np.abs(found - expected)
        assert error.mean() <= 0.003 * expected.mean()
        assert error.max() <= 0.02 * expected.max()


@pytest.mark.parametrize(
    ("material", "exponent"), [(MATT, 50), (GLOSSY, 50), (GLOSSY, 1000)], ids=["lambert", "50", "1000"]
)
def test_shadows_are_near_the_reference(method, material, exponent):
    """One lobe per leaf and light: a few percent in penumbrae, as the weights' fit has (tests/tables)."""
    at = points(plane_grid(), material=material)
    blocking = random_blockers(np.random.default_rng(2))
    of = paper_scene([KEY], phong={"kd": 0.3, "ks": 0.3, "exponent": exponent})
    found = method.shade(of, at, blocking).radiance
    expected = direct_light(of, at, occluders(blocking), strata(4096), (0,)).radiance
    assert np.isfinite(found).all()
    assert np.all(found >= 0)
    assert np.sqrt(np.mean((found - expected) ** 2)) <= 0.03 * expected.mean()
    assert np.abs(found - expected).mean() <= 0.015 * expected.mean()


def test_lobes_sharper_than_the_light_have_the_shadow_of_cells(method):
    """Exponent 1000, where the light's lobe has about 110: as in the accurate estimator."""
    at = points(plane_grid(), material=GLOSSY)
    blocking = random_blockers(np.random.default_rng(2))
    phong = {"kd": 0.0, "ks": 1.0, "exponent": 1000}
    found = method.shade(paper_scene([KEY], phong=phong), at, blocking).radiance
    exact = method.shade(scene([KEY], phong=phong), at, blocking).radiance
    # The accurate estimator may give a narrow lobe a finer mask of its own: a cell's share of the highlight.
    np.testing.assert_allclose(found, exact, atol=0.02 * exact.max())
    assert np.any((exact > 0.01 * exact.max()) & (exact < 0.5 * exact.max()))


def test_threshold_saves_products_and_darkens_no_light_region(method):
    """t_i: leaves that cannot matter have no products; what stands in for them hardly shows."""
    at = points(plane_grid())
    blocking = random_blockers(np.random.default_rng(4))
    layers = ("products", "mask_leaves")
    exact = method.shade(paper_scene([KEY]), at, blocking, layers)
    quick = method.shade(paper_scene([KEY], threshold=1e-3), at, blocking, layers)
    np.testing.assert_array_equal(exact.layers["mask_leaves"], quick.layers["mask_leaves"])
    # A diffuse point has the product with the light, and one for each leaf unless the light is covered.
    leaves = exact.layers["mask_leaves"]
    shaded = exact.radiance[:, 0] > 0
    np.testing.assert_array_equal(exact.layers["products"][shaded], 1 + leaves[shaded])
    assert quick.layers["products"].sum() < 0.55 * exact.layers["products"].sum()
    assert np.all(quick.radiance[~shaded] == 0)
    assert np.abs(quick.radiance - exact.radiance).mean() <= 1e-3 * exact.radiance.mean()
    none = method.shade(paper_scene([KEY], threshold=10.0), at, blocking)
    assert np.all(none.radiance == 0)


def test_leaves_are_those_of_the_accurate_estimator(method):
    at = points(plane_grid(12))
    blocking = random_blockers(np.random.default_rng(5))
    layers = ("mask_leaves", "irradiance")
    one = method.shade(paper_scene([KEY]), at, blocking, layers)
    two = method.shade(scene([KEY]), at, blocking, layers)
    np.testing.assert_array_equal(one.layers["mask_leaves"], two.layers["mask_leaves"])
    assert one.layers["mask_leaves"].max() > 10
    np.testing.assert_allclose(one.layers["irradiance"] / np.pi, one.radiance, rtol=1e-5)
