/* Direct light at PW points per work-item. What of a light's terms the blockers leave is the business of the estimator:
   accurate.cl or paper.cl define `whole_diffuse` and `shadow`. */

/* Lights by how points see them, and the work that this took. */
typedef struct {
    pi lit, partial, dark, below, splats, products, leaves;
} counts_t;

/* The points of a work-item. */
typedef struct {
    pf3 position, geometric, shading;
    pf turn;
    pi object, material;
} receivers_t;

inline receivers_t load_points(__global const point_t *points, int n)
{
    receivers_t r;
    for (int l = 0; l < PW; l++) {
        __global const point_t *p = points + min(l, n - 1);
        LANE(r.position.x, l) = p->position[0];
        LANE(r.position.y, l) = p->position[1];
        LANE(r.position.z, l) = p->position[2];
        LANE(r.geometric.x, l) = p->geometric[0];
        LANE(r.geometric.y, l) = p->geometric[1];
        LANE(r.geometric.z, l) = p->geometric[2];
        LANE(r.shading.x, l) = p->shading[0];
        LANE(r.shading.y, l) = p->shading[1];
        LANE(r.shading.z, l) = p->shading[2];
        LANE(r.turn, l) = p->turn;
        INT_LANE(r.object, l) = p->object;
        INT_LANE(r.material, l) = p->material;
    }
    return r;
}

inline receiver_t receiver_lane(const receivers_t *receivers, int l)
{
    receiver_t receiver;
    receiver.position = vector_lane(&receivers->position, l);
    receiver.geometric = vector_lane(&receivers->geometric, l);
    receiver.shading = vector_lane(&receivers->shading, l);
    receiver.object = INT_LANE(receivers->object, l);
    receiver.turn = LANE(receivers->turn, l);
    return receiver;
}

inline pf3 vectors(float x, float y, float z)
{
    const pf3 v = {x, y, z};
    return v;
}

inline void add_lane(pf3 *sum, int l, float3 v)
{
    LANE(sum->x, l) += v.x;
    LANE(sum->y, l) += v.y;
    LANE(sum->z, l) += v.z;
}

inline void store_points(pf3 v, int n, __global float *out)
{
    for (int l = 0; l < n; l++)
        vstore3(vector_lane(&v, l), l, out);
}

