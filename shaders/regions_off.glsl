// Twin of regions.glsl for a transfer function of one variable: no regions.
float steepness(vec3 slope, float mass) {
    return 0.0;
}

vec4 mean_matter(vec2 first, vec2 last, float length_) {
    return vec4(0.0);
}
