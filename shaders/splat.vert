// One corner of one splat's quad: placed relative to the eye, rotated, stretched, shaded.
// Instances are splats in drawing order; four vertices a quad, as a triangle strip.
// switch SHADING 0
// switch FEEDBACK 0
#include "frame.glsl"
#include "optics.glsl"
#include "footprint.glsl"

in vec3 in_position;        // grid indices
in float in_optical_depth;  // extinction × mean spacing
in vec3 in_color;           // linear RGB
in ivec3 in_normal;         // gradient direction, world axes; zero: unshaded

// few and packed: a software rasteriser sets up each of them for each triangle
out vec2 table_at;          // place in the footprint table, [0, 1]²
flat out vec4 splat;        // linear RGB, shaded; optical depth, or for mip the opacity, at the centre
#if ATTENUATION == ATTENUATION_OPACITY
flat out float coverage;    // 1/m² [M98 Eq. 6]
#endif
#if FEEDBACK
out vec3 corner_eye;        // the corner in eye axes, mean spacings
out float gain;
#endif

// C = c (0.3 + 0.7 |n·l|), l towards the eye; a zero gradient is unshaded
float head_light(vec3 towards_eye) {
#if SHADING
    vec3 n = mat3(frame.eye_from_world[0].xyz, frame.eye_from_world[1].xyz, frame.eye_from_world[2].xyz) * vec3(in_normal);
    float size = length(n);
    if (size > 0.0) return style.ambient + style.diffuse * min(abs(dot(n / size, towards_eye)), 1.0);
#endif
    return 1.0;
}

void main() {
    // relative to the eye before anything is rounded
    vec3 index = (in_position - frame.eye_whole.xyz) - frame.eye_part.xyz;
    mat3 a = mat3(frame.eye_from_index[0].xyz, frame.eye_from_index[1].xyz, frame.eye_from_index[2].xyz);
    vec3 v = a * index;

    // the corner
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    Quad quad = splat_quad(v);
    vec3 at = v + style.radius * (corner.x * quad.axis_1 + corner.y * quad.axis_2);
    table_at = corner * 0.5 + 0.5;
#if BLEND == BLEND_MIP
    splat.a = one_minus_exp(in_optical_depth * style.opacity_length);
#else
    splat.a = in_optical_depth * quad.gain * style.peak;
#endif
#if ATTENUATION == ATTENUATION_OPACITY
    coverage = quad.coverage;
#endif
#if FEEDBACK
    corner_eye = at;
    gain = quad.gain;
#endif

    // no depth test: z is only there to clip what is nearer than `near`
#if PERSPECTIVE
    gl_Position = vec4(at.xy * frame.clip_scale, at.z - 2.0 * frame.near, at.z);
    float far = length(v);
    splat.rgb = in_color * head_light(far > 0.0 ? -v / far : vec3(0.0, 0.0, -1.0));
#else
    gl_Position = v.z < 0.0 ? vec4(0.0, 0.0, 2.0, 1.0) : vec4(at.xy * frame.clip_scale, 0.0, 1.0);
    splat.rgb = in_color * head_light(vec3(0.0, 0.0, -1.0));
#endif
}
