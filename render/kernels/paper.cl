/* The estimator of Meunier et al. 2009: lobes for the light (31), one lobe per shadow leaf (Sec. 5.3), products from the
   table, reflectance and light first (Sec. 5.4). Twin: coslobe.render.paper. */

/* What the light and one part of the reflectance give together: the lobe scale max(axis.l, 0)^exponent, with the cosine
   to the normal or without; its integral, what shadow leaves take from it, and the largest component (`size`) of the
   colour by which both count. Part 0 is the diffuse one, lobes follow. */
typedef struct {
    float3 axis;
    float exponent, scale, whole, taken, size;
    int number, cosine, sharp;
} term_t;

/* Integral of a lobe of scale 1, with the cosine to n: int (p.v)^e (n.v) = 2 pi / (e + 2) (n.p). */
inline float lobe_moment(float3 axis, float exponent, float3 n, int cosine)
{
    return cosine ? 2.0f * M_PI_F / (exponent + 2.0f) * dot(n, axis) : 2.0f * M_PI_F / (exponent + 1.0f);
}

/* The diffuse term: the light's lobe, of exponent e, with the cosine. */
inline void diffuse_term(term_t *term, const cap_t *cap, float e, float3 n)
{
    term->axis = cap->a;
    term->exponent = e;
    term->cosine = 1;
    term->scale = UNIT_LIGHTS ? 1.0f : 0.5f * cap->sine * cap->sine * (e + 2.0f); /* pi sin^2 (n.a) in all */
    term->whole = term->scale * lobe_moment(cap->a, e, n, 1);
}

/* The product of the light's lobe, of exponent e, with one of the reflectance. The light's amplitude is such that their
   exact integral is `whole`; where the horizon `cut`s the light, that is with the cosine to the lobe's own axis. */
inline void lobe_term(term_t *term, const __local tables_t *tables, const cap_t *cap, float e, const bound_lobe_t *lobe, float3 n,
                      float whole, int cut)
{
    const float3 a = cap->a, gap = lobe->axis - a;
    const float alpha = 2.0f * asin(fmin(0.5f * sqrt(dot(gap, gap)), 1.0f));
    const ProductLobe product = product_lobe(tables->products, e, lobe->exponent, alpha);
    const float3 across = gap - dot(gap, a) * a; /* towards the lobe's axis, along the great circle through both */
    const float length2 = dot(across, across);
    term->axis = a;
    if (length2 > 0.0f)
        term->axis = cos(product.axis_angle) * a + sin(product.axis_angle) * rsqrt(length2) * across;
    term->exponent = product.exponent;
    term->cosine = lobe->cosine;
    term->scale = L2_PRODUCTS ? product.scale_l2 : product.scale_energy;
    if (!UNIT_LIGHTS) {
        const float unit = product.scale_energy
                         * lobe_moment(term->axis, term->exponent, cut ? term->axis : n, term->cosine);
        term->scale *= unit > 0.0f ? whole / unit : 0.0f;
    }
    term->whole = term->scale * lobe_moment(term->axis, term->exponent, n, term->cosine);
}

/* The products of the light with the diffuse term and with the lobes of the reflectance, from their integrals over the
   light: `wholes`, the diffuse one first. Those whose integral, for unit radiance, is below the threshold are dropped with
   all that follows from them; the diffuse one stays where the irradiance is asked for. Returns how many are left.

   A lobe sharper than the light's stays as it is: the light is an image in it, with an edge that no lobe has, and soft
   lobes of leaves cannot tell on which side of a shadow's edge it falls. Its shadow is that of the mask's cells. */
