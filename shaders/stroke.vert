// Draws an instanced rectangle around a straight stroke with round ends, in window pixels.

in vec2 start;   // pixels, (0, 0) at the upper left corner
in vec2 stop;
in vec4 ink;     // sRGB, straight alpha
in vec2 widths;  // of the stroke, and of the rim around it, pixels

uniform vec2 size;  // the window's, pixels

flat out vec2 from;
flat out vec2 to;
flat out vec4 paint;
flat out vec2 wide;

void main() {
    float reach = 0.5 * widths.x + widths.y + 1.0;
    vec2 along = stop - start;
    float long_ = length(along);
    vec2 unit = long_ > 0.0 ? along / long_ : vec2(1.0, 0.0);
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    vec2 at = start + unit * mix(-reach, long_ + reach, corner.x) + vec2(-unit.y, unit.x) * reach * (2.0 * corner.y - 1.0);
    from = start;
    to = stop;
    paint = ink;
    wide = widths;
    gl_Position = vec4((2.0 * at / size - 1.0) * vec2(1.0, -1.0), 0.0, 1.0);
}
