// Evaluates a still splat at one pixel: its footprint by a table or a polynomial, then the blend mode's value.
// switch FOOTPRINT FOOTPRINT_TABLE  source of a footprint's values
// switch TILED 0                    drawn by tile_draw.comp: depths are scaled by QUICK_SCALE
// switch POLYNOMIALS_0 0            coefficients of a polynomial footprint, vec4s
// switch POLYNOMIALS_1 0
// switch POLYNOMIALS_2 0
// switch POLYNOMIALS_3 0
// switch POLYNOMIALS_4 0
#include "approximations.glsl"
#include "varyings.glsl"
#define FOOTPRINT_TABLE 0
#define FOOTPRINT_RADIAL 1
#define FOOTPRINT_POLYNOMIAL 2
#define FOOTPRINT_SINGLE 3
// of the box of a voxel, see boxes.glsl
#define FOOTPRINT_BOX 4
// see splatgl/splat/kernels.py: eight terms over s = D²/R², seven over 1 − s, where these begin, and 1/R²

// F/F(0) over [−R, R]²; or radial: one texel high, F/F(0) at a squared distance, and the step to the next
uniform sampler2D footprint_table;
uniform sampler2D half_table;  // share of a chord's integral from the eye on: over s/L in [−1, 1], D²/R²

// A linearly filtered texel. Graphics cards weight texels in steps of 1/256: there it is computed in float32.
float filtered(sampler2D table, vec2 place) {
    if (CARD == 0) return texture(table, place).r;
    ivec2 last = textureSize(table, 0) - 1;
    vec2 texel = clamp(place * vec2(last + 1) - 0.5, vec2(0.0), vec2(last)), part = fract(texel);
    ivec2 low = ivec2(texel), high = min(low + 1, last);
    vec2 upper = vec2(texelFetch(table, low, 0).r, texelFetch(table, ivec2(high.x, low.y), 0).r);
    vec2 lower = vec2(texelFetch(table, ivec2(low.x, high.y), 0).r, texelFetch(table, high, 0).r);
    vec2 both = mix(upper, lower, part.y);
    return mix(both.x, both.y, part.x);
}

// F/F(0) by the squared distance, in voxels
float radial(float d2) {
    if (FOOTPRINT == FOOTPRINT_SINGLE) {
        const vec4 a = vec4(POLYNOMIALS_0), b = vec4(POLYNOMIALS_1), c = vec4(POLYNOMIALS_2);
        float s = clamp(d2 * c.y, 0.0, 1.0), u = 1.0 - s, near = max(c.x - s, 0.0);
        float whole = a.x + s * (a.y + s * (a.z + s * (a.w + s * (b.x + s * b.y))));
        return u * u * u * whole + near * near * near * (b.z + s * b.w);
    }
    if (FOOTPRINT == FOOTPRINT_POLYNOMIAL) {
        // literal coefficients: a software renderer reloads a uniform on every use
        const vec4 a = vec4(POLYNOMIALS_0), b = vec4(POLYNOMIALS_1), c = vec4(POLYNOMIALS_2), e = vec4(POLYNOMIALS_3);
        const vec4 scale = vec4(POLYNOMIALS_4);
        // a widened footprint's terms may make the square negative
        float s = clamp(d2 * scale.x, 0.0, 1.0);
        float u = 1.0 - s;
        float near = a.x + s * (a.y + s * (a.z + s * (a.w + s * (b.x + s * (b.y + s * (b.z + s * b.w))))));
        float far = c.x + u * (c.y + u * (c.z + u * (c.w + u * (e.x + u * (e.y + u * e.z)))));
        return s < e.w ? near : far * (u * u) * sqrt(u);
    }
    if (FOOTPRINT == FOOTPRINT_RADIAL) {
        // one unfiltered fetch of value and step: faster than any filtered lookup
        float place = clamp(d2 * style.radial_scale, 0.0, style.radial_last);
        int texel = int(place);
        vec2 line = texelFetch(footprint_table, ivec2(texel, 0), 0).rg;
        return line.x + line.y * (place - float(texel));
    }
    // along the table's middle row, which holds every distance
    float share = sqrt(max(d2, 0.0)) / style.radius;
    return share < 1.0 ? filtered(footprint_table, vec2(share * 0.5 + 0.5, 0.5)) : 0.0;
}

