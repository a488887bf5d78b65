/* What stands between a point and a light: the light as a cap, the spheres before it as bits of a mask. */

/* A light as a point sees it: unit axis a, sine and cosine of the cap's half-angle, depth = 1 - cosine. Of the light's
   sphere: centre from the point, its distance d, the squared radius, tangent = length of the tangent, tau = its square,
   near = distance of its nearest point. */
typedef struct {
    float3 a, centre;
    float sine, cosine, depth, d, radius2, tangent, tau, near;
} cap_t;

typedef struct {
    __global const float *x, *y, *z, *radius, *outside;
    __global const int *owner;
    __global const float *group_x, *group_y, *group_z, *group_radius;
    int n_groups; /* a multiple of VW; a group holds GROUP spheres */
} blockers_t;

typedef struct {
    float3 position, geometric, shading;
    int object;
    float turn; /* by which its masks are turned, as a fraction of a full turn */
} receiver_t;

/* Samples that estimators read beside the slices of the lobe-over-cap table: products, caps and the weights of shadow
   lobes. */
typedef struct {
    __global const float *products, *caps, *weights;
} tables_t;

/* What a point and light took. */
typedef struct {
    uint splats, products, leaves;
} work_t;

enum { LIT = 0, PARTIAL = 1, DARK = 2 };

/* Squared distances from the light's axis of spheres whose centres lie `along` it. Not |o|^2 - along^2, which cancels:
   at a milliradian from the axis it would be wrong by a tenth. */
inline vf across_axis(const cap_t *cap, vf ox, vf oy, vf oz, vf along)
{
    const vf x = ox - along * cap->a.x, y = oy - along * cap->a.y, z = oz - along * cap->a.z;
    return x * x + y * y + z * z;
}

/* Lanes whose sphere (centre o from the point, |o|^2 = d2, o.a = along, squared distance from the axis across2, radius
   r) may block the cap: its centre is not farther from the cone than its radius, and it does not start behind the
   light's outline. Without roots or angles; true for every sphere that contains the point. */
inline vi meets_cap(const cap_t *cap, vf along, vf across2, vf d2, vf r)
{
    const vf limit = (r + along * cap->sine) / cap->cosine;
    const vf farthest = cap->tangent + r;
    return (across2 <= limit * limit) & (limit > 0.0f) & (d2 < farthest * farthest) & (r > 0.0f);
}

/* Lanes whose sphere covers the cap: the cone's far side lies inside it, and in front of the point. */
inline vi covers_cap(const cap_t *cap, vf along, vf across2, vf r)
{
    const vf limit = (r - along * cap->sine) / cap->cosine, ahead = along * cap->cosine;
    return (across2 < limit * limit) & (limit > 0.0f) & (across2 * (cap->sine * cap->sine) < ahead * ahead)
         & (along > 0.0f);
}

/* The radius at which a sphere of the receiver's own object blocks it, 0 where it does not: spheres bulge by up to
   `outside` above the surface that they stand for (docs/theory.md, section 6). `height` is the centre's height above
   the tangent plane. Twin: coslobe.render.own_spheres. */
#define OWN_RADIUS(T, name) \
    inline T name(T r, T outside, T height, T distance) \
    { \
        const T bulge = outside * clamp(0.25f - height / r, (T)(0.0f), (T)(1.0f)); \
        const T near = clamp((r + 2.0f * outside - distance) / fmax(outside, (T)(1e-30f)), (T)(0.0f), (T)(1.0f)); \
        const T left = fmax(r - bulge * near, (T)(0.0f)); \
        return select(left, (T)(0.0f), (height <= -r) | (distance < r + bulge)); \
    }
OWN_RADIUS(vf, own_radius)
OWN_RADIUS(float, own_radius_1)

/* Which part of the light the spheres leave: fills `mask` (cleared by the caller, who may have put the horizon in)
   and returns LIT, PARTIAL or DARK. *splats counts the spheres rasterised. */
