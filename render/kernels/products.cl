/* Products of one lobe with many lobes of one other exponent: a row of `product_lobe` at a time. */

#if L2_PRODUCTS
#define SCALE_CHANNEL 1
#else
#define SCALE_CHANNEL 2
#endif

typedef struct {
    float e1, e2;
    __global const float *samples[4]; /* of the four pairs of sampled exponents around this one, and their weights */
    float weights[4];
    float last, across; /* the largest angle, and the Beta function of the integral */
} pair_t;

/* Completes a pair of exponents by what all its products share. */
inline void find_samples(pair_t *pair, __global const float *table)
{
    const float e1 = pair->e1, e2 = pair->e2, z = 0.5f * (e1 + e2 + 2.0f);
    pair->last = product_reach(e1, e2);
    pair->across = sqrt(M_PI_F / (z - 0.25f + 0.03125f / z));
    const float2 position = fmin(log1p((float2)(2.0f * e1, 2.0f * e2)) * PRODUCT_STEPS, PRODUCT_EXPONENTS - 1);
    const int2 cell = min(convert_int2(position), PRODUCT_EXPONENTS - 2);
    const float2 f = position - convert_float2(cell);
    for (int corner = 0; corner < 4; corner++) {
        const int a = corner & 1, b = corner >> 1;
        pair->samples[corner] = table + product_row(cell.x + a, cell.y + b);
        pair->weights[corner] = (a ? f.x : 1.0f - f.x) * (b ? f.y : 1.0f - f.y);
    }
}

/* Tangents of the angles from both axes to the peak, over the sine of the angle between the axes, whose cosine is c. */
inline void peak_rows(float e1, float e2, rf c, rf s2, rf *t, rf *u)
{
    const rf along = (e1 + e2) * fabs(c);
    const rf root = sqrt(along * along + 4.0f * e1 * e2 * s2);
    /* The two forms of the root of e1 tan t = e2 tan u, each where it does not cancel. */
    const rf sum = along + root, scaled = sum / fmax(s2, 1e-30f);
    *t = select(2.0f * e2 / sum, scaled / (2.0f * e1), c < 0.0f);
    *u = select(2.0f * e1 / sum, scaled / (2.0f * e2), c < 0.0f);
}

/* Integrals of the products with the first `count` lobes, whose axes have q = |a1 - a2|^2 / 2. The product's axis is *along1 a1 +
   *along2 a2, its exponent *exponent. Both exponents are above 0. */
inline rf products(const pair_t *pair, rf q, int count, rf *along1, rf *along2, rf *exponent)
{
    const float e1 = pair->e1, e2 = pair->e2, last = pair->last;
    const rf c = 1.0f - q, s2 = q * (2.0f - q);
    const rf alpha = angle_rows(q);
    float angles[RW], shapes[RW] = {0}, scales[RW] = {0};
    RF_STORE(clamp((last - alpha) / last, 0.0f, 1.0f) * (PRODUCT_ANGLES - 1), angles);
    for (int lane = 0; lane < count; lane++) {
        const int angle = min((int)angles[lane], PRODUCT_ANGLES - 2);
        const int offset = 3 * (PRODUCT_ANGLES - 2 - angle);
        const float f = angles[lane] - angle;
        float shape = 0.0f, scale = 0.0f;
        for (int corner = 0; corner < 4; corner++) {
            __global const float *p = pair->samples[corner] + offset;
            shape += pair->weights[corner] * mix(p[3], p[0], f);
            scale += pair->weights[corner] * mix(p[3 + SCALE_CHANNEL], p[SCALE_CHANNEL], f);
        }
        shapes[lane] = shape;
        scales[lane] = scale;
    }
    const rf shape = RF_LOAD(shapes), scale = RF_LOAD(scales);

    /* What residuals are relative to: coslobe.tables.product._closed_forms. */
    rf t, u;
    peak_rows(e1 + PRODUCT_SHIFT, e2 + PRODUCT_SHIFT, c, s2, &t, &u);
    const rf tan2_t = t * t * s2, tan2_u = u * u * s2;
    const rf log_peak = 0.5f * (e1 * log_rows(tan2_t / (1.0f + tan2_t)) + e2 * log_rows(tan2_u / (1.0f + tan2_u)));
    const rf k = e1 * (1.0f + tan2_t) + e2 * (1.0f + tan2_u);
    *exponent = fmax(exp_rows(shape) * (sqrt((e1 + e2) * k) + PRODUCT_SHIFT) - PRODUCT_SHIFT, 0.0f);
#if L2_PRODUCTS
    const rf integral = exp_rows(log_peak + scale) * (2.0f * M_PI_F) / (*exponent + 1.0f);
#else
    const rf opening = fmax(M_PI_F - alpha, 1e-15f);
    const rf width = rsqrt(k / (2.0f * M_PI_F) + 1.0f / (opening * opening));
    const rf integral = exp_rows(log_peak + scale) * pair->across * width;
#endif
    peak_rows(e1, e2, c, s2, &t, &u);
    *along1 = u * rsqrt(1.0f + u * u * s2);
    *along2 = t * rsqrt(1.0f + t * t * s2);
    return select(integral, (rf)(0.0f), alpha > last);
}
