"""The structs and constants that host and device share; their C declarations are generated from here."""

import numpy as np

from coslobe.core.device import struct_declaration

_F3 = (np.float32, (3,))

POINT = np.dtype(
    [
        ("position", *_F3),  # relative to the frame's origin
        ("geometric", *_F3),
        ("shading", *_F3),
        ("material", np.int32),
        ("object", np.int32),
        ("turn", np.float32),  # of the point's masks, as a fraction of a full turn
    ]
)
MATERIAL = np.dtype(
    [
        ("kd", *_F3),  # diffuse BRDF, 1/sr
        ("first_lobe", np.int32),
        ("n_lobes", np.int32),
    ]
)
LOBE = np.dtype(
    [
        ("rho", *_F3),  # of c scaled so that its largest component is 1
        ("c", *_F3),
        ("deficit", *_F3),  # 1 - c^2
        ("exponent", np.float32),
        ("slice", np.int32),  # of the lobe-over-cap table
        ("cosine", np.int32),  # 0: the lobe stands for BRDF times cosine
    ]
)
# A light of radius 0 has an intensity in the place of its radiance.
LIGHT = np.dtype([("center", *_F3), ("radius", np.float32), ("radiance", *_F3)])
# Per point: lights by how they are seen; spheres splatted, lobe products computed, mask leaves integrated.
STATS = np.dtype(
    [(name, np.uint32) for name in ("lit", "partial", "dark", "below", "splats", "products", "leaves")]
)

GROUP = 16  # spheres that are culled together
NO_OWNER = -1
FIRST_EMITTER = -2  # owner of the first light's sphere among the blockers; further lights count down


def emitter_owner(light: int) -> int:
    """Owner of the sphere that stands for a light among the blockers of the other lights."""
    return FIRST_EMITTER - light


def declarations() -> str:
    """OpenCL C for everything above."""
    structs = {
        "point_t": POINT,
        "material_t": MATERIAL,
        "lobe_t": LOBE,
        "light_t": LIGHT,
        "stats_t": STATS,
    }
    return (
        "".join(struct_declaration(name, dtype) for name, dtype in structs.items())
        + f"#define GROUP {GROUP}\n#define EMITTER_OWNER(light) ({FIRST_EMITTER} - (light))\n"
    )
