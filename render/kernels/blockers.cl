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
    __constant uint *disk; /* cells of masks that count */
    /* Of the points of this work-group; see lists.cl. */
    __local const float *near;
    __local const int *list;
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

/* A light at `centre` from a point that is outside of it. */
inline cap_t cap_of(float3 centre, float radius)
{
    cap_t cap;
    const float d2 = dot(centre, centre);
    cap.centre = centre;
    cap.d = sqrt(d2);
    cap.a = centre / cap.d;
    cap.radius2 = radius * radius;
    cap.near = cap.d - radius;
    cap.tau = fmax(cap.near * (cap.d + radius), 0.0f);
    cap.tangent = sqrt(cap.tau);
    cap.sine = radius / cap.d;
    cap.cosine = cap.tangent / cap.d;
    cap.depth = cap.sine * cap.sine / (1.0f + cap.cosine);
    return cap;
}

/* Lanes whose sphere (centre o from the point, |o|^2 = d2, o.a = along, squared distance from the axis across2, radius
   r > 0) may block the cap, as seen from the point or from others up to `slack` around it: its centre is not farther
   from the cone than its radius, and it does not start behind the light's outline. Without roots or angles; true for
   every sphere that contains the point. */
inline vi meets_cap(const cap_t *cap, vf along, vf across2, vf d2, vf r, float slack)
{
    const vf limit = (r + slack + along * cap->sine) * (1.0f / cap->cosine);
    const vf farthest = cap->tangent + r + 2.0f * slack;
    return (across2 <= limit * limit) & (limit > 0.0f) & (d2 < farthest * farthest) & (r > 0.0f);
}

/* Lanes whose sphere covers the cap: the cone's far side lies inside it, and in front of the point. */
inline vi covers_cap(const cap_t *cap, vf along, vf across2, vf r)
{
    const vf limit = (r - along * cap->sine) * (1.0f / cap->cosine), ahead = along * cap->cosine;
    return (across2 < limit * limit) & (limit > 0.0f) & (across2 * (cap->sine * cap->sine) < ahead * ahead)
         & (along > 0.0f);
}

