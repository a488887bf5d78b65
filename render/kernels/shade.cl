/* Direct light at PW points per work-item. What of a light's terms the blockers leave is the business of the estimator:
   accurate.cl or paper.cl define `whole_diffuse` and `shadow`. */

/* What all points of a frame share. */
typedef struct {
    __global const float *points; /* rows of `stride` numbers, whole work-groups */
    __global const float *tangents;
    table_t materials, lobes;
    __global const float4 *slices;
    __global const light_t *lights;
    __constant uint *disk;
    __global float *radiance, *irradiance;
    __global uint2 *work;
    float3 eye;
    float threshold;
    int n_points, stride, n_lights;
    tables_t tables;
    blockers_t blockers;
} frame_t;

/* Lights by how points see them, and the work that this took; see layout.STATS. */
typedef struct {
    pi lit, partial, dark, below, listed, splats, products, leaves;
} counts_t;

/* The points of a work-item. */
typedef struct {
    pf3 position, geometric, shading;
    pf turn;
    pi object, material;
} receivers_t;

inline receivers_t load_points(__global const float *rows, int stride)
{
    receivers_t r;
    r.position = load3(rows + POSITION_X * stride, stride);
    r.geometric = load3(rows + GEOMETRIC_X * stride, stride);
    r.shading = load3(rows + SHADING_X * stride, stride);
    r.turn = PF_LOAD(rows + TURN * stride);
    r.material = AS_PI(PF_LOAD(rows + MATERIAL * stride));
    r.object = AS_PI(PF_LOAD(rows + OBJECT * stride));
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

inline void add_lane(pf3 *sum, int l, float3 v)
{
    LANE(sum->x, l) += v.x;
    LANE(sum->y, l) += v.y;
    LANE(sum->z, l) += v.z;
}

/* Of all points, in addition to what is there where that is asked for. */
inline void store_points(pf3 v, int add, __global float *out)
{
    if (add)
        for (int l = 0; l < PW; l++)
            add_lane(&v, l, vload3(l, out));
    store3(v, out);
}

/* Adds light `j` where it is a point, or no mask can hold it, to the `chosen` points one by one. */
inline void add_special(const __local frame_t *frame, int j, pi chosen, const receivers_t *receivers, const brdfs_t *brdfs,
                        const caps_t *caps, pf3 *sum, pf3 *arriving, counts_t *count)
{
    const float3 colour = vload3(0, frame->lights[j].radiance);
    for (uint lanes = point_bits(chosen); lanes; lanes &= lanes - 1) {
        const int l = lowest_bit(lanes);
        const receiver_t receiver = receiver_lane(receivers, l);
        const brdf_t brdf = brdf_lane(brdfs, l);
        cap_t cap = cap_lane(caps, l);
        float diffuse = 0.0f;
        float3 part = 0.0f;
        if (cap.radius2 == 0.0f) {
            if (cap.d == 0.0f)
                continue;
            part = reflected_point(&receiver, &brdf, &cap, &frame->blockers, j, &diffuse);
            INT_LANE(*(diffuse > 0.0f ? &count->lit : &count->dark), l) += 1;
        } else {
            const int inside = cap.near <= 0.0f;
            if (inside) {
                cap.a = receiver.geometric;
                cap.sine = 1.0f;
                cap.cosine = 0.0f;
            }
            cap.depth = 1.0f - cap.cosine;
            part = reflected_wide(&receiver, &brdf, &cap, &frame->blockers, j, inside, &diffuse);
            INT_LANE(count->partial, l) += 1;
        }
        add_lane(sum, l, colour * part);
        add_lane(arriving, l, colour * diffuse);
    }
}

/* Integrals of BRDF times cosine over a light's caps as if nothing blocked them: the diffuse one, then those of the lobes.
   Lobes below the threshold are 0. */
inline void whole_terms(pf *terms, const __local frame_t *frame, const receivers_t *receivers, const brdfs_t *brdfs,
                        const caps_t *caps, pf over_shading)
{
    terms[0] = whole_diffuse(caps, over_shading);
    for (int k = brdfs->n_lobes; k < MAX_LOBES; k++)
        terms[1 + k] = 0.0f;
    for (int k = 0; k < brdfs->n_lobes; k++) {
        const bound_lobes_t *lobe = &brdfs->lobes[k];
        /* Where the horizon cuts the light, with the cosine to the lobe's own axis: the cells take it to the true one. */
        const pf3 normal = choose(receivers->shading, lobe->axis, over_shading < caps->sine);
        const pf whole = lobe_over_cap(frame->slices, lobe->slice, lobe->exponent, lobe->axis, normal, caps->a, caps->sine,
                                       caps->depth, lobe->cosine);
        terms[1 + k] = select(whole, (pf)(0.0f), largest_of(lobe->colour) * whole < frame->threshold);
    }
}

/* Adds light `j` to the `chosen` points. */
inline void add_light(const __local frame_t *frame, int j, pi chosen, const receivers_t *receivers, const brdfs_t *brdfs,
                      const caps_t *caps, pf3 *sum, pf3 *arriving, counts_t *count)
{
    const pf over_geometric = dots(receivers->geometric, caps->a), over_shading = dots(receivers->shading, caps->a);
    const pi below = (over_geometric <= -caps->sine) | (over_shading <= -caps->sine);
    const pi above = chosen & (below == 0);
    const int listed = frame->blockers.list[2 * j + 1];
    count->below += ones(chosen & below);
    count->listed += ones(chosen) * (listed >= 0 ? listed : frame->blockers.n_groups * GROUP);
    if (!point_bits(above))
        return;
    pf terms[1 + MAX_LOBES];
#if ENDS_BEFORE(UP_TO_INTEGRATION)
    for (int k = 0; k <= MAX_LOBES; k++)
        terms[k] = 0.0f;
#else
    whole_terms(terms, frame, receivers, brdfs, caps, over_shading);
#endif
    const float least = frame->threshold > 0.0f ? frame->threshold : -INFINITY;
    const pf useful = select((pf)(1.0f), (pf)(0.0f), largest_of(brdfs->kd) * terms[0] < least);
    pi state = LIT, to_do = above;
    if (listed == 0 && !UNIT_LIGHTS)
        to_do &= (over_geometric < caps->sine) | (over_shading < caps->sine);
    for (uint lanes = point_bits(to_do); lanes; lanes &= lanes - 1) {
        const int l = lowest_bit(lanes);
        const receiver_t receiver = receiver_lane(receivers, l);
        const brdf_t brdf = brdf_lane(brdfs, l);
        const cap_t cap = cap_lane(caps, l);
        /* Of constant length: LLVM 15 compiles copies of as many as there are lobes wrongly where PW is 1. */
        float own[1 + MAX_LOBES];
        for (int k = 0; k <= MAX_LOBES; k++)
            own[k] = LANE(terms[k], l);
        work_t work = {0};
        INT_LANE(state, l) = shadow(own, &receiver, &brdf, &cap, &frame->blockers, j, &frame->tables, frame->disk,
                                    frame->threshold, &work);
        for (int k = 0; k <= MAX_LOBES; k++)
            LANE(terms[k], l) = own[k];
        INT_LANE(count->splats, l) += work.splats;
        INT_LANE(count->products, l) += work.products;
        INT_LANE(count->leaves, l) += work.leaves;
    }
    const pi shaded = above & (state != DARK);
    count->lit += ones(above & (state == LIT));
    count->partial += ones(above & (state == PARTIAL));
    count->dark += ones(above & (state == DARK));
    count->products += ones(shaded) * (1 + brdfs->n_lobes);
    if (ENDS_BEFORE(UP_TO_INTEGRATION))
        return;
    pf3 part = scaled(brdfs->kd, useful * terms[0]);
    for (int k = 0; k < brdfs->n_lobes; k++)
        part = plus(part, terms[1 + k], brdfs->lobes[k].colour);
    const float3 colour = vload3(0, frame->lights[j].radiance);
    sum->x += select((pf)(0.0f), colour.x * part.x, shaded);
    sum->y += select((pf)(0.0f), colour.y * part.y, shaded);
    sum->z += select((pf)(0.0f), colour.z * part.z, shaded);
    *arriving = plus(*arriving, select((pf)(0.0f), terms[0], shaded), vectors(colour.x, colour.y, colour.z));
}

#if STAGE != FUSED
/* Bits of all that is in vectors, points, reflectances and caps; see stages.cl. */
inline pi bits_of(pf3 v)
{
    return AS_PI(v.x + v.y + v.z);
}

inline pi receivers_bits(const receivers_t *r)
{
    return bits_of(r->position) + bits_of(r->geometric) + bits_of(r->shading) + AS_PI(r->turn) + r->object + r->material;
}

inline pi brdfs_bits(const brdfs_t *brdfs)
{
    pi bits = bits_of(brdfs->kd);
    for (int k = 0; k < brdfs->n_lobes; k++) {
        const bound_lobes_t *lobe = &brdfs->lobes[k];
        bits += bits_of(lobe->axis) + bits_of(lobe->colour) + AS_PI(lobe->exponent) + lobe->slice + lobe->cosine;
    }
    return bits;
}

inline pi caps_bits(const caps_t *c)
{
    return bits_of(c->a) + AS_PI(c->sine + c->cosine + c->depth + c->d + c->tangent + c->tau + c->near);
}
#endif

/* Shades PW points from the first on by lights from `begin` to before `end`, in addition to those before; returns what that
   took. */
__attribute__((noinline))
stats_t shade_points(const __local frame_t *frame, int first, int begin, int end)
{
    const int n = min(PW, frame->n_points - first);
    const receivers_t receivers = load_points(frame->points + first, frame->stride);
    pf3 sum = vectors(0.0f, 0.0f, 0.0f), arriving = sum, tangent = sum;
#if ANISOTROPIC
    for (int l = 0; l < n; l++)
        add_lane(&tangent, l, vload3(first + l, frame->tangents));
#endif
    pf3 view = plus(vectors(frame->eye.x, frame->eye.y, frame->eye.z), -1.0f, receivers.position);
    view = scaled(view, rsqrt(dots(view, view)));
#if ENDS_BEFORE(UP_TO_REFLECTANCE)
    const brdfs_t brdfs = {{0.0f, 0.0f, 0.0f}, 0};
#else
    const brdfs_t brdfs = bind_brdfs(&frame->materials, &frame->lobes, receivers.material, view, receivers.shading, tangent);
#endif
    pi within = 0; /* points that there are */
    for (int l = 0; l < n; l++)
        INT_LANE(within, l) = PW == 1 ? 1 : -1;
    counts_t count = {0};
    KEEP(count.lit, receivers_bits(&receivers) + bits_of(view));
    KEEP(count.lit, brdfs_bits(&brdfs));
    for (int j = begin; j < end; j++) {
        if (ENDS_BEFORE(UP_TO_CAPS))
            break;
        if (!ENDS_BEFORE(UP_TO_MASK) && frame->blockers.list[2 * j + 1] == BELOW) {
            count.below += ones(within);
            continue;
        }
        const light_t light = frame->lights[j];
        const caps_t caps = caps_of(plus(vectors(light.center[0], light.center[1], light.center[2]), -1.0f, receivers.position),
                                    light.radius);
        KEEP(count.lit, caps_bits(&caps));
        if (ENDS_BEFORE(UP_TO_MASK))
            continue;
        pi special = within;
        if (light.radius > 0.0f)
            special &= (caps.near <= 0.0f) | (caps.tau < COS2_WIDE * caps.d * caps.d);
        if (!ENDS_BEFORE(UP_TO_INTEGRATION))
            add_special(frame, j, special, &receivers, &brdfs, &caps, &sum, &arriving, &count);
        add_light(frame, j, within & (special == 0), &receivers, &brdfs, &caps, &sum, &arriving, &count);
    }
    store_points(sum, begin > 0, frame->radiance + 3 * first);
#if IRRADIANCE
    store_points(arriving, begin > 0, frame->irradiance + 3 * first);
#endif
#if WORK
    for (int l = 0; l < PW; l++) {
        const uint2 before = begin > 0 ? frame->work[first + l] : (uint2)(0);
        frame->work[first + l] = before + (uint2)(INT_LANE(count.products, l), INT_LANE(count.leaves, l));
    }
#endif
    const stats_t all = {point_sum(count.lit), point_sum(count.partial), point_sum(count.dark), point_sum(count.below),
                         point_sum(count.listed), point_sum(count.splats), point_sum(count.products), point_sum(count.leaves)};
    return all;
}

__kernel __attribute__((reqd_work_group_size(WORK_GROUP / PW, 1, 1)))
void shade(__global const float *points, const int n_points, __global const float *tangents,
           const float eye_x, const float eye_y, const float eye_z,
           __global const float *materials, const int n_materials, __global const float *lobes, const int n_lobes,
           __global const float4 *slices, __global const float *product_table,
           __global const float *cap_table, __global const float *weights,
           __global const light_t *lights, const int n_lights, const float threshold,
           __global const float *x, __global const float *y, __global const float *z,
           __global const float *radius, __global const float *outside, __global const int *owner,
           __global const float *group_x, __global const float *group_y, __global const float *group_z,
           __global const float *group_radius, const int n_groups, __constant uint *disk, __local int *list,
           __global float *radiance, __global stats_t *stats, __global float *irradiance, __global uint2 *work)
{
    __local frame_t frame;
    __local float near[NEAR_ROWS * NEAR_ROOM];
    __local stats_t counts[WORK_GROUP / PW], sum;
    __local int end;
    const int first = get_group_id(0) * WORK_GROUP, lane = get_local_id(0), own = first + lane * PW;
    const stats_t nothing = {0};
    counts[lane] = nothing;
    if (lane == 0) {
        sum = nothing;
        frame.points = points;
        frame.tangents = tangents;
        frame.materials.rows = materials;
        frame.materials.count = n_materials;
        frame.lobes.rows = lobes;
        frame.lobes.count = n_lobes;
        frame.slices = slices;
        frame.lights = lights;
        frame.disk = disk;
        frame.radiance = radiance;
        frame.irradiance = irradiance;
        frame.work = work;
        frame.eye = (float3)(eye_x, eye_y, eye_z);
        frame.threshold = threshold;
        frame.n_points = n_points;
        frame.stride = get_num_groups(0) * WORK_GROUP;
        frame.n_lights = n_lights;
        frame.tables.products = product_table;
        frame.tables.caps = cap_table;
        frame.tables.weights = weights;
        frame.blockers.x = x;
        frame.blockers.y = y;
        frame.blockers.z = z;
        frame.blockers.radius = radius;
        frame.blockers.outside = outside;
        frame.blockers.owner = owner;
        frame.blockers.group_x = group_x;
        frame.blockers.group_y = group_y;
        frame.blockers.group_z = group_z;
        frame.blockers.group_radius = group_radius;
        frame.blockers.n_groups = n_groups;
        frame.blockers.disk = disk;
        frame.blockers.near = near;
        frame.blockers.list = list;
    }
    int begin = 0;
    do { /* all lights at once, where there is room for their lists */
        if (lane == 0)
            end = ENDS_BEFORE(UP_TO_MASK) ? n_lights
                : list_near(&frame.blockers, points + first, frame.stride, lights, begin, n_lights, near, list);
        barrier(CLK_LOCAL_MEM_FENCE);
        const int next = end; /* before another item may write it */
        if (own < n_points)
            counts[lane] = shade_points(&frame, own, begin, next);
        barrier(CLK_LOCAL_MEM_FENCE);
        begin = next;
        if (lane == 0)
            add_stats(&sum, counts);
    } while (begin < n_lights);
    if (lane == 0)
        stats[get_group_id(0)] = sum;
}
