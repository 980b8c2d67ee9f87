// Keeps the parts of a pixel's ray that lie inside a mask. Twin of splatgl/splat/mask_field.py.
#constant MASK_EDGE  // the mask's value at which matter ends
#constant FLUSH      // a part whose ends are nearer to the edge lies in it
#include "mask_normal.glsl"
#include "trilinear.glsl"

uniform vec3 mask_low;    // the mask's first voxel from the eye, index axes
uniform float mask_sure;  // gradient from which on it lights a face of the mask that it fits
// of a pixel's ray: its place in the mask at sheet 0, and voxels per sheet
vec3 mask_first[ROWS], mask_step[ROWS];

// start: the ray's offset from the eye at sheet 0; step: to the next sheet; index axes.
void set_mask_ray(int row, vec3 start, vec3 step_) {
    mask_first[row] = start - mask_low;
    mask_step[row] = step_;
}

vec4 mask_at(int row, float sheet) {
    return trilinear(mask_field, mask_first[row] + mask_step[row] * sheet);
}

// The mask at a place of a ray, in sheets, less its edge.
float mask_above(int row, float sheet) {
    return mask_at(row, sheet).r - MASK_EDGE;
}

// The kept rest of a part of which the mask less its edge is m at the ends and linear between. A part in a face is kept.
vec2 kept_part(vec2 part, vec2 m) {
    if (max(abs(m.x), abs(m.y)) < FLUSH) return part;
    float edge = mix(part.x, part.y, m.x / (m.x == m.y ? 1.0 : m.x - m.y));
    if (m.x >= 0.0) return vec2(part.x, m.y >= 0.0 ? part.y : edge);
    return m.y >= 0.0 ? vec2(edge, part.y) : part.xx;
}

// The share of light by the mask's normal; the rest is by the gradient of values.
float face_share(vec3 gradient, vec3 normal) {
    float size2 = dot(gradient, gradient), face2 = dot(normal, normal), along = dot(gradient, normal);
    float alike = along * along / max(size2 * face2, 1e-30) * (size2 / (size2 + mask_sure * mask_sure));
    return sqrt(face2) * (1.0 - alike);
}

// Shortens a part of the ray behind `origin`, in sheets, to what the mask keeps; m: the mask at its begin, then its end.
// Returns whether the part's begin may have changed.
bool mask_part(int row, float origin, inout vec2 part, inout float m) {
    float end = mask_above(row, origin + part.y);
    part = kept_part(part, vec2(m, end));
    m = end;
    return true;
}

// The mask's normal at a place of a ray, world axes, and the share of light by it.
vec4 mask_face(int row, float sheet, vec3 gradient) {
    vec3 normal = normal_in(mask_at(row, sheet));
    return vec4(normal, face_share(gradient, normal));
}
