// Twin of mesh_texture.glsl without a texture.

// Linear RGB of a mesh, and 1. value: of mapped_color.
vec4 mesh_paint(vec2 value, vec3 plain) {
    return vec4(mapped_color(value, plain), 1.0);
}
