// One splat's contribution to one pixel, by the footprint table.
// switch BLEND BLEND_COMPOSITE
// switch ATTENUATION ATTENUATION_OPTICAL_DEPTH
#include "frame.glsl"
#include "optics.glsl"
#define BLEND_COMPOSITE 0
#define BLEND_XRAY 1
#define BLEND_MIP 2
#define ATTENUATION_OPTICAL_DEPTH 0
#define ATTENUATION_OPACITY 1

uniform sampler2D footprint_table;  // F/F(0) over [−R, R]²

in vec2 table_at;
flat in vec3 color;
flat in float optical_depth;
flat in float gain;
flat in float coverage;

out vec4 fragment;  // linear premultiplied: 'over', sum or maximum, as BLEND says

void main() {
    float shape = texture(footprint_table, table_at).r;
    float depth = optical_depth * gain * style.peak * shape;
#if BLEND == BLEND_XRAY
    fragment = vec4(color, 1.0) * depth;
#elif BLEND == BLEND_MIP
    fragment = vec4(color, 1.0) * (one_minus_exp(optical_depth * style.opacity_length) * shape);
#elif ATTENUATION == ATTENUATION_OPACITY
    // the paper's: the opacity of the unstretched splat, weakened by (z_k/z_v)² = coverage  [M98 Eq. 6]
    fragment = vec4(color, 1.0) * (coverage > 0.0 ? coverage * one_minus_exp(depth / coverage) : 0.0);
#else
    fragment = vec4(color, 1.0) * one_minus_exp(depth);
#endif
}
