"""What the kernel files tables.cl and paper.cl share with the tables: constants, and samples as float32."""

import numpy as np
from numpy.typing import NDArray

from coslobe.tables import cap, integral, product, weights
from coslobe.tables.grid import MAX_EXPONENT, exponent_coordinate
from coslobe.tables.store import LobeTables


def defines() -> dict[str, int | float]:
    """Compile-time constants."""
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
        "WEIGHT_SAMPLES": weights.SAMPLES,
        "WEIGHT_LEVELS": weights.LEVELS,
        "WEIGHT_STEPS": (weights.SAMPLES - 1) / weights.LARGEST_SINE2,
    }


def samples(tables: LobeTables) -> dict[str, NDArray]:
    """The arrays that `product_lobe`, `table_integral`, `cap_lobe` and `leaf_level` read, float32.

    The weights begin anew for each of `weights.MASK_DEPTHS`.
    """
    arrays = {
        "product": tables.product.values,
        "integral": tables.integral.values,
        "cap": tables.cap.values,
        "weights": tables.weights.values,
    }
    return {name: np.ascontiguousarray(array, np.float32) for name, array in arrays.items()}
