// Twin of depth_limits.glsl without meshes: the whole ray is drawn.
vec2 within_depths(vec2 ends, ivec2 pixel, float scale) {
    return ends;
}
