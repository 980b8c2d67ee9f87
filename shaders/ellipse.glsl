// Projects a voxel's kernel on a plane, and computes the smallest width of antialiasing. Twin of splatgl/splat/view.py.
// switch ALIGN ALIGN_RAY  plane of a quad  [M98 Table 1]
// switch PERSPECTIVE 1    0: a parallel view
// switch ANTIALIAS 1      splats are widened beyond z_k  [M98 Eq. 4]
// switch CUBIC 1          voxels are cubes
#include "frame.glsl"
#define ALIGN_GRID 0
#define ALIGN_RAY 1
#define ALIGN_HYBRID 2
#define ALIGN_EXACT 3

float splat_size = 1.0;  // of voxels that are joined to one splat, in voxels along each side; of the quads of a table

mat3 eye_from_index() {
    return mat3(frame.eye_from_index[0].xyz, frame.eye_from_index[1].xyz, frame.eye_from_index[2].xyz);
}

mat3 index_from_eye() {
    return mat3(frame.index_from_eye[0].xyz, frame.index_from_eye[1].xyz, frame.index_from_eye[2].xyz);
}

// An offset in the kernel's own axes: a cube's kernel is the same in eye axes.
vec3 to_index(vec3 offset) {
    return CUBIC == 1 ? offset : index_from_eye() * offset;
}

// Two unit vectors perpendicular to the unit vector u and to each other: the rotation of the quad.
void perpendicular_axes(vec3 u, out vec3 e1, out vec3 e2) {
    float s = u.z < 0.0 ? -1.0 : 1.0;
    float a = -1.0 / (s + u.z);
    float b = u.x * u.y * a;
    e1 = vec3(1.0 + s * u.x * u.x * a, s * b, -s * u.x);
    e2 = vec3(b, s + u.y * u.y * a, -u.y);
}

// A pixel's side at depth z.
float pixel_side(float z) {
    return PERSPECTIVE == 1 ? frame.pixel_pitch * max(z, 0.0) : frame.pixel_pitch;
}

// The antialiasing's smallest half axis at depth z; 0 without antialiasing.  [M98 Eq. 3]
float smallest_axis(float z) {
    return ANTIALIAS == 1 ? frame.blur * pixel_side(z) : 0.0;
}

// Half axes of a kernel of unit radius, projected across the plane of e1 and e2.
struct Ellipse {
    vec3 axis_1;  // unit vectors
    vec3 axis_2;
    vec2 width;   // σ₁ ≥ σ₂
};

// Eigenvectors of C = A₂A₂ᵀ, A₂ the rows of A along e1 and e2.
Ellipse voxel_ellipse(vec3 e1, vec3 e2) {
    vec3 row_1 = e1 * eye_from_index();
    vec3 row_2 = e2 * eye_from_index();
    float diff = (dot(row_1, row_1) - dot(row_2, row_2)) * 0.5;
    float mixed = dot(row_1, row_2);
    float root = length(vec2(diff, mixed));
    vec2 major = diff >= 0.0 ? vec2(diff + root, mixed) : vec2(mixed, root - diff);
    major = root > 0.0 ? normalize(major) : vec2(1.0, 0.0);
    // the widths' product from the cross product, without cancellation for flat voxels
    float area = length(cross(row_1, row_2));
    float width_1 = sqrt((dot(row_1, row_1) + dot(row_2, row_2)) * 0.5 + root);
    return Ellipse(e1 * major.x + e2 * major.y, e2 * major.x - e1 * major.y, vec2(width_1, area / width_1));
}

// Distances below and above x/z of the slopes s at which planes through the eye touch the kernel's ellipsoid:
// (x − s z)² = R² |e − s f|², e and f the rows of eye_from_index along x and depth. Perspective views.
vec2 tangents(float x, float z, vec3 e, vec3 f) {
    float r2 = style.radius * style.radius;
    float a = z * z - r2 * dot(f, f);
    float b = x * z - r2 * dot(e, f);
    float c = x * x - r2 * dot(e, e);
    float middle = b - a * x / z, root = sqrt(max(b * b - a * c, 0.0));
    return vec2(root - middle, root + middle) / a;
}
