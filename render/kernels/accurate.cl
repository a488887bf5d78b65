/* The accurate estimator: closed forms and one table where nothing blocks a light, and their lit share where the mask
   says that something does. */

/* The integral of a lobe (and the cosine) over the whole cap; where the horizon `cut`s it, with the cosine to the lobe's
   own axis, from which the cells take it to the true one. */
inline float whole_lobe(const bound_lobe_t *lobe, const cap_t *cap, float3 n, int cut)
{
    return lobe_over_cap(lobe->slice, lobe->exponent, lobe->axis, cut ? lobe->axis : n, cap->a, cap->sine, cap->depth,
                         lobe->cosine);
}

/* The share of the diffuse term that reaches the point: lit cells over all cells, each with its cosine. */
inline float diffuse_share(const ru *lit, float3 moments, __constant uint *disk, float h, float3 n, int cut)
{
    if (!cut && h < LARGEST_MOMENT_H)
        return clamp(dot(n, (float3)(moments.y, moments.z, moments.x)) / (n.z * DISK_CELLS), 0.0f, 1.0f);
    const float2 cells = diffuse_cells(lit, disk, h, n);
    return cells.x > 0.0f ? cells.y / cells.x : 0.0f;
}

/* BRDF times cosine over the part of the light's cone that the point sees; *irradiance is the diffuse integral. Terms
   below the threshold, for unit radiance, are left out. */
inline float3 reflected(const receiver_t *receiver, const brdf_t *brdf, const cap_t *cap, const __local blockers_t *blockers,
                        int light, const __local tables_t *tables, __constant uint *disk, float threshold, stats_t *count,
                        float *irradiance)
{
    const float3 n = receiver->shading, g = receiver->geometric;
    const float over_geometric = dot(g, cap->a), over_shading = dot(n, cap->a);
    *irradiance = 0.0f;
    if (over_geometric <= -cap->sine || over_shading <= -cap->sine) {
        count->below++;
        return 0.0f;
    }
    const float h = cap->sine / cap->cosine;
    const int cut = over_shading < cap->sine; /* the shading horizon crosses the light */
    float3 t, u;
    ru mask[NR];
    for (int k = 0; k < NR; k++)
        mask[k] = 0;
    int framed = 0;
    if (over_geometric < cap->sine || (cut & (brdf->n_lobes > 0))) {
        frame_around(cap->a, receiver->turn, &t, &u);
        splat_horizon(mask, h, (float3)(dot(g, t), dot(g, u), over_geometric));
        framed = 1;
    }
    const int state = visibility(blockers, receiver, cap, light, &t, &u, framed, mask, &count->splats);
#if LEAVES
    uint tree[TREE_ROWS];
    count->leaves += state == PARTIAL ? shadow_leaves(mask, disk, tree) : state == DARK;
#endif
    if (state == DARK) {
        count->dark++;
        return 0.0f;
    }
    float diffuse = lambert_sphere(over_shading, cap->sine * cap->sine);
    float lobes[MAX_LOBES > 0 ? MAX_LOBES : 1];
    for (int l = 0; l < brdf->n_lobes; l++)
        lobes[l] = whole_lobe(&brdf->lobes[l], cap, n, cut);
    count->products += 1 + brdf->n_lobes;
    *irradiance = diffuse;
    if (threshold > 0.0f) {
        if (largest(brdf->kd) * diffuse < threshold)
            diffuse = 0.0f;
        for (int l = 0; l < brdf->n_lobes; l++)
            if (largest(brdf->lobes[l].colour) * lobes[l] < threshold)
                lobes[l] = 0.0f;
    }
    if (state == LIT) {
        count->lit++;
        return brdf->kd * diffuse + sum_of_lobes(brdf, lobes);
    }
    ru lit[NR];
    for (int k = 0; k < NR; k++)
        lit[k] = RU_LOAD(k, disk) & ~mask[k];
    const float3 moments = bit_moments(lit, h);
    if (moments.x == 0.0f) {
        count->dark++;
        *irradiance = 0.0f;
        return 0.0f;
    }
    if (moments.x == DISK_CELLS && !cut) {
        count->lit++;
        return brdf->kd * diffuse + sum_of_lobes(brdf, lobes);
    }
    count->partial++;
    const float3 nl = (float3)(dot(n, t), dot(n, u), over_shading);
    const float share = diffuse_share(lit, moments, disk, h, nl, cut);
    diffuse *= share;
    *irradiance *= share;
    for (int l = 0; l < brdf->n_lobes; l++) {
        const bound_lobe_t *lobe = &brdf->lobes[l];
        /* A lobe that hardly reaches the light is not worth its cells. */
        if (largest(lobe->colour) * lobes[l] <= NEGLIGIBLE_LOBE * 2.0f * cap->depth)
            continue;
        float3 cells = -1.0f;
        if (WINDOW * WINDOW < h * h * (lobe->exponent + 1.0f))
            cells = window_cells(lobe, receiver, cap, blockers, light, disk, &count->splats);
        if (cells.x < 0.0f)
            cells = glossy_cells(lit, disk, h, nl, in_frame(lobe->axis, t, u, cap->a), lobe->exponent, lobe->cosine);
        const float whole = cut ? cells.x : cells.y;
        lobes[l] = whole > 0.0f ? lobes[l] * cells.z / whole : 0.0f;
        count->products++;
    }
    return brdf->kd * diffuse + sum_of_lobes(brdf, lobes);
}
