// One splat's contribution to one pixel, by the footprint table.
#include "optics.glsl"

uniform sampler2D footprint_table;  // F/F(0) over [−R, R]²

in vec2 table_at;
flat in vec4 splat;  // linear RGB; optical depth, or for mip the opacity, at the splat's centre
#if ATTENUATION == ATTENUATION_OPACITY
flat in float coverage;
#endif

out vec4 fragment;  // linear premultiplied: 'over', sum or maximum, as BLEND says

void main() {
    float value = splat.a * texture(footprint_table, table_at).r;
#if BLEND == BLEND_COMPOSITE
#if ATTENUATION == ATTENUATION_OPACITY
    // the paper's: the opacity of the unstretched splat, weakened by (z_k/z_v)² = coverage  [M98 Eq. 6]
    value = coverage > 0.0 ? coverage * one_minus_exp(value / coverage) : 0.0;
#else
    value = one_minus_exp(value);
#endif
#endif
    fragment = vec4(splat.rgb, 1.0) * value;
}
