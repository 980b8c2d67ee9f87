// Stores the matter of layers in slots, without buffers that shaders write: each piece has a slot, which is a part of a
// texture as large as a band of the picture. A piece holds its begin, in sheets from the first; red and green; its optical
// depth; blue and its length.
#define LONGEST_PIECE 2.0
#define LEAST_DEPTH 1e-8
// share of a direction's length up to which a component counts as positive, so that rounding does not decide
#define UPRIGHT 1e-6

uint packed_pair(vec2 pair) {
    uvec2 rounded = uvec2(clamp(pair, 0.0, 1.0) * 65535.0 + 0.5);
    return rounded.x | (rounded.y << 16);
}

vec2 unpacked_pair(uint word) {
    return vec2(word & 0xffffu, word >> 16) / 65535.0;
}

uvec4 packed_piece(vec2 ends, vec4 matter, float brightest) {
    vec3 color = matter.rgb / (matter.a * brightest);
    uint last = packed_pair(vec2(color.b, (ends.y - ends.x) / LONGEST_PIECE));
    return uvec4(floatBitsToUint(ends.x), packed_pair(color.rg), floatBitsToUint(matter.a), last);
}

vec4 matter_of_piece(uvec4 words, float brightest) {
    vec3 color = vec3(unpacked_pair(words.y), unpacked_pair(words.w).x);
    return vec4(color * brightest, 1.0) * uintBitsToFloat(words.z);
}

vec2 ends_of_piece(uvec4 words) {
    float begin = uintBitsToFloat(words.x);
    return vec2(begin, begin + unpacked_pair(words.w).y * LONGEST_PIECE);
}

// Signs of a ray's direction, index axes. Along the ray, the sum of signs times voxel numbers grows by one a voxel.
vec3 signs_of(vec3 direction) {
    return mix(vec3(1.0), vec3(-1.0), lessThan(direction, vec3(-UPRIGHT * length(direction))));
}