__kernel void shade(__global const point_t *points, const int n_points, __global const float *tangents,
                    const float eye_x, const float eye_y, const float eye_z,
                    __global const material_t *materials, __global const lobe_t *lobes,
                    __global const float4 *slices, __global const float *product_table,
                    __global const float *cap_table, __global const float *weights,
                    __global const light_t *lights, const int n_lights, const float threshold,
                    __global const float *x, __global const float *y, __global const float *z,
                    __global const float *radius, __global const float *outside, __global const int *owner,
                    __global const float *group_x, __global const float *group_y, __global const float *group_z,
                    __global const float *group_radius, const int n_groups, __constant uint *disk,
                    __global float *radiance, __global stats_t *stats, __global float *irradiance)
{
    const int first = get_global_id(0) * PW;
    if (first >= n_points)
        return;
    const int n = min(PW, n_points - first);
    const blockers_t blockers = {x, y, z, radius, outside, owner, group_x, group_y, group_z, group_radius, n_groups};
    const tables_t tables = {product_table, cap_table, weights};
    const receivers_t receivers = load_points(points + first, n);
    pf3 tangent = vectors(0.0f, 0.0f, 0.0f);
#if ANISOTROPIC
    for (int l = 0; l < n; l++)
        add_lane(&tangent, l, vload3(first + l, tangents));
#endif
    pf3 view = plus(vectors(eye_x, eye_y, eye_z), -1.0f, receivers.position);
    view = scaled(view, rsqrt(dots(view, view)));
    const brdfs_t brdfs = bind_brdfs(materials, lobes, receivers.material, view, receivers.shading, tangent);

    pf3 sum = vectors(0.0f, 0.0f, 0.0f), arriving = sum;
    counts_t count = {0};
    for (int j = 0; j < n_lights; j++) {
        const light_t light = lights[j];
        const caps_t caps = caps_of(plus(vectors(light.center[0], light.center[1], light.center[2]), -1.0f, receivers.position),
                                    light.radius);
        const float3 colour = (float3)(light.radiance[0], light.radiance[1], light.radiance[2]);
        const pf over_geometric = dots(receivers.geometric, caps.a), over_shading = dots(receivers.shading, caps.a);
        /* Points to which the light is a point, or no mask can hold it: one by one. */
        const pi special = light.radius == 0.0f ? caps.d == caps.d
                                                : (caps.near <= 0.0f) | (caps.tau < COS2_WIDE * caps.d * caps.d);
        for (uint lanes = point_bits(special); lanes; lanes &= lanes - 1) {
            const int l = lowest_bit(lanes);
            const receiver_t receiver = receiver_lane(&receivers, l);
            const brdf_t brdf = brdf_lane(&brdfs, l);
            cap_t cap = cap_lane(&caps, l);
            float diffuse = 0.0f;
            float3 part = 0.0f;
            if (light.radius == 0.0f) {
                if (cap.d == 0.0f)
                    continue;
                part = reflected_point(&receiver, &brdf, &cap, &blockers, j, &diffuse);
                INT_LANE(*(diffuse > 0.0f ? &count.lit : &count.dark), l) += 1;
            } else {
                const int inside = cap.near <= 0.0f;
                if (inside) {
                    cap.a = receiver.geometric;
                    cap.cosine = 0.0f;
                    cap.sine = 1.0f;
                }
                cap.depth = 1.0f - cap.cosine;
                part = reflected_wide(&receiver, &brdf, &cap, &blockers, j, inside, &diffuse);
                INT_LANE(count.partial, l) += 1;
            }
            add_lane(&sum, l, colour * part);
            add_lane(&arriving, l, colour * diffuse);
        }
        const pi below = (over_geometric <= -caps.sine) | (over_shading <= -caps.sine);
        const pi seen = (special == 0) & (below == 0);
        count.below -= (special == 0) & below;
        if (!point_bits(seen))
            continue;

        pf terms[1 + MAX_LOBES];
        const pi cut = over_shading < caps.sine;
        terms[0] = whole_diffuse(&caps, over_shading);
        const pf3 kd = brdfs.kd;
        for (int k = 0; k < brdfs.n_lobes; k++) {
            const bound_lobes_t *lobe = &brdfs.lobes[k];
            pf3 normal = receivers.shading;
            normal.x = select(normal.x, lobe->axis.x, cut);
            normal.y = select(normal.y, lobe->axis.y, cut);
            normal.z = select(normal.z, lobe->axis.z, cut);
            terms[1 + k] = lobe_over_cap(slices, lobe->slice, lobe->exponent, lobe->axis, normal, caps.a, caps.sine, caps.depth,
                                         lobe->cosine);
            if (threshold > 0.0f)
                terms[1 + k] = select((pf)(0.0f), terms[1 + k], largest_of(lobe->colour) * terms[1 + k] >= threshold);
        }
        const pf useful = select((pf)(1.0f), (pf)(0.0f), largest_of(kd) * terms[0] < (threshold > 0.0f ? threshold : -INFINITY));
        pi state = LIT;
        pi to_do = seen;
        if (n_groups == 0 && !UNIT_LIGHTS)
            to_do &= (over_geometric < caps.sine) | cut;
        for (uint lanes = point_bits(to_do); lanes; lanes &= lanes - 1) {
            const int l = lowest_bit(lanes);
            const receiver_t receiver = receiver_lane(&receivers, l);
            const brdf_t brdf = brdf_lane(&brdfs, l);
            const cap_t cap = cap_lane(&caps, l);
            float own[1 + MAX_LOBES];
            for (int k = 0; k <= brdf.n_lobes; k++)
                own[k] = LANE(terms[k], l);
            work_t work = {0};
            INT_LANE(state, l) = shadow(own, &receiver, &brdf, &cap, &blockers, j, &tables, disk, threshold, &work);
            for (int k = 0; k <= brdf.n_lobes; k++)
                LANE(terms[k], l) = own[k];
            INT_LANE(count.splats, l) += work.splats;
            INT_LANE(count.products, l) += work.products;
            INT_LANE(count.leaves, l) += work.leaves;
        }
        const pi shaded = seen & (state != DARK);
        count.lit -= seen & (state == LIT);
        count.partial -= seen & (state == PARTIAL);
        count.dark -= seen & (state == DARK);
        count.products -= shaded * (1 + brdfs.n_lobes);
        pf3 part = scaled(brdfs.kd, useful * terms[0]);
        for (int k = 0; k < brdfs.n_lobes; k++)
            part = plus(part, terms[1 + k], brdfs.lobes[k].colour);
        sum.x += select((pf)(0.0f), colour.x * part.x, shaded);
        sum.y += select((pf)(0.0f), colour.y * part.y, shaded);
        sum.z += select((pf)(0.0f), colour.z * part.z, shaded);
        const pf diffuse = select((pf)(0.0f), terms[0], shaded);
        arriving = plus(arriving, diffuse, vectors(colour.x, colour.y, colour.z));
    }
    store_points(sum, n, radiance + 3 * first);
#if IRRADIANCE
    store_points(arriving, n, irradiance + 3 * first);
#endif
    for (int l = 0; l < n; l++) {
        const stats_t own = {INT_LANE(count.lit, l), INT_LANE(count.partial, l), INT_LANE(count.dark, l), INT_LANE(count.below, l),
                             INT_LANE(count.splats, l), INT_LANE(count.products, l), INT_LANE(count.leaves, l)};
        stats[first + l] = own;
    }
}
