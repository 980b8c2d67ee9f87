// Twin of iso_surfaces.glsl without surfaces: the segments of a sheet are its parts.
#define SEGMENTS (PIECE == 1 ? own_part + 1 : STEPS)
#define FIRST_SEGMENT (PIECE == 1 ? own_part : 0)
#define OWN_PIECE(number) true

bool meets_iso(int row, vec3 mass) {
    return false;
}

void begin_segments(float from) {}

vec2 segment_of(int row, int i, vec2 inside, vec3 mass) {
    return clamp(vec2(float(i), float(i + 1)) / float(STEPS), inside.x, inside.y);
}

void close_segment(int row, int i, float at, float mass, vec3 gradient, float mask) {}
