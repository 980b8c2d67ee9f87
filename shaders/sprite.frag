// Shows a texture in sRGB with straight alpha, row 0 on top.

uniform sampler2D shown;

in vec2 share;  // of its width and height

out vec4 fragment;

void main() { fragment = texture(shown, share); }
