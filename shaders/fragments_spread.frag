// Writes what the fragments of sheet_draw.frag have drawn to the pixels of a window.
// switch ROWS 8    pixels of a fragment, in a column
#constant COLUMNS
#constant TILE_ROWS
#include "tile_fragments.glsl"
uniform ivec2 origin;  // the window's first pixel
uniform sampler2D row0;
#if ROWS > 1
uniform sampler2D row1, row2, row3, row4, row5, row6, row7;
#endif
out vec4 pixel;

void main() {
    ivec2 place = ivec2(gl_FragCoord.xy) - origin, at = fragment_of(place);
    int row = place.y % TILE_ROWS;
#if ROWS > 1
    if (row == 1) pixel = texelFetch(row1, at, 0);
    else if (row == 2) pixel = texelFetch(row2, at, 0);
    else if (row == 3) pixel = texelFetch(row3, at, 0);
    else if (row == 4) pixel = texelFetch(row4, at, 0);
    else if (row == 5) pixel = texelFetch(row5, at, 0);
    else if (row == 6) pixel = texelFetch(row6, at, 0);
    else if (row == 7) pixel = texelFetch(row7, at, 0);
    else
#endif
    pixel = texelFetch(row0, at, 0);
}
