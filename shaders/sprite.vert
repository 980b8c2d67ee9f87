// Draws a rectangle of the window, in pixels, that a texture fills.

uniform vec2 size;   // the window's, pixels
uniform vec4 place;  // left, top, right, bottom, pixels, (0, 0) at the upper left corner

out vec2 share;  // of the texture's width and height

void main() {
    share = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    vec2 at = mix(place.xy, place.zw, share);
    gl_Position = vec4((2.0 * at / size - 1.0) * vec2(1.0, -1.0), 0.0, 1.0);
}
