"""Materials of the scene file as what the kernel evaluates: a diffuse term and at most one lobe."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.render.layout import MATERIAL

if TYPE_CHECKING:
    from coslobe.render.scene import Material


def pack_materials(materials: Sequence["Material"]) -> tuple[NDArray, NDArray]:
    """Structs [max(n, 1)], and the distinct exponents that their slices refer to, float64 [k].

    Normalised as in Mitsuba: Lambert is albedo / pi; the modified Phong is kd / pi plus the lobe
    ks (n + 2) / (2 pi) max(r.l, 0)^n.
    """
    packed = np.zeros(max(len(materials), 1), MATERIAL)
    packed["slice"] = -1
    exponents: list[float] = []
    for entry, material in zip(packed, materials, strict=False):
        if material.lambert is not None:
            entry["kd"] = np.asarray(material.lambert.albedo) / np.pi
        elif material.phong is not None:
            phong = material.phong
            entry["kd"] = np.asarray(phong.kd) / np.pi
            entry["ks"] = np.asarray(phong.ks) * (phong.exponent + 2) / (2 * np.pi)
            entry["exponent"] = phong.exponent
            if np.any(np.asarray(phong.ks) > 0):
                if phong.exponent not in exponents:
                    exponents.append(phong.exponent)
                entry["slice"] = exponents.index(phong.exponent)
    return packed, np.asarray(exponents, np.float64)
