/* A point's BRDF as the sum of a diffuse term and lobes. Twin: coslobe.render.materials.bound_lobe. */

/* colour max(axis.l, 0)^exponent, in 1/sr; where `cosine` is 0 it already stands for BRDF times cosine. The samples of
   the lobe-over-cap table at the exponent begin at `slice`. */
typedef struct {
    float3 axis, colour;
    float exponent;
    __global const float4 *slice;
    int cosine;
} bound_lobe_t;

/* rho max(cx vx lx + cy vy ly + cz vz lz, 0)^n in the tangent frame (x, y, normal n) is a lobe around w = c v of the
   amplitude rho |w|^n (30). |w|^2 = 1 - sum of (1 - c^2) v^2 without the rounding of a length, which a large n would
   magnify; the host has scaled c so that its largest component is 1. */
inline bound_lobe_t bind_lobe(const lobe_t lobe, __global const float4 *slices, float3 view, float3 n, float3 x)
{
    const float vz = dot(view, n);
#if ANISOTROPIC
    const float3 y = cross(n, x);
    const float vx = dot(view, x), vy = dot(view, y);
    const float3 w = lobe.c[0] * vx * x + lobe.c[1] * vy * y + lobe.c[2] * vz * n;
    const float lost = lobe.deficit[0] * vx * vx + lobe.deficit[1] * vy * vy + lobe.deficit[2] * vz * vz;
#else
    const float3 across = view - vz * n;
    const float3 w = lobe.c[0] * across + lobe.c[2] * vz * n;
    const float lost = lobe.deficit[0] * dot(across, across) + lobe.deficit[2] * vz * vz;
#endif
    const float log_length = 0.5f * log1p(-fmin(lost, 1.0f));
    bound_lobe_t bound;
    bound.axis = lost < 1.0f ? normalize(w) : n;
    bound.colour = (float3)(lobe.rho[0], lobe.rho[1], lobe.rho[2]);
    if (lost > 0.0f)
        bound.colour *= exp(lobe.exponent * log_length);
    bound.exponent = lobe.exponent;
    bound.slice = slices + lobe.slice * (CAPS * ANGLES);
    bound.cosine = lobe.cosine;
    return bound;
}

typedef struct {
    float3 kd;
    int n_lobes;
    bound_lobe_t lobes[MAX_LOBES > 0 ? MAX_LOBES : 1];
} brdf_t;

/* The lobes' part of the BRDF times cosine for one light, from the lobes' integrals. */
inline float3 sum_of_lobes(const brdf_t *brdf, const float *integrals)
{
    float3 sum = 0.0f;
    for (int l = 0; l < brdf->n_lobes; l++)
        sum += brdf->lobes[l].colour * integrals[l];
    return sum;
}

inline float largest(float3 colour)
{
    return fmax(fmax(colour.x, colour.y), colour.z);
}
