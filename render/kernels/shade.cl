/* Direct light at one point per work-item. What a light adds is the business of the estimator: accurate.cl or paper.cl
   define `reflected`. */

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
    const int i = get_global_id(0);
    if (i >= n_points)
        return;
    const point_t point = points[i];
    const material_t material = materials[point.material];
    const blockers_t blockers = {x, y, z, radius, outside, owner, group_x, group_y, group_z, group_radius, n_groups};
    const tables_t tables = {product_table, cap_table, weights};
    receiver_t receiver;
    receiver.position = (float3)(point.position[0], point.position[1], point.position[2]);
    receiver.geometric = (float3)(point.geometric[0], point.geometric[1], point.geometric[2]);
    receiver.shading = (float3)(point.shading[0], point.shading[1], point.shading[2]);
    receiver.object = point.object;
    receiver.turn = point.turn;
    brdf_t brdf;
    brdf.kd = (float3)(material.kd[0], material.kd[1], material.kd[2]);
    brdf.n_lobes = 0;
#if MAX_LOBES > 0
    const float3 view = normalize((float3)(eye_x, eye_y, eye_z) - receiver.position);
    const float3 tangent = ANISOTROPIC ? vload3(i, tangents) : (float3)(0.0f);
    brdf.n_lobes = material.n_lobes;
    for (int l = 0; l < material.n_lobes; l++)
        brdf.lobes[l] = bind_lobe(lobes[material.first_lobe + l], slices, view, receiver.shading, tangent);
#endif

    float3 sum = 0.0f, arriving = 0.0f;
    stats_t count = {0};
    for (int j = 0; j < n_lights; j++) {
        const light_t light = lights[j];
        const float3 to_light = (float3)(light.center[0], light.center[1], light.center[2]) - receiver.position;
        const float3 colour = (float3)(light.radiance[0], light.radiance[1], light.radiance[2]);
        const float d2 = dot(to_light, to_light), r = light.radius;
        cap_t cap;
        cap.centre = to_light;
        cap.d = sqrt(d2);
        cap.radius2 = r * r;
        cap.near = cap.d - r;
        cap.tau = fmax(cap.near * (cap.d + r), 0.0f);
        cap.tangent = sqrt(cap.tau);
        float diffuse = 0.0f;
        float3 part = 0.0f;
        if (r == 0.0f) {
            if (d2 == 0.0f)
                continue;
            cap.a = to_light / cap.d;
            part = reflected_point(&receiver, &brdf, &cap, &blockers, j, &diffuse);
            *(diffuse > 0.0f ? &count.lit : &count.dark) += 1;
        } else if (cap.near <= 0.0f || cap.tau < COS2_WIDE * d2) {
            const int inside = cap.near <= 0.0f;
            cap.a = inside ? receiver.geometric : to_light / cap.d;
            cap.cosine = inside ? 0.0f : cap.tangent / cap.d;
            cap.sine = inside ? 1.0f : r / cap.d;
            cap.depth = 1.0f - cap.cosine;
            part = reflected_wide(&receiver, &brdf, &cap, &blockers, j, inside, &diffuse);
            count.partial++;
        } else {
            cap.a = to_light / cap.d;
            cap.sine = r / cap.d;
            cap.cosine = cap.tangent / cap.d;
            cap.depth = cap.sine * cap.sine / (1.0f + cap.cosine);
            part = reflected(&receiver, &brdf, &cap, &blockers, j, &tables, disk, threshold, &count, &diffuse);
        }
        sum += colour * part;
        arriving += colour * diffuse;
    }
    vstore3(sum, i, radiance);
    stats[i] = count;
#if IRRADIANCE
    vstore3(arriving, i, irradiance);
#endif
}
