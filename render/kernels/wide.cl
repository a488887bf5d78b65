/* Lights that no mask holds: so near or so large that their cone does not fit a plane, or points. */

/* Integral over the directions of a wide light, or of the light that the point is inside of: directions in an equal-area
   map of the cap (inside: of the hemisphere) for the diffuse term (`lobe` 0), and such as the lobe itself distributes
   them, since a sharp one would fall between the former; each tested against every blocker. */
inline float wide_sum(const __local blockers_t *blockers, const receiver_t *receiver, const cap_t *cap, int light, int inside,
                      const bound_lobe_t *lobe)
{
    float sum = 0.0f;
    const float3 axis = lobe ? lobe->axis : cap->a;
    float3 t, u;
    frame_around(axis, receiver->turn, &t, &u);
    for (int k = 0; k < WIDE_RINGS; k++) {
        const float share = (k + 0.5f) / WIDE_RINGS;
        const float below = lobe ? -expm1(log(share) / (lobe->exponent + 1.0f)) : share * cap->depth; /* 1 - cosine */
        const float z = 1.0f - below, rim = sqrt(fmax(below * (2.0f - below), 0.0f));
        for (int c = 0; c < WIDE_SECTORS; c++) {
            float sine;
            const float cosine = sincos_turn((c + 0.5f) / WIDE_SECTORS, &sine);
            const float3 l = rim * (cosine * t + sine * u) + z * axis;
            if (sees_light(blockers, receiver, cap, light, inside, l))
                sum += lobe && !lobe->cosine ? 1.0f : dot(receiver->shading, l);
        }
    }
    const float measure = lobe ? 1.0f / (lobe->exponent + 1.0f) : cap->depth;
    return sum * measure * (2.0f * M_PI_F / (WIDE_RINGS * WIDE_SECTORS));
}

/* BRDF times cosine over a wide light. */
inline float3 reflected_wide(const receiver_t *receiver, const brdf_t *brdf, const cap_t *cap,
                             const __local blockers_t *blockers, int light, int inside, float *irradiance)
{
    *irradiance = wide_sum(blockers, receiver, cap, light, inside, 0);
    float3 sum = brdf->kd * *irradiance;
    for (int l = 0; l < brdf->n_lobes; l++)
        sum += brdf->lobes[l].colour * wide_sum(blockers, receiver, cap, light, inside, &brdf->lobes[l]);
    return sum;
}

/* BRDF times cosine over the squared distance of a point light: one direction, seen or not. */
inline float3 reflected_point(const receiver_t *receiver, const brdf_t *brdf, const cap_t *cap,
                              const __local blockers_t *blockers, int light, float *irradiance)
{
    const float3 l = cap->a;
    const float cosine = dot(receiver->shading, l);
    *irradiance = 0.0f;
    if (cosine <= 0.0f || dot(receiver->geometric, l) <= 0.0f
        || (blockers->n_groups > 0 && blocked(blockers, receiver, light, l, cap->d)))
        return 0.0f;
    const float falloff = 1.0f / (cap->d * cap->d);
    *irradiance = cosine * falloff;
    float3 sum = brdf->kd * *irradiance;
    for (int k = 0; k < brdf->n_lobes; k++) {
        const bound_lobe_t *lobe = &brdf->lobes[k];
        const float3 gap = lobe->axis - l;
        const float value = lobe_value(0.5f * dot(gap, gap), lobe->exponent);
        sum += lobe->colour * (value * falloff * (lobe->cosine ? cosine : 1.0f));
    }
    return sum;
}