// A pixel's ray: the terms shared by all splats.
struct Ray {
    float length_;  // of a ray of depth 1
    float shrink;   // 1/|across|², across the ray in index axes
    float gain;     // the integral over F, for a kernel that is not widened
};

vec3 ray_at(vec2 pixel_center) {
    return vec3((pixel_center - frame.image_center) * frame.pixel_pitch, 1.0);
}

Ray ray_of(vec2 pixel_center) {
    if (ALIGN != ALIGN_EXACT) return Ray(1.0, 1.0, 1.0);
    vec3 ray = ray_at(pixel_center), across = to_index(ray);
    float across2 = dot(across, across), length_ = length(ray);
    return Ray(length_, 1.0 / across2, CUBIC == 0 && PEAK == 0 ? length_ * inversesqrt(across2) : 1.0);
}

// The integral along a ray over F(0)·gain. at: its position in the footprint; shrink: D² over |at|², if not widened.
float exact_share(vec2 at, float shrink, Ray ray) {
    float d2 = dot(at, at), value = 1.0;
    bool widened = ANTIALIAS == 1 && bend.x < 0.0;
    // far beyond the rim of a widened footprint its terms are invalid
    const float ends = 1.0 + FIRST_ORDER;
    if (widened && d2 > ends * ends * style.radius * style.radius) return 0.0;
    if (ANTIALIAS == 1 && CUBIC == 1) {
        value += at.x * (bend.z + bend.w * at.x) + max(-bend.x, 0.0) * at.y * at.y;
        d2 += bend.y * at.x * at.x * at.x;
    } else if (ANTIALIAS == 1) {
        float t = dot(cubic.zw, at);
        d2 += dot(cubic.xy, at) * t * t + dot(mixed.xy, at) * dot(mixed.zw, at) * t;
        if (widened) value += dot(bend.zw, at);
    }
    if (CUBIC == 0 && PEAK == 0) value *= widened ? ray.length_ : ray.gain;
    return value * radial(widened ? d2 : d2 * shrink);
}

// For a kernel around the eye, at i from it in index axes: the integral along the pixel's ray from the eye, over F(0).
float half_line(vec3 i, vec3 ray) {
    vec3 along = to_index(ray);
    float speed = length(along);
    along /= speed;
    vec3 cross_ = cross(i, along);
    float d2 = dot(cross_, cross_);
    float chord2 = style.radius * style.radius - d2;
    if (chord2 <= 0.0) return 0.0;
    float start = clamp(dot(i, along) * inversesqrt(chord2), -1.0, 1.0);
    vec2 place = vec2(start * 0.5 + 0.5, d2 / (style.radius * style.radius));
    vec2 texels = vec2(textureSize(half_table, 0));
    float share = filtered(half_table, (place * (texels - 1.0) + 0.5) / texels);
    return radial(d2) * share * (PEAK == 1 ? 1.0 : length(ray) / speed);
}

// From a footprint's optical depth here to opacity, or to the sum's term; for tiles, depth is scaled by QUICK_SCALE.
float hidden_by(float value) {
    return TILED == 1 ? quick_one_minus_exp(value) : one_minus_exp(value);
}

float blended(float value) {
    if (!IN_ORDER) return value;
    if (ATTENUATION != ATTENUATION_OPACITY) return hidden_by(value);
    // the paper's: the opacity of the unstretched splat, weakened by (z_k/z_v)² = coverage  [M98 Eq. 6]
    return coverage > 0.0 ? coverage * hidden_by(value / coverage) : 0.0;
}
