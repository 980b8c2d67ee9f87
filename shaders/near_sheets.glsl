// Reads the sheets around the eye, which are planes that near_field.frag has drawn.
uniform sampler2D near_sums;    // sums and masses of near_field.frag
uniform sampler2D near_masses;
uniform ivec2 near_sheets;      // first of the sheets that are planes, and the one behind the last
uniform vec2 near_grid;         // 1 over pixels between two rays, and rows of a sheet
uniform float near_top;         // row of the picture at which the band begins

// Whether a sheet is a plane, or lies before them.
bool is_plane(int sheet) {
    return sheet < near_sheets.y;
}

// The sheet that is closed first, and how many sheets may hold something: two behind the planes, too.
ivec2 planes() {
    return ivec2(near_sheets.x, near_sheets.y - near_sheets.x + 2);
}

// Replaces a sheet's sums and mass if it is a plane. pixel: centre in the band.
void take_plane(vec2 pixel, int sheet, inout vec4 sums, inout float mass) {
    if (sheet >= near_sheets.y) return;
    vec2 at = (pixel + vec2(0.0, near_top) - 0.5) * near_grid.x + 0.5;
    at.y += near_grid.y * float(sheet - near_sheets.x);
    at /= vec2(textureSize(near_sums, 0));
    bool ahead = sheet >= near_sheets.x;
    sums = ahead ? textureLod(near_sums, at, 0.0) : vec4(0.0);
    mass = ahead ? textureLod(near_masses, at, 0.0).r : 0.0;
}