/* Which of the VW groups from the first on may block a cap as seen from p or from points up to `slack` around it. */
inline uint near_groups(const __local blockers_t *blockers, const cap_t *cap, int first, float3 p, float slack)
{
    const vf x = VF_LOAD(blockers->group_x + first) - p.x, y = VF_LOAD(blockers->group_y + first) - p.y;
    const vf z = VF_LOAD(blockers->group_z + first) - p.z, r = VF_LOAD(blockers->group_radius + first);
    const vf along = x * cap->a.x + y * cap->a.y + z * cap->a.z;
    return lane_bits(meets_cap(cap, along, across_axis(cap, x, y, z, along), x * x + y * y + z * z, r, slack));
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

/* Marks what VW spheres at o from the point cover, of the given radius, bulge and owner. Returns DARK where one covers the
   light, LIT where none meets it, else PARTIAL; completes the frame (t, u, a) where it was not `framed`. */
inline int mark_spheres(ru *mask, float3 *t, float3 *u, int *framed, const receiver_t *receiver, const cap_t *cap, int light,
                        __constant uint *disk, vf ox, vf oy, vf oz, vf r, vf outside, vi owner, uint *splats)
{
    const float3 a = cap->a, n = receiver->geometric;
    const vf along = ox * a.x + oy * a.y + oz * a.z, d2 = ox * ox + oy * oy + oz * oz;
    const vf across2 = across_axis(cap, ox, oy, oz, along);
    vi meets = meets_cap(cap, along, across2, d2, r, 0.0f) & (owner != EMITTER_OWNER(light));
    uint lanes = lane_bits(meets);
    if (!lanes)
        return LIT;
    const vi own = meets & (owner == receiver->object);
    if (some(own)) {
        const vf height = ox * n.x + oy * n.y + oz * n.z;
        r = select(r, own_radius(r, outside, height, sqrt(d2)), own);
        meets &= meets_cap(cap, along, across2, d2, r, 0.0f);
        lanes = lane_bits(meets);
        if (!lanes)
            return LIT;
    }
    /* The light's cap inside the sphere's, and the sphere in front of the light. */
    const float near2 = cap->near * cap->near;
    const vf tau = fmax(d2 - r * r, 0.0f), rho2 = fmin(r * r, d2);
    if (some(meets & covers_cap(cap, along, across2, r) & (tau < near2)))
        return DARK;
    if (!*framed)
        frame_around(a, receiver->turn, t, u);
    *framed = 1;
    const float h = cap->sine / cap->cosine;
    const vf x = ox * t->x + oy * t->y + oz * t->z, y = ox * u->x + oy * u->y + oz * u->z;
    ellipses_t e;
    const vi simple = meets & ellipses_of(&e, h, x, y, along, tau, rho2) & (tau <= near2);
    float middle[VW], shear[VW], offset[VW], slope[VW], size[VW], growth[VW];
    VF_STORE(e.middle, middle);
    VF_STORE(e.shear, shear);
    VF_STORE(e.offset, offset);
    VF_STORE(e.slope, slope);
    VF_STORE(e.size, size);
    VF_STORE(e.growth, growth);
    *splats += popcount(lanes);
    /* Vector by vector of the mask, so that it stays in a register and no branch depends on what a sphere reaches. */
#pragma unroll
    for (int k = 0; k < NR; k++) {
        ru bits = mask[k];
        for (uint left = lane_bits(simple & (e.begin < (k + 1.0f) * RW) & (e.end > (float)(k * RW))); left; left &= left - 1) {
            const int l = lowest_bit(left);
            const ellipse_t one = {middle[l], shear[l], offset[l], slope[l], size[l], growth[l]};
            bits |= ellipse_bits(&one, k);
        }
        mask[k] = bits;
    }
    lanes &= ~lane_bits(simple);
    if (lanes) {
        float fx[VW], fy[VW], fz[VW], ft[VW], fr[VW];
        VF_STORE(x, fx);
        VF_STORE(y, fy);
        VF_STORE(along, fz);
        VF_STORE(tau, ft);
        VF_STORE(rho2, fr);
        for (; lanes; lanes &= lanes - 1) {
            const int l = lowest_bit(lanes);
            if (ft[l] <= near2) {
                splat_outline(mask, h, fx[l], fy[l], fz[l], ft[l], fr[l]);
            } else {
                ru touched[NR];
                for (int k = 0; k < NR; k++)
                    touched[k] = 0;
                splat_sphere(touched, h, fx[l], fy[l], fz[l], ft[l], fr[l]);
                for (int k = 0; k < NR; k++)
                    touched[k] &= RU_LOAD(k, disk);
                splat_near_light(mask, touched, h, fx[l], fy[l], fz[l], fr[l], in_frame(cap->centre, *t, *u, a),
                                 cap->radius2);
            }
        }
    }
    return PARTIAL;
}

/* Which part of the light the spheres leave: fills `mask` (cleared by the caller, who may have put the horizon in)
   and returns LIT, PARTIAL or DARK. *splats counts the spheres rasterised. Of the light, the work-group's list is read; where
   it found no room, all groups are. */
inline int visibility(const __local blockers_t *blockers, const receiver_t *receiver, const cap_t *cap, int light,
                      float3 *t, float3 *u, int framed, ru *mask, uint *splats)
{
    const float3 p = receiver->position, a = cap->a;
    int state = framed ? PARTIAL : LIT;
    const int first = blockers->list[2 * light], listed = blockers->list[2 * light + 1];
    for (int s = first; s < first + listed; s += VW) {
        __local const float *near = blockers->near + s;
        const int found = mark_spheres(mask, t, u, &framed, receiver, cap, light, blockers->disk, VF_LOAD(near) - p.x,
                                       VF_LOAD(near + NEAR_ROOM) - p.y, VF_LOAD(near + 2 * NEAR_ROOM) - p.z,
                                       VF_LOAD(near + 3 * NEAR_ROOM), VF_LOAD(near + 4 * NEAR_ROOM),
                                       AS_VI(VF_LOAD(near + 5 * NEAR_ROOM)), splats);
        if (found == DARK)
            return DARK;
        state = max(state, found);
    }
    if (listed >= 0)
        return state;
    for (int g = 0; g < blockers->n_groups; g += VW) {
        uint groups = near_groups(blockers, cap, g, p, 0.0f);
        for (; groups; groups &= groups - 1) {
            const int begin = (g + lowest_bit(groups)) * GROUP;
            for (int s = begin; s < begin + GROUP; s += VW) {
                const int found = mark_spheres(mask, t, u, &framed, receiver, cap, light, blockers->disk, VF_LOAD(blockers->x + s) - p.x,
                                               VF_LOAD(blockers->y + s) - p.y, VF_LOAD(blockers->z + s) - p.z,
                                               VF_LOAD(blockers->radius + s), VF_LOAD(blockers->outside + s),
                                               VI_LOAD(blockers->owner + s), splats);
                if (found == DARK)
                    return DARK;
                state = max(state, found);
            }
        }
    }
    return state;
}

/* Does any sphere block the unit direction l before the light is entered at `reach`? */
inline int blocked(const __local blockers_t *blockers, const receiver_t *receiver, int light, float3 l, float reach)
{
    const float3 p = receiver->position;
    for (int g = 0; g < blockers->n_groups; g++) {
        const float3 go = (float3)(blockers->group_x[g], blockers->group_y[g], blockers->group_z[g]) - p;
        const float gr = blockers->group_radius[g], g_along = dot(go, l);
        const float3 g_across = go - g_along * l; /* not by the difference of squares, which cancels */
        if (gr <= 0.0f || g_along < -gr || dot(g_across, g_across) > gr * gr)
            continue;
        for (int s = g * GROUP; s < (g + 1) * GROUP; s++) {
            float r = blockers->radius[s];
            const int owner = blockers->owner[s];
            if (r <= 0.0f || owner == EMITTER_OWNER(light))
                continue;
            const float3 o = (float3)(blockers->x[s], blockers->y[s], blockers->z[s]) - p;
            const float along = dot(o, l);
            const float3 across = o - along * l;
            if (owner == receiver->object)
                r = own_radius_1(r, blockers->outside[s], dot(receiver->geometric, o), length(o));
            const float half_chord2 = r * r - dot(across, across);
            if (r > 0.0f && along > 0.0f && half_chord2 >= 0.0f && along - sqrt(half_chord2) < reach)
                return 1;
        }
    }
    return 0;
}

/* Does the light reach the point from the unit direction l? */
inline int sees_light(const __local blockers_t *blockers, const receiver_t *receiver, const cap_t *cap, int light,
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