inline int light_terms(term_t *terms, const float *wholes, const brdf_t *brdf, const cap_t *cap, const __local tables_t *tables,
                       float3 n, int cut, float threshold)
{
    float amplitude;
    const float e = cap_lobe(tables->caps, cap->depth, &amplitude);
    int kept = 0;
    for (int l = -1; l < brdf->n_lobes; l++) {
        term_t *term = &terms[kept];
        term->number = 1 + l;
        term->taken = 0.0f;
        term->sharp = 0;
        term->whole = wholes[1 + l];
        term->size = largest(l < 0 ? brdf->kd : brdf->lobes[l].colour);
        if (!(IRRADIANCE && l < 0)
            && (term->size <= 0.0f || (threshold > 0.0f && term->size * term->whole < threshold)))
            continue;
        kept++;
        if (l < 0) {
            diffuse_term(term, cap, e, n);
            continue;
        }
        const bound_lobe_t *lobe = &brdf->lobes[l];
        if (UNIT_LIGHTS || lobe->exponent <= e) {
            lobe_term(term, tables, cap, e, lobe, n, term->whole, cut);
        } else {
            term->sharp = 1;
            term->axis = lobe->axis;
            term->exponent = lobe->exponent;
            term->cosine = lobe->cosine;
        }
    }
    return kept;
}

/* The lobes of the leaves of one level: their exponent, and their weight. */
typedef struct {
    float exponent, weight;
} level_t;

/* The leaves at 2^depth to a side over a light with tan alpha_cap = h, cap through the corners of the one at the centre;
   the weight is linear between samples of sin^2 alpha_cap. */
inline level_t leaf_level(const __local tables_t *tables, const cap_t *cap, float h, int rows, int depth)
{
    const float corner2 = 2.0f * h * h / (rows * rows), length = sqrt(1.0f + corner2);
    const float position = cap->sine * cap->sine * WEIGHT_STEPS;
    const int i = min((int)position, WEIGHT_SAMPLES - 2);
    __global const float *w = tables->weights + i * WEIGHT_LEVELS + depth;
    float amplitude;
    level_t level;
    level.exponent = cap_lobe(tables->caps, corner2 / (length * (1.0f + length)), &amplitude);
    level.weight = mix(w[0], w[WEIGHT_LEVELS], position - i);
    return level;
}

/* Up to RW leaves: their columns and rows in half cells, exponents and weights of their lobes. */
typedef struct {
    int column[RW], row[RW], count;
    rf exponent, weight;
} leaves_t;

/* Takes leaves from a term; axis and n in the mask's frame. A leaf whose product cannot reach the threshold is not worth
   one: closed form. Returns how many products that needed. */
inline uint take(term_t *term, const leaves_t *leaves, const __local tables_t *tables, float h, float3 axis, float3 n,
                 float threshold)
{
    const rf x = (TO_RF(RI_LOAD(leaves->column)) * (1.0f / ROWS) - 1.0f) * h;
    const rf y = (TO_RF(RI_LOAD(leaves->row)) * (1.0f / ROWS) - 1.0f) * h;
    const rf e2 = leaves->exponent;
    const float e1 = term->exponent;
    const ri there = row_numbers() < (float)leaves->count;
    const rf inverse = rsqrt(x * x + y * y + 1.0f), sum = e1 + e2;
    const rf lx = x * inverse, ly = y * inverse;
    const rf dx = lx - axis.x, dy = ly - axis.y, dz = inverse - axis.z;
    const rf q = 0.5f * (dx * dx + dy * dy + dz * dz);
    const rf amplitude = term->scale * leaves->weight, coaxial = 2.0f * M_PI_F / (sum + 1.0f);
    const ri worth = there & (term->size * amplitude * coaxial >= threshold);
    const uint n_products = row_bits_count(worth);
    rf along_axis = e1 / sum, along_leaf = e2 / sum, exponent = sum, integral;
    if (n_products < leaves->count)
        integral = lobe_rows(q, e1 * along_leaf) * coaxial;
    if (n_products > 0) {
        rf a, b, e;
        const rf exact = products(tables->products, e1, e2, q, leaves->count, &a, &b, &e);
        integral = select(integral, exact, worth);
        along_axis = select(along_axis, a, worth);
        along_leaf = select(along_leaf, b, worth);
        exponent = select(exponent, e, worth);
    }
    rf value = integral * amplitude * inverse * inverse * inverse;
    if (term->cosine) {
        const rf cosine_to_leaf = n.x * lx + n.y * ly + n.z * inverse;
        value *= (along_axis * dot(n, axis) + along_leaf * cosine_to_leaf) * (exponent + 1.0f) / (exponent + 2.0f);
    }
    term->taken += row_sum(select((rf)(0.0f), value, there));
    return n_products;
}

