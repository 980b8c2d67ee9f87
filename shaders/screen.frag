// Composites a linear premultiplied picture over the window's ground, encodes sRGB, and composites the overlay.

// switch COMPARE COMPARE_NONE  comparison mode
#define COMPARE_NONE 0
#define COMPARE_SPLIT 1       // `other` right of the middle
#define COMPARE_DIFFERENCE 2  // |picture − other| × gain
// switch OVERLAY 1             an overlay is drawn; every texture read takes time in software

uniform sampler2D picture;   // linear premultiplied, row 0 on top
uniform sampler2D other;     // the picture to compare with, likewise
uniform sampler2D overlay;   // sRGB, straight alpha, row 0 on top
uniform vec2 size;           // the window's, pixels
uniform float scale;         // 1 / brightest of an X-ray, else 1
uniform float gain;
uniform int ground;          // 0 black, 1 white, 2 checks
uniform vec4 background;     // linear RGB; alpha 1 if the picture has a background, which replaces the ground

out vec4 fragment;

const float CHECK = 16.0;            // pixels
const vec2 GREYS = vec2(0.05, 0.1);  // of the checks, linear light

// IEC 61966-2-1, its power by three roots: error within 0.01 of a level of 255
vec3 srgb_from_linear(vec3 linear) {
    vec3 c = clamp(linear, 0.0, 1.0);
    vec3 second = sqrt(c), fourth = sqrt(second), eighth = sqrt(fourth);
    vec3 curved = 0.653986 * second + 0.688713 * fourth - 0.318475 * eighth - 0.020188 * c - 0.004067;
    return mix(c * 12.92, curved, step(0.0031308, c));
}

vec3 below(vec2 at) {
    if (background.a > 0.0) return background.rgb;
    vec2 cell = floor(at / CHECK);
    return vec3(ground == 2 ? GREYS[int(mod(cell.x + cell.y, 2.0))] : float(ground));
}

void main() {
    // the window's rows begin at the bottom
    vec2 at = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y);
    vec2 place = at / size;
    vec4 drawn = texture(picture, place) * scale;
#if COMPARE == COMPARE_SPLIT
    if (place.x > 0.5) drawn = texture(other, place) * scale;
#endif
    vec3 light = drawn.rgb + (1.0 - min(drawn.a, 1.0)) * below(at);
#if COMPARE == COMPARE_SPLIT
    if (abs(at.x - 0.5 * size.x) < 1.0) light = vec3(1.0);
#elif COMPARE == COMPARE_DIFFERENCE
    light = abs(drawn.rgb - texture(other, place).rgb * scale) * gain;
#endif
    fragment = vec4(srgb_from_linear(light), 1.0);
#if OVERLAY
    vec4 text = texture(overlay, place);
    fragment.rgb = mix(fragment.rgb, text.rgb, text.a);
#endif
}
