// Depths between which matter is drawn, of each sample: the parts of a picture between meshes.
// switch LIMITED 0
#if LIMITED == 1
uniform sampler2D nearest_depth;
uniform sampler2D farthest_depth;
uniform float depth_unit;  // of both, in lengths of the frame

// The part of a pixel's ray between two ends that is drawn, in `scale` per depth.
vec2 within_depths(vec2 ends, ivec2 pixel, float scale) {
    vec2 depths = vec2(texelFetch(nearest_depth, pixel, 0).r, texelFetch(farthest_depth, pixel, 0).r);
    depths *= depth_unit * scale;
    return vec2(max(ends.x, depths.x), min(ends.y, depths.y));
}
#endif
