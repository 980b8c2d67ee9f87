// Clears a target of surfaces: no light, at the depth of the surface behind.
uniform sampler2D farthest_depth;
layout(location = 0) out vec4 light;
layout(location = 1) out vec4 depth;

void main() {
    light = vec4(0.0);
    depth = texelFetch(farthest_depth, ivec2(gl_FragCoord.xy), 0);
}
