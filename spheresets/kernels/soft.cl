// What soft unions of points and of lines share: vectors of WIDTH lanes, and the odds e_i of one sphere,
// exp((r_i - d) / tau) at distance d. Lengths are in unit coordinates (bounding-box diagonal 1).
// Host side: soft.py.

#define CAT_(a, b) a##b
#define CAT(a, b) CAT_(a, b)
typedef CAT(float, WIDTH) vf;
typedef CAT(int, WIDTH) vi;
#define load CAT(vload, WIDTH)
#define store CAT(vstore, WIDTH)

float sum_lanes(vf v) {
    float lanes[WIDTH];
    store(v, 0, lanes);
    float sum = 0.0f;
    for (int i = 0; i < WIDTH; i++) sum += lanes[i];
    return sum;
}

// In tau: how far from a sphere it still counts.
float cutoff(float tau) { return clamp(REACH / tau, CUTOFF, FARTHEST); }

// Distance beyond which a sphere does not count.
float reach(float4 sphere, float tau) { return fmax(sphere.w + cutoff(tau) * tau, 0.0f); }

// e_i of one vector of offsets from the center, 0 beyond the sphere's reach; *touched says whether any lane is within.
// Depths beyond DEEPEST tau count as DEEPEST, which keeps the odds within float32.
vf odds(vf dx, vf dy, vf dz, float4 sphere, float tau, bool *touched) {
    const vf d2 = dx * dx + dy * dy + dz * dz;
    const float far = reach(sphere, tau);
    const vi within = d2 < far * far;
    *touched = any(within);
    if (!*touched) return (vf)(0.0f);
    const vf e = exp(fmin((sphere.w - sqrt(d2)) / tau, DEEPEST));
    return select((vf)(0.0f), e, within);
}
