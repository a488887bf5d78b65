"""Materials as lobe sums: fits, what the kernel makes of them, and whole shading against the reference."""

import re

import numpy as np
import pytest

from coslobe.core.errors import InvalidInput
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.occlusion import NONE, Occluders, Spheres
from coslobe.evaluate.sampling import strata
from coslobe.render import layout, materials
from coslobe.render.assets import Blockers
from coslobe.render.brdf_fits import read_fit
from coslobe.render.fields import ColourTexture, Source
from coslobe.render.gbuffer import GBuffer
from coslobe.render.materials import bound_lobe, pack_materials
from coslobe.render.methods.cosine_lobes import CosineLobes, kernel_defines, kernel_units
from coslobe.render.scene import Lafortune, Mask, Material, Scene
from coslobe.render.surface import perpendicular
from coslobe.tables import lobe_cap, store
from coslobe.tables.lobe import product_integral

pytestmark = pytest.mark.filterwarnings("ignore:Kernel .* retrieved more than once")

EYE = np.array([-1.6, 2.0, 1.2])
KEY = ([1.0, 2.2, 0.2], 0.4)  # its mirror image lies among the points

MATERIALS = {
    "phong": {"phong": {"kd": 0.2, "ks": [0.5, 0.3, 0.1], "exponent": 60}},
    "phong_1975": {"phong_1975": {"kd": 0.1, "ks": 0.4, "exponent": 30}},
    "off-specular": {
        "lafortune": {"kd": 0.05, "lobes": [{"rho": 1.5, "c": [-1, -1, 0.7], "exponent": 25}]},
    },
    "retro-reflective": {"lafortune": {"kd": 0.1, "lobes": [{"rho": 1.2, "c": [1, 1, 1], "exponent": 14}]}},
    "anisotropic": {
        "lafortune": {
            "kd": 0.02,
            "lobes": [
                {"rho": [2.0, 1.0, 0.5], "c": [-1, -0.6, 0.9], "exponent": 18},
                {"rho": 0.3, "c": [-0.95, -1, 0.9], "exponent": 4},
            ],
        }
    },
    "sharp": {"lafortune": {"kd": 0, "lobes": [{"rho": 400, "c": [-0.999, -0.999, 1], "exponent": 3000}]}},
}


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def scene(material, light=KEY) -> Scene:
    center, radius = light
    return Scene.model_validate(
        {
            "camera": {"look_at": {"origin": list(EYE), "target": [0, 0, 0]}, "fov": 40},
            "image": {"width": 8, "height": 8},
            "materials": {"m": material},
            "lights": {"key": {"sphere": {"center": center, "radius": radius, "radiance": 10}}},
            "objects": {},
        }
    )


def points(position, normal=(0, 1, 0), texels=None, eye=EYE) -> GBuffer:
    n = len(position)
    normals = unit(np.broadcast_to(np.asarray(normal, float), (n, 3)))
    along = np.tile([0.8, 0.0, 0.6], (n, 1))
    return GBuffer(
        position=position,
        geometric_normal=normals,
        shading_normal=normals,
        view=unit(eye - position),
        object=np.zeros(n, np.int32),
        material=np.zeros(n, np.int32),
        pixel=np.arange(n, dtype=np.int32),
        depth=np.linalg.norm(eye - position, axis=1),
        triangle=np.zeros(n, np.int32),
        weights=np.full((n, 3), 1 / 3),
        width=n,
        height=1,
        samples=1,
        texels=texels or {},
        tangent=perpendicular(along, normals),
    )


def grid(n=24, size=2.4):
    x = (np.arange(n) + 0.5) / n * size - size / 2
    return np.stack([np.repeat(x, n) - 0.3, np.zeros(n * n), np.tile(x, n) + 0.4], axis=1)


def blockers(*spheres) -> Blockers:
    array = np.asarray(spheres, float).reshape(-1, 4)
    n = len(array)
    return Blockers(array[:, :3], array[:, 3], np.zeros(n), np.full(n, 5, np.int32))


def reference(of, at, blocking, samples=4096):
    emitter = np.full(len(blocking.radii), NONE, np.int32)
    spheres = Spheres(blocking.centers, blocking.radii, blocking.outside, blocking.owner, emitter)
    return direct_light(of, at, Occluders(spheres), strata(samples), (0,))


