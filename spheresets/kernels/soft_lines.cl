// The soft silhouette of spheres: squared error of bundles of lines against a solid, and its gradient.
//
// The odds that a line is blocked are S = sum over i of e_i, e_i = exp((r_i - d_i) / tau) with d_i the distance
// of the line from c_i; u = S / (1 + S). A bundle is BUNDLE lines next to each other, as from a receiver to a
// light; its error counts line by line and as a whole, as the mean of its u, which is a soft shadow.
//
// Follows soft.cl. Host side: soft_lines.py, with the float64 twin of every function here.

#define BUNDLE_VECTORS (BUNDLE / WIDTH)

// One bundle: origin, unit direction and hit (1 or 0) are rows of `lines` [7][n].
typedef struct {
    __global const float *ox, *oy, *oz, *wx, *wy, *wz, *hit;
} Bundle;

Bundle bundle_of(__global const float *lines, int n, int bundle) {
    __global const float *first = lines + bundle * BUNDLE;
    return (Bundle){first, first + n, first + 2 * n, first + 3 * n, first + 4 * n, first + 5 * n, first + 6 * n};
}

// Lists the spheres that reach one of the bundle's lines; returns how many. No line is farther from a point p
// than the first one is, less `aside + apart (|p - o| + aside)`: how far the origins and directions differ.
int collect_lines(Bundle b, __global const float4 *spheres, int n_spheres, float tau, __global int *near) {
    const float3 o = (float3)(b.ox[0], b.oy[0], b.oz[0]), w = (float3)(b.wx[0], b.wy[0], b.wz[0]);
    float aside = 0.0f, apart = 0.0f;
    for (int i = 1; i < BUNDLE; i++) {
        aside = fmax(aside, distance(o, (float3)(b.ox[i], b.oy[i], b.oz[i])));
        apart = fmax(apart, distance(w, (float3)(b.wx[i], b.wy[i], b.wz[i])));
    }
    int count = 0;
    for (int s = 0; s < n_spheres; s++) {
        const float4 sphere = spheres[s];
        const float3 offset = sphere.xyz - o;
        const float along = dot(offset, w), d2 = dot(offset, offset);
        const float far = 1.001f * (reach(sphere, tau) + aside + apart * (sqrt(d2) + aside));
        if (d2 - along * along < far * far) near[count++] = s;
    }
    return count;
}

// From the sphere's center to the nearest points of one vector of lines.
void perpendicular(Bundle b, int v, float4 sphere, vf *qx, vf *qy, vf *qz) {
    const vf wx = load(v, b.wx), wy = load(v, b.wy), wz = load(v, b.wz);
    const vf x = load(v, b.ox) - sphere.x, y = load(v, b.oy) - sphere.y, z = load(v, b.oz) - sphere.z;
    const vf along = x * wx + y * wy + z * wz;
    *qx = x - along * wx;
    *qy = y - along * wy;
    *qz = z - along * wz;
}

// partial[row][sphere] = `weight` times the gradient of the loss, summed over BUNDLES bundles, with respect to
// (center, radius); losses[row] = `weight` times that sum. Work-item 0 has the row `first_row`. near: scratch
// [rows][n_spheres].
__kernel void line_gradient(__global const float *lines, int n_lines, __global const float4 *spheres,
                            int n_spheres, float tau, float weight, int first_row, __global int *near,
                            __global float4 *partial, __global float *losses) {
    const int item = get_global_id(0), row = first_row + item;
    near += row * n_spheres;
    partial += row * n_spheres;
    for (int s = 0; s < n_spheres; s++) partial[s] = (float4)(0.0f);
    float loss = 0.0f;
    bool touched;
    for (int bundle = item * BUNDLES; bundle < (item + 1) * BUNDLES; bundle++) {
        const Bundle b = bundle_of(lines, n_lines, bundle);
        const int n_near = collect_lines(b, spheres, n_spheres, tau, near);
        vf qx, qy, qz;
        vf error[BUNDLE_VECTORS], slope[BUNDLE_VECTORS]; // u - hit; first d u / d S, then d loss / d S
        float sum = 0.0f;
        for (int v = 0; v < BUNDLE_VECTORS; v++) {
            vf S = 0.0f;
            for (int k = 0; k < n_near; k++) {
                const float4 sphere = spheres[near[k]];
                perpendicular(b, v, sphere, &qx, &qy, &qz);
                S += odds(qx, qy, qz, sphere, tau, &touched);
            }
            const vf free = 1.0f / (1.0f + S);
            slope[v] = free * free;
            error[v] = S * free - load(v, b.hit);
            sum += sum_lanes(error[v]);
            loss += 0.5f * sum_lanes(error[v] * error[v]);
        }
        const float mean = sum / BUNDLE;
        loss += 0.5f * BUNDLE * mean * mean;
        for (int v = 0; v < BUNDLE_VECTORS; v++) slope[v] *= weight * (error[v] + mean);
        for (int k = 0; k < n_near; k++) {
            const float4 sphere = spheres[near[k]];
            vf gx = 0.0f, gy = 0.0f, gz = 0.0f, gr = 0.0f;
            for (int v = 0; v < BUNDLE_VECTORS; v++) {
                perpendicular(b, v, sphere, &qx, &qy, &qz);
                const vf e = odds(qx, qy, qz, sphere, tau, &touched);
                if (!touched) continue;
                const vf g = slope[v] * e;
                const vf t = g * rsqrt(fmax(qx * qx + qy * qy + qz * qz, 1e-20f));
                gr += g;
                gx += t * qx;
                gy += t * qy;
                gz += t * qz;
            }
            partial[near[k]] += (float4)(sum_lanes(gx), sum_lanes(gy), sum_lanes(gz), sum_lanes(gr)) / tau;
        }
    }
    losses[row] = weight * loss;
}
