// Which sprites nothing can be seen of: what they may touch was closed by those nearer.
// switch HIDING 0

#if HIDING
uniform float hidden_tile;  // pixels along a tile's edge
uniform sampler2D hidden;   // a texel a tile: 1 where all around, as far as the largest sprite reaches, is closed

bool is_hidden(vec2 center) {
    // a centre beyond the edge touches no more than the edge's own tile does
    ivec2 tile = clamp(ivec2(floor(center / hidden_tile)), ivec2(0), textureSize(hidden, 0) - 1);
    return texelFetch(hidden, tile, 0).r > 0.5;
}
#endif
