"""Every kernel against its float64 twin on every device, and the twins against definitions."""

import numpy as np
import pytest

from coslobe.spheresets import descent, soft_lines, soft_union, union
from coslobe.spheresets.descent import Descent, State
from coslobe.spheresets.directions import fibonacci_sphere
from coslobe.spheresets.soft import CUTOFF, cutoff
from coslobe.spheresets.soft_lines import BUNDLE, BUNDLES, SoftLines
from coslobe.spheresets.soft_union import SoftUnion
from coslobe.spheresets.union import Union

TAU = 0.01
EDGE = 1e-4  # in tau; float32 may put points closer than this to the cutoff on the other side of it


def spheres_and_points(count: int, seed: int = 0):
    """Spheres [count, 4] in a ball, and points [1024, 3] with labels; none is next to a cutoff."""
    rng = np.random.default_rng(seed)
    spheres = np.column_stack([rng.normal(0, 0.15, (count, 3)), rng.uniform(0.02, 0.12, count)])
    spheres = spheres.astype(np.float32).astype(np.float64)
    points = rng.normal(0, 0.2, (4096, 3)).astype(np.float32).astype(np.float64)
    z = (spheres[:, 3] - np.linalg.norm(points[:, None] - spheres[:, :3], axis=2)) / TAU
    edges = [cutoff(TAU, reach) for reach in (0.0, soft_union.REACH)]
    points = points[np.all([(np.abs(z + edge) > EDGE).all(1) for edge in edges], axis=0)][:1024]
    return spheres, points, (np.linalg.norm(points, axis=1) < 0.25).astype(float)


def on_device(device, points, inside) -> SoftUnion:
    rows = np.column_stack([points, inside]).T.astype(np.float32)
    return SoftUnion(device, rows[None], rows)


@pytest.mark.parametrize("count", [1, 3, 64, 200])
def test_a_step_of_descent(device, count):
    spheres, points, inside = spheres_and_points(count)
    state = State.start(spheres)
    union = on_device(device, points, inside)
    loss = Descent(device, (union, 1.0)).run(state, np.array([TAU]), np.array([1e-3]))
    losses, gradient = soft_union.loss_and_gradient(points, inside, spheres, TAU)
    expected = descent.adam(State.start(spheres), gradient, 1e-3)
    assert loss == pytest.approx(losses.mean(), rel=1e-5)
    # the first moment after one step is a tenth of the gradient; sums of 1024 float32 terms of either sign
    scale = np.abs(gradient).max()
    np.testing.assert_allclose(state.mean, expected.mean, atol=1e-6 * scale)
    large = (
        np.abs(gradient) > 1e-4 * scale
    )  # Adam's first step is the sign of the gradient: noise where it is 0
    np.testing.assert_allclose(state.spheres[large], expected.spheres[large], atol=1e-6)


def test_many_steps_of_adam(device):
    """Moments and bias corrections over steps, against the twin driven by the device's own gradients."""
    spheres, points, inside = spheres_and_points(5)
    on_points = Descent(device, (on_device(device, points, inside), 1.0))
    state = State.start(spheres)
    for _ in range(4):
        before = State(state.spheres.copy(), state.mean.copy(), state.square.copy(), state.step)
        on_points.run(state, np.array([TAU]), np.array([1e-3]))
        gradient = (state.mean - descent.BETA1 * before.mean) / (1 - descent.BETA1)
        expected = descent.adam(before, gradient, 1e-3)
        np.testing.assert_allclose(state.square, expected.square, rtol=1e-4, atol=1e-12)
        np.testing.assert_allclose(state.spheres, expected.spheres, atol=2e-6)
    assert state.step == 4


