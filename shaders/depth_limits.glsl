// Limits a pixel's ray to the depths between two meshes.
uniform sampler2D nearest_depth;   // of each sample, in units of depth_unit
uniform sampler2D farthest_depth;
uniform float depth_unit;          // mean spacings
uniform int depth_top;             // row of the picture at which the band begins

// The part of a ray between two ends that is drawn. scale: units of the ends per depth.
vec2 within_depths(vec2 ends, ivec2 pixel, float scale) {
    pixel.y += depth_top;
    vec2 depths = vec2(texelFetch(nearest_depth, pixel, 0).r, texelFetch(farthest_depth, pixel, 0).r);
    depths *= depth_unit * scale;
    return vec2(max(ends.x, depths.x), min(ends.y, depths.y));
}
