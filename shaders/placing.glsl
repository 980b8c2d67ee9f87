// One splat placed relative to the eye, as a sprite, with its matter: for a vertex, or for the lists of tiles.
// ATTRIBUTE and VARYING are defined as `in` and `out` in the vertex shader, FLAT as `flat`; elsewhere as nothing.
// switch SHADING 0
#include "frame.glsl"
#include "optics.glsl"
#include "exact.glsl"
#include "footprint.glsl"
#include "sprite.glsl"
#include "fill.glsl"
#include "motion.glsl"
#include "varyings.glsl"

ATTRIBUTE vec3 in_position;        // grid indices
ATTRIBUTE float in_optical_depth;  // extinction × mean spacing
ATTRIBUTE vec3 in_color;           // linear RGB
ATTRIBUTE ivec3 in_normal;         // gradient direction, world axes; zero: unshaded
ATTRIBUTE int in_runs;             // how far matter goes on along the grid's axes, coded

#if ALIGN == ALIGN_EXACT || ALIGN == ALIGN_B1
#define PLANE ExactQuad
#else
#define PLANE Quad
#endif

// C = c (0.3 + 0.7 |n·l|), l towards the eye; a zero gradient is unshaded
float head_light(vec3 v) {
#if SHADING
#if PERSPECTIVE
    float far = length(v);
    vec3 towards_eye = far > 0.0 ? -v / far : vec3(0.0, 0.0, -1.0);
#else
    const vec3 towards_eye = vec3(0.0, 0.0, -1.0);
#endif
    mat3 eye_from_world = mat3(frame.eye_from_world[0].xyz, frame.eye_from_world[1].xyz, frame.eye_from_world[2].xyz);
    vec3 n = eye_from_world * vec3(in_normal);
    float size = length(n);
    if (size > 0.0) return style.ambient + style.diffuse * min(abs(dot(n / size, towards_eye)), 1.0);
#endif
    return 1.0;
}

// Optical depth, per mean spacing, that attenuation by m² leaves right on average.
float attenuated_depth(vec3 v, float coverage) {
#if ATTENUATION == ATTENUATION_FILL && ANTIALIAS
    if (coverage < 1.0)
        return filled_depth(in_optical_depth, index_from_eye() * v, coverage, smallest_axis(v.z), in_runs);
#endif
    return in_optical_depth;
}

// What a still splat hands to its fragments of its matter.
void give_matter(vec3 v, PLANE quad) {
#if BLEND == BLEND_MIP
    splat.a = one_minus_exp(in_optical_depth * style.opacity_length);
#else
    splat.a = attenuated_depth(v, quad.coverage) * quad.gain * style.peak;
#endif
#if ATTENUATION == ATTENUATION_OPACITY
    coverage = quad.coverage;
#endif
    splat.rgb = in_color * head_light(v);
}

#if SPRITE
// How its pixels lie in the footprint; seen: whether it is before the eye.
PLANE place_sprite(vec3 v, out Sprite sprite, out bool seen) {
#if ALIGN == ALIGN_EXACT
    bool stretched = is_stretched(v);
    PLANE quad = exact_quad(v, stretched);
    if (stretched) sprite = planar_sprite(v, quad.axis_1, quad.axis_2, quad.reach);
    else sprite = near_sprite(v);
    seen = v.z > frame.depth_reach;
#if ANTIALIAS
    bend = quad.bend;
#if !CUBIC
    cubic = quad.cubic;
    mixed = quad.mixed;
#endif
#endif
#else
    PLANE quad = splat_quad(v);
    sprite = planar_sprite(v, quad.axis_1, quad.axis_2, style.radius);
    seen = true;
#endif
    to_local = sprite.to_local;
    pixel = sprite.center;
    return quad;
}
#endif