#if STAGE != FUSED
/* Bits of all that is in leaves; see stages.cl. */
inline uint leaves_bits(const leaves_t *leaves)
{
    return row_or(AS_RU(RI_LOAD(leaves->column) + RI_LOAD(leaves->row)) + AS_RU(leaves->exponent + leaves->weight));
}
#endif

/* Takes leaves from all terms; returns how many products that needed. */
inline uint take_all(term_t *terms, int n_terms, const leaves_t *leaves, const __local tables_t *tables, const cap_t *cap,
                     float h, float3 n, float3 t, float3 u, float threshold)
{
    const float3 nl = in_frame(n, t, u, cap->a);
    uint n_products = 0;
    KEEP(n_products, leaves_bits(leaves));
    for (int k = 0; k < n_terms; k++)
        if (!terms[k].sharp)
            n_products += take(&terms[k], leaves, tables, h, in_frame(terms[k].axis, t, u, cap->a), nl, threshold);
    return n_products;
}

/* Takes the leaves of a tree, whose rows are filled up to 2 ROWS, from all terms; returns how many products that needed. */
inline uint take_leaves(term_t *terms, int n_terms, const uint *tree, const cap_t *cap, const __local tables_t *tables, float h,
                        float3 n, float3 t, float3 u, float threshold)
{
    leaves_t leaves;
    leaves.count = 0;
    leaves.exponent = leaves.weight = 1.0f; /* lanes that no leaf fills still hold numbers */
    RI_STORE((ri)(ROWS), leaves.column);
    RI_STORE((ri)(ROWS), leaves.row);
    uint n_products = 0;
    int depth = MASK_DEPTH + 1, begin = 0, end = 0; /* of the level at hand, and its rows */
    level_t level;
    for (int k = 0; k < 2 * NR; k++)
        for (uint filled = row_bits(AS_RI(RU_LOAD(k, tree) != 0)); filled; filled &= filled - 1) {
            const int r = k * RW + lowest_bit(filled);
            if (r >= end) {
                for (; r >= end; depth--) {
                    begin = end;
                    end += 1 << (depth - 1);
                }
                level = leaf_level(tables, cap, h, 1 << depth, depth);
                const ri later = row_numbers() >= (float)leaves.count;
                leaves.exponent = select(leaves.exponent, (rf)(level.exponent), later);
                leaves.weight = select(leaves.weight, (rf)(level.weight), later);
            }
            const int width = ROWS >> depth, row = (2 * (r - begin) + 1) * width;
            for (uint left = tree[r]; left; left &= left - 1) {
                leaves.column[leaves.count] = 2 * lowest_bit(left) + width;
                leaves.row[leaves.count] = row;
                if (++leaves.count < RW)
                    continue;
                n_products += take_all(terms, n_terms, &leaves, tables, cap, h, n, t, u, threshold);
                leaves.count = 0;
                leaves.exponent = level.exponent;
                leaves.weight = level.weight;
            }
        }
    return n_products + (leaves.count ? take_all(terms, n_terms, &leaves, tables, cap, h, n, t, u, threshold) : 0);
}

