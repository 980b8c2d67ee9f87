// 1 where all pixels of a tile are closed: next to nothing passes them any more.

uniform sampler2D drawn;
uniform float opaque;     // alpha from which on a pixel is closed
uniform int tile;         // pixels along a tile's edge

out vec4 fragment;

void main() {
    ivec2 first = ivec2(gl_FragCoord.xy) * tile;
    // what is beyond the edge is nobody's
    ivec2 last = textureSize(drawn, 0) - 1;
    float least = 1.0;
    for (int y = 0; y < tile; ++y) {
        for (int x = 0; x < tile; ++x) least = min(least, texelFetch(drawn, min(first + ivec2(x, y), last), 0).a);
    }
    fragment = vec4(least < opaque ? 0.0 : 1.0);
}
