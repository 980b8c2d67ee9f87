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
#define LOG2_E 1.44269504

// 1 − 2⁻ˣ, 0 ≤ x ≤ 1, to 4e−7 of itself
float hidden_part(float x) {
    return x * (0.693146916 + x * (-0.240213824 + x * (0.0554043416 + x * (-0.00933759844 + x * 0.00100035493))));
}

// 1 − exp(−x) for x ≥ 0, to 1e−6 of itself: what two halves of a depth hide, four, …, cancels nothing; the steps are
// cheaper than exp and a series for what is thin
float one_minus_exp(float x) {
    float h = hidden_part(min(x * (LOG2_E / 32.0), 1.0));
    h *= 2.0 - h;
    h *= 2.0 - h;
    h *= 2.0 - h;
    h *= 2.0 - h;
    return h * (2.0 - h);
}

// The same for a splat's depth, which is none of the scene's larger than 2^HALVINGS ln 2.
float opacity_of(float x) {
    float h = hidden_part(min(x * (LOG2_E / float(1 << HALVINGS)), 1.0));
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
