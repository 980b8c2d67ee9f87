// Describes tiles of pixels and placed splats, for the passes that list splats by tile and that draw tiles.
// A splat is one texel in each of several textures: bounds: its centre and its ellipse's extent, if visible; heads: its
// centre, optical depth, and half of its colour or half its side; shapes: the triangular root of its quadratic form and
// the rest of its colour, or to_local. If full also matters: its colour, or gradient, and coverage, or place in sheets;
// if bent, further textures of footprint terms. If packed, its gradient and place in sheets are where the colour was.
// switch SHEETS 0  sheets that share a splat; 0: splats composite one by one
// switch PACKED 0  gradients of 17 bits a component
// switch COMPUTE 1  compute shaders list splats; without, bounds hold the half sides of the box around the ellipse
#include "varyings.glsl"
#constant COLUMNS  // pixels of a tile
#constant TILE_ROWS
#constant ABREAST  // splats along a row of the textures
#constant LISTED   // and fours of entries along one of the list
#constant PIXEL_MARGIN
// half side, or height, of a splat that touches no tile, and height of one that touches all
#define UNSEEN -1e9
#define EVERYWHERE 1e9
// marks a kernel around the eye, instead of a half side or a triangle's first number, which are positive
#define AROUND -1.0
// whether a footprint is more than a quadratic form
const bool BENT = ANTIALIAS == 1 && ALIGN == ALIGN_EXACT;
// whether colour and shape take whole texels
const bool FULL = BENT || (SHEETS > 0 && PACKED == 0);

uniform ivec2 origin;   // the first tile's first pixel
uniform ivec2 tiles;    // along x and y

ivec2 texel_of(uint n) {
    return ivec2(int(n % ABREAST), int(n / ABREAST));
}

// The first pixel of an invocation of a tile's group: of rows of COLUMNS invocations, from the tile's first row on.
ivec2 first_pixel(uint tile, uint lane) {
    ivec2 corner = ivec2(tile % uint(tiles.x), tile / uint(tiles.x)) * ivec2(COLUMNS, TILE_ROWS);
    return origin + corner + ivec2(lane % uint(COLUMNS), lane / uint(COLUMNS));
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

// A gradient in a word and the last bytes of three others, which are off by 2⁻¹⁵ of themselves: the power of two above
// its largest component, and the components over it, of 17 bits.
#define LOWEST 104u
uvec4 packed_gradient(vec3 gradient, uvec3 others) {
    vec3 size = abs(gradient);
    uint power = clamp(floatBitsToUint(max(size.x, max(size.y, size.z))) >> 23, LOWEST, LOWEST + 31u);
    ivec3 parts = ivec3(clamp(round(gradient * uintBitsToFloat((269u - power) << 23)), -65535.0, 65535.0));
    uvec3 high = uvec3(parts >> 8) & 0x1ffu;
    uint word = high.x | (high.y << 9) | (high.z << 18) | ((power - LOWEST) << 27);
    return uvec4((others & 0xffffff00u) | (uvec3(parts) & 0xffu), word);
}

vec3 unpacked_gradient(uvec4 words) {
    ivec3 parts = ivec3(uvec3(words.w << 23, words.w << 14, words.w << 5) & 0xff800000u) >> 15;
    return vec3(parts | ivec3(words.xyz & 0xffu)) * uintBitsToFloat(((words.w >> 27) + (LOWEST - 15u)) << 23);
}

// The texel of the list with an entry and the others of its four.
ivec2 listed_at(uint n) {
    return ivec2(int(n / 4u % LISTED), int(n / 4u / LISTED));
}

// D² = (t.x x + t.y y)² + (t.z y)² at pixel offsets (x, y): two squares, so that long ellipses lose no digits.
vec3 triangle_of(vec4 local) {
    float across = max(length(local.xz), 1e-30);
    return vec3(across, dot(local.xz, local.yw) / across, (local.x * local.w - local.y * local.z) / across);
}

// The ellipse of a footprint around its centre, in pixels: x = k y ± width √(1 − (y/height)²).
struct Extent {
    float height;
    float width;
    float k;
};

// Of a form up to radius². Larger by PIXEL_MARGIN in every direction.
Extent extent_of(vec3 t, float radius) {
    float k = -t.y / t.x;
    return Extent(radius / t.z + PIXEL_MARGIN, radius / t.x + PIXEL_MARGIN * (1.0 + abs(k)), k);
}

// In the last two words of bounds. Wider than any picture, it is everywhere in its rows.
vec2 packed_extent(Extent it) {
#if COMPUTE
    const float most = 60000.0;
    vec2 rounded = unpackHalf2x16(packHalf2x16(vec2(0.0, clamp(it.k, -most, most))));
    float width = (it.width + abs(it.k - rounded.y) * it.height) * 1.002;
    uint words = width < most ? packHalf2x16(vec2(width, rounded.y)) : packHalf2x16(vec2(65504.0, 0.0));
    return vec2(it.height, uintBitsToFloat(words));
#else
    return vec2(it.height, length(vec2(it.width, it.k * it.height)));
#endif
}

#if COMPUTE
Extent unpacked_extent(vec2 words) {
    vec2 rest = unpackHalf2x16(floatBitsToUint(words.y));
    return Extent(words.x, rest.x, rest.y);
}
#endif

// First and last of `many` tiles along an axis with a pixel's centre between the ends.
ivec2 reached_by(vec2 ends, float origin_, int side, int many) {
    vec2 tile = (ends - origin_ - vec2(float(side) - 0.5, 0.5)) / float(side);
    // clamped before the conversion, which overflows far away
    return ivec2(clamp(ceil(tile.x), 0.0, float(many)), clamp(floor(tile.y), -1.0, float(many - 1)));
}

// First and last row of tiles that an ellipse touches.
ivec2 rows_of(float center, float height) {
    return reached_by(vec2(center - height, center + height), float(origin.y), TILE_ROWS, tiles.y);
}

// First and last tile that it touches in a row of tiles; none if the first is after the last.
ivec2 span_of(vec2 center, Extent it, int row) {
    float top = float(origin.y + row * TILE_ROWS) + 0.5 - center.y;
    vec2 y = vec2(max(top, -it.height), min(top + float(TILE_ROWS - 1), it.height));
    if (y.x > y.y) return ivec2(1, 0);
    // where x is furthest
    float furthest = it.k * it.height * it.height / max(length(vec2(it.width, it.k * it.height)), 1e-30);
    vec2 at = vec2(clamp(-furthest, y.x, y.y), clamp(furthest, y.x, y.y));
    vec2 share = at / max(it.height, 1e-30);
    vec2 chord = it.width * sqrt(max(1.0 - share * share, 0.0));
    vec2 ends = center.x + it.k * at + vec2(-chord.x, chord.y);
    return reached_by(ends, float(origin.x), COLUMNS, tiles.x);
}
