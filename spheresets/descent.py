"""Stochastic descent of spheres on a sum of losses, on an OpenCL device."""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.spheresets.programs import kernels

SMALLEST = 1e-5  # radius
BETA1, BETA2 = 0.9, 0.99  # decay of Adam's moments

Array = NDArray[np.float64]


@dataclass
class State:
    """Spheres under optimisation with Adam's moments.

    Attributes
    ----------
    spheres, mean, square : float32 [n, 4] (float64 in the twin)
        Center and radius, and the running first and second moment of their gradient.
    step : int
        Steps done.
    """

    spheres: NDArray[np.floating]
    mean: NDArray[np.floating]
    square: NDArray[np.floating]
    step: int = 0

    @classmethod
    def start(cls, spheres: Array) -> "State":
        """At rest at `spheres` [n, 4]."""
        start = spheres.astype(np.float32)
        return cls(start, np.zeros_like(start), np.zeros_like(start))

    def keep(self, index: NDArray[np.int64]) -> None:
        """Drop all spheres that `index` does not name."""
        self.spheres, self.mean, self.square = (a[index] for a in (self.spheres, self.mean, self.square))

    def replace(self, index: NDArray[np.int64], spheres: Array) -> None:
        """Put new spheres [k, 4] in the place of old ones; they start at rest."""
        self.spheres[index] = spheres
        self.mean[index] = 0
        self.square[index] = 0


class Target(NamedTuple):
    """Where losses write their gradients on the device.

    Attributes
    ----------
    near : int32 [rows, n]
        Scratch.
    partial : float4 [rows, n]
        Gradients with respect to center and radius; Adam sums the rows in their order.
    losses : float32 [rows]
    """

    near: Any
    partial: Any
    losses: Any


class Loss(Protocol):
    """A loss over batches of samples: `rows` work-items write a row of the target each."""

    rows: int

    def gradient(
        self, step: int, spheres: Any, n: int, tau: float, weight: float, target: Target, row: int
    ) -> None:
        """Launch the kernel that writes `weight` times the mean loss of the step's batch, from `row` on."""


class Descent:
    """Adam on a weighted sum of losses: `losses` holds (loss, weight)."""

    def __init__(self, device: Device, *losses: tuple[Loss, float]) -> None:
        self._device = device
        self._losses = losses
        self._rows = sum(loss.rows for loss, _ in losses)
        constants = {"SMALLEST": SMALLEST, "BETA1": BETA1, "BETA2": BETA2}
        self._adam = kernels(device, ("adam.cl",), ("adam",), constants)["adam"]

    def run(self, state: State, taus: Array, rates: Array) -> float:
        """One step per entry of `taus` and `rates`; returns the loss of the last step's batches."""
        device, n, rows = self._device, len(state.spheres), self._rows
        buffers = [device.upload(a) for a in (state.spheres, state.mean, state.square)]
        spheres, mean, square = buffers
        target = Target(*(device.allocate(size) for size in (4 * rows * n, 16 * rows * n, 4 * rows)))
        for tau, rate in zip(taus, rates, strict=True):
            row = 0
            for loss, weight in self._losses:
                loss.gradient(state.step, spheres, n, tau, weight, target, row)
                row += loss.rows
            state.step += 1
            device.launch(
                self._adam, n, None,
                target.partial, np.int32(rows), np.int32(n), np.int32(state.step), np.float32(rate),
                mean, square, spheres,
            )  # fmt: skip
        state.spheres, state.mean, state.square = (device.download(b, (n, 4), np.float32) for b in buffers)
        return float(device.download(target.losses, (rows,), np.float32).astype(np.float64).sum())


def adam(state: State, gradient: Array, rate: float) -> State:
    """One step of Adam (Kingma and Ba 2015), float64."""
    step = state.step + 1
    mean = BETA1 * state.mean + (1 - BETA1) * gradient
    square = BETA2 * state.square + (1 - BETA2) * gradient**2
    spheres = state.spheres - rate * (mean / (1 - BETA1**step)) / (np.sqrt(square / (1 - BETA2**step)) + 1e-8)
    spheres[:, 3] = np.maximum(spheres[:, 3], SMALLEST)
    return State(spheres, mean, square, step)
