// Closes the pixels through which next to nothing passes any more: only depth is written, and only there.

uniform sampler2D drawn;
uniform float opaque;     // alpha from which on a pixel is closed

void main() {
    if (texelFetch(drawn, ivec2(gl_FragCoord.xy), 0).a < opaque) discard;
}
