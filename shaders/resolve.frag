// Averages samples × samples of the target into pixels, in linear premultiplied light, over the background.
// Euler–Maclaurin: the mean over a pixel is that of its samples and (f_k − f_k₋₁ − f_0 + f_₋₁)/24, the end correction, along
// each axis; samples beyond the edges repeat. All weights are positive. Where the tile of a pixel has one sample a pixel,
// it is the mean of those. Twin of splatgl/reference/blend.py.
// switch SINGLE 0  tiles may have one sample a pixel
#constant COLUMNS  // samples of a tile, along both axes

uniform sampler2D drawn;
uniform sampler2D single; // one sample a pixel
uniform sampler2D errors; // of its means, by tile
uniform float allowed;    // error up to which a tile has one sample a pixel
uniform int samples;      // along each axis
uniform ivec2 last;       // sample
uniform float ends;       // 1/24, or 0: the samples' own mean
uniform vec4 background;  // linear premultiplied; zero: transparent

out vec4 fragment;

// Of sample j, −1 to count, of a pixel with `count`, to which they add up.
float weight(int j, int count) {
    float inside = j >= 0 && j < count ? 1.0 : ends;
    if (j == 0) inside -= ends;
    if (j == count - 1) inside -= ends;
    return inside;
}

bool is_single(ivec2 at) {
    return SINGLE == 1 && texelFetch(errors, at / COLUMNS, 0).r <= allowed;
}

// What is at a sample's place between pixels of one sample.
vec4 between(ivec2 at) {
    vec2 place = (vec2(at) + 0.5) / float(samples) - 0.5;
    ivec2 pixel = ivec2(floor(place)), most = last / samples;
    vec2 share = place - vec2(pixel);
    vec4 above = mix(texelFetch(single, clamp(pixel, ivec2(0), most), 0),
                     texelFetch(single, clamp(pixel + ivec2(1, 0), ivec2(0), most), 0), share.x);
    vec4 below = mix(texelFetch(single, clamp(pixel + ivec2(0, 1), ivec2(0), most), 0),
                     texelFetch(single, clamp(pixel + ivec2(1, 1), ivec2(0), most), 0), share.x);
    return mix(above, below, share.y);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), first = pixel * samples;
    int around = ends > 0.0 ? 1 : 0;
    vec4 sum = vec4(0.0);
    // row by row, to keep float32 sums short
    if (is_single(first)) {
        for (int y = -1; y <= 1; ++y) {
            vec4 row = vec4(0.0);
            for (int x = -1; x <= 1; ++x)
                row += weight(x, 1) * texelFetch(single, clamp(pixel + ivec2(x, y), ivec2(0), last / samples), 0);
            sum += weight(y, 1) * row;
        }
        sum *= float(samples * samples);
    } else {
        for (int y = -around; y < samples + around; ++y) {
            vec4 row = vec4(0.0);
            for (int x = -around; x < samples + around; ++x) {
                ivec2 at = clamp(first + ivec2(x, y), ivec2(0), last);
                row += weight(x, samples) * (is_single(at) ? between(at) : texelFetch(drawn, at, 0));
            }
            sum += weight(y, samples) * row;
        }
    }
    vec4 mean = sum / float(samples * samples);
    fragment = mean + (1.0 - mean.a) * background;
}
