// The soft union of spheres and its binary cross-entropy against a solid: loss, gradient, and what the loss
// becomes with one sphere less or one more. Follows soft.cl.
//
// The occupancy odds of a point p are S = B + sum over i of e_i, e_i = exp((r_i - |p - c_i|) / tau):
// log S is the log-sum-exp soft union, S / (1 + S) the probability of being inside.
//
// One work-item owns one chunk of points that lie close together, keeps the spheres near the chunk's box,
// and writes its own row of `partial`: sums are taken in a fixed order, so results do not depend on timing.
// Host side: soft_union.py, with the float64 twin of every function here.

#define VECTORS (CHUNK / WIDTH)

// The points of one chunk: x, y, z are rows of `points` [4][n], the last row says inside (1) or outside (0).
typedef struct {
    __global const float *x, *y, *z, *inside;
} Chunk;

Chunk chunk_of(__global const float *points, int n, int chunk) {
    __global const float *first = points + chunk * CHUNK;
    return (Chunk){first, first + n, first + 2 * n, first + 3 * n};
}

// Lists the spheres that reach the chunk's box; returns how many.
int collect(Chunk c, __global const float4 *spheres, int n_spheres, float tau, __global int *near) {
    float3 lower = (float3)(INFINITY), upper = (float3)(-INFINITY);
    for (int i = 0; i < CHUNK; i++) {
        const float3 p = (float3)(c.x[i], c.y[i], c.z[i]);
        lower = fmin(lower, p);
        upper = fmax(upper, p);
    }
    int count = 0;
    for (int s = 0; s < n_spheres; s++) {
        const float4 sphere = spheres[s];
        const float3 gap = fmax(fmax(lower - sphere.xyz, sphere.xyz - upper), 0.0f);
        const float far = reach(sphere, tau);
        if (dot(gap, gap) < far * far) near[count++] = s;
    }
    return count;
}

// Binary cross-entropy of odds S.
vf cross_entropy(vf S, vf inside) { return log(1.0f + S) - inside * log(S); }

// partial[row][sphere] = `weight` times the gradient of the loss, summed over a chunk, with respect to (center,
// radius); losses[row] = `weight` times that sum. Chunk 0 has the row `first_row`. near: scratch
// [rows][n_spheres].
__kernel void gradient(__global const float *points, int n_points, __global const float4 *spheres,
                       int n_spheres, float tau, float weight, int first_row, __global int *near,
                       __global float4 *partial, __global float *losses) {
    const int chunk = get_global_id(0), row = first_row + chunk;
    const Chunk c = chunk_of(points, n_points, chunk);
    near += row * n_spheres;
    partial += row * n_spheres;
    const int n_near = collect(c, spheres, n_spheres, tau, near);

    const float background = exp(-cutoff(tau));
    vf slope[VECTORS]; // weighted d loss / d S
    vf loss = 0.0f;
    bool touched;
    for (int v = 0; v < VECTORS; v++) {
        const vf x = load(v, c.x), y = load(v, c.y), z = load(v, c.z), inside = load(v, c.inside);
        vf S = background;
        for (int k = 0; k < n_near; k++) {
            const float4 sphere = spheres[near[k]];
            S += odds(x - sphere.x, y - sphere.y, z - sphere.z, sphere, tau, &touched);
        }
        loss += cross_entropy(S, inside);
        slope[v] = weight * (1.0f / (1.0f + S) - inside / S);
    }
    losses[row] = weight * sum_lanes(loss);

    for (int s = 0; s < n_spheres; s++) partial[s] = (float4)(0.0f);
    for (int k = 0; k < n_near; k++) {
        const float4 sphere = spheres[near[k]];
        vf gx = 0.0f, gy = 0.0f, gz = 0.0f, gr = 0.0f;
        for (int v = 0; v < VECTORS; v++) {
            const vf dx = load(v, c.x) - sphere.x, dy = load(v, c.y) - sphere.y, dz = load(v, c.z) - sphere.z;
            const vf e = odds(dx, dy, dz, sphere, tau, &touched);
            if (!touched) continue;
            const vf g = slope[v] * e; // d loss / d log S times the sphere's share of S
            const vf t = g * rsqrt(fmax(dx * dx + dy * dy + dz * dz, 1e-20f));
            gr += g;
            gx += t * dx;
            gy += t * dy;
            gz += t * dz;
        }
        partial[near[k]] = (float4)(sum_lanes(gx), sum_lanes(gy), sum_lanes(gz), sum_lanes(gr)) / tau;
    }
}

// The next two kernels start at chunk `first`; their scratch and partial sums have a row per work-item.

// total[point] = S, rest[point] = S without its largest term. near: scratch [items][n_spheres].
__kernel void total_odds(__global const float *points, int n_points, int first,
                         __global const float4 *spheres, int n_spheres, float tau, __global int *near,
                         __global float *total, __global float *rest) {
    const int item = get_global_id(0), chunk = first + item;
    const Chunk c = chunk_of(points, n_points, chunk);
    near += item * n_spheres;
    const int n_near = collect(c, spheres, n_spheres, tau, near);
    const float background = exp(-cutoff(tau));
    bool touched;
    for (int v = 0; v < VECTORS; v++) {
        const vf x = load(v, c.x), y = load(v, c.y), z = load(v, c.z);
        vf largest = 0.0f, others = background;
        for (int k = 0; k < n_near; k++) {
            const float4 sphere = spheres[near[k]];
            const vf e = odds(x - sphere.x, y - sphere.y, z - sphere.z, sphere, tau, &touched);
            others += fmin(e, largest);
            largest = fmax(e, largest);
        }
        store(largest + others, v, total + chunk * CHUNK);
        store(others, v, rest + chunk * CHUNK);
    }
}

// partial[item][sphere] = change of the loss, summed over the chunk, when the sphere is taken out of the
// union that `total` and `rest` describe (removing = 1), or put into it (0).
__kernel void exchange(__global const float *points, int n_points, int first, __global const float *total,
                       __global const float *rest, __global const float4 *spheres, int n_spheres, float tau,
                       int removing, __global int *near, __global float *partial) {
    const int item = get_global_id(0), chunk = first + item;
    const Chunk c = chunk_of(points, n_points, chunk);
    near += item * n_spheres;
    partial += item * n_spheres;
    total += chunk * CHUNK;
    rest += chunk * CHUNK;
    const int n_near = collect(c, spheres, n_spheres, tau, near);
    for (int s = 0; s < n_spheres; s++) partial[s] = 0.0f;
    bool touched;
    for (int k = 0; k < n_near; k++) {
        const float4 sphere = spheres[near[k]];
        vf change = 0.0f;
        for (int v = 0; v < VECTORS; v++) {
            const vf dx = load(v, c.x) - sphere.x, dy = load(v, c.y) - sphere.y, dz = load(v, c.z) - sphere.z;
            const vf e = odds(dx, dy, dz, sphere, tau, &touched);
            if (!touched) continue;
            const vf S = load(v, total), others = load(v, rest), inside = load(v, c.inside);
            // S - e would cancel where this sphere holds nearly all of S: that sum is kept apart.
            const vf without = select(S - e, others, e > 0.999f * (S - others));
            const vf after = removing ? without : S + e;
            change += cross_entropy(after, inside) - cross_entropy(S, inside);
        }
        partial[near[k]] = sum_lanes(change);
    }
}
