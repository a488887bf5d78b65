/* Products of one lobe with many lobes of one other exponent: a row of `product_lobe` at a time. */

#if L2_PRODUCTS
#define SCALE_CHANNEL 1
#else
#define SCALE_CHANNEL 2
#endif

/* As product_row, of many pairs. */
inline ri product_rows(ri i, ri j)
{
    const ri high = max(i, j);
    return 3 * PRODUCT_ANGLES * (high * (high + 1) / 2 + min(i, j));
}

/* Residuals of the products of one lobe with lobes of the exponents e2: of the product's exponent (x) and of its scale
   (y), at `back` angles from the last one. Linear between the samples of four pairs of exponents and two angles. */
inline void residuals(__global const float *table, float e1, rf e2, rf back, int count, rf *shape, rf *scale)
{
    const rf position1 = fmin(ln_rows((rf)(1.0f + 2.0f * e1)) * PRODUCT_STEPS, PRODUCT_EXPONENTS - 1.0f);
    const rf position2 = fmin(ln_rows(1.0f + 2.0f * e2) * PRODUCT_STEPS, PRODUCT_EXPONENTS - 1.0f);
    const ri i = min(TO_RI(position1), PRODUCT_EXPONENTS - 2), j = min(TO_RI(position2), PRODUCT_EXPONENTS - 2);
    const ri angle = min(TO_RI(back), PRODUCT_ANGLES - 2);
    const rf g1 = position1 - TO_RF(i), f1 = 1.0f - g1, g2 = position2 - TO_RF(j), f2 = 1.0f - g2, f = back - TO_RF(angle);
    const ri place = 3 * (PRODUCT_ANGLES - 2 - angle);
    float w[4][RW];
    int p[4][RW];
    RF_STORE(f1 * f2, w[0]);
    RF_STORE(g1 * f2, w[1]);
    RF_STORE(f1 * g2, w[2]);
    RF_STORE(g1 * g2, w[3]);
    RI_STORE(place + product_rows(i, j), p[0]);
    RI_STORE(place + product_rows(i + 1, j), p[1]);
    RI_STORE(place + product_rows(i, j + 1), p[2]);
    RI_STORE(place + product_rows(i + 1, j + 1), p[3]);
    float last[2][RW] = {{0}}, before[2][RW] = {{0}}; /* at the greater angle and at the smaller one */
    for (int l = 0; l < count; l++) {
        const float8 v = w[0][l] * vload8(0, table + p[0][l]) + w[1][l] * vload8(0, table + p[1][l])
                       + w[2][l] * vload8(0, table + p[2][l]) + w[3][l] * vload8(0, table + p[3][l]);
        before[0][l] = v.s0;
        before[1][l] = SCALE_CHANNEL == 1 ? v.s1 : v.s2;
        last[0][l] = v.s3;
        last[1][l] = SCALE_CHANNEL == 1 ? v.s4 : v.s5;
    }
    *shape = mix(RF_LOAD(last[0]), RF_LOAD(before[0]), f);
    *scale = mix(RF_LOAD(last[1]), RF_LOAD(before[1]), f);
}

/* Tangents of the angles from both axes to the peak, over the sine of the angle between the axes, whose cosine is c. */
inline void peak_rows(float e1, rf e2, rf c, rf s2, rf *t, rf *u)
{
    const rf along = (e1 + e2) * fabs(c);
    const rf root = sqrt(along * along + 4.0f * e1 * e2 * s2);
    /* The two forms of the root of e1 tan t = e2 tan u, each where it does not cancel. */
    const rf sum = along + root, scaled = sum / fmax(s2, 1e-30f);
    *t = select(2.0f * e2 / sum, scaled / (2.0f * e1), c < 0.0f);
    *u = select(2.0f * e1 / sum, scaled / (2.0f * e2), c < 0.0f);
}

/* Integrals of the products of a lobe of exponent e1 with the first `count` lobes of exponents e2, all above 0, whose
   axes have q = |a1 - a2|^2 / 2. A product's axis is *along1 a1 + *along2 a2. */
inline rf products(__global const float *table, float e1, rf e2, rf q, int count, rf *along1, rf *along2, rf *exponent)
{
    const rf c = 1.0f - q, s2 = q * (2.0f - q);
    const rf alpha = angle_rows(q);
    const rf last = fmin(PRODUCT_REACH * sqrt(1.0f / (e1 + 1.0f) + 1.0f / (e2 + 1.0f)), M_PI_F); /* as in product_reach */
    rf shape, scale;
    residuals(table, e1, e2, clamp((last - alpha) / last, 0.0f, 1.0f) * (PRODUCT_ANGLES - 1), count, &shape, &scale);

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
    const rf z = 0.5f * (e1 + e2 + 2.0f), across = sqrt(M_PI_F / (z - 0.25f + 0.03125f / z)); /* the plane of both axes */
    const rf integral = exp_rows(log_peak + scale) * across * width;
#endif
    peak_rows(e1, e2, c, s2, &t, &u);
    *along1 = u * rsqrt(1.0f + u * u * s2);
    *along2 = t * rsqrt(1.0f + t * t * s2);
    return select(integral, (rf)(0.0f), alpha > last);
}
