/* A light as points see it; see cap_t. */

typedef struct {
    pf3 a, centre;
    pf sine, cosine, depth, d, tangent, tau, near;
    float radius;
} caps_t;

/* Caps of a light at `centre` from the points. */
inline caps_t caps_of(pf3 centre, float radius)
{
    caps_t caps;
    caps.centre = centre;
    caps.radius = radius;
    caps.d = sqrt(dots(centre, centre));
    caps.near = caps.d - radius;
    caps.tau = fmax(caps.near * (caps.d + radius), 0.0f);
    caps.tangent = sqrt(caps.tau);
    const pf inverse = 1.0f / caps.d;
    caps.a = scaled(centre, inverse);
    caps.sine = radius * inverse;
    caps.cosine = caps.tangent * inverse;
    caps.depth = caps.sine * caps.sine / (1.0f + caps.cosine);
    return caps;
}

/* The cap that point l sees. */
inline cap_t cap_lane(const caps_t *caps, int l)
{
    cap_t cap;
    cap.a = vector_lane(&caps->a, l);
    cap.centre = vector_lane(&caps->centre, l);
    cap.sine = LANE(caps->sine, l);
    cap.cosine = LANE(caps->cosine, l);
    cap.depth = LANE(caps->depth, l);
    cap.d = LANE(caps->d, l);
    cap.radius2 = caps->radius * caps->radius;
    cap.tangent = LANE(caps->tangent, l);
    cap.tau = LANE(caps->tau, l);
    cap.near = LANE(caps->near, l);
    return cap;
}
