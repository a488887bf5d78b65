/* Direct light at one point per work-item: closed forms where nothing blocks, bits where something does. */

/* A light as a point sees it: unit axis a, distance d of the centre, sine and cosine of the cap's half-angle,
   depth = 1 - cosine, tangent = length of the tangent, tau = its square, near = distance of its nearest point. */
typedef struct {
    float3 a;
    float d, sine, cosine, depth, tangent, tau, near;
} cap_t;

typedef struct {
    __global const float *x, *y, *z, *radius, *outside;
    __global const int *owner;
    __global const float *group_x, *group_y, *group_z, *group_radius;
    int n_groups; /* a multiple of VW; a group holds GROUP spheres */
} blockers_t;

typedef struct {
    float3 position, geometric, shading, mirror;
    int object;
    float turn; /* by which its masks are turned, as a fraction of a full turn */
} receiver_t;

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
                        splat_near_light(mask, touched, h, fx[l], fy[l], fz[l], fr[l], cap->d,
                                         cap->sine * cap->sine * cap->d * cap->d);
                    }
                }
            }
        }
    }
    return state;
}

/* Values of the cells in column c whose bit is set, 0 of the others. */
inline rf where_bit(ru rows, int c, rf value)
{
    return select((rf)(0.0f), value, AS_RI(rows << (31 - c)));
}

/* Sums of solid angle times cosine over the cells of the light's disk, over all (x) and over lit ones (y). */
inline float2 diffuse_cells(const ru *lit, __constant uint *disk, float h, float3 n)
{
    rf all = 0.0f, some = 0.0f;
    for (int k = 0; k < NR; k++) {
        const rf y = row_centres(k) * h;
        const ru inside = RU_LOAD(k, disk);
        for (int c = 0; c < ROWS; c++) {
            const float x = column_centre(c) * h;
            const rf inverse = rsqrt(x * x + y * y + 1.0f);
            const rf omega = where_bit(inside, c, inverse * inverse * inverse);
            const rf value = omega * fmax((n.x * x + n.y * y + n.z) * inverse, 0.0f);
            all += value;
            some += where_bit(lit[k], c, value);
        }
    }
    return (float2)(row_sum(all), row_sum(some));
}

/* Sums over the cells of the light's disk with a lobe of exponent e around the unit vector r: solid angle times lobe
   times the cosine to r (x), to the normal over all (y) and over lit cells (z). A lobe that falls between the cells'
   centres is widened until neighbouring cells share it. */
