/* The lobe-over-cap table: a lobe integrated over a light's cap. Twin: coslobe.tables.lobe_cap.lookup_slice. */

inline pf smooth_minimum(pf a, pf b)
{
    const pf x = a / b, x2 = x * x;
    return a * rsqrt(sqrt(1.0f + x2 * x2));
}

/* Cubic along the caps of a slice, weights w, at two neighbouring angles. */
inline float8 along_caps(__global const float4 *slice, int j, int k, float4 w)
{
    __global const float *p = (__global const float *)(slice + j * ANGLES + k);
    return w.x * vload8(0, p) + w.y * vload8(0, p + 4 * ANGLES) + w.z * vload8(0, p + 8 * ANGLES)
         + w.w * vload8(0, p + 12 * ANGLES);
}

/* Integrals of (r.v)^e (n.v), or of (r.v)^e without `cosine`, over the caps around a whose half-angles, at most 60
   degrees, have this `sine` and `depth` = 1 - cosine, the caps wholly in front of n. */
inline pf lobe_over_cap(__global const float4 *slices, pi slice, pf e, pf3 r, pf3 n, pf3 a, pf sine, pf depth,
                        pi with_cosine)
{
    const pf width = rsqrt(e + 1.0f);
    const pf3 gap = plus(a, -1.0f, r);
    const pf chord2 = dots(gap, gap);
    const pf farthest = 1.21f * sine + (OUTER + SMALLEST_CAP) * width; /* asin(x) < 1.21 x up to 60 degrees */
    if (!point_bits(chord2 <= farthest * farthest))
        return 0.0f;
    const pf alpha = angle_points(depth), theta = angle_points(fmin(0.5f * chord2, 2.0f));
    const pf sampled = fmax(alpha, SMALLEST_CAP * width);
    const pf first = sampled - smooth_minimum(sampled, INNER * width);
    const pf last = sampled + smooth_minimum(0.5f * M_PI_F, OUTER * width);
    const pi reached = theta <= last;
    const pf y = ln_points(sampled / (SMALLEST_CAP * width)) * CAPS_PER_LOG;
    const pi j = clamp(TO_PI(y) - 1, 0, CAPS - 4);
    const pf u = clamp(y, 0.0f, (float)(CAPS - 1)) - TO_PF(j);
    const pf u1 = u - 1.0f, u2 = u - 2.0f, u3 = u - 3.0f;
    const pf w0 = u1 * u2 * u3 * (-1.0f / 6), w1 = u * u2 * u3 * 0.5f, w2 = u * u1 * u3 * -0.5f, w3 = u * u1 * u2 * (1.0f / 6);
    const pf z = clamp((theta - first) / (last - first) * (ANGLES - 1), 0.0f, (float)(ANGLES - 1));
    const pi k = min(TO_PI(z), ANGLES - 2);
    const pf f = z - TO_PF(k), g = 1.0f - f;
    float4 near[PW], far[PW];
    for (uint lanes = point_bits(reached); lanes; lanes &= lanes - 1) {
        const int l = lowest_bit(lanes);
        const float4 w = (float4)(LANE(w0, l), LANE(w1, l), LANE(w2, l), LANE(w3, l));
        const float8 v = along_caps(slices + INT_LANE(slice, l) * (CAPS * ANGLES), INT_LANE(j, l), INT_LANE(k, l), w);
        near[l] = v.lo;
        far[l] = v.hi;
    }
    pf p[4], q[4];
    columns_of(near, p);
    columns_of(far, q);
    const pf log_t = g * g * ((1.0f + 2.0f * f) * p[0] + f * p[1])
                   + f * f * ((3.0f - 2.0f * f) * q[0] - g * q[1]);
    const pf cap = 2.0f * M_PI_F * depth, whole = 2.0f * M_PI_F / (e + 1.0f);
    /* Below e = 1 the samples overshoot where the lobe's hemisphere ends within a small cap; no lobe exceeds the cap. */
    const pf integral = fmin(exp_points(log_t) * whole / (cap + whole), 1.0f) * cap;
    const pf along = g * p[2] + f * q[2], towards = g * p[3] + f * q[3];
    const pf nr = dots(n, r), cosine = 1.0f - 0.5f * chord2;
    const pf with = integral * fmax(along * nr + towards * (dots(n, a) - cosine * nr), 0.0f);
    return select((pf)(0.0f), select(integral, with, with_cosine != 0), reached);
}
