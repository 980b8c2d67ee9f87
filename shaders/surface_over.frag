// Blends matter and the surface behind it behind nearer light.
uniform sampler2D matter;
uniform sampler2D surface;
out vec4 fragment;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 near = texelFetch(matter, pixel, 0);
    fragment = near + (1.0 - near.a) * texelFetch(surface, pixel, 0);
}
