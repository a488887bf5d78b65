"""What the kernel file tables.cl shares with the tables: its constants, and the samples as float32."""

import numpy as np
from numpy.typing import NDArray

from coslobe.tables import cap, integral, product
from coslobe.tables.grid import MAX_EXPONENT, exponent_coordinate
from coslobe.tables.store import LobeTables


def defines() -> dict[str, int | float]:
    """Compile-time constants of tables.cl."""
    return {
        "MAX_EXPONENT": MAX_EXPONENT,
        "PRODUCT_EXPONENTS": product.EXPONENTS,
        "PRODUCT_ANGLES": product.ANGLES,
        "PRODUCT_STEPS": float((product.EXPONENTS - 1) / exponent_coordinate(MAX_EXPONENT)),
        "PRODUCT_REACH": product.REACH,
        "PRODUCT_SHIFT": product.SHIFT,
        "INTEGRAL_SAMPLES": integral.SAMPLES,
        "CAP_SAMPLES": cap.SAMPLES,
        "CAP_SMALLEST_DEPTH": cap.SMALLEST_DEPTH,
    }


def samples(tables: LobeTables) -> dict[str, NDArray]:
    """The arrays that `product_lobe`, `table_integral` and `cap_lobe` read, float32."""
    arrays = {"product": tables.product.values, "integral": tables.integral.values, "cap": tables.cap.values}
    return {name: np.ascontiguousarray(array, np.float32) for name, array in arrays.items()}
