// How a ball overlaps the solid inside a closed, oriented surface: exact sums over the triangles that meet it.
//
// Over the cone from the ball's center to a triangle, the overlap is that of the whole ball, but where the
// triangle is inside the ball the cone ends on the triangle. So each triangle T adds, with D the disc in which
// its plane cuts the ball and h the plane's distance from the center,
//     h area(T and D) / 3 - r^3 omega(T and D) / 3,     omega: solid angle seen from the center,
// to w 4/3 pi r^3, w being the winding number of the center. Triangles outside the ball add nothing.
// Host side: outside_volume.py, with the float64 twin.

#define CAT_(a, b) a##b
#define CAT(a, b) CAT_(a, b)
typedef CAT(float, WIDTH) vf;
#define load CAT(vload, WIDTH)
#define store CAT(vstore, WIDTH)

typedef struct {
    vf x, y, z;
} V3;

V3 sub(V3 a, V3 b) { return (V3){a.x - b.x, a.y - b.y, a.z - b.z}; }
vf dot3(V3 a, V3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
V3 scale(V3 a, vf s) { return (V3){a.x * s, a.y * s, a.z * s}; }
V3 cross3(V3 a, V3 b) {
    return (V3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
// The factor that makes a vector a unit vector; 0 for no vector.
vf inverse_length(V3 a) {
    const vf d2 = dot3(a, a);
    return select((vf)(0.0f), rsqrt(d2), d2 > 1e-30f);
}

float sum_lanes(vf v) {
    float lanes[WIDTH];
    store(v, 0, lanes);
    float sum = 0.0f;
    for (int i = 0; i < WIDTH; i++) sum += lanes[i];
    return sum;
}

// Adds what the edge from p to q of a triangle with unit normal n contributes to area and solid angle of T and
// D: signed, the part in D of the triangle between the edge and the foot of the center's perpendicular.
void edge(V3 p, V3 q, V3 n, vf H, vf a2, float r, vf *area, vf *omega) {
    const V3 between = sub(q, p);
    const V3 along = scale(between, inverse_length(between));
    const vf m = -dot3(cross3(n, along), p), mu = fabs(m);
    const vf t0 = dot3(along, p), t1 = dot3(along, q); // from the point nearest to the foot
    const vf chord = sqrt(fmax(a2 - m * m, 0.0f));     // half of the line's part in D
    const vf u0 = fmax(fmin(t0, chord), -chord), u1 = fmax(fmin(t1, chord), -chord);
    const vf seen = atan2(t1, mu) - atan2(t0, mu), seen_in = atan2(u1, mu) - atan2(u0, mu);
    const vf w2 = H * H + m * m;
    const vf lost = atan2(H * u1, mu * sqrt(w2 + u1 * u1)) - atan2(H * u0, mu * sqrt(w2 + u0 * u0));
    const vf side = sign(m);
    *area += side * 0.5f * (mu * (u1 - u0) + a2 * (seen - seen_in));
    *omega += side * (seen * (1.0f - H / r) + seen_in * H / r - lost);
}

// result[ball] = (volume, omega, area * normal): sums over the triangles of the volume term above, of the
// signed solid angle, and of each triangle's area in the ball times its unit normal.
// corners: rows x, y, z of the three corners, [9][n_triangles]; boxes: lower and upper corner per BLOCK
// triangles.
__kernel void overlaps(__global const float *corners, int n_triangles, __global const float4 *boxes,
                       __global const float4 *balls, __global float8 *result) {
    const int i = get_global_id(0);
    const float4 ball = balls[i];
    const float r = ball.w, r2 = r * r, r3 = r2 * r;
    float volume = 0.0f, total = 0.0f, nx = 0.0f, ny = 0.0f, nz = 0.0f;
    for (int block = 0; block < n_triangles / BLOCK; block++) {
        const float3 gap = fmax(fmax(boxes[2 * block].xyz - ball.xyz, ball.xyz - boxes[2 * block + 1].xyz), 0.0f);
        if (dot(gap, gap) >= r2) continue;
        for (int v = 0; v < BLOCK / WIDTH; v++) {
            __global const float *first = corners + block * BLOCK + v * WIDTH;
            V3 p[3];
            for (int k = 0; k < 3; k++) {
                p[k].x = load(0, first + (3 * k) * n_triangles) - ball.x;
                p[k].y = load(0, first + (3 * k + 1) * n_triangles) - ball.y;
                p[k].z = load(0, first + (3 * k + 2) * n_triangles) - ball.z;
            }
            V3 n = cross3(sub(p[1], p[0]), sub(p[2], p[0]));
            n = scale(n, inverse_length(n));
            const vf h = dot3(n, p[0]), H = fabs(h), a2 = fmax(r2 - h * h, 0.0f);
            if (!any(a2 > 0.0f)) continue;
            vf area = 0.0f, omega = 0.0f;
            for (int k = 0; k < 3; k++) edge(p[k], p[(k + 1) % 3], n, H, a2, r, &area, &omega);
            const vf meets = select((vf)(0.0f), (vf)(1.0f), a2 > 0.0f);
            area *= meets;
            omega *= meets * select((vf)(-1.0f), (vf)(1.0f), h >= 0.0f);
            volume += sum_lanes(h * area - r3 * omega) / 3.0f;
            total += sum_lanes(omega);
            nx += sum_lanes(area * n.x);
            ny += sum_lanes(area * n.y);
            nz += sum_lanes(area * n.z);
        }
    }
    result[i] = (float8)(volume, total, nx, ny, nz, 0.0f, 0.0f, 0.0f);
}
