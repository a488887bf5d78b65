/* The quadtree of shadow leaves over a light (Sec. 5.3), as an AND-pyramid of the mask's bits: four covered blocks make
   their parent the leaf. Twin: coslobe.tables.quadtree.

   A tree is 2 ROWS - 1 rows of bits, the mask's own level first, the root last. The level of depth d has 2^d rows; a
   block is the bit of its first column. Cells outside the light's disk count as covered where blocks are merged, so that
   a covered disk is one leaf, and are no leaves themselves: `disk` is a tree of the blocks that hold a cell of it. */

#define TREE_ROWS (2 * ROWS - 1)

/* The first row of the level with `rows` rows. */
inline int tree_level(int rows)
{
    return 2 * (ROWS - rows);
}

/* Turns a mask into the tree of its leaves; returns how many there are. */
inline int shadow_leaves(const ru *mask, __constant uint *disk, uint *tree)
{
    for (int k = 0; k < NR; k++)
        RU_STORE(mask[k] | ~RU_LOAD(k, disk), k, tree);
    uint *children = tree;
    for (int width = 1, rows = ROWS / 2; rows > 0; width *= 2, rows /= 2) {
        uint *parents = tree + tree_level(rows);
        const uint first_columns = 2 * width < 32 ? 0xffffffffu / ((1u << (2 * width & 31)) - 1) : 1;
        for (int r = 0; r < rows; r++) {
            const uint both = children[2 * r] & children[2 * r + 1];
            parents[r] = both & (both >> width) & first_columns;
            const uint above = parents[r] | (parents[r] << width);
            children[2 * r] &= ~above;
            children[2 * r + 1] &= ~above;
        }
        children = parents;
    }
    int count = 0;
    for (int r = 0; r < TREE_ROWS; r++) {
        tree[r] &= disk[r];
        count += popcount(tree[r]);
    }
    return count;
}