inline int visibility(const blockers_t *blockers, const receiver_t *receiver, const cap_t *cap, int light,
                      float3 *t, float3 *u, int framed, ru *mask, uint *splats)
{
    const float3 p = receiver->position, a = cap->a, n = receiver->geometric;
    const float h = cap->sine / cap->cosine;
    int state = framed ? PARTIAL : LIT;
    for (int g = 0; g < blockers->n_groups; g += VW) {
        const vf gx = VF_LOAD(blockers->group_x + g) - p.x, gy = VF_LOAD(blockers->group_y + g) - p.y;
        const vf gz = VF_LOAD(blockers->group_z + g) - p.z;
        const vf gr = VF_LOAD(blockers->group_radius + g), g2 = gx * gx + gy * gy + gz * gz;
        const vf g_along = gx * a.x + gy * a.y + gz * a.z;
        const vi near = meets_cap(cap, g_along, across_axis(cap, gx, gy, gz, g_along), g2, gr);
        for (uint groups = any(near) ? lane_bits(near) : 0; groups; groups &= groups - 1) {
            const int first = (g + lowest_bit(groups)) * GROUP;
            for (int s = first; s < first + GROUP; s += VW) {
                const vf ox = VF_LOAD(blockers->x + s) - p.x, oy = VF_LOAD(blockers->y + s) - p.y;
                const vf oz = VF_LOAD(blockers->z + s) - p.z;
                vf r = VF_LOAD(blockers->radius + s);
                const vf along = ox * a.x + oy * a.y + oz * a.z, d2 = ox * ox + oy * oy + oz * oz;
                const vf across2 = across_axis(cap, ox, oy, oz, along);
                vi meets = meets_cap(cap, along, across2, d2, r);
                if (!any(meets))
                    continue;
                const vi owner = CAT(vload, VW)(0, blockers->owner + s);
                const vf height = ox * n.x + oy * n.y + oz * n.z;
                meets &= owner != EMITTER_OWNER(light);
                const vi own = owner == receiver->object;
                if (any(meets & own)) {
                    r = select(r, own_radius(r, VF_LOAD(blockers->outside + s), height, sqrt(d2)), own);
                    meets &= meets_cap(cap, along, across2, d2, r);
                }
                if (!any(meets))
                    continue;
                /* The light's cap inside the sphere's, and the sphere in front of the light. */
                const vf tau = fmax(d2 - r * r, 0.0f);
                if (any(meets & covers_cap(cap, along, across2, r) & (tau < cap->near * cap->near)))
                    return DARK;
                if (!framed) {
                    frame_around(a, receiver->turn, t, u);
                    framed = 1;
                }
                state = PARTIAL;
                float fx[VW], fy[VW], fz[VW], ft[VW], fr[VW];
                VF_STORE(ox * t->x + oy * t->y + oz * t->z, fx);
                VF_STORE(ox * u->x + oy * u->y + oz * u->z, fy);
                VF_STORE(along, fz);
                VF_STORE(tau, ft);
                VF_STORE(fmin(r * r, d2), fr);
                for (uint lanes = lane_bits(meets); lanes; lanes &= lanes - 1) {
                    const int l = lowest_bit(lanes);
                    ++*splats;
                    if (ft[l] <= cap->near * cap->near) {
                        splat_sphere(mask, h, fx[l], fy[l], fz[l], ft[l], fr[l]);
                    } else {
                        ru touched[NR];
                        for (int k = 0; k < NR; k++)
                            touched[k] = 0;
                        splat_sphere(touched, h, fx[l], fy[l], fz[l], ft[l], fr[l]);
                        splat_near_light(mask, touched, h, fx[l], fy[l], fz[l], fr[l], in_frame(cap->centre, *t, *u, a),
                                         cap->radius2);
                    }
                }
            }
        }
    }
    return state;
}

/* Does any sphere block the unit direction l before the light is entered at `reach`? */
inline int blocked(const blockers_t *blockers, const receiver_t *receiver, int light, float3 l, float reach)
{
    const float3 p = receiver->position;
    for (int g = 0; g < blockers->n_groups; g++) {
        const float3 go = (float3)(blockers->group_x[g], blockers->group_y[g], blockers->group_z[g]) - p;
        const float gr = blockers->group_radius[g], g_along = dot(go, l);
        if (gr <= 0.0f || g_along < -gr || dot(go, go) - g_along * g_along > gr * gr)
            continue;
        for (int s = g * GROUP; s < (g + 1) * GROUP; s++) {
            float r = blockers->radius[s];
            const int owner = blockers->owner[s];
            if (r <= 0.0f || owner == EMITTER_OWNER(light))
                continue;
            const float3 o = (float3)(blockers->x[s], blockers->y[s], blockers->z[s]) - p;
            const float along = dot(o, l), d2 = dot(o, o);
            if (owner == receiver->object)
                r = own_radius_1(r, blockers->outside[s], dot(receiver->geometric, o), sqrt(d2));
            const float tau = fmax(d2 - r * r, 0.0f);
            if (r > 0.0f && along > 0.0f && along * along >= tau && along - sqrt(along * along - tau) < reach)
                return 1;
        }
    }
    return 0;
}

/* Does the light reach the point from the unit direction l? */
inline int sees_light(const blockers_t *blockers, const receiver_t *receiver, const cap_t *cap, int light,
                      int inside, float3 l)
{
    if (dot(receiver->shading, l) <= 0.0f || dot(receiver->geometric, l) <= 0.0f)
        return 0;
    if (inside)
        return 1;
    const float along = cap->d * dot(cap->a, l), beyond = along * along - cap->tau;
    if (along <= 0.0f || beyond < 0.0f)
        return 0;
    return blockers->n_groups == 0 || !blocked(blockers, receiver, light, l, along - sqrt(beyond));
}
