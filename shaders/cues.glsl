// Shares of the sky and of the light that reach a place: ambient occlusion and shadows.
// Twin of splatgl/splat/ambient_occlusion.py.
// switch SKY 0      ambient occlusion
// switch SHADOWS 0  shadows
#include "trilinear.glsl"
#define CUED 1

layout(std140) uniform Cues {
    vec4 cell_from_index[3];   // columns: grid steps to cells
    vec4 cell_from_normal[3];  // a unit normal, world axes, to the place before the surface
    vec4 cell_of_eye;
    vec4 strength;             // of occlusion and of shadows
} cues;
uniform sampler3D sky_field;    // of each cell the first moment, world axes, and the mean
uniform sampler3D shade_field;  // of each cell the share of light

// The cell of an offset from the eye, index axes.
vec3 cell_at(vec3 offset) {
    return cues.cell_of_eye.xyz + mat3(cues.cell_from_index[0].xyz, cues.cell_from_index[1].xyz, cues.cell_from_index[2].xyz) * offset;
}

// The shares of ambient and of direct light in a cell. normal: of a surface, of any length; toward: the ray's unit
// vector; both in world axes.
vec2 reached(vec3 cell, vec3 normal, vec3 toward) {
    float size2 = dot(normal, normal);
    vec3 n = normal * inversesqrt(max(size2, 1e-37));
    if (dot(n, toward) > 0.0) n = -n;
    cell += mat3(cues.cell_from_normal[0].xyz, cues.cell_from_normal[1].xyz, cues.cell_from_normal[2].xyz) * n;
    vec2 share = vec2(1.0);
    if (SKY == 1) {
        vec4 seen = trilinear(sky_field, cell);
        float sky = size2 > 0.0 ? seen.a + 2.0 * dot(n, seen.rgb) : 2.0 * seen.a;
        share.x = 1.0 - cues.strength.x * (1.0 - clamp(sky, 0.0, 1.0));
    }
    if (SHADOWS == 1) share.y = 1.0 - cues.strength.y * (1.0 - trilinear(shade_field, cell).r);
    return share;
}