def test_the_gradient_is_that_of_the_loss():
    """Central differences; no point is within a step of a cutoff, where the loss jumps."""
    spheres, points, inside = spheres_and_points(6)
    _, gradient = soft_union.loss_and_gradient(points, inside, spheres, TAU)
    step = 1e-7
    for index in np.ndindex(spheres.shape):
        ends = []
        for sign in (1, -1):
            moved = spheres.copy()
            moved[index] += sign * step
            ends.append(soft_union.loss_and_gradient(points, inside, moved, TAU)[0].mean())
        assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(gradient[index], rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("count", [1, 64])
def test_odds(device, count):
    spheres, points, inside = spheres_and_points(count)
    total, rest = on_device(device, points, inside).odds(spheres.astype(np.float32), TAU)
    expected_total, expected_rest = soft_union.total_odds(points, spheres, TAU)
    # exp((r - d) / tau): an error of 2e-8 in r - d is 2e-6 in the exponent
    np.testing.assert_allclose(total, expected_total, rtol=2e-5)
    np.testing.assert_allclose(rest, expected_rest, rtol=2e-5, atol=1e-9)


@pytest.mark.parametrize("blocks", [1, 3])
@pytest.mark.parametrize("removing", [True, False])
def test_exchanges(device, removing, blocks, monkeypatch):
    monkeypatch.setattr(soft_union, "SCRATCH_ENTRIES", 40 * 8 // blocks)
    spheres, points, inside = spheres_and_points(40)
    others, changed = (spheres, spheres) if removing else (spheres[:30], spheres[30:])
    kernels = on_device(device, points, inside)
    odds = kernels.odds(others.astype(np.float32), TAU)
    change = kernels.exchange(odds, changed, TAU, removing=removing)
    expected = soft_union.exchange(points, inside, changed, others, TAU, removing=removing)
    np.testing.assert_allclose(change, expected, rtol=2e-4, atol=2e-4)


def test_an_exchange_is_the_difference_of_two_losses():
    spheres, points, inside = spheres_and_points(8)

    def loss(chosen):
        return soft_union.cross_entropy(soft_union.total_odds(points, chosen, TAU)[0], inside).sum()

    removal = soft_union.exchange(points, inside, spheres, spheres, TAU, removing=True)
    insertion = soft_union.exchange(
        points, inside, spheres[3:4], np.delete(spheres, 3, 0), TAU, removing=False
    )
    for k in range(8):
        # removal cancels S - e in float64: 1e-16 of odds up to e^12
        assert removal[k] == pytest.approx(loss(np.delete(spheres, k, 0)) - loss(spheres), rel=1e-6)
    assert insertion[0] == pytest.approx(-removal[3], rel=1e-6)


def spheres_and_bundles(count: int, seed: int = 0):
    """Spheres [count, 4], and 32 bundles of lines of many widths with labels; none is next to a cutoff."""
    rng = np.random.default_rng(seed)
    spheres = np.column_stack([rng.normal(0, 0.15, (count, 3)), rng.uniform(0.02, 0.08, count)])
    spheres = spheres.astype(np.float32).astype(np.float64)
    middle, spread = rng.normal(size=(400, 1, 3)), np.geomspace(1e-3, 0.3, 400)[:, None, None]
    directions = middle / np.linalg.norm(middle, axis=2, keepdims=True)
    directions = directions + spread * rng.uniform(-1, 1, (400, BUNDLE, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    origins = rng.normal(0, 0.15, (400, 1, 3)) + spread * rng.uniform(-0.1, 0.1, (400, BUNDLE, 3))
    lines = np.concatenate([origins, directions], axis=2).astype(np.float32).astype(np.float64)
    offset = lines[:, :, None, :3] - spheres[:, :3]
    d = np.linalg.norm(np.cross(offset, lines[:, :, None, 3:]), axis=3)
    clear = (np.abs((spheres[:, 3] - d) / TAU + CUTOFF) > EDGE).all((1, 2))
    lines = lines[clear][:: clear.sum() // 32][:32].reshape(-1, 6)
    return spheres, lines[:, :3], lines[:, 3:], (rng.random(len(lines)) < 0.5).astype(float)


@pytest.mark.parametrize("count", [1, 3, 64, 200])
def test_a_step_of_descent_on_lines(device, count):
    spheres, origins, directions, hit = spheres_and_bundles(count)
    assert len(hit) == 4 * BUNDLE * BUNDLES
    rows = np.column_stack([origins, directions, hit]).T.astype(np.float32)
    state = State.start(spheres)
    on_lines = Descent(device, (SoftLines(device, rows[None]), 3.0))
    loss = on_lines.run(state, np.array([TAU]), np.array([1e-3]))
    expected, gradient = soft_lines.loss_and_gradient(origins, directions, hit, spheres, TAU)
    assert loss == pytest.approx(3 * expected, rel=1e-5)
    # float32 perpendiculars are good to 1e-7, which is 1e-5 of tau; sums of 512 terms of either sign
    np.testing.assert_allclose(state.mean / 0.1, 3 * gradient, atol=2e-5 * 3 * np.abs(gradient).max())


def test_points_and_lines_add_up(device):
    """One step on both is the weighted sum of one step on each."""
    spheres, points, inside = spheres_and_points(20)
    _, origins, directions, hit = spheres_and_bundles(20)
    rows = np.column_stack([origins, directions, hit]).T.astype(np.float32)
    terms = (on_device(device, points, inside), 0.5), (SoftLines(device, rows[None]), 7.0)
    means, losses = [], []
    for chosen in (terms[:1], terms[1:], terms):
        state = State.start(spheres)
        losses.append(Descent(device, *chosen).run(state, np.array([TAU]), np.array([1e-3])))
        means.append(state.mean)
    assert losses[2] == pytest.approx(losses[0] + losses[1], rel=1e-6)
    np.testing.assert_allclose(means[2], means[0] + means[1], atol=1e-6 * np.abs(means[2]).max())


def test_the_gradient_of_lines_is_that_of_the_loss():
    """Central differences; no line is within a step of a cutoff, where the loss jumps."""
    spheres, *lines = spheres_and_bundles(6)
    _, gradient = soft_lines.loss_and_gradient(*lines, spheres, TAU)
    step = 1e-7
    for index in np.ndindex(spheres.shape):
        ends = []
        for sign in (1, -1):
            moved = spheres.copy()
            moved[index] += sign * step
            ends.append(soft_lines.loss_and_gradient(*lines, moved, TAU)[0])
        assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(gradient[index], rel=1e-5, abs=1e-6)


def test_points_and_lines_against_the_union(device):
    rng = np.random.default_rng(1)
    spheres = np.column_stack([rng.normal(0, 0.2, (50, 3)), rng.uniform(0.02, 0.1, 50)])
    origins = rng.normal(0, 0.3, (1000, 3))
    directions = rng.normal(size=(1000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    on = Union(device, spheres)
    clearance, containing = on.points(origins)
    expected, count = union.points(origins, spheres)
    np.testing.assert_allclose(clearance, expected, atol=3e-7)
    clear = np.abs(np.linalg.norm(origins[:, None] - spheres[:, :3], axis=2) - spheres[:, 3]).min(1) > 1e-6
    np.testing.assert_array_equal(containing[clear], count[clear])
    passing = on.lines(origins, directions)
    np.testing.assert_allclose(passing, union.lines(origins, directions, spheres), atol=5e-7)


@pytest.mark.parametrize("blocks", [1, 7])
def test_caps_against_the_union(device, blocks, monkeypatch):
    """Receivers around and inside spheres, a light of which spheres lie before, within and behind."""
    rng = np.random.default_rng(2)
    spheres = np.column_stack([rng.normal(0, 0.4, (40, 3)), rng.uniform(0.02, 0.2, 40)])
    light = np.array([0.9, 0.8, 0.3, 0.35])
    receivers = rng.normal(0, 0.5, (60, 3))
    distance = np.linalg.norm(light[:3] - receivers, axis=1)
    receivers, distance = receivers[distance > 0.4], distance[distance > 0.4]
    axis = (light[:3] - receivers) / distance[:, None]
    cos_cap = np.sqrt(1 - (light[3] / distance) ** 2)
    everywhere = fibonacci_sphere(4000)
    directions = np.stack([everywhere[np.argsort(-(everywhere @ a))[:64]] for a in axis])
    within = (directions * axis[:, None]).sum(-1) > cos_cap[:, None]
    monkeypatch.setattr(union, "NEAR_ENTRIES", len(spheres) * len(receivers) // blocks + 1)
    on = Union(device, spheres)
    blocked = on.caps(receivers, np.column_stack([axis, cos_cap]), directions, light)
    expected = union.caps(receivers, np.column_stack([axis, cos_cap]), directions, light, spheres)
    wrong = (blocked != expected) & within
    assert within.sum() > 1000
    assert 0.2 < expected[within].mean() < 0.9
    assert wrong.sum() <= 2  # rays that graze a sphere to within float32


def test_a_receiver_inside_a_sphere_loses_the_half_space_towards_its_center():
    up = np.array([[[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
    light = np.array([0.0, 5.0, 0.0, 1.0])
    sphere = np.array([[0.0, 0.5, 0.0, 1.0]])
    blocked = union.caps(np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0, 0.9]]), up, light, sphere)
    np.testing.assert_array_equal(blocked, [[True, False]])


def test_a_sphere_behind_the_lights_surface_blocks_nothing():
    """The cap's directions enter the light at distance 4; spheres beyond that entry do not count."""
    up = np.array([[[0.0, 1.0, 0.0]]])
    light = np.array([0.0, 5.0, 0.0, 1.0])
    for height, expected in ((3.0, True), (4.2, True), (4.4, False), (8.0, False)):
        sphere = np.array([[0.0, height, 0.0, 0.3]])
        blocked = union.caps(np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0, 0.9]]), up, light, sphere)
        assert blocked[0, 0] == expected