def assert_agrees(found, expected, bound):
    """In units of the RMS of the radiance: relative to the mean, a highlight on black counts for more."""
    scale = np.sqrt(np.mean(expected.radiance**2))
    noise = np.sqrt(expected.variance.mean()) / scale
    assert noise < 0.7 * bound
    assert np.sqrt(np.mean((found - expected.radiance) ** 2)) / scale < np.hypot(bound, noise)


@pytest.fixture(scope="session")
def method(device):
    return CosineLobes(device)


@pytest.mark.parametrize("name", MATERIALS)
def test_unoccluded_materials_match_the_reference(method, name):
    of, at = scene(MATERIALS[name]), points(grid())
    # The table of lobes over caps is exact to 1e-3 of its highest value.
    assert_agrees(method.shade(of, at, blockers()).radiance, reference(of, at, blockers()), 0.002)


@pytest.mark.parametrize("name", MATERIALS)
def test_shadows_on_every_material_match_the_reference(method, name):
    rng = np.random.default_rng(2)
    centre = rng.uniform([-0.5, 0.3, -0.5], [0.6, 1.0, 0.7], (25, 3))
    blocking = blockers(*np.concatenate([centre, rng.uniform(0.03, 0.12, (25, 1))], axis=1))
    of, at = scene(MATERIALS[name]), points(grid())
    # A mask places an edge within a fraction of a cell (theory, section 5).
    assert_agrees(method.shade(of, at, blocking).radiance, reference(of, at, blocking), 0.005)


@pytest.mark.parametrize("name", [name for name in MATERIALS if name != "sharp"])
def test_lights_across_the_horizon_match_the_reference(method, name):
    """Normals turned so far that the horizon cuts the light, at every depth."""
    rng = np.random.default_rng(3)
    n = 300
    towards = unit(np.asarray(KEY[0]))
    normals = unit(np.cross(towards, rng.normal(size=(n, 3)))) + 0.3 * rng.uniform(-1, 1, (n, 1)) * towards
    normals *= np.sign(normals @ EYE)[:, None]
    at = points(np.zeros((n, 3)), normals)
    of = scene(MATERIALS[name], (KEY[0], 0.8))
    # The horizon is an edge in the mask, too.
    assert_agrees(method.shade(of, at, blockers()).radiance, reference(of, at, blockers()), 0.006)


@pytest.mark.parametrize("name", [name for name in MATERIALS if name != "sharp"])
def test_in_a_furnace_materials_have_their_albedo(method, name):
    """Inside a light of radiance L a point reflects L times the integral of BRDF and cosine."""
    normals = unit(np.random.default_rng(4).normal(size=(60, 3)) + unit(EYE))
    normals *= np.sign(normals @ EYE)[:, None]
    at = points(np.zeros((60, 3)), normals)
    of = scene(MATERIALS[name], ([0, 0, 0], 1.0))
    found = method.shade(of, at, blockers()).radiance
    packed = pack_materials(of.materials, at)
    expected = np.pi * packed.materials["kd"][packed.index].astype(float)
    for entry in packed.lobes[: packed.materials["n_lobes"][0]]:
        axis, colour = bound_lobe(entry, at.view, at.shading_normal, at.tangent)
        angle = np.arccos(np.clip(np.einsum("ij,ij->i", axis, at.shading_normal), -1, 1))
        expected += colour * product_integral(entry["exponent"], float(entry["cosine"]), angle)[:, None]
    np.testing.assert_allclose(found, 10 * expected, rtol=0.01)  # 32 rings and 64 sectors


@pytest.mark.parametrize("exponent", [1500, 16600])
def test_narrow_lobes_mirror_the_edges_of_shadows(method, exponent):
    """Their own masks resolve what would fall between the cells of the light's: those alone are off by 1.2 %
    at 16,600 and 0.7 % at 1500."""
    position = 0.4 * grid(16, 2.0) + [-0.24, 0, 0.56]  # where the mirror shows the light
    rho = (exponent + 2) / (2 * np.pi)
    of = scene({"lafortune": {"lobes": [{"rho": rho, "c": [-1, -1, 1], "exponent": exponent}]}})
    blocking = blockers([0.3, 1.1, 0.5, 0.12], [0.42, 1.2, 0.35, 0.07])
    at = points(position)
    assert_agrees(method.shade(of, at, blocking).radiance, reference(of, at, blocking), 0.006)


