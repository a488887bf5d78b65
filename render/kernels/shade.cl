/* Direct light at one point per work-item; the points of a work-group share lists of blockers. What a light adds is the
   business of the estimator: accurate.cl or paper.cl define `reflected`. */

/* What all points have in common. Work-groups keep it in local memory: private variables of a kernel with barriers are
   copied for each of its work-items. */
typedef struct {
    __global const point_t *points;
    __global const float *tangents;
    __global const material_t *materials;
    __global const lobe_t *lobes;
    __global const float4 *slices;
    __global const light_t *lights;
    __constant uint *disk;
    __global float *radiance, *irradiance;
    __global uint2 *work;
    float3 eye;
    float threshold;
    int n_lights;
    blockers_t blockers;
    tables_t tables;
} frame_t;

/* Light of all sources that leaves the point, and, in `arriving`, that arrives on its diffuse side. */
inline float3 light_point(const __local frame_t *frame, const receiver_t *receiver, const brdf_t *brdf, stats_t *count,
                          float3 *arriving)
{
    const __local blockers_t *blockers = &frame->blockers;
    float3 sum = 0.0f;
    for (int j = 0; j < frame->n_lights; j++) {
        if (blockers->list[2 * j + 1] == BELOW) {
            count->below++;
            continue;
        }
        const light_t light = frame->lights[j];
        const float3 colour = vload3(0, light.radiance);
        cap_t cap = cap_of(vload3(0, light.center) - receiver->position, light.radius);
        float diffuse = 0.0f;
        float3 part = 0.0f;
        if (light.radius == 0.0f) {
            if (cap.d == 0.0f)
                continue;
            part = reflected_point(receiver, brdf, &cap, blockers, j, &diffuse);
            *(diffuse > 0.0f ? &count->lit : &count->dark) += 1;
        } else if (cap.near <= 0.0f || cap.tau < COS2_WIDE * cap.d * cap.d) {
            const int inside = cap.near <= 0.0f;
            if (inside) {
                cap.a = receiver->geometric;
                cap.sine = 1.0f;
                cap.cosine = 0.0f;
            }
            cap.depth = 1.0f - cap.cosine;
            part = reflected_wide(receiver, brdf, &cap, blockers, j, inside, &diffuse);
            count->partial++;
        } else {
            count->listed += max(blockers->list[2 * j + 1], 0);
            part = reflected(receiver, brdf, &cap, blockers, j, &frame->tables, frame->disk, frame->threshold, count, &diffuse);
        }
        sum += colour * part;
        *arriving += colour * diffuse;
    }
    return sum;
}

__attribute__((noinline))
stats_t shade_point(const __local frame_t *frame, int i)
{
    const point_t point = frame->points[i];
    const material_t material = frame->materials[point.material];
    receiver_t receiver;
    receiver.position = vload3(0, point.position);
    receiver.geometric = vload3(0, point.geometric);
    receiver.shading = vload3(0, point.shading);
    receiver.object = point.object;
    receiver.turn = point.turn;
    brdf_t brdf;
    brdf.kd = vload3(0, material.kd);
    brdf.n_lobes = 0;
#if MAX_LOBES > 0
    const float3 view = normalize(frame->eye - receiver.position);
    const float3 tangent = ANISOTROPIC ? vload3(i, frame->tangents) : (float3)(0.0f);
    brdf.n_lobes = material.n_lobes;
    for (int l = 0; l < material.n_lobes; l++)
        brdf.lobes[l] = bind_lobe(frame->lobes[material.first_lobe + l], frame->slices, view, receiver.shading, tangent);
#endif
    stats_t count = {0};
    float3 arriving = 0.0f;
    vstore3(light_point(frame, &receiver, &brdf, &count, &arriving), i, frame->radiance);
#if IRRADIANCE
    vstore3(arriving, i, frame->irradiance);
#endif
#if WORK
    frame->work[i] = (uint2)(count.products, count.leaves);
#endif
    return count;
}

__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1)))
void shade(__global const point_t *points, const int n_points, __global const float *tangents,
           const float eye_x, const float eye_y, const float eye_z,
           __global const material_t *materials, __global const lobe_t *lobes,
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
    __local float near[7 * NEAR_ROOM];
    __local stats_t counts[WORK_GROUP];
    const int first = get_group_id(0) * WORK_GROUP, lane = get_local_id(0);
    if (lane == 0) {
        frame.points = points;
        frame.tangents = tangents;
        frame.materials = materials;
        frame.lobes = lobes;
        frame.slices = slices;
        frame.lights = lights;
        frame.disk = disk;
        frame.radiance = radiance;
        frame.irradiance = irradiance;
        frame.work = work;
        frame.eye = (float3)(eye_x, eye_y, eye_z);
        frame.threshold = threshold;
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
        frame.blockers.near = near;
        frame.blockers.list = list;
        list_near(&frame.blockers, points + first, min(WORK_GROUP, n_points - first), lights, n_lights, near, list);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    const stats_t nothing = {0};
    counts[lane] = first + lane < n_points ? shade_point(&frame, first + lane) : nothing;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (lane == 0)
        stats[get_group_id(0)] = sum_of_stats(counts);
}
