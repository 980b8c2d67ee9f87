// Places the triangles of meshes: mean spacings from the eye, eye axes.
// switch PERSPECTIVE 1  0: a parallel view
#include "frame.glsl"
uniform vec2 depths;  // nearest and farthest of all triangles

in vec3 in_place;
in vec3 in_normal;
in vec4 in_color;     // linear RGB, and opacity
out vec3 place;
out vec3 normal;
out vec4 color;
in vec2 in_value;     // place of the value in a colour map, and the map's row; below 0: none
out vec2 value;

void main() {
    place = in_place;
    normal = in_normal;
    color = in_color;
    value = in_value;
    vec2 at = place.xy * frame.clip_scale;
    // clips what is nearer than the nearest depth
    if (PERSPECTIVE == 1) gl_Position = vec4(at, place.z - 2.0 * depths.x, place.z);
    else gl_Position = vec4(at, (2.0 * place.z - (depths.y + depths.x)) / (depths.y - depths.x), 1.0);
}
