// One splat's contribution to one pixel: its footprint, then the blend mode's value.
#define VARYING in
#define FLAT flat
#include "value.glsl"
#include "streak.glsl"

#if HALF_LINE
uniform sampler2D half_table;       // share of a chord's integral from the eye on: over s/L in [−1, 1], D²/R²
#endif

out vec4 fragment;  // linear premultiplied: 'over', sum or maximum, as BLEND says

#if HALF_LINE
// Of a kernel around the eye: the integral along this pixel's ray, from the eye on, over F(0).
float half_share(vec3 ray) {
    vec3 along = to_index(ray);
    float speed = length(along);
    along /= speed;
    vec3 cross_ = cross(center.xyz, along);
    float d2 = dot(cross_, cross_);
    float chord2 = style.radius * style.radius - d2;
    if (chord2 <= 0.0) return 0.0;
    float start = clamp(dot(center.xyz, along) * inversesqrt(chord2), -1.0, 1.0);
    vec2 place = vec2(start * 0.5 + 0.5, d2 / (style.radius * style.radius));
    vec2 texels = vec2(textureSize(half_table, 0));
    float share = texture(half_table, (place * (texels - 1.0) + 0.5) / texels).r;
#if BLEND == BLEND_MIP
    return radial(d2) * share;
#else
    return radial(d2) * share * length(ray) / speed;
#endif
}
#endif

// What stands still, over F(0)·gain.
float footprint() {
#if SPRITE
    vec2 at = local_place(gl_FragCoord.xy - pixel);
#endif
#if ALIGN == ALIGN_EXACT
#if HALF_LINE
    if (center.w > 0.0) return half_share(ray_at(gl_FragCoord.xy));
#endif
    return exact_share(at, ray_of(gl_FragCoord.xy));
#elif SPRITE
    return radial(dot(at, at));
#elif FOOTPRINT != FOOTPRINT_TABLE
    return radial(dot(at, at) * style.radius * style.radius);
#else
    // quads are a little larger than the table
    return max(abs(at.x), abs(at.y)) <= 1.0 ? texture(footprint_table, at * 0.5 + 0.5).r : 0.0;
#endif
}

void main() {
#if MOTION != MOTION_OFF
    if (move != vec2(0.0)) {
#if CUBIC
        Inner inner = Inner(mat2x3(shrink.x, 0.0, 0.0, 0.0, shrink.x, 0.0), shrink);
#else
        Inner inner = Inner(mat2x3(inner_x, inner_y), shrink);
#endif
        Passing p = passing(heart, at, move, inner);
        float value = splat.a * streak_shape(p);
#if BLEND == BLEND_COMPOSITE && ATTENUATION == ATTENUATION_FILL
        value = dwelt_opacity(value, splat.a * p.gain * closest(p), lone);
#else
        value = blended(value);
#endif
        fragment = vec4(splat.rgb, 1.0) * value;
        return;
    }
#endif
    fragment = vec4(splat.rgb, 1.0) * blended(splat.a * footprint());
}
