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
# Lights by how points see them; spheres in the lists that were looked through, spheres splatted; lobe products computed,
# mask leaves integrated.
STATS = np.dtype(
    [(name, np.uint32) for name in ("lit", "partial", "dark", "below", "listed", "splats", "products", "leaves")]
)

WORK_GROUP = 64  # points, an 8x8 tile of pixels where all of them hit something
NEAR_ROOM = 1024  # spheres that the lists of a work-group hold together
GROUP = 16  # spheres that are culled together
NO_OWNER = -1
FIRST_EMITTER = -2  # owner of the first light's sphere among the blockers; further lights count down


_SUM_OF_STATS = f"""\
inline stats_t sum_of_stats(const __local stats_t *counts)
{{
    stats_t sum = counts[0];
    for (int k = 1; k < {WORK_GROUP} / PW; k++) {{
        {" ".join(f"sum.{name} += counts[k].{name};" for name in STATS.names or ())}
    }}
    return sum;
}}
"""


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
        + _SUM_OF_STATS
        + f"#define GROUP {GROUP}\n#define WORK_GROUP {WORK_GROUP}\n#define NEAR_ROOM {NEAR_ROOM}\n"
        + f"#define EMITTER_OWNER(light) ({FIRST_EMITTER} - (light))\n"
    )
