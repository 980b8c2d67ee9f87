// The least of the tiles within `reach` along an axis.

uniform sampler2D tiles;
uniform int reach;
uniform ivec2 axis;

out vec4 fragment;

void main() {
    ivec2 here = ivec2(gl_FragCoord.xy);
    ivec2 last = textureSize(tiles, 0) - 1;
    float least = 1.0;
    for (int n = -reach; n <= reach; ++n) least = min(least, texelFetch(tiles, clamp(here + n * axis, ivec2(0), last), 0).r);
    fragment = vec4(least);
}
