/* Points of a picture from what its rays hit, one work-item per hit of one object, in double precision: the device's
   twin of `resolve` in gbuffer.py. A hit that another object hides is left alone. */
#pragma OPENCL EXTENSION cl_khr_fp64 : enable

/* The camera: unit vectors right, up, forward; half-width and half-height at distance 1; origin; sample positions. */
inline double3 ray_direction(const int pixel, const int sample, const int width, const int height,
                             __constant double *camera)
{
    const double across = pixel % width + camera[14 + 2 * sample], down = pixel / width + camera[15 + 2 * sample];
    const double x = (2.0 * across / width - 1.0) * camera[9], y = (1.0 - 2.0 * down / height) * camera[10];
    const double3 ray = x * vload3(0, camera) + y * vload3(1, camera) + vload3(2, camera);
    return ray / sqrt(x * x + y * y + 1.0);
}

/* Normals are turned to the viewer; `inverse` is that of the object's matrix, by rows. */
inline void write_point(__global point_t *point, const double3 position, const double3 geometric, const double3 shading,
                        const double3 ray, __constant double *inverse, const int material, const int object,
                        const int pixel, const int width)
{
    const double3 x = vload3(0, inverse), y = vload3(1, inverse), z = vload3(2, inverse);
    double3 g = normalize(geometric.x * x + geometric.y * y + geometric.z * z);
    double3 s = normalize(shading.x * x + shading.y * y + shading.z * z);
    g = dot(g, ray) > 0.0 ? -g : g;
    s = dot(s, g) < 0.0 ? -s : s;
    vstore3(convert_float3(position), 0, point->position);
    vstore3(convert_float3(g), 0, point->geometric);
    vstore3(convert_float3(s), 0, point->shading);
    point->material = material;
    point->object = object;
    const double noise = 0.06711056 * (pixel % width) + 0.00583715 * (pixel / width);
    const double turn = 52.9829189 * (noise - floor(noise));
    point->turn = (float)(turn - floor(turn));
}

/* What both kernels need. `number` holds the point of each ray; `placing` the object's matrix by rows of four, with
   its translation relative to the points' origin, and its inverse. */
#define HIT_ARGUMENTS                                                                                                  \
    const int n, __global const int *rays, __global const int *pixels, __global const int *objects,                   \
        __global const int *number, const int complete, const int object, const int width, const int height,           \
        const int samples, __constant double *camera, __constant double *placing, __global const int *material,        \
        __global point_t *points

#define HIT_OF_THIS_ITEM                                                                                               \
    const int e = get_global_id(0);                                                                                    \
    if (e >= n || objects[rays[e]] != object)                                                                          \
        return;                                                                                                        \
    const int ray = rays[e], pixel = pixels[ray], i = complete ? ray : number[ray];                                    \
    const double3 direction = ray_direction(pixel, ray % samples, width, height, camera);

__kernel void points_on_mesh(HIT_ARGUMENTS, __global const int *triangle, __global const float *uv,
                             __global const int *faces, __global const double *vertices, __global const double *normals,
                             const int flat)
{
    HIT_OF_THIS_ITEM
    const int3 corner = vload3(triangle[e], faces);
    const double3 a = vload3(corner.x, vertices), b = vload3(corner.y, vertices), c = vload3(corner.z, vertices);
    const double u = uv[2 * e], v = uv[2 * e + 1], w = 1.0 - u - v;
    const double3 point = w * a + u * b + v * c, geometric = cross(b - a, c - a);
    double3 smooth = w * vload3(corner.x, normals) + u * vload3(corner.y, normals) + v * vload3(corner.z, normals);
    if (flat || dot(smooth, smooth) <= 1e-12)
        smooth = geometric;
    const double3 position = (double3)(dot(vload4(0, placing).xyz, point) + placing[3],
                                       dot(vload4(1, placing).xyz, point) + placing[7],
                                       dot(vload4(2, placing).xyz, point) + placing[11]);
    write_point(points + i, position, geometric, smooth, direction, placing + 12, material[i], object, pixel, width);
}

__kernel void points_on_plane(HIT_ARGUMENTS, __global const double *t)
{
    HIT_OF_THIS_ITEM
    const double3 up = (double3)(0.0, 1.0, 0.0), position = vload3(0, camera + 11) + t[e] * direction;
    write_point(points + i, position, up, up, direction, placing + 12, material[i], object, pixel, width);
}
