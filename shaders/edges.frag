// How much a pixel's mean of one sample may be wrong: of each tile of samples the largest second difference of the pixels
// in it and around it, over 24, the weight of the end correction. Twin of splatgl/reference/blend.py.
#constant COLUMNS  // samples of a tile

uniform sampler2D single;  // one sample a pixel
uniform int samples;       // along each axis of a pixel
uniform ivec4 inner;       // first and last of the pixels that are drawn

out vec4 fragment;         // the error, and whether the tile holds anything

void main() {
    int side = COLUMNS / samples;
    ivec2 corner = ivec2(gl_FragCoord.xy) * side;
    vec4 largest = vec4(0.0), most = vec4(0.0);
    for (int y = 0; y < side; ++y)
        for (int x = 0; x < side; ++x) {
            ivec2 at = clamp(corner + ivec2(x, y), inner.xy, inner.zw);
            vec4 here = texelFetch(single, at, 0);
            for (int axis = 0; axis < 2; ++axis) {
                ivec2 beside = axis == 0 ? ivec2(1, 0) : ivec2(0, 1);
                vec4 around = texelFetch(single, clamp(at - beside, inner.xy, inner.zw), 0)
                              + texelFetch(single, clamp(at + beside, inner.xy, inner.zw), 0);
                largest = max(largest, abs(around - 2.0 * here));
            }
            most = max(most, here);
        }
    float error = max(max(largest.r, largest.g), max(largest.b, largest.a)) / 24.0;
    fragment = vec4(error, float(any(greaterThan(most, vec4(0.0)))), 0.0, 0.0);
}
