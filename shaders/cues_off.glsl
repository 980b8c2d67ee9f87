// Twin of cues.glsl without ambient occlusion and shadows: all light reaches every place.
#define CUED 0
vec3 cell_at(vec3 offset) {
    return vec3(0.0);
}

vec2 reached(vec3 cell, vec3 normal, vec3 toward) {
    return vec2(1.0);
}
