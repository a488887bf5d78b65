/* BRDFs of points as sums of a diffuse term and lobes. Twin: coslobe.render.materials.bound_lobe. */

/* One lobe of each point: colour max(axis.l, 0)^exponent, in 1/sr; where `cosine` is 0 it already stands for BRDF times
   cosine. The lobe-over-cap table's samples at the exponent are those of `slice`. */
typedef struct {
    pf3 axis, colour;
    pf exponent;
    pi slice, cosine;
} bound_lobes_t;

/* Points with fewer lobes than others beside them have black ones. */
typedef struct {
    pf3 kd;
    int n_lobes;
    bound_lobes_t lobes[MAX_LOBES > 0 ? MAX_LOBES : 1];
} brdfs_t;

/* The same of one point. */
typedef struct {
    float3 axis, colour;
    float exponent;
    int cosine;
} bound_lobe_t;

typedef struct {
    float3 kd;
    int n_lobes;
    bound_lobe_t lobes[MAX_LOBES > 0 ? MAX_LOBES : 1];
} brdf_t;

/* rho max(cx vx lx + cy vy ly + cz vz lz, 0)^n in the tangent frame (x, y, normal n) is a lobe around w = c v of the
   amplitude rho |w|^n (30). |w|^2 = 1 - sum of (1 - c^2) v^2 without the rounding of a length, which a large n would
   magnify; the host has scaled c so that its largest component is 1. */
inline bound_lobes_t bind_lobes(const __local table_t *lobes, pi number, pf3 view, pf3 n, pf3 x)
{
    const int kind = kind_of(number);
    const pf3 c = look_up3(lobes, LOBE_C, number, kind), deficit = look_up3(lobes, LOBE_DEFICIT, number, kind);
    const pf vz = dots(view, n);
#if ANISOTROPIC
    const pf3 y = crosses(n, x);
    const pf vx = dots(view, x), vy = dots(view, y);
    const pf3 w = plus(plus(scaled(n, c.z * vz), c.y * vy, y), c.x * vx, x);
    const pf lost = deficit.x * vx * vx + deficit.y * vy * vy + deficit.z * vz * vz;
#else
    const pf3 across = plus(view, -vz, n);
    const pf3 w = plus(scaled(n, c.z * vz), c.x, across);
    const pf lost = deficit.x * dots(across, across) + deficit.z * vz * vz;
#endif
    bound_lobes_t bound;
    bound.axis = choose(scaled(w, rsqrt(fmax(dots(w, w), 1e-37f))), n, lost >= 1.0f);
    bound.colour = look_up3(lobes, LOBE_RHO, number, kind);
    bound.exponent = look_up(lobes, LOBE_EXPONENT, number, kind);
    bound.slice = AS_PI(look_up(lobes, LOBE_SLICE, number, kind));
    bound.cosine = AS_PI(look_up(lobes, LOBE_COSINE, number, kind));
    if (point_bits(lost > 0.0f))
        bound.colour = scaled(bound.colour, exp_points(0.5f * bound.exponent * log_points(clamp(lost, 0.0f, 1.0f))));
    return bound;
}

/* BRDFs of points with the given numbers of materials. */
inline brdfs_t bind_brdfs(const __local table_t *materials, const __local table_t *lobes, pi material, pf3 view, pf3 n, pf3 x)
{
    const int kind = kind_of(material);
    brdfs_t brdfs;
    brdfs.kd = look_up3(materials, MATERIAL_KD, material, kind);
    brdfs.n_lobes = 0;
#if MAX_LOBES > 0
    const pi has = AS_PI(look_up(materials, MATERIAL_N_LOBES, material, kind));
    const pi first = AS_PI(look_up(materials, MATERIAL_FIRST_LOBE, material, kind));
    const pi step = AS_PI(look_up(materials, MATERIAL_LOBE_STEP, material, kind));
    for (pi left = has; point_bits(left > 0); left -= 1) {
        const pi missing = left <= 0;
        const int k = brdfs.n_lobes++;
        bound_lobes_t *lobe = &brdfs.lobes[k];
        *lobe = bind_lobes(lobes, select(first + k * step, (pi)(0), missing), view, n, x);
        lobe->colour = choose(lobe->colour, vectors(0.0f, 0.0f, 0.0f), missing);
    }
#endif
    return brdfs;
}

/* That of point l; the lobe's colours say which lobes it lacks. */
inline brdf_t brdf_lane(const brdfs_t *brdfs, int l)
{
    brdf_t brdf;
    brdf.kd = vector_lane(&brdfs->kd, l);
    brdf.n_lobes = brdfs->n_lobes;
    for (int k = 0; k < brdfs->n_lobes; k++) {
        const bound_lobes_t *lobe = &brdfs->lobes[k];
        brdf.lobes[k].axis = vector_lane(&lobe->axis, l);
        brdf.lobes[k].colour = vector_lane(&lobe->colour, l);
        brdf.lobes[k].exponent = LANE(lobe->exponent, l);
        brdf.lobes[k].cosine = INT_LANE(lobe->cosine, l);
    }
    return brdf;
}

inline float largest(float3 colour)
{
    return fmax(fmax(colour.x, colour.y), colour.z);
}
