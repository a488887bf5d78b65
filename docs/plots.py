"""Draw the plots of docs/theory.md into docs/images: `python docs/plots.py`."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from coslobe.tables import cap, lobe, lobe_cap, store

IMAGES = Path(__file__).parent / "images"


def separated(left: Any, right: Any, _: store.LobeTables) -> None:
    """The product over the sphere's two angles, and the one-dimensional integrand that is left of it."""
    e1, e2, alpha = 6.0, 20.0, 0.9
    phi, psi = np.linspace(-0.7, np.pi / 2, 300), np.linspace(-np.pi / 2, np.pi / 2, 200)
    across = np.maximum(np.cos(phi), 0) ** e1 * np.maximum(np.cos(phi - alpha), 0) ** e2
    product = np.cos(psi[:, None]) ** (e1 + e2 + 1) * across
    left.contourf(phi, psi, product / product.max(), 20, cmap="viridis")
    left.axvline(float(lobe.peak_angle(e1, e2, alpha)), color="w", linewidth=0.8)
    left.set(
        xlabel="φ [rad], axes at 0 and 0.9", ylabel="ψ [rad]", title="c1 c2 cos ψ is a product of two factors"
    )
    for a, b, angle in ((0.3, 0.6, 1.8), (6, 20, 0.9), (400, 900, 0.25)):
        x = np.linspace(angle - np.pi / 2, np.pi / 2, 4000)[1:-1]
        value = np.cos(x) ** a * np.cos(x - angle) ** b
        right.plot(x, value / value.max(), label=f"e1 = {a:g}, e2 = {b:g}, α = {angle:g}")
    right.set(xlabel="φ [rad]", ylabel="integrand of J / its peak", title="what is left to integrate")
    right.legend(fontsize=7)


def products(left: Any, right: Any, tables: store.LobeTables) -> None:
    """A product with the lobes that stand for it, and the errors of their integrals."""
    e1, e2, alpha = 8.0, 20.0, 0.7
    x = np.linspace(-0.6, 1.4, 600)

    def value(axis: float, exponent: float) -> np.ndarray:
        return np.maximum(np.cos(x - axis), 0) ** exponent

    left.plot(x, value(0, e1), label="c1, e = 8")
    left.plot(x, value(alpha, e2), label="c2, e = 20")
    left.plot(x, value(0, e1) * value(alpha, e2), "k", label="product")
    fits = {"L2 fit": lobe.product_l2(e1, e2, alpha), "energy-conserving": lobe.product_energy(e1, e2, alpha)}
    for (name, fit), style in zip(fits.items(), ("--", ":"), strict=True):
        axis, exponent, scale = (float(part) for part in fit)
        left.plot(x, scale * value(axis, exponent), style, color="C3", label=f"{name}, er = {exponent:.1f}")
    left.axvline(float(fits["L2 fit"].axis_angle), color="0.7", linewidth=0.8)
    left.set(xlabel="angle in the plane of the axes [rad]", ylabel="value", ylim=(0, 1.7))
    left.legend(fontsize=7)

    rng = np.random.default_rng(0)
    n = 20_000
    e1s, e2s = 10 ** rng.uniform(0, 5, (2, n))
    alphas = rng.uniform(0, 1, n) * np.minimum(np.pi, 6 * np.sqrt(1 / (e1s + 1) + 1 / (e2s + 1)))
    exact = lobe.product_integral(e1s, e2s, alphas)
    e1s, e2s, alphas, exact = (values[exact > 1e-8] for values in (e1s, e2s, alphas, exact))
    found = tables.product.lookup(e1s, e2s, alphas)
    curvature, l2 = lobe.product_curvature(e1s, e2s, alphas), lobe.product_l2(e1s, e2s, alphas)
    integrals = {
        "closed curvature form": curvature.scale * lobe.integral(curvature.exponent),
        "exact L2 fit": l2.scale * lobe.integral(l2.exponent),
        "table, L2 scale": found.scale_l2 * lobe.integral(found.exponent),
        "table, energy-conserving": found.integral,
    }
    for name, integral in integrals.items():
        error = np.sort(np.abs(integral / exact - 1))
        right.semilogy(np.linspace(0, 100, len(error)), error, label=name)
    right.set(
        xlabel="percentile of products above 1e-8", ylabel="relative error of the integral", ylim=(1e-8, 1)
    )
    right.legend(fontsize=7)


def caps(left: Any, right: Any, tables: store.LobeTables) -> None:
    """The lobe that stands for a cap, and the energy that it has too much."""
    alpha = 0.3
    depth = 2 * np.sin(alpha / 2) ** 2
    exponent = float(tables.cap.exponent(depth))
    x = np.linspace(-0.9, 0.9, 600)
    left.plot(x, np.abs(x) <= alpha, "k", label="cap of 0.3 rad")
    left.plot(x, np.cos(x) ** exponent, label=f"lobe of amplitude 1, e = {exponent:.1f}")
    amplitude = float(tables.cap.energy_amplitude(depth))
    left.plot(x, amplitude * np.cos(x) ** exponent, "--", label=f"energy-conserving, s = {amplitude:.3f}")
    left.set(xlabel="angle from the axis [rad]", ylabel="value", ylim=(0, 1.5))
    left.legend(fontsize=7)

    angles = np.geomspace(1e-3, np.pi / 2, 300)
    depths = 2 * np.sin(angles / 2) ** 2
    ratio = lobe.integral(tables.cap.exponent(depths)) / (2 * np.pi * depths)
    right.semilogx(np.degrees(angles), 100 * (ratio - 1), label="energy of the amplitude-1 lobe")
    right.semilogx(np.degrees(angles), 0 * angles, "--", label="energy-conserving")
    least = [float(cap.l2_distance(d, tables.cap.exponent(d)) / d) for d in depths]
    right.semilogx(
        np.degrees(angles), 100 * np.array(least), color="0.6", label="L2 distance / energy of the cap"
    )
    right.set(xlabel="half-angle [degrees]", ylabel="per cent of the cap")
    right.legend(fontsize=7)


def lobe_over_cap(left: Any, right: Any, tables: store.LobeTables) -> None:
    """T over the angle for several exponents, exact and from the table, and their difference."""
    alpha = 0.3
    for exponent in (1.0, 10.0, 100.0, 1000.0, 1e4):
        _, last = lobe_cap.angle_range(exponent, alpha)
        theta = np.linspace(0, float(last), 300)
        exact = lobe_cap.exact(exponent, theta, alpha).integral
        found = tables.lobe_cap.lookup(exponent, theta, alpha).integral
        line = left.plot(theta, exact / exact[0], label=f"e = {exponent:g}")[0]
        left.plot(theta[::12], found[::12] / exact[0], ".", color=line.get_color())
        right.semilogy(theta, np.maximum(np.abs(found - exact) / exact[0], 1e-8), color=line.get_color())
    for axes in (left, right):
        axes.axvline(alpha, color="0.7", linewidth=0.8)
        axes.set_xlabel("angle between the axes of lobe and cap [rad]")
    left.set_ylabel("T / T at 0")
    left.legend(fontsize=7)
    right.set(ylabel="|table - exact| / T at 0", ylim=(1e-8, 1e-2))


def main() -> None:
    """Write every plot."""
    tables = store.cached()
    for drawing in (separated, products, caps, lobe_over_cap):
        figure = Figure(figsize=(8.2, 3.1), layout="constrained")
        drawing(*figure.subplots(1, 2), tables)
        figure.savefig(IMAGES / f"{drawing.__name__}.png", dpi=100, metadata={"Software": None})


if __name__ == "__main__":
    main()
