// The quad of one splat: its plane, its two half axes and what antialiasing does to them.
// Twin of splatgl/splat/footprint.py, rows 4 and 5.  [M98 Table 1 row 4] [M98 Table 1 row 5]
// switch ALIGN ALIGN_RAY
// switch PERSPECTIVE 1
// switch ANTIALIAS 1
// switch CUBIC 1
#define ALIGN_GRID 0
#define ALIGN_RAY 1
#define ALIGN_HYBRID 2

// All lengths in mean voxel spacings, in eye axes.
struct Quad {
    vec3 axis_1;     // half extents of the kernel's unit radius across the plane
    vec3 axis_2;
    float gain;      // line integral of the splat at its centre over F(0): 1/m² for cubic voxels [M98 Eq. 6]
    float coverage;  // share of the stretched footprint that the unstretched one would fill: 1/m²
};

// Two unit vectors perpendicular to the unit vector u and to each other: the rotation of the quad.
void perpendicular_axes(vec3 u, out vec3 e1, out vec3 e2) {
    float s = u.z < 0.0 ? -1.0 : 1.0;
    float a = -1.0 / (s + u.z);
    float b = u.x * u.y * a;
    e1 = vec3(1.0 + s * u.x * u.x * a, s * b, -s * u.x);
    e2 = vec3(b, s + u.y * u.y * a, -u.y);
}

// The plane the quad lies in: parallel to the image, or perpendicular to the eye–voxel ray.
void quad_plane(vec3 v, out vec3 e1, out vec3 e2) {
    e1 = vec3(1.0, 0.0, 0.0);
    e2 = vec3(0.0, 1.0, 0.0);
#if PERSPECTIVE && ALIGN != ALIGN_GRID
    float far = length(v);
    bool rotate = far > 0.0;
#if ALIGN == ALIGN_HYBRID
    rotate = rotate && v.z < frame.switch_depth;
#endif
    if (rotate) perpendicular_axes(v / far, e1, e2);
#endif
}

// A pixel's side at depth z: the antialiasing's smallest half axis; 0 without antialiasing.  [M98 Eq. 3]
float smallest_axis(float z) {
#if !ANTIALIAS
    return 0.0;
#elif PERSPECTIVE
    return frame.pixel_pitch * max(z, 0.0);
#else
    return frame.pixel_pitch;
#endif
}

// v: the voxel's centre.  Stretch m = max(1, p/s) [M98 Eq. 4], along each axis of a non-cubic voxel by itself.
Quad splat_quad(vec3 v) {
    vec3 e1, e2;
    quad_plane(v, e1, e2);
    float p = smallest_axis(v.z);
#if CUBIC
    float g = max(1.0, p);
    return Quad(e1 * g, e2 * g, 1.0 / (g * g), 1.0 / (g * g));
#else
    // the voxel's ellipse on the plane: C = A₂A₂ᵀ and its eigenvectors
    mat3 a = mat3(frame.eye_from_index[0].xyz, frame.eye_from_index[1].xyz, frame.eye_from_index[2].xyz);
    vec3 row_1 = e1 * a;
    vec3 row_2 = e2 * a;
    float diff = (dot(row_1, row_1) - dot(row_2, row_2)) * 0.5;
    float mixed = dot(row_1, row_2);
    float root = length(vec2(diff, mixed));
    vec2 major = diff >= 0.0 ? vec2(diff + root, mixed) : vec2(mixed, root - diff);
    major = root > 0.0 ? normalize(major) : vec2(1.0, 0.0);
    // widths σ₁ ≥ σ₂; their product from the cross product, so that a flat voxel loses no digits
    float area = length(cross(row_1, row_2));
    float width_1 = sqrt((dot(row_1, row_1) + dot(row_2, row_2)) * 0.5 + root);
    float width_2 = area / width_1;
    float g1 = max(width_1, p);
    float g2 = max(width_2, p);
    vec3 along_1 = e1 * major.x + e2 * major.y;
    vec3 along_2 = e2 * major.x - e1 * major.y;
    return Quad(along_1 * g1, along_2 * g2, 1.0 / (g1 * g2), area / (g1 * g2));
#endif
}
