/* Staged builds, which tell what parts of the shading kernel take: one per STAGE below, each of which ends the work of a
   point and light after that part, in the order in which the kernel does it. KEEP adds bits of what a part found to counts
   that are stored, so that no compiler leaves the part out; counts then mean nothing, radiance is right where all parts
   are there. FUSED is the kernel itself, in which none of this leaves a trace. Measured by coslobe.evaluate.table1. */

#define FUSED 0
#define UP_TO_POINTS 1 /* read and written */
#define UP_TO_REFLECTANCE 2
#define UP_TO_CAPS 3 /* of lights */
#define UP_TO_MASK 4
#define UP_TO_LEAVES 5 /* or what else an estimator makes of a mask */
#define UP_TO_LIGHT_LOBES 6
#define UP_TO_INTEGRATION 7 /* all */

#if STAGE == FUSED
#define ENDS_BEFORE(part) 0
#define KEEP(count, bits)
#else
#define ENDS_BEFORE(part) (STAGE < (part))
#define KEEP(count, bits) (count) += (bits)
#endif