inline float3 glossy_cells(const ru *lit, __constant uint *disk, float h, float3 n, float3 r, float e)
{
    rf around = 0.0f, all = 0.0f, some = 0.0f;
    const float exponent = fmin(e, (float)(ROWS * ROWS) / (h * h)); /* half a cell wide at least */
    for (int k = 0; k < NR; k++) {
        const rf y = row_centres(k) * h;
        const ru inside = RU_LOAD(k, disk);
        for (int c = 0; c < ROWS; c++) {
            const float x = column_centre(c) * h;
            const rf inverse = rsqrt(x * x + y * y + 1.0f);
            const rf omega = where_bit(inside, c, inverse * inverse * inverse);
            const rf dx = x * inverse - r.x, dy = y * inverse - r.y, dz = inverse - r.z;
            const rf q = 0.5f * (dx * dx + dy * dy + dz * dz);
            const rf lobe = omega * lobe_rows(q, exponent);
            const rf value = lobe * fmax((n.x * x + n.y * y + n.z) * inverse, 0.0f);
            around += lobe * (1.0f - q);
            all += value;
            some += where_bit(lit[k], c, value);
        }
    }
    return (float3)(row_sum(around), row_sum(all), row_sum(some));
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

/* Diffuse and glossy integrals for a light so near or so large that no plane holds its cone: directions in an
   equal-area map of the cap (inside the light: of the hemisphere), and such as the lobe itself distributes them, since
   a sharp one would fall between the former; each tested against every blocker. */
inline float2 wide_light(const blockers_t *blockers, const receiver_t *receiver, const cap_t *cap, int light,
                         int inside, int glossy, float e)
{
    float sums[2] = {0.0f, 0.0f};
    for (int lobe = 0; lobe <= glossy; lobe++) {
        const float3 axis = lobe ? receiver->mirror : cap->a;
        float3 t, u;
        frame_around(axis, receiver->turn, &t, &u);
        for (int k = 0; k < WIDE_RINGS; k++) {
            const float share = (k + 0.5f) / WIDE_RINGS;
            const float below = lobe ? -expm1(log(share) / (e + 1.0f)) : share * cap->depth; /* 1 - cosine */
            const float z = 1.0f - below, rim = sqrt(fmax(below * (2.0f - below), 0.0f));
            for (int c = 0; c < WIDE_SECTORS; c++) {
                float sine;
                const float cosine = sincos_turn((c + 0.5f) / WIDE_SECTORS, &sine);
                const float3 l = rim * (cosine * t + sine * u) + z * axis;
                if (sees_light(blockers, receiver, cap, light, inside, l))
                    sums[lobe] += dot(receiver->shading, l);
            }
        }
    }
    return (float2)(sums[0] * cap->depth, sums[1] / (e + 1.0f)) * (2.0f * M_PI_F / (WIDE_RINGS * WIDE_SECTORS));
}

__kernel void shade(__global const point_t *points, const int n_points, const float eye_x, const float eye_y,
                    const float eye_z, __global const material_t *materials, __global const float4 *slices,
                    __global const light_t *lights, const int n_lights, __global const float *x,
                    __global const float *y, __global const float *z, __global const float *radius,
                    __global const float *outside, __global const int *owner, __global const float *group_x,
                    __global const float *group_y, __global const float *group_z,
                    __global const float *group_radius, const int n_groups, __constant uint *disk,
                    __global float *radiance, __global stats_t *stats)
{
    const int i = get_global_id(0);
    if (i >= n_points)
        return;
    const point_t point = points[i];
    const material_t material = materials[point.material];
    const blockers_t blockers = {x, y, z, radius, outside, owner, group_x, group_y, group_z, group_radius, n_groups};
    receiver_t receiver;
    receiver.position = (float3)(point.position[0], point.position[1], point.position[2]);
    receiver.geometric = (float3)(point.geometric[0], point.geometric[1], point.geometric[2]);
    receiver.shading = (float3)(point.shading[0], point.shading[1], point.shading[2]);
    receiver.object = point.object;
    receiver.turn = point.turn;
    const float3 n = receiver.shading;
    const float3 view = normalize((float3)(eye_x, eye_y, eye_z) - receiver.position);
    receiver.mirror = 2.0f * dot(n, view) * n - view;
    const float3 kd = (float3)(material.kd[0], material.kd[1], material.kd[2]);
    const float3 ks = (float3)(material.ks[0], material.ks[1], material.ks[2]);
    const float e = material.exponent;
    const int glossy = GLOSSY ? material.slice >= 0 : 0;

    float3 sum = 0.0f;
    stats_t count = {0, 0, 0, 0, 0};
    for (int j = 0; j < n_lights; j++) {
        const light_t light = lights[j];
        const float3 to_light = (float3)(light.center[0], light.center[1], light.center[2]) - receiver.position;
        const float d2 = dot(to_light, to_light), r = light.radius;
        cap_t cap;
        cap.d = sqrt(d2);
        cap.near = cap.d - r;
        cap.tau = fmax(cap.near * (cap.d + r), 0.0f);
        cap.tangent = sqrt(cap.tau);
        float diffuse, lobe = 0.0f;
        if (cap.near <= 0.0f || cap.tau < COS2_WIDE * d2) {
            const int inside = cap.near <= 0.0f;
            cap.a = inside ? receiver.geometric : to_light / cap.d;
            cap.cosine = inside ? 0.0f : cap.tangent / cap.d;
            cap.sine = inside ? 1.0f : r / cap.d;
            cap.depth = 1.0f - cap.cosine;
            const float2 both = wide_light(&blockers, &receiver, &cap, j, inside, glossy, e);
            diffuse = both.x;
            lobe = both.y;
            count.partial++;
        } else {
            cap.a = to_light / cap.d;
            cap.sine = r / cap.d;
            cap.cosine = cap.tangent / cap.d;
            const float q = cap.sine * cap.sine;
            cap.depth = q / (1.0f + cap.cosine);
            const float over_geometric = dot(receiver.geometric, cap.a), over_shading = dot(n, cap.a);
            if (over_geometric <= -cap.sine || over_shading <= -cap.sine) {
                count.below++;
                continue;
            }
            const float h = cap.sine / cap.cosine;
            const int cut = over_shading < cap.sine; /* the shading horizon crosses the light */
            float3 t, u;
            ru mask[NR];
            for (int k = 0; k < NR; k++)
                mask[k] = 0;
            int framed = 0;
            if (over_geometric < cap.sine || (cut & glossy)) {
                frame_around(cap.a, receiver.turn, &t, &u);
                const float3 g = receiver.geometric;
                splat_horizon(mask, h, (float3)(dot(g, t), dot(g, u), over_geometric));
                framed = 1;
            }
            uint splats = 0;
            const int state = visibility(&blockers, &receiver, &cap, j, &t, &u, framed, mask, &splats);
            count.splats += splats;
            if (state == DARK) {
                count.dark++;
                continue;
            }
            diffuse = lambert_sphere(over_shading, q);
            if (glossy) /* where the horizon cuts the light, with the cosine to the lobe's own axis */
                lobe = lobe_over_cap(slices + material.slice * (CAPS * ANGLES), e, receiver.mirror,
                                     cut ? receiver.mirror : n, cap.a, cap.sine, cap.depth);
            if (state == PARTIAL) {
                ru lit[NR];
                for (int k = 0; k < NR; k++)
                    lit[k] = RU_LOAD(k, disk) & ~mask[k];
                const float3 moments = bit_moments(lit, h);
                if (moments.x == 0.0f) {
                    count.dark++;
                    continue;
                }
                const float3 nl = (float3)(dot(n, t), dot(n, u), over_shading);
                if (moments.x < DISK_CELLS || cut) {
                    count.partial++;
                    if (!cut && h < LARGEST_MOMENT_H) {
                        const float seen = dot(nl, (float3)(moments.y, moments.z, moments.x));
                        diffuse *= clamp(seen / (nl.z * DISK_CELLS), 0.0f, 1.0f);
                    } else {
                        const float2 cells = diffuse_cells(lit, disk, h, nl);
                        diffuse = cells.x > 0.0f ? diffuse * cells.y / cells.x : 0.0f;
                    }
                    /* A lobe that hardly reaches the light is not worth its cells. */
                    if (glossy && lobe * (e + 2.0f) > NEGLIGIBLE_LOBE * 4.0f * M_PI_F * cap.depth) {
                        const float3 m = receiver.mirror;
                        const float3 ml = (float3)(dot(m, t), dot(m, u), dot(m, cap.a));
                        const float3 cells = glossy_cells(lit, disk, h, nl, ml, e);
                        const float whole = cut ? cells.x : cells.y;
                        lobe = whole > 0.0f ? lobe * cells.z / whole : 0.0f;
                    }
                } else {
                    count.lit++;
                }
            } else {
                count.lit++;
            }
        }
        sum += (float3)(light.radiance[0], light.radiance[1], light.radiance[2]) * (kd * diffuse + ks * lobe);
    }
    radiance[3 * i] = sum.x;
    radiance[3 * i + 1] = sum.y;
    radiance[3 * i + 2] = sum.z;
    stats[i] = count;
}
