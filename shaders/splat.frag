// One splat's contribution to one pixel: its footprint by one look-up, then the blend mode's value.
// switch FOOTPRINT FOOTPRINT_TABLE
#include "frame.glsl"
#include "optics.glsl"
#include "exact.glsl"
#define VARYING in
#include "varyings.glsl"
#define FOOTPRINT_TABLE 0
#define FOOTPRINT_RADIAL 1

// F/F(0) over [−R, R]²; or radial: one texel high, F/F(0) at a squared distance, and the step to the next
uniform sampler2D footprint_table;
#if HALF_LINE
uniform sampler2D half_table;       // share of a chord's integral from the eye on: over s/L in [−1, 1], D²/R²
#endif

out vec4 fragment;  // linear premultiplied: 'over', sum or maximum, as BLEND says

// F/F(0) by the squared distance, in voxels
float radial(float d2) {
#if FOOTPRINT == FOOTPRINT_RADIAL
    // two numbers in one look-up without a filter: faster than any filtered one
    float place = clamp(d2 * style.radial_scale, 0.0, style.radial_last);
    int texel = int(place);
    vec2 line = texelFetch(footprint_table, ivec2(texel, 0), 0).rg;
    return line.x + line.y * (place - float(texel));
#else
    // along the table's middle row, which holds every distance
    float share = sqrt(max(d2, 0.0)) / style.radius;
    return share < 1.0 ? texture(footprint_table, vec2(share * 0.5 + 0.5, 0.5)).r : 0.0;
#endif
}

#include "streak.glsl"

#if SPRITE
vec2 local_place() {
    vec2 offset = gl_FragCoord.xy - pixel;
    return vec2(dot(to_local.xy, offset), dot(to_local.zw, offset));
}
#endif

#if ALIGN == ALIGN_EXACT
// The integral along this pixel's ray over F(0)·gain.
float exact_footprint() {
    vec3 ray = vec3((gl_FragCoord.xy - frame.image_center) * frame.pixel_pitch, 1.0);
#if SPRITE
    vec2 at = local_place();
#endif
#if HALF_LINE
    if (center.w > 0.0) {
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
#endif
        return radial(d2) * share * length(ray) / speed;
    }
#endif
    float r2 = dot(at, at);
#if SPRITE
    // before z_k a sprite's place is across the pixel's own ray
    vec3 across = to_index(ray);
    float shrink = dot(across, across);
#if ANTIALIAS
    if (bend.x < 0.0) shrink = 1.0;
#endif
#else
    float shrink = 1.0 + r2 * max(bend.x, 0.0);
#endif
#if ANTIALIAS && CUBIC
    float d2 = (r2 + bend.y * at.x * at.x * at.x) / shrink;
    float value = 1.0 + at.x * (bend.z + bend.w * at.x) + max(-bend.x, 0.0) * at.y * at.y;
#elif ANTIALIAS
    bool stretched = bend.x < 0.0;
    float t = dot(cubic.zw, at);
    float d2 = (r2 + dot(cubic.xy, at) * t * t + dot(mixed.xy, at) * dot(mixed.zw, at) * t) / shrink;
    float value = stretched ? 1.0 + dot(bend.zw, at) : 1.0;
#else
    const bool stretched = false;
    float d2 = r2 / shrink;
    float value = 1.0;
#endif
#if !CUBIC && BLEND != BLEND_MIP
    value *= length(ray) / (stretched ? 1.0 : length(to_index(ray)));
#endif
    return value * radial(d2);
}
#endif

// What stands still, over F(0)·gain.
float footprint() {
#if ALIGN == ALIGN_EXACT
    return exact_footprint();
#elif SPRITE
    vec2 place = local_place();
    return radial(dot(place, place));
#elif FOOTPRINT == FOOTPRINT_RADIAL
    return radial(dot(at, at) * style.radius * style.radius);
#else
    return texture(footprint_table, at * 0.5 + 0.5).r;
#endif
}

void main() {
#if MOTION != MOTION_OFF
    bool moves = move != vec2(0.0);
    float shape, most = 0.0;
    if (moves) {
#if CUBIC
        Inner inner = Inner(mat2x3(shrink.x, 0.0, 0.0, 0.0, shrink.x, 0.0), shrink);
#else
        Inner inner = Inner(mat2x3(inner_x, inner_y), shrink);
#endif
        Passing p = passing(heart, at, move, inner);
        shape = streak_shape(p);
#if BLEND == BLEND_COMPOSITE && ATTENUATION == ATTENUATION_FILL
        most = splat.a * p.gain * closest(p);
#endif
    } else {
        shape = footprint();
    }
#else
    float shape = footprint();
#endif
    float value = splat.a * shape;
#if BLEND == BLEND_COMPOSITE
#if ATTENUATION == ATTENUATION_OPACITY
    // the paper's: the opacity of the unstretched splat, weakened by (z_k/z_v)² = coverage  [M98 Eq. 6]
    value = coverage > 0.0 ? coverage * one_minus_exp(value / coverage) : 0.0;
#elif MOTION != MOTION_OFF && ATTENUATION == ATTENUATION_FILL
    value = moves ? dwelt_opacity(value, most, lone) : one_minus_exp(value);
#else
    value = one_minus_exp(value);
#endif
#endif
    fragment = vec4(splat.rgb, 1.0) * value;
}
