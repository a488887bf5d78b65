// Exact queries against a union of spheres (center, radius as float4): points, lines, and light caps.
// Host side: union.py, with the float64 twin of every function here.

// clearance[p] = distance of the point from the union, negative inside (then a bound: depth in one sphere);
// containing[p] = how many spheres hold the point.
__kernel void points(__global const float4 *points, __global const float4 *spheres, int n_spheres,
                     __global float *clearance, __global int *containing) {
    const int i = get_global_id(0);
    const float3 p = points[i].xyz;
    float least = INFINITY;
    int count = 0;
    for (int s = 0; s < n_spheres; s++) {
        const float4 sphere = spheres[s];
        const float gap = distance(p, sphere.xyz) - sphere.w;
        least = fmin(least, gap);
        count += gap < 0.0f;
    }
    clearance[i] = least;
    containing[i] = count;
}

// clearance[i] = how far the line through origins[i] along the unit directions[i] passes from the union,
// negative where it goes through.
__kernel void lines(__global const float4 *origins, __global const float4 *directions,
                    __global const float4 *spheres, int n_spheres, __global float *clearance) {
    const int i = get_global_id(0);
    const float3 origin = origins[i].xyz, w = directions[i].xyz;
    float least = INFINITY;
    for (int s = 0; s < n_spheres; s++) {
        const float4 sphere = spheres[s];
        const float3 offset = sphere.xyz - origin;
        least = fmin(least, length(cross(offset, w)) - sphere.w);
    }
    clearance[i] = least;
}

// blocked[r][k] = whether direction k of receiver r meets a sphere before it enters the light. A direction
// that starts inside a sphere is blocked where it points towards its center: the limit of touching it.
// axes[r] = center of receiver r's cap of directions and the cosine of its half-angle; near: scratch
// [receivers][n_spheres].
__kernel void caps(__global const float4 *receivers, __global const float4 *axes,
                   __global const float4 *directions, int n_directions, float4 light,
                   __global const float4 *spheres, int n_spheres, __global int *near,
                   __global uchar *blocked) {
    const int r = get_global_id(0);
    const float3 x = receivers[r].xyz, axis = axes[r].xyz;
    const float cos_cap = axes[r].w, sin_cap = sqrt(fmax(1.0f - cos_cap * cos_cap, 0.0f));
    near += r * n_spheres;
    int n_near = 0;
    for (int s = 0; s < n_spheres; s++) {
        const float3 o = spheres[s].xyz - x;
        const float radius = spheres[s].w;
        // Distance of the center from the cone around the cap; the cone's apex is its nearest point behind it.
        const float along = dot(o, axis), aside = sqrt(fmax(dot(o, o) - along * along, 0.0f));
        const bool behind = along * cos_cap + aside * sin_cap < 0.0f;
        const float gap = behind ? length(o) : aside * cos_cap - along * sin_cap;
        if (gap <= radius * 1.001f) near[n_near++] = s;
    }
    const float3 to_light = light.xyz - x;
    const float light_d2 = fmax(dot(to_light, to_light) - light.w * light.w, 0.0f);
    for (int k = 0; k < n_directions; k++) {
        const float3 l = directions[r * n_directions + k].xyz;
        const float tl = dot(to_light, l);
        const float enter_light = tl - sqrt(fmax(tl * tl - light_d2, 0.0f));
        bool hit = false;
        for (int n = 0; n < n_near && !hit; n++) {
            const float4 sphere = spheres[near[n]];
            const float3 o = sphere.xyz - x;
            const float b = dot(o, l), q = fmax(dot(o, o) - sphere.w * sphere.w, 0.0f);
            hit = b > 0.0f && b * b >= q && b - sqrt(b * b - q) < enter_light;
        }
        blocked[r * n_directions + k] = hit;
    }
}
