"""One quadrature rule for integrands with algebraic ends and interior peaks put at an end."""

import numpy as np
from numpy.typing import NDArray

# 96 nodes resolve a Gaussian half-peak cut at exp(-50) and ends like x^e for every e > -1/2 to 1e-10.
_NODES = 96
_REACH = 3.4


def double_exponential() -> tuple[NDArray, NDArray, NDArray]:
    """Nodes and weights on [0, 1] that cluster double-exponentially at both ends, float64 [nodes, 1] each.

    Returns x, 1 - x (each accurate to full relative precision near its own end) and the weights.
    """
    u = np.linspace(-_REACH, _REACH, _NODES)[:, None]
    x = 1 / (1 + np.exp(-np.pi * np.sinh(u)))
    complement = 1 / (1 + np.exp(np.pi * np.sinh(u)))
    return x, complement, (u[1] - u[0]) * np.pi * np.cosh(u) * x * complement
