// Averages samples × samples of the target, in linear premultiplied light, and composites over the background.

uniform sampler2D drawn;
uniform int samples;      // along each axis
uniform vec4 background;  // linear premultiplied; zero: transparent

out vec4 fragment;

void main() {
    ivec2 first = ivec2(gl_FragCoord.xy) * samples;
    vec4 sum = vec4(0.0);
    // row by row, to keep float32 sums short
    for (int y = 0; y < samples; ++y) {
        vec4 row = vec4(0.0);
        for (int x = 0; x < samples; ++x) row += texelFetch(drawn, first + ivec2(x, y), 0);
        sum += row;
    }
    vec4 mean = sum / float(samples * samples);
    fragment = mean + (1.0 - mean.a) * background;
}
