// Looks up the shares of ambient and of direct light that reach a place: ambient occlusion and shadows.
// Twin of splatgl/splat/ambient_occlusion.py.
// switch SKY 0      ambient occlusion
// switch SHADOWS 0  shadows
#include "trilinear.glsl"
#define CUED 1

uniform mat3 cell_from_index;   // index axes to cells
uniform mat3 cell_from_normal;  // a unit normal, world axes, to the place before the surface, in cells
uniform vec3 cell_of_eye;
uniform vec2 cue_strength;      // of occlusion and of shadows, 0 to 1
uniform sampler3D sky_field;    // of each cell the first moment, world axes, and the mean
uniform sampler3D shade_field;  // of each cell the share of light

// The cell of an offset from the eye, index axes.
vec3 cell_at(vec3 offset) {
    return cell_of_eye + cell_from_index * offset;
}

// The shares of ambient and of direct light in a cell. normal: of a surface, of any length; toward: the ray's unit
// vector; both in world axes.
vec2 reached(vec3 cell, vec3 normal, vec3 toward) {
    float size2 = dot(normal, normal);
    vec3 n = normal * inversesqrt(max(size2, 1e-37));
    if (dot(n, toward) > 0.0) n = -n;
    cell += cell_from_normal * n;
    vec2 share = vec2(1.0);
    if (SKY == 1) {
        vec4 seen = trilinear(sky_field, cell);
        float sky = size2 > 0.0 ? seen.a + 2.0 * dot(n, seen.rgb) : 2.0 * seen.a;
        share.x = 1.0 - cue_strength.x * (1.0 - clamp(sky, 0.0, 1.0));
    }
    if (SHADOWS == 1) share.y = 1.0 - cue_strength.y * (1.0 - trilinear(shade_field, cell).r);
    return share;
}
