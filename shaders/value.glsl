// What a splat that stands still gives to one pixel: its footprint by a look-up or a polynomial, then the blend mode's value.
// switch FOOTPRINT FOOTPRINT_TABLE
// switch TILED 0
// switch POLYNOMIALS_0 0
// switch POLYNOMIALS_1 0
// switch POLYNOMIALS_2 0
// switch POLYNOMIALS_3 0
// switch POLYNOMIALS_4 0
#include "frame.glsl"
#include "optics.glsl"
#include "exact.glsl"
#include "varyings.glsl"
#define FOOTPRINT_TABLE 0
#define FOOTPRINT_RADIAL 1
#define FOOTPRINT_POLYNOMIAL 2
// see splatgl/splat/kernel.py: eight terms over s = D²/R², seven over 1 − s, where these begin, and 1/R²

#if FOOTPRINT != FOOTPRINT_POLYNOMIAL
// F/F(0) over [−R, R]²; or radial: one texel high, F/F(0) at a squared distance, and the step to the next
uniform sampler2D footprint_table;
#endif

// F/F(0) by the squared distance, in voxels
float radial(float d2) {
#if FOOTPRINT == FOOTPRINT_POLYNOMIAL
    // literal coefficients: a software renderer reads a uniform anew for every use
    const vec4 a = POLYNOMIALS_0, b = POLYNOMIALS_1, c = POLYNOMIALS_2, e = POLYNOMIALS_3;
    // a widened footprint's terms may take the square below 0
    float s = clamp(d2 * POLYNOMIALS_4.x, 0.0, 1.0);
    float u = 1.0 - s;
    float near = a.x + s * (a.y + s * (a.z + s * (a.w + s * (b.x + s * (b.y + s * (b.z + s * b.w))))));
    float far = c.x + u * (c.y + u * (c.z + u * (c.w + u * (e.x + u * (e.y + u * e.z)))));
    return s < e.w ? near : far * (u * u) * sqrt(u);
#elif FOOTPRINT == FOOTPRINT_RADIAL
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

#if SPRITE
// The place in the footprint of a pixel off the splat's centre.
vec2 local_place(vec2 offset) {
    return vec2(dot(to_local.xy, offset), dot(to_local.zw, offset));
}
#endif

// A pixel's ray, and what all splats have of it.
struct Ray {
    float across2;  // |across|² in index axes, of a ray of depth 1
    float length_;
};

vec3 ray_at(vec2 pixel_center) {
    return vec3((pixel_center - frame.image_center) * frame.pixel_pitch, 1.0);
}

Ray ray_of(vec2 pixel_center) {
#if ALIGN == ALIGN_EXACT
    vec3 ray = ray_at(pixel_center);
    vec3 across = to_index(ray);
    return Ray(dot(across, across), length(ray));
#else
    return Ray(1.0, 1.0);
#endif
}

#if ALIGN == ALIGN_EXACT
// The integral along a ray over F(0)·gain; at: its place in the footprint.
float exact_share(vec2 at, Ray ray) {
    float r2 = dot(at, at);
#if SPRITE
    // before z_k a sprite's place is across the pixel's own ray
    float shrink = ray.across2;
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
    value *= ray.length_ / (stretched ? 1.0 : sqrt(ray.across2));
#endif
    return value * radial(d2);
}
#endif

// where tiles are drawn, of a depth times QUICK_SCALE
#if TILED
#define OPACITY_OF quick_one_minus_exp
#else
#define OPACITY_OF one_minus_exp
#endif

// From what a footprint is worth here to opacity, or whatever adds up.
float blended(float value) {
#if BLEND == BLEND_COMPOSITE
#if ATTENUATION == ATTENUATION_OPACITY
    // the paper's: the opacity of the unstretched splat, weakened by (z_k/z_v)² = coverage  [M98 Eq. 6]
    return coverage > 0.0 ? coverage * OPACITY_OF(value / coverage) : 0.0;
#else
    return OPACITY_OF(value);
#endif
#else
    return value;
#endif
}
