// Tiles of pixels and placed splats, shared by the passes that list splats by tile and draw the tiles.
// A splat is one texel in each of several textures: bounds: its centre, half its square's side and the radius of its
// bounding circle, if visible; heads: its centre, optical depth, and half of its colour or half its side; shapes: the
// triangular root of its quadratic form and the rest of its colour, or to_local. If full also matters: its colour, or
// gradient, and coverage, or place in sheets; if bent, further textures of footprint terms.
// switch SHEETS 0
// version 430
#include "varyings.glsl"
#constant COLUMNS  // pixels of a tile
#constant ROWS
#constant ABREAST  // splats along a row of the textures
#constant LISTED   // and along one of the list
// half side of a splat that touches no tile
#define UNSEEN -1e9
#define EVERYWHERE 1e9
// marks a kernel around the eye, instead of a half side or a triangle's first number, which are positive
#define AROUND -1.0
// whether a footprint is more than a quadratic form
const bool BENT = ANTIALIAS == 1 && ALIGN == ALIGN_EXACT;
// whether colour and shape take whole texels
const bool FULL = BENT || SHEETS > 0;

uniform ivec2 origin;   // the first tile's first pixel
uniform ivec2 tiles;    // along x and y

ivec2 texel_of(uint n) {
    return ivec2(int(n % ABREAST), int(n / ABREAST));
}

// A colour from 0 to 1 in two words: 21 bits a channel, of which green's are in both.
#define COLOR_STEPS 2097151.0
uvec2 packed_color(vec3 color) {
    uvec3 c = uvec3(clamp(color, 0.0, 1.0) * COLOR_STEPS + 0.5);
    return uvec2(c.r | (c.g << 21), c.b | ((c.g >> 11) << 21));
}

vec3 unpacked_color(uvec2 words) {
    uvec2 low = words & 0x1fffffu;
    return vec3(low.x, (words.x >> 21) | ((words.y >> 21) << 11), low.y) / COLOR_STEPS;
}

// Four entries of the list form a square of texels, for one textureGather.
ivec2 listed_at(uint n) {
    uint four = n / 4u;
    return ivec2(int(four % LISTED) * 2 + int(n & 1u), int(four / LISTED) * 2 + int((n >> 1) & 1u));
}

// D² = (t.x x + t.y y)² + (t.z y)² at pixel offsets (x, y): two squares, so that long ellipses lose no digits.
vec3 triangle_of(vec4 local) {
    float across = max(length(local.xz), 1e-30);
    return vec3(across, dot(local.xz, local.yw) / across, (local.x * local.w - local.y * local.z) / across);
}

// First and last tile, x and y, that a square around a centre touches.
ivec4 tiles_around(vec2 center, float half_side) {
    vec2 side = vec2(COLUMNS, ROWS);
    vec2 low = floor((center - half_side - vec2(origin)) / side);
    vec2 high = floor((center + half_side - vec2(origin)) / side);
    // clamped before the conversion, which overflows far away
    vec2 last = vec2(tiles) - 1.0;
    return ivec4(clamp(low, vec2(0.0), last + 1.0), clamp(high, vec2(-1.0), last));
}

// Radius of the circle around that ellipse in the square: half_side · its long half axis / the larger of its extents.
float circle_around(vec3 t, float half_side) {
    float width = t.x * t.x, height = t.y * t.y + t.z * t.z;
    float mean = 0.5 * (width + height), off = 0.5 * (width - height);
    float longest = mean + sqrt(off * off + width * t.y * t.y);
    return half_side * sqrt(longest / max(max(width, height), 1e-30));
}

// Whether the circle reaches the box of the tile's pixel centres.
bool touches(ivec2 tile, vec2 center, float radius) {
    vec2 low = vec2(origin + tile * ivec2(COLUMNS, ROWS)) + 0.5;
    vec2 off = center - clamp(center, low, low + vec2(COLUMNS - 1, ROWS - 1));
    return dot(off, off) <= radius * radius;
}
