// Averages samples × samples of the target into pixels, in linear premultiplied light, over the background.
// Euler–Maclaurin: the mean over a pixel is that of its samples and (f_k − f_k₋₁ − f_0 + f_₋₁)/24, the end correction, along
// each axis; samples beyond the edges repeat. All weights are positive. Twin of splatgl/reference/blend.py.

uniform sampler2D drawn;
uniform int samples;      // along each axis
uniform ivec2 last;       // sample
uniform float ends;       // 1/24, or 0: the samples' own mean
uniform vec4 background;  // linear premultiplied; zero: transparent

out vec4 fragment;

// Of sample j, −1 to samples; they add up to `samples`.
float weight(int j) {
    float inside = j >= 0 && j < samples ? 1.0 : ends;
    if (j == 0) inside -= ends;
    if (j == samples - 1) inside -= ends;
    return inside;
}

void main() {
    ivec2 first = ivec2(gl_FragCoord.xy) * samples;
    int around = ends > 0.0 ? 1 : 0;
    vec4 sum = vec4(0.0);
    // row by row, to keep float32 sums short
    for (int y = -around; y < samples + around; ++y) {
        vec4 row = vec4(0.0);
        for (int x = -around; x < samples + around; ++x)
            row += weight(x) * texelFetch(drawn, clamp(first + ivec2(x, y), ivec2(0), last), 0);
        sum += weight(y) * row;
    }
    vec4 mean = sum / float(samples * samples);
    fragment = mean + (1.0 - mean.a) * background;
}
