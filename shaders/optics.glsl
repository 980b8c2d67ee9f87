// What splats add up to, and from optical depth to opacity without cancellation.
// switch BLEND BLEND_COMPOSITE
// switch ATTENUATION ATTENUATION_OPTICAL_DEPTH
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
