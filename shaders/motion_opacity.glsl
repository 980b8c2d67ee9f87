// Computes the opacity of a splat that covers a pixel for a part of the exposure. Twin of splatgl/splat/motion_blur.py.
#include "optics.glsl"
// dense splats hide for longer than the share p of the exposure: 1 − (1 − p)^κ, κ = 1 + DENSE x/(1 + DENSEST x)
#constant DENSE
#constant DENSEST
#constant LEAST

// 1 for a lone splat, 0 for a splat whose matter continues along its path. size: of the path; through: run of matter.
float isolation(float size, float through) {
    float follows = max(through - 1.0, 0.0) / (size + 1.0);
    return 1.0 / (1.0 + follows * follows);
}

// mean, most: mean and maximum of its depth at the pixel; isolation: of the splat.
float dwelt_opacity(float mean, float most, float isolation) {
    float part = most > 0.0 ? max(mean / most, LEAST) : 1.0;
    if (part >= 1.0) return one_minus_exp(mean);
    float dense = 1.0 + DENSE * most / (1.0 + DENSEST * most);
    float rare = part < 0.01 ? part * (1.0 + part * (0.5 + part / 3.0)) : -log(1.0 - part);
    return pow(one_minus_exp(dense * rare), isolation) * one_minus_exp(mean * pow(part, -isolation));
}
