// Covers a stroke's pixels by their distance from its middle line, and a dark rim around it.

flat in vec2 from;  // pixels, (0, 0) at the upper left corner
flat in vec2 to;
flat in vec4 paint;
flat in vec2 wide;

uniform vec2 size;  // the window's, pixels

out vec4 fragment;

const float RIM = 0.6;  // opacity of the rim

void main() {
    // the window's rows begin at the bottom
    vec2 at = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y);
    vec2 along = to - from, off = at - from;
    float share = clamp(dot(off, along) / max(dot(along, along), 1e-12), 0.0, 1.0);
    float apart = length(off - share * along) - 0.5 * wide.x;
    float line = clamp(0.5 - apart, 0.0, 1.0), rim = RIM * clamp(0.5 + wide.y - apart, 0.0, 1.0);
    float alpha = line + (1.0 - line) * rim;
    fragment = vec4(paint.rgb * line / max(alpha, 1e-6), alpha * paint.a);
}