/* Takes the cells of a mask from sharp terms; see light_terms. */
inline void take_cells(term_t *terms, int n_terms, const ru *mask, __constant uint *disk, const cap_t *cap, float h,
                       float3 n, float3 t, float3 u, int cut)
{
    ru lit[NR];
    for (int k = 0; k < NR; k++)
        lit[k] = RU_LOAD(k, disk) & ~mask[k];
    const float3 nl = (float3)(dot(n, t), dot(n, u), dot(n, cap->a));
    for (int k = 0; k < n_terms; k++) {
        const term_t *term = &terms[k];
        if (!term->sharp || term->size * term->whole <= NEGLIGIBLE_LOBE * 2.0f * cap->depth)
            continue;
        const float3 axis = (float3)(dot(term->axis, t), dot(term->axis, u), dot(term->axis, cap->a));
        const float2 cells = glossy_cells(lit, disk, h, nl, axis, term->exponent, term->cosine, cut);
        terms[k].taken = term->whole * (1.0f - (cells.x > 0.0f ? cells.y / cells.x : 0.0f));
    }
}

/* Of the terms of points that see all of a light: the diffuse one, negative where the light is below the horizon. */
inline pf whole_diffuse(const caps_t *caps, pf over_shading)
{
    return M_PI_F * caps->sine * caps->sine * over_shading;
}

/* Turns `integrals` of BRDF times cosine over all of the light's cap, the diffuse one first and then those of the lobes,
   into those over the part that the point sees. Returns LIT, PARTIAL or DARK. */
inline int shadow(float *integrals, const receiver_t *receiver, const brdf_t *brdf, const cap_t *cap,
                  const __local blockers_t *blockers, int light, const __local tables_t *tables, __constant uint *disk, float threshold,
                  work_t *work)
{
    const float3 n = receiver->shading, g = receiver->geometric;
    const float over_geometric = dot(g, cap->a), over_shading = dot(n, cap->a);
    const float h = cap->sine / cap->cosine;
    float3 t, u;
    ru mask[NR];
    for (int k = 0; k < NR; k++)
        mask[k] = 0;
    int framed = 0;
    const int cut = over_shading < cap->sine; /* the shading horizon crosses the light */
    if (over_geometric < cap->sine || cut) {
        frame_around(cap->a, receiver->turn, &t, &u);
        splat_horizon(mask, h, (float3)(dot(g, t), dot(g, u), over_geometric));
        splat_horizon(mask, h, (float3)(dot(n, t), dot(n, u), over_shading));
        framed = 1;
    }
    const int state = visibility(blockers, receiver, cap, light, &t, &u, framed, mask, &work->splats);
    KEEP(work->products, state == PARTIAL ? columns_with_bits(mask) : 0);
    if (ENDS_BEFORE(UP_TO_LEAVES))
        return state;
    uint tree[2 * ROWS];
    tree[TREE_ROWS] = 0;
    const int leaves = state == PARTIAL ? shadow_leaves(mask, disk, tree) : state == DARK;
    work->leaves += leaves;
    if (state == DARK || (leaves > 0 && tree[TREE_ROWS - 1]))
        return DARK;
    if (leaves == 0 && !cut && !UNIT_LIGHTS)
        return LIT;

#if ENDS_BEFORE(UP_TO_INTEGRATION)
    work->products += leaves ? take_leaves(0, 0, tree, cap, tables, h, n, t, u, threshold) : 0;
    float amplitude;
    if (!ENDS_BEFORE(UP_TO_LIGHT_LOBES))
        KEEP(work->products, as_uint(cap_lobe(tables->caps, cap->depth, &amplitude)));
    return leaves ? PARTIAL : LIT;
#endif

    term_t terms[1 + MAX_LOBES];
    const int n_terms = light_terms(terms, integrals, brdf, cap, tables, n, cut, threshold);
    if (leaves)
        work->products += take_leaves(terms, n_terms, tree, cap, tables, h, n, t, u, threshold);
    if (leaves || cut)
        take_cells(terms, n_terms, mask, disk, cap, h, n, t, u, cut);
    for (int k = 0; k < n_terms; k++)
        integrals[terms[k].number] = fmax(terms[k].whole - terms[k].taken, 0.0f);
    return leaves ? PARTIAL : LIT;
}
