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

/* Parameters of lobe `number` of every point's material, of which `same` says that they are all one; see layout.LOBE. */
typedef struct {
    pf3 rho, c, deficit;
    pf exponent;
    pi slice, cosine;
} lobes_t;

inline lobes_t gather_lobes(__global const material_t *materials, __global const lobe_t *lobes, const pi *material,
                            int number, int same)
{
    lobes_t found;
    for (int l = 0; l < (same ? 1 : PW); l++) {
        const material_t m = materials[INT_LANE(*material, l)];
        const int has = number < m.n_lobes;
        const lobe_t lobe = lobes[m.first_lobe + (has ? number : 0)];
        LANE(found.rho.x, l) = has ? lobe.rho[0] : 0.0f;
        LANE(found.rho.y, l) = has ? lobe.rho[1] : 0.0f;
        LANE(found.rho.z, l) = has ? lobe.rho[2] : 0.0f;
        LANE(found.c.x, l) = lobe.c[0];
        LANE(found.c.y, l) = lobe.c[1];
        LANE(found.c.z, l) = lobe.c[2];
        LANE(found.deficit.x, l) = lobe.deficit[0];
        LANE(found.deficit.y, l) = lobe.deficit[1];
        LANE(found.deficit.z, l) = lobe.deficit[2];
        LANE(found.exponent, l) = lobe.exponent;
        INT_LANE(found.slice, l) = lobe.slice;
        INT_LANE(found.cosine, l) = lobe.cosine;
    }
    if (same && PW > 1) {
        found.rho.x = LANE(found.rho.x, 0);
        found.rho.y = LANE(found.rho.y, 0);
        found.rho.z = LANE(found.rho.z, 0);
        found.c.x = LANE(found.c.x, 0);
        found.c.y = LANE(found.c.y, 0);
        found.c.z = LANE(found.c.z, 0);
        found.deficit.x = LANE(found.deficit.x, 0);
        found.deficit.y = LANE(found.deficit.y, 0);
        found.deficit.z = LANE(found.deficit.z, 0);
        found.exponent = LANE(found.exponent, 0);
        found.slice = INT_LANE(found.slice, 0);
        found.cosine = INT_LANE(found.cosine, 0);
    }
    return found;
}

/* rho max(cx vx lx + cy vy ly + cz vz lz, 0)^n in the tangent frame (x, y, normal n) is a lobe around w = c v of the
   amplitude rho |w|^n (30). |w|^2 = 1 - sum of (1 - c^2) v^2 without the rounding of a length, which a large n would
   magnify; the host has scaled c so that its largest component is 1. */
inline bound_lobes_t bind_lobes(const lobes_t *lobe, pf3 view, pf3 n, pf3 x)
{
    const pf vz = dots(view, n);
#if ANISOTROPIC
    const pf3 y = crosses(n, x);
    const pf vx = dots(view, x), vy = dots(view, y);
    const pf3 w = plus(plus(scaled(n, lobe->c.z * vz), lobe->c.y * vy, y), lobe->c.x * vx, x);
    const pf lost = lobe->deficit.x * vx * vx + lobe->deficit.y * vy * vy + lobe->deficit.z * vz * vz;
#else
    const pf3 across = plus(view, -vz, n);
    const pf3 w = plus(scaled(n, lobe->c.z * vz), lobe->c.x, across);
    const pf lost = lobe->deficit.x * dots(across, across) + lobe->deficit.z * vz * vz;
#endif
    bound_lobes_t bound;
    bound.axis = scaled(w, rsqrt(fmax(dots(w, w), 1e-37f)));
    const pi vanishes = lost >= 1.0f;
    bound.axis.x = select(bound.axis.x, n.x, vanishes);
    bound.axis.y = select(bound.axis.y, n.y, vanishes);
    bound.axis.z = select(bound.axis.z, n.z, vanishes);
    bound.colour = lobe->rho;
    if (point_bits(lost > 0.0f))
        bound.colour = scaled(lobe->rho, exp_points(0.5f * lobe->exponent * log_points(clamp(lost, 0.0f, 1.0f))));
    bound.exponent = lobe->exponent;
    bound.slice = lobe->slice;
    bound.cosine = lobe->cosine;
    return bound;
}

/* BRDFs of points with the given indices of materials. */
inline brdfs_t bind_brdfs(__global const material_t *materials, __global const lobe_t *lobes, pi material, pf3 view,
                          pf3 n, pf3 x)
{
    brdfs_t brdfs;
    brdfs.n_lobes = 0;
    const int same = !point_bits(material != (pi)(INT_LANE(material, 0)));
    if (same) {
        const material_t m = materials[INT_LANE(material, 0)];
        brdfs.kd.x = m.kd[0];
        brdfs.kd.y = m.kd[1];
        brdfs.kd.z = m.kd[2];
        brdfs.n_lobes = m.n_lobes;
    } else {
        for (int l = 0; l < PW; l++) {
            const material_t m = materials[INT_LANE(material, l)];
            LANE(brdfs.kd.x, l) = m.kd[0];
            LANE(brdfs.kd.y, l) = m.kd[1];
            LANE(brdfs.kd.z, l) = m.kd[2];
            brdfs.n_lobes = max(brdfs.n_lobes, m.n_lobes);
        }
    }
#if MAX_LOBES > 0
    for (int k = 0; k < brdfs.n_lobes; k++) {
        const lobes_t parameters = gather_lobes(materials, lobes, &material, k, same);
        brdfs.lobes[k] = bind_lobes(&parameters, view, n, x);
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
