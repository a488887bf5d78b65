/* The accurate estimator: closed forms and one table where nothing blocks a light, and their lit share where the mask
   says that something does. */

/* Of the terms of points that see all of a light: the diffuse one. */
inline pf whole_diffuse(const caps_t *caps, pf over_shading)
{
    return lambert_sphere(over_shading, caps->sine * caps->sine);
}

/* The share of the diffuse term that reaches the point: lit cells over all cells, each with its cosine. */
inline float diffuse_share(const ru *lit, float3 moments, __constant uint *disk, float h, float3 n, int cut)
{
    if (!cut && h < LARGEST_MOMENT_H)
        return clamp(dot(n, (float3)(moments.y, moments.z, moments.x)) / (n.z * DISK_CELLS), 0.0f, 1.0f);
    const float2 cells = diffuse_cells(lit, disk, h, n);
    return cells.x > 0.0f ? cells.y / cells.x : 0.0f;
}

/* Turns `terms`, the integrals of BRDF times cosine over all of the light's cap, the diffuse one first and then those of
   the lobes, into the integrals over the part that the point sees. Returns LIT, PARTIAL or DARK. */
inline int shadow(float *terms, const receiver_t *receiver, const brdf_t *brdf, const cap_t *cap,
                  const __local blockers_t *blockers, int light, const __local tables_t *tables, __constant uint *disk, float threshold,
                  work_t *work)
{
    const float3 n = receiver->shading, g = receiver->geometric;
    const float over_geometric = dot(g, cap->a), over_shading = dot(n, cap->a);
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
    const int state = visibility(blockers, receiver, cap, light, &t, &u, framed, mask, &work->splats);
    KEEP(work->products, state == PARTIAL ? columns_with_bits(mask) : 0);
    if (ENDS_BEFORE(UP_TO_LEAVES))
        return state;
#if LEAVES
    uint tree[TREE_ROWS];
    work->leaves += state == PARTIAL ? shadow_leaves(mask, disk, tree) : state == DARK;
#endif
    if (state != PARTIAL)
        return state;
    ru lit[NR];
    for (int k = 0; k < NR; k++)
        lit[k] = RU_LOAD(k, disk) & ~mask[k];
    const float3 moments = bit_moments(lit, h);
    if (moments.x == 0.0f)
        return DARK;
    if (moments.x == DISK_CELLS && !cut)
        return LIT;
    KEEP(work->products, as_uint(moments.y + moments.z));
    if (ENDS_BEFORE(UP_TO_INTEGRATION))
        return PARTIAL;
    const float3 nl = (float3)(dot(n, t), dot(n, u), over_shading);
    terms[0] *= diffuse_share(lit, moments, disk, h, nl, cut);
    for (int l = 0; l < brdf->n_lobes; l++) {
        const bound_lobe_t *lobe = &brdf->lobes[l];
        /* A lobe that hardly reaches the light is not worth its cells. */
        if (largest(lobe->colour) * terms[1 + l] <= NEGLIGIBLE_LOBE * 2.0f * cap->depth)
            continue;
        float2 cells = -1.0f;
        if (WINDOW * WINDOW < h * h * (lobe->exponent + 1.0f))
            cells = window_cells(lobe, receiver, cap, cut, blockers, light, disk, &work->splats);
        if (cells.x < 0.0f)
            cells = glossy_cells(lit, disk, h, nl, in_frame(lobe->axis, t, u, cap->a), lobe->exponent, lobe->cosine, cut);
        terms[1 + l] *= cells.x > 0.0f ? cells.y / cells.x : 0.0f;
        work->products++;
    }
    return PARTIAL;
}
