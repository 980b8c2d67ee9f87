// Stores the matter of layers in slots, without buffers that shaders write: each piece has a slot, which is a part of a
// texture as large as a band of the picture.
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

#include "layer_piece.glsl"

// Signs of a ray's direction, index axes. Along the ray, the sum of signs times voxel numbers grows by one a voxel.
vec3 signs_of(vec3 direction) {
    return mix(vec3(1.0), vec3(-1.0), lessThan(direction, vec3(-UPRIGHT * length(direction))));
}
