/* Lobe mathematics on the device. Each function has a float64 twin: coslobe.tables.lobe, coslobe.tables.lobe_cap
   and coslobe.render.unshadowed. Angles in rad, solid angles in sr. */

/* log(1 - q) for rows of q in [0, 1). Own polynomials here and below, because runtimes compute exp and log lane by
   lane. */
inline rf log_rows(rf q)
{
    const rf x = fmax(1.0f - q, 1e-30f);
    const ri raw = AS_RI(x);
    const ri exponent = (raw - 0x3f3504f3) >> 23; /* x = m 2^exponent with m in [sqrt(1/2), sqrt(2)) */
    const rf m = AS_RF(raw - (exponent << 23));
    const rf s = (m - 1.0f) / (m + 1.0f);
    const rf z = s * s;
    const rf atanh2 = 2.0f * s * (1.0f + z * (1.0f / 3 + z * (1.0f / 5 + z * (1.0f / 7 + z * (1.0f / 9)))));
    /* The last term restores what rounding took from 1 - q. */
    return atanh2 + TO_RF(exponent) * 0.693147180559945f - (q - (1.0f - x)) / x;
}

/* exp(y) for rows of y <= 80; 0 below -80, before results lose digits. */
inline rf exp_rows(rf y)
{
    const rf t = fmax(y, -80.0f) * 1.44269504088896f;
    const rf whole = floor(t + 0.5f);
    const rf f = t - whole;
    const rf p = 1.0f + f * (0.693147180559945f + f * (0.240226506959101f + f * (0.0555041086648216f
               + f * (0.00961812910762848f + f * (0.00133335581464284f + f * 0.000154035303933816f)))));
    return select((rf)(0.0f), p * AS_RF((TO_RI(whole) + 127) << 23), y > -80.0f);
}

/* exp(e log(1 - q)) for rows of q >= 0: the lobe from q = |a - v|^2 / 2, without the rounding of a dot product.
   Relative error 1e-6 + 2e-7 |e log(1 - q)|. */
inline rf lobe_rows(rf q, float e)
{
    return select((rf)(0.0f), exp_rows(e * log_rows(q)), q < 1.0f);
}

/* The same for one direction. */
inline float lobe_value(float q, float e)
{
    return q < 1.0f ? exp(fmax(e * log1p(-q), -80.0f)) : 0.0f;
}

/* Irradiance / radiance of a uniform sphere light that a horizon may cut: Snyder 1996; Lagarde and de Rousiers
   2014. `co` = n.a, `q` = (r / d)^2 < 1. */
inline float lambert_sphere(float co, float q)
{
    if (co * co > q)
        return M_PI_F * q * fmax(co, 0.0f);
    const float st = sqrt(fmax(1.0f - co * co, 1e-12f));
    const float x = sqrt(fmax(1.0f / q - 1.0f, 0.0f));
    const float y = clamp(-x * co / st, -1.0f, 1.0f);
    const float z = st * sqrt(fmax(1.0f - y * y, 0.0f));
    return fmax((co * acos(y) - x * z) * q + atan2(z, x), 0.0f);
}

/* Cosine (returned) and sine of a fraction of a full turn. */
inline float sincos_turn(float turn, float *sine)
{
    float cosine;
    *sine = sincos(2.0f * M_PI_F * turn, &cosine);
    return cosine;
}

inline float smooth_minimum(float a, float b)
{
    const float x = a / b, x2 = x * x;
    return a * rsqrt(sqrt(1.0f + x2 * x2));
}

/* Integral of (r.v)^e (n.v), or of (r.v)^e without `cosine`, over the cap around a whose half-angle, at most 60 degrees,
   has this `sine` and `depth` = 1 - cosine, the cap wholly in front of n; see coslobe.tables.lobe_cap.lookup_slice. */
inline float lobe_over_cap(__global const float4 *slice, float e, float3 r, float3 n, float3 a, float sine, float depth,
                           int with_cosine)
{
    const float width = rsqrt(e + 1.0f);
    const float3 gap = a - r;
    const float chord2 = dot(gap, gap);
    const float farthest = 1.21f * sine + (OUTER + SMALLEST_CAP) * width; /* asin(x) < 1.21 x up to 60 degrees */
    if (chord2 > farthest * farthest)
        return 0.0f;
    const float2 angles = asin(fmin((float2)(sine, 0.5f * sqrt(chord2)), 1.0f));
    const float alpha = angles.x, theta = 2.0f * angles.y;
    const float sampled = fmax(alpha, SMALLEST_CAP * width);
    const float first = sampled - smooth_minimum(sampled, INNER * width);
    const float last = sampled + smooth_minimum(0.5f * M_PI_F, OUTER * width);
    if (theta > last)
        return 0.0f;
    const float y = log(sampled / (SMALLEST_CAP * width)) * CAPS_PER_LOG;
    const int j = clamp((int)y - 1, 0, CAPS - 4);
    const float u = clamp(y, 0.0f, (float)(CAPS - 1)) - j;
    const float4 w = (float4)(-(u - 1) * (u - 2) * (u - 3) / 6, u * (u - 2) * (u - 3) / 2,
                              -u * (u - 1) * (u - 3) / 2, u * (u - 1) * (u - 2) / 6);
    const float z = clamp((theta - first) / (last - first) * (ANGLES - 1), 0.0f, (float)(ANGLES - 1));
    const int k = min((int)z, ANGLES - 2);
    const float f = z - k, g = 1.0f - f;
    __global const float4 *p = slice + j * ANGLES + k;
    const float4 near = w.x * p[0] + w.y * p[ANGLES] + w.z * p[2 * ANGLES] + w.w * p[3 * ANGLES];
    const float4 far = w.x * p[1] + w.y * p[ANGLES + 1] + w.z * p[2 * ANGLES + 1] + w.w * p[3 * ANGLES + 1];
    const float log_t = g * g * ((1.0f + 2.0f * f) * near.x + f * near.y) + f * f * ((3.0f - 2.0f * f) * far.x - g * far.y);
    const float cap = 2.0f * M_PI_F * depth, whole = 2.0f * M_PI_F / (e + 1.0f);
    /* Below e = 1 the samples overshoot where the lobe's hemisphere ends within a small cap; no lobe exceeds the cap. */
    const float integral = fmin(exp(log_t) * whole / (cap + whole), 1.0f) * cap;
    if (!with_cosine)
        return integral;
    const float along = g * near.z + f * far.z, towards = g * near.w + f * far.w;
    const float cosine = 1.0f - 0.5f * chord2;
    return integral * fmax(along * dot(n, r) + towards * (dot(n, a) - cosine * dot(n, r)), 0.0f);
}
