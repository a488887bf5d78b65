"""The structs and constants that host and device share; their C declarations are generated from here."""

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import struct_declaration

_F3 = (np.float32, (3,))

# What is known of points, one row of 4-byte numbers for each, so that vectors hold neighbours.
POINT_ROWS = (
    *("position_x", "position_y", "position_z"),  # relative to the frame's origin
    *("geometric_x", "geometric_y", "geometric_z", "shading_x", "shading_y", "shading_z"),
    "turn",  # of the point's masks, as a fraction of a full turn
    *("material", "object"),  # int32
)
# The device has materials and their lobes as `table` makes it of these.
MATERIAL = np.dtype(
    [
        ("kd", *_F3),  # diffuse BRDF, 1/sr
        ("n_lobes", np.int32),
        ("first_lobe", np.int32),
        ("lobe_step", np.int32),  # from one lobe to the next
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
# Lights by how points see them; spheres in the lists that were looked through, spheres splatted; lobe
# products computed, mask leaves integrated.
STATS = np.dtype(
    [
        (name, np.uint32)
        for name in ("lit", "partial", "dark", "below", "listed", "splats", "products", "leaves")
    ]
)

WORK_GROUP = 64  # points, an 8x8 tile of pixels where all of them hit something
NEAR_ROOM = 1024  # spheres that the lists of a work-group hold together
GROUP = 16  # spheres that are culled together
NO_OWNER = -1
FIRST_EMITTER = -2  # owner of the first light's sphere among the blockers; further lights count down


_ADD_STATS = f"""\
inline void add_stats(__local stats_t *sum, const __local stats_t *counts)
{{
    for (int k = 0; k < {WORK_GROUP} / PW; k++) {{
        {" ".join(f"sum->{name} += counts[k].{name};" for name in STATS.names or ())}
    }}
}}
"""


def table(structs: NDArray) -> NDArray[np.float32]:
    """Structs of 4-byte numbers [n] as rows [numbers, n]: what lies side by side belongs to neighbours."""
    words = structs.view(np.float32).reshape(len(structs), -1)
    return np.ascontiguousarray(words.T)


def _rows(name: str, dtype: np.dtype) -> str:
    """An enum of the rows at which a struct's fields begin."""
    first = {field: offset // 4 for field, (_, offset, *_) in (dtype.fields or {}).items()}
    return f"enum {{ {', '.join(f'{name}_{field.upper()} = {row}' for field, row in first.items())} }};\n"


def padded(n: int) -> int:
    """Room for n points in whole work-groups; points beyond the last are copies of it."""
    return -(-n // WORK_GROUP) * WORK_GROUP


def emitter_owner(light: int) -> int:
    """Owner of the sphere that stands for a light among the blockers of the other lights."""
    return FIRST_EMITTER - light


def point_rows() -> str:
    """OpenCL C for the names of POINT_ROWS."""
    return f"enum {{ {', '.join(POINT_ROWS).upper()} }};\n"


def declarations() -> str:
    """OpenCL C for everything above."""
    structs = {
        "light_t": LIGHT,
        "stats_t": STATS,
    }
    return (
        "".join(struct_declaration(name, dtype) for name, dtype in structs.items())
        + _ADD_STATS
        + point_rows()
        + _rows("MATERIAL", MATERIAL)
        + _rows("LOBE", LOBE)
        + f"#define GROUP {GROUP}\n#define WORK_GROUP {WORK_GROUP}\n#define NEAR_ROOM {NEAR_ROOM}\n"
        + f"#define EMITTER_OWNER(light) ({FIRST_EMITTER} - (light))\n"
    )
