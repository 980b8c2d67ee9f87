// Sets up one splat relative to the eye: its colour and optical depth, for a quad's vertex or the tile lists.
// VARYING is defined as `out` in the vertex shader, FLAT as `flat`; elsewhere as nothing.
// switch SHADING 0  normals are lit
// switch BOXES 0    splats are boxes of voxels, see boxes.glsl
// switch QUANTIZED 0  records are those of a web page
#include "approximations.glsl"
#include "attenuation.glsl"
#include "light.glsl"
#include "motion_opacity.glsl"
#include "quantized_records.glsl" if QUANTIZED else "records.glsl"
#include "varyings.glsl"

// The voxel's colour by its normal, and by the light that reaches it; a zero gradient is unshaded. Boxes are lit later.
vec3 shone(vec3 v) {
    if ((SHADING == 0 && CUED == 0) || BOXES == 1) return in_color;
    float far = length(v);
    vec3 toward = PERSPECTIVE == 1 && far > 0.0 ? v / far : vec3(0.0, 0.0, 1.0);
    mat3 eye_from_world = mat3(frame.eye_from_world[0].xyz, frame.eye_from_world[1].xyz, frame.eye_from_world[2].xyz);
    vec3 normal = SHADING == 1 ? vec3(in_normal) : vec3(0.0);
    vec2 share = reached(cell_at(index_from_eye() * v), normal, toward * eye_from_world);
    vec2 light = surface_light(eye_from_world * normal, toward, style.light.xyz, share);
    return in_color * light.x + light.y;
}

// Optical depth, per mean spacing, that is correct on average after attenuation by m².
float attenuated_depth(vec3 v, float coverage) {
    if (ATTENUATION == ATTENUATION_FILL && ANTIALIAS == 1 && coverage < 1.0)
        return filled_depth(in_optical_depth, index_from_eye() * v, coverage, smallest_axis(v.z), in_runs);
    return in_optical_depth;
}

// Writes a still splat's varyings.
void give_matter(vec3 v, Quad quad) {
    splat.rgb = shone(v);
    if (STEPS > 0) splat = vec4(in_color, in_optical_depth);
    else if (PEAK == 1) splat.a = one_minus_exp(in_optical_depth * style.opacity_length);
    else if (BOXES == 1) splat.a = in_optical_depth;
    else splat.a = attenuated_depth(v, quad.coverage) * quad.gain * style.peak;
    coverage = quad.coverage;
    bend = quad.bend;
    cubic = quad.cubic;
    mixed = quad.mixed;
}
