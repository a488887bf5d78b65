/* The product, integral and cap tables on the device. Twins: coslobe.tables.product, .integral and .cap; the
   arrays are the same float32 samples, the constants come from coslobe.tables.layout. */

typedef struct
{
    float axis_angle; /* from the first axis, in the plane of both */
    float exponent;
    float scale_l2;
    float scale_energy;
    float integral;
} ProductLobe;

/* Angle of the product's peak from the first axis (18); coslobe.tables.lobe.peak_angle. */
inline float peak_angle(float e1, float e2, float alpha)
{
    float c;
    const float s = sincos(alpha, &c), along = (e1 + e2) * c;
    const float root = hypot(along, 2.0f * sqrt(e1) * sqrt(e2) * s);
    if (e1 + e2 == 0.0f)
        return 0.5f * alpha;
    return c >= 0.0f ? atan2(2.0f * e2 * s, along + root) : atan2(root - along, 2.0f * e1 * s);
}

/* e log cos(t + rest): the series' leading term is kept in two floats, because e may be 1e5. */
inline float log_cosine_power(float e, float t, float rest)
{
    if (e == 0.0f)
        return 0.0f;
    if (t > 1.2f)
        return e * log(cos(t) - rest * sin(t));
    const float x = t * t, x_rest = fma(t, t, -x) + 2.0f * t * rest;
    const float series = 0.0833333342f + x * (0.0222220828f + x * (0.00674986115f + x * (0.00214635375f
                       + x * (0.000956714751f + x * (-0.000417043923f + x * (0.00136244636f
                       + x * (-0.00146420921f + x * (0.00109173882f + x * (-0.000437378925f
                       + x * 8.25694134e-05f)))))))));
    const float half_e = 0.5f * e, leading = half_e * x;
    return -leading - (fma(half_e, x, -leading) + half_e * x_rest + e * x * x * series);
}

/* The largest sampled angle. */
inline float product_reach(float e1, float e2)
{
    return fmin(PRODUCT_REACH * sqrt(1.0f / (e1 + 1.0f) + 1.0f / (e2 + 1.0f)), M_PI_F);
}

/* Where the samples of a pair of sampled exponents begin; half of the square is stored. */
inline int product_row(int i, int j)
{
    const int high = max(i, j);
    return 3 * PRODUCT_ANGLES * (high * (high + 1) / 2 + min(i, j));
}

/* The lobe that stands for the product of two lobes of amplitude 1 whose axes are `alpha` in [0, pi] apart. */
inline ProductLobe product_lobe(__global const float *table, float e1, float e2, float alpha)
{
    const float last = product_reach(e1, e2);
    const float opening = (M_PI_F - alpha) - 8.742278e-8f; /* pi is that much less than its float */
    ProductLobe lobe;
    lobe.axis_angle = peak_angle(e1, e2, alpha);
    lobe.exponent = e1 + e2;
    lobe.scale_l2 = lobe.scale_energy = lobe.integral = 0.0f;
    if (alpha > last || opening <= 0.0f)
        return lobe;
    const float2 position = fmin(log1p((float2)(2.0f * e1, 2.0f * e2)) * PRODUCT_STEPS, PRODUCT_EXPONENTS - 1);
    const int2 cell = min(convert_int2(position), PRODUCT_EXPONENTS - 2);
    const float2 f = position - convert_float2(cell);
    /* Angles are counted from the last one, near which residuals are steep. */
    const float back = clamp((last == M_PI_F ? opening : last - alpha) / last, 0.0f, 1.0f) * (PRODUCT_ANGLES - 1);
    const int angle = min((int)back, PRODUCT_ANGLES - 2);
    float3 residual = 0.0f;
    for (int corner = 0; corner < 4; corner++) {
        const int a = corner & 1, b = corner >> 1;
        __global const float *p = table + product_row(cell.x + a, cell.y + b) + 3 * (PRODUCT_ANGLES - 2 - angle);
        residual += (a ? f.x : 1.0f - f.x) * (b ? f.y : 1.0f - f.y) * mix(vload3(1, p), vload3(0, p), back - angle);
    }

    /* What residuals are relative to: coslobe.tables.product._closed_forms. */
    const float sharp = fmax(e1, e2), broad = fmin(e1, e2); /* the peak is nearer to the sharper lobe's axis */
    const float t = peak_angle(sharp + PRODUCT_SHIFT, broad + PRODUCT_SHIFT, alpha);
    const float u = alpha - t, rest = (alpha - u) - t;
    float cos_t = cos(t), cos_u = cos(u);
    if (alpha > 1.0f) { /* from the distances to right angles, which obey the same equation, without cancelling */
        const float v = peak_angle(sharp + PRODUCT_SHIFT, broad + PRODUCT_SHIFT, opening);
        cos_t = sin(opening - v);
        cos_u = sin(v);
    }
    const float log_peak = log_cosine_power(sharp, t, 0.0f) + log_cosine_power(broad, u, rest);
    const float k = sharp / (cos_t * cos_t) + broad / (cos_u * cos_u);
    const float width = rsqrt(k / (2.0f * M_PI_F) + 1.0f / fmax(opening * opening, 1e-30f));
    const float z = 0.5f * (e1 + e2 + 2.0f);

    lobe.exponent = fmax(exp(residual.x) * (sqrt((e1 + e2) * k) + PRODUCT_SHIFT) - PRODUCT_SHIFT, 0.0f);
    lobe.scale_l2 = exp(log_peak + residual.y);
    lobe.integral = exp(log_peak + residual.z) * sqrt(M_PI_F / (z - 0.25f + 0.03125f / z)) * width;
    lobe.scale_energy = lobe.integral * (lobe.exponent + 1.0f) / (2.0f * M_PI_F);
    return lobe;
}

/* Integral of a lobe of amplitude 1, linear between INTEGRAL_SAMPLES samples in each decade. */
inline float table_integral(__global const float *table, float e)
{
    if (e > MAX_EXPONENT)
        return 2.0f * M_PI_F / (e + 1.0f);
    float low = 0.0f, high = 1.0f;
    int interval = 0;
    while (e > high) {
        low = high;
        high *= 10.0f;
        interval++;
    }
    const float position = fmax((e - low) / (high - low), 0.0f) * (INTEGRAL_SAMPLES - 1);
    const int i = min((int)position, INTEGRAL_SAMPLES - 2);
    __global const float *p = table + interval * (INTEGRAL_SAMPLES - 1) + i;
    return mix(p[0], p[1], position - i);
}

/* Exponent of the lobe that stands for the cap of `depth` = 1 - cosine, and (in `amplitude`) the one that gives
   it the cap's solid angle. Caps beyond the hemisphere are hemispheres. */
inline float cap_lobe(__global const float *table, float depth, float *amplitude)
{
    depth = clamp(depth, CAP_SMALLEST_DEPTH, 1.0f);
    const float position = depth * (CAP_SAMPLES - 1);
    const int i = min((int)position, CAP_SAMPLES - 2);
    const float product = mix(table[i], table[i + 1], position - i);
    *amplitude = product + depth;
    return product / depth;
}
