// The blend modes, as functions that join what lies behind to a pixel, and opacity from optical depth without cancellation.
// Twin of splatgl/reference/blend.py.
// switch JOIN JOIN_OVER                         how values along a ray are joined: the blend mode
// switch PEAK 0                                 a splat's value is a share of its footprint's peak, not an integral
// switch ATTENUATION ATTENUATION_OPTICAL_DEPTH  of splats beyond z_k  [M98 Eq. 6]
// switch DOUBLINGS 5                            of quick_one_minus_exp
#define JOIN_OVER 0
#define JOIN_SUM 1
#define JOIN_MAX 2
#define JOIN_MIN 3
#define JOIN_MEAN 4
#define JOIN_ATTENUATED 5
// nearer matter hides what is behind
#define IN_ORDER (JOIN == JOIN_OVER)
// a pixel of reconstructed values shows one value
#define ONE_VALUE (JOIN == JOIN_MAX || JOIN == JOIN_MIN || JOIN == JOIN_MEAN || JOIN == JOIN_ATTENUATED)
// factor of values that OpenGL blends: it has no minimum of one component and a sum of the other
#define BLENDED_SIGN (JOIN == JOIN_MIN ? -1.0 : 1.0)
#define ATTENUATION_OPTICAL_DEPTH 0
#define ATTENUATION_OPACITY 1
#define ATTENUATION_FILL 2
#constant MOST_DOUBLINGS

// 1 − exp(−x) for x ≥ 0; the series below 1/16 is accurate to float32's last digit
float one_minus_exp(float x) {
    if (x < 0.0625) return x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0))));
    return 1.0 - exp(-x);
}

// The same, faster, to a relative 1e−6, for y = x · QUICK_SCALE: a polynomial for 1 − 2⁻ʸ, y ≤ 1, then DOUBLINGS times
// the opacity of two equal layers, without cancellation. A scene's y is at most 1, or so large that opacity is 1.
#define QUICK_SCALE (1.44269504 / float(1 << DOUBLINGS))
float quick_one_minus_exp(float y) {
    if (DOUBLINGS == MOST_DOUBLINGS) y = min(y, 1.0);
    float h = y * (0.693146916 + y * (-0.240213824 + y * (0.0554043416 + y * (-0.00933759844 + y * 0.00100035493))));
    for (int k = 0; k < DOUBLINGS; k++) h *= 2.0 - h;
    return h;
}

// Light that reaches the eye from behind `light`, through matter: emission and optical depth.
vec4 behind(vec4 light, vec4 matter) {
    if (JOIN == JOIN_SUM) return light + matter;
    float share = matter.a > 1e-30 ? one_minus_exp(matter.a) / matter.a : 1.0;
    return light + (1.0 - light.a) * share * matter;
}

// A pixel's light and the matter of a box, or its opacity, behind it.
vec4 join_matter(vec4 light, vec4 matter) {
    return JOIN == JOIN_MAX ? max(light, matter) : behind(light, matter);
}

// A pixel's light and a splat of that color and value of `blended` behind it.
vec4 join_splat(vec4 light, vec3 color, float value) {
    if (JOIN == JOIN_MAX) return max(light, vec4(color, 1.0) * value);
    if (IN_ORDER) value *= 1.0 - light.a;
    return light + vec4(color, 1.0) * value;
}

// The length of a box along a ray that its value counts with.
float joined_length(float length_) {
    return JOIN == JOIN_MAX ? 1.0 : length_;
}

// A pixel's joined value and its length, and more behind. mean: the value is a sum by length.
vec4 join_value(vec4 light, float value, float length_) {
    if (length_ <= 0.0) return light;
    float both = JOIN == JOIN_MEAN ? light.x + value * length_
                                   : JOIN == JOIN_MIN ? min(light.x, value) : max(light.x, value);
    return vec4(JOIN == JOIN_MEAN || light.y > 0.0 ? both : value, light.y + length_, 0.0, 0.0);
}

// A pixel's attenuated maximum, its length and, as alpha, the optical depth so far, and a part of the ray behind, with
// shares of the window at its ends and in its middle. depth: of the part where shares are 1.
vec4 join_attenuated(vec4 light, vec3 shares, float length_, float depth) {
    if (length_ <= 0.0) return light;
    // integrals, to the middle and to the end, of the parabola through the shares
    float whole = dot(shares, vec3(1.0, 4.0, 1.0)) / 6.0;
    float half_ = clamp(dot(shares, vec3(5.0, 8.0, -1.0)) / 24.0, 0.0, whole);
    vec3 seen = shares * exp(-light.a - depth * vec3(0.0, half_, whole));
    return vec4(max(max(light.x, seen.x), max(seen.y, seen.z)), light.y + length_, 0.0, light.a + depth * whole);
}

// The value of a pixel whose values are all joined.
float joined_value(vec4 light) {
    return JOIN == JOIN_MEAN ? light.x / max(light.y, 1e-30) : light.x;
}