WRAPPER = """
__kernel void bind_many(__global const float *lobes, const int n_lobes, __global const float *frames,
                        __global float *out)
{
    __local table_t table;
    table.rows = lobes;
    table.count = n_lobes;
    const int i = get_global_id(0);
    __global const float *p = frames + 9 * i;
    /* The vector's last point has lobe i, the others have the same, its neighbours, or scattered ones. */
    const pi apart = point_numbers() - (PW - 1);
    const pi number = i % 3 == 0 || i < PW ? (pi)(i) : i % 3 == 1 ? i + apart : i + apart % 2;
    const pf3 v = {p[0], p[1], p[2]}, n = {p[3], p[4], p[5]}, x = {p[6], p[7], p[8]};
    const bound_lobes_t bound = bind_lobes(&table, number, v, n, x);
    vstore3(vector_lane(&bound.axis, PW - 1), 2 * i, out);
    vstore3(vector_lane(&bound.colour, PW - 1), 2 * i + 1, out);
}
"""


@pytest.mark.parametrize("anisotropic", [False, True])
def test_binding_a_lobe_to_a_view(device, anisotropic):
    rng = np.random.default_rng(5)
    n = 2000
    c = rng.uniform(-1, 1, (n, 3))
    c[: n // 2] *= 0.02
    c[: n // 2] += [-0.98, -0.98, 0.98]  # nearly mirrors, with high exponents
    if not anisotropic:
        c[:, 1] = c[:, 0]
    exponents = np.where(np.arange(n) < n // 2, 10 ** rng.uniform(0, 4.3, n), rng.uniform(0, 20, n))
    c /= np.abs(c).max(axis=1, keepdims=True)
    lobes = [{"rho": 0.5, "c": list(row), "exponent": e} for row, e in zip(c, exponents, strict=True)]
    material = Material.model_validate({"lafortune": {"lobes": lobes}})
    entries = pack_materials({"m": material}, points(np.zeros((1, 3)))).lobes
    normal = unit(rng.normal(size=(n, 3)))
    view = unit(rng.normal(size=(n, 3)) + normal)
    frames = np.concatenate([view, normal, perpendicular(rng.normal(size=(n, 3)), normal)], axis=1)
    frames = frames.astype(np.float32)
    defines = kernel_defines(device.info.vector_width, Mask(), 1, anisotropic=anisotropic)
    program = device.build([*kernel_units("accurate"), ("wrapper", WRAPPER)], defines)
    out = device.allocate(n * 6 * 4)
    table, inputs = device.upload(layout.table(entries)), device.upload(frames)
    device.launch(program.bind_many, n, None, table, np.int32(n), inputs, out)
    found = device.download(out, (n, 2, 3), np.float32)
    for entry, frame, (axis, colour) in zip(entries, frames.astype(float), found, strict=True):
        v, m, x = (unit(part)[None] for part in np.split(frame, 3))
        expected_axis, expected_colour = bound_lobe(entry, v, m, x)
        np.testing.assert_allclose(axis, expected_axis[0], atol=1e-5)
        # |w|^e is exp(e / 2 log(1 - lost)): roundings of `lost`, of 1e-7, count e / 2 / (1 - lost) times.
        left = (expected_colour[0, 0] / 0.5) ** (2 / float(entry["exponent"]))
        tolerance = 3e-6 + 2e-7 * float(entry["exponent"]) / max(left, 1e-3)
        np.testing.assert_allclose(colour, expected_colour[0], rtol=tolerance, atol=1e-30)


def fit_file(tmp_path, *rows, header="name,kd_r,kd_g,kd_b,ks_r,ks_g,ks_b,Cxy,Cz,sharpness"):
    path = tmp_path / "fits.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_fits_have_the_formula_of_their_table(tmp_path):
    """In logarithms, because the table's own factors leave the range of numbers."""
    rng = np.random.default_rng(6)
    rows = [("steel", 0.3, 0.5, -0.577, 0.576, 16600.0), ("felt", 0.1, 0.2, -0.707, 5e-8, 2.29)]
    path = fit_file(
        tmp_path, *(f"{m},{kd},{kd},{kd},{ks},{ks},{ks},{a},{b},{n}" for m, kd, ks, a, b, n in rows)
    )
    normal = np.tile([0.0, 0.0, 1.0], (200, 1))
    view = unit(rng.normal(size=(200, 3)) * 0.3 + normal)
    for name, kd, ks, c_xy, c_z, n in rows:
        material = Material.model_validate({"lafortune": {"fit": str(path), "name": name}})
        packed = pack_materials({"m": material}, points(np.zeros((1, 3))))
        axis, colour = bound_lobe(packed.lobes[0], view, normal, perpendicular(view, normal))
        light = unit(axis + 0.3 / np.sqrt(n) * rng.normal(size=(200, 3)))
        product = c_xy * (view[:, :2] * light[:, :2]).sum(axis=1) + c_z * view[:, 2] * light[:, 2]
        log_f = (
            np.log(ks * (n + 2) / (2 * np.pi)) - n * np.log(max(abs(c_xy), abs(c_z))) + n * np.log(product)
        )
        cosine = np.einsum("ij,ij->i", axis, light)
        found = np.log(colour[:, 0]) + n * np.log(cosine)
        # Float32 rounds c, which moves |w| by 3e-8 and its power by n times that.
        np.testing.assert_allclose(found, log_f, atol=1e-6 + 1e-7 * n)
        np.testing.assert_allclose(packed.materials["kd"][0], kd / np.pi, rtol=1e-7)


@pytest.mark.parametrize(
    ("row", "header", "message"),
    [
        ("gold,0,0,0,1,1,1,-1,1,oops", None, "fits.csv:2: sharpness: must be a number (got oops)"),
        ("gold,0,0,0,1,1,1,-1", None, "fits.csv:2: Cz: must be a number (got )"),
        ("gold,0,0,0,1,1,1,0,0,3", None, "fits.csv:2: Cxy and Cz are both 0"),
        ("gold,0,0,0,-1,1,1,1,1,3", None, "fits.csv:2: kd, ks and sharpness must be >= 0"),
        ("golf,0,0,0,1,1,1,-1,1,3", None, "no material 'gold'; did you mean golf?"),
        ("gold,0", "name,kd", "fits.csv:1: no column kd_r; did you mean kd?"),
        ('"gold,0', None, "cannot be read as a table"),
    ],
)
def test_wrong_tables_are_refused_in_words(tmp_path, row, header, message):
    path = fit_file(tmp_path, row, **({"header": header} if header else {}))
    with pytest.raises(InvalidInput, match=re.escape(message)):
        read_fit(path, "gold")


def textured(file="t.png", **texture):
    return {"texture": file, **texture}


@pytest.fixture
def picture(tmp_path):
    (tmp_path / "t.png").touch()
    return str(tmp_path / "t.png")


def test_every_number_may_come_from_a_texture(method, picture):
    """Points with equal texels are shaded as by the constant material."""
    texel = np.repeat([0.2, 0.6], 100)
    colour = np.repeat([[0.1, 0.5, 0.9], [0.7, 0.2, 0.4]], 100, axis=0)
    position = np.tile(grid(10), (2, 1))
    texels = {Source(picture, False): texel, Source(picture, True): colour}
    number, rgb = textured(picture, scale=0.5, offset=0.3), textured(picture, scale=2, offset=0.1)
    exponent = textured(picture, scale=100)

    def materials_of(k):
        """The four kinds with textures (k None), or with the constants of half k."""
        value = number if k is None else 0.3 + 0.5 * [0.2, 0.6][k]
        tone = rgb if k is None else (0.1 + 2 * colour[100 * k]).tolist()
        n = exponent if k is None else 100 * [0.2, 0.6][k]
        lobes = [
            {"rho": tone, "c": [-1, value, 1], "exponent": n},
            {"rho": 1, "c": [-1, -1, 0.9], "exponent": n},
        ]
        return [
            {"lambert": {"albedo": tone}},
            {"phong": {"kd": tone, "ks": 0.3, "exponent": n}},
            {"phong_1975": {"kd": 0.1, "ks": tone, "exponent": n}},
            {"lafortune": {"kd": tone, "lobes": lobes}},
        ]

    for kind in range(4):
        found = method.shade(
            scene(materials_of(None)[kind]), points(position, texels=texels), blockers()
        ).radiance
        for k in (0, 1):
            half = slice(100 * k, 100 * (k + 1))
            constant = method.shade(scene(materials_of(k)[kind]), points(position[half]), blockers()).radiance
            np.testing.assert_allclose(found[half], constant, rtol=3e-6, atol=1e-9)


def test_textured_materials_match_the_reference(method, picture):
    rng = np.random.default_rng(7)
    position = grid()
    n = len(position)
    texels = {Source(picture, False): rng.random(n), Source(picture, True): rng.random((n, 3))}
    phong = {
        "kd": textured(picture),
        "ks": textured(picture, scale=0.5),
        "exponent": textured(picture, scale=300, offset=2),
    }
    of, at = scene({"phong": phong}), points(position, texels=texels)
    blocking = blockers([0.2, 0.8, 0.1, 0.2])
    assert_agrees(method.shade(of, at, blocking).radiance, reference(of, at, blocking), 0.005)


@pytest.mark.parametrize("limits", [(1, 1e5), (2, 50), (100, 3000)])
def test_slices_of_the_nearest_exponent_are_near_enough(limits):
    """Of more exponents than slices: within 0.1 % of the highest value, beside the table's own 0.1 %."""
    rng = np.random.default_rng(8)
    n = 6000
    e = np.exp(rng.uniform(*np.log(limits), n)).astype(np.float32)
    nodes, index = materials._slices(e)
    assert len(nodes) < 1200
    table = store.cached().lobe_cap
    alpha = 10 ** rng.uniform(-3, np.log10(1.04), n)
    e = e.astype(float)
    _, last = lobe_cap.angle_range(e, alpha)
    theta = rng.uniform(0, 1, n) * np.minimum(last, np.pi)
    near = lobe_cap.lookup_slice(table.slice(nodes), index, e, theta, alpha)
    exact = table.lookup(e, theta, alpha)
    error = (near.integral - exact.integral) / lobe_cap.scale(e, alpha)
    assert np.max(np.abs(error)) < 1e-3
    assert np.sqrt(np.mean(error**2)) < 3e-4


def test_few_exponents_have_slices_of_their_own():
    nodes, index = materials._slices(np.array([50, 2, 1e5, 2], np.float32))
    np.testing.assert_array_equal(nodes[index], [50, 2, 1e5, 2])


@pytest.mark.parametrize(
    ("material", "message"),
    [
        (
            {"phong": {"kd": 0, "ks": 1, "exponent": textured(scale=-1)}},
            "materials.m: t.png with scale -1 and offset 0 gives -0.5; must be >= 0",
        ),
        (
            {"lambert": {"albedo": textured(offset=-0.6)}},
            "materials.m: t.png with scale 1 and offset -0.6 gives -0.1; must be >= 0",
        ),
        (
            {"lafortune": {"lobes": [{"rho": 1, "c": [2, 2, textured(scale=6)], "exponent": 200}]}},
            "materials.m: rho |c|^exponent = 10^95 is too large",
        ),
    ],
)
def test_textures_that_give_impossible_numbers_are_refused_in_words(tmp_path, monkeypatch, material, message):
    (tmp_path / "t.png").touch()
    monkeypatch.chdir(tmp_path)
    parsed = Material.model_validate(material)
    texels = {source: np.full((1, 3) if source.colour else 1, 0.5) for source in parsed.pictures}
    with pytest.raises(InvalidInput) as error:
        pack_materials({"m": parsed}, points(np.zeros((1, 3)), texels=texels))
    assert str(error.value).replace(f"{tmp_path}/", "") == message


def test_a_lobe_without_an_axis_is_black(picture):
    lobes = [{"rho": 1, "c": [0, 0, textured(picture, scale=0)], "exponent": 0}]
    material = Material.model_validate({"lafortune": {"lobes": lobes}})
    texels = {Source(picture, False): np.full(1, 0.5)}
    packed = pack_materials({"m": material}, points(np.zeros((1, 3)), texels=texels))
    assert np.all(packed.lobes["rho"] == 0)
    assert np.isfinite(packed.lobes["c"]).all()


def test_a_fit_is_its_numbers(tmp_path):
    """What is hashed does not depend on where the table lies."""
    path = fit_file(tmp_path, "gold,0.1,0.2,0.3,1,2,3,-0.5,0.4,10")
    found = Lafortune.model_validate({"fit": str(path), "name": "gold"})
    data = found.model_dump()
    assert "fit" not in data
    assert data["kd"] == (0.1, 0.2, 0.3)
    assert data["lobes"][0]["c"] == (-1, -1, 0.8)


def test_colours_and_numbers_of_one_picture_are_told_apart(picture):
    material = Material.model_validate(
        {"phong": {"kd": textured(picture), "ks": 1, "exponent": textured(picture)}}
    )
    assert isinstance(material.phong.kd, ColourTexture)
    assert material.pictures == {Source(picture, True), Source(picture, False)}
