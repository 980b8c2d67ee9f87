// Twin of near_sheets.glsl for an eye outside the volume: no sheet is a plane.
bool is_plane(int sheet) {
    return false;
}

ivec2 planes() {
    return ivec2(0);
}

void take_plane(vec2 pixel, int sheet, inout vec4 sums, inout float mass) {}
