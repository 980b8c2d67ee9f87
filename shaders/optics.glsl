// What splats add up to, and from optical depth to opacity without cancellation.
// switch BLEND BLEND_COMPOSITE
// switch ATTENUATION ATTENUATION_OPTICAL_DEPTH
// switch HALVINGS 5
#define BLEND_COMPOSITE 0
#define BLEND_XRAY 1
#define BLEND_MIP 2
#define ATTENUATION_OPTICAL_DEPTH 0
#define ATTENUATION_OPACITY 1
#define ATTENUATION_FILL 2

// 1 − exp(−x) for x ≥ 0; the series below 1/16 is good to float32's last digit
float one_minus_exp(float x) {
    if (x < 0.0625) return x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0))));
    return 1.0 - exp(-x);
}

// The same to 1e−6 of itself and quicker, for y = x · QUICK_SCALE: a polynomial for 1 − 2⁻ʸ, y ≤ 1, and HALVINGS times
// what two halves hide together, which cancels nothing. A scene's y is no larger, or so large that all is hidden.
#define QUICK_SCALE (1.44269504 / float(1 << HALVINGS))
float quick_one_minus_exp(float y) {
#if HALVINGS == 5
    y = min(y, 1.0);
#endif
    float h = y * (0.693146916 + y * (-0.240213824 + y * (0.0554043416 + y * (-0.00933759844 + y * 0.00100035493))));
#if HALVINGS > 0
    h *= 2.0 - h;
#endif
#if HALVINGS > 1
    h *= 2.0 - h;
#endif
#if HALVINGS > 2
    h *= 2.0 - h;
#endif
#if HALVINGS > 3
    h *= 2.0 - h;
#endif
#if HALVINGS > 4
    h *= 2.0 - h;
#endif
    return h;
}
