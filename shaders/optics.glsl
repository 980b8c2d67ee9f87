// Blend modes, and opacity from optical depth without cancellation.
// switch JOIN JOIN_OVER
// switch PEAK 0
// switch ATTENUATION ATTENUATION_OPTICAL_DEPTH
// switch DOUBLINGS 5
#define JOIN_OVER 0
#define JOIN_SUM 1
#define JOIN_MAX 2
#define JOIN_MIN 3
#define JOIN_MEAN 4
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

// Light that reaches the eye from behind `light`, through matter.
vec4 behind(vec4 light, vec4 matter) {
    if (JOIN == JOIN_SUM) return light + matter;
    float share = matter.a > 1e-30 ? one_minus_exp(matter.a) / matter.a : 1.0;
    return light + (1.0 - light.a) * share * matter;
}
