// Draws iso-surfaces: divides a sheet into segments that end at its parts' borders and where its value passes a surface's,
// and composites the surface behind its segment. Twin of splatgl/splat/iso.py and splatgl/reference/sheets.py.
#constant MOST_ISO
#constant THIN  // thickness of a surface among the matter of layers, sheets

uniform int isos;                     // number of surfaces
uniform float iso_value[MOST_ISO];    // their values
uniform vec4 iso_matter[MOST_ISO];    // and emissions and optical depths
uniform bool iso_lit;

// a layer keeps a piece of each segment, and one of the surface behind it
#define SEGMENTS (STEPS + 2 * isos)
#define FIRST_SEGMENT 0
#define OWN_PIECE(number) (PIECE == 0 || own_part == (number))

// of the sheet that is closed: its part, and the place in it from which on segments are left; the surface at the end of
// the latest segment, or −1; and the place from which on crossings are left
int iso_part, iso_surface;
float iso_begin, iso_next;

// The value of a surface; a loop that indexes the array by its counter itself is repeated MOST_ISO times by Mesa.
float value_of(int k) {
    return iso_value[min(k, isos - 1)];
}

// Whether surfaces pass around the sheet that is closed next.
bool meets_iso(int row, vec3 mass) {
    bool meets = false;
    for (int k = 0; k < isos; k++) {
        bvec3 above = greaterThan(around[row] - value_of(k) * mass, vec3(0.0));
        meets = meets || (any(above) && !all(above));
    }
    return meets;
}

// Places, ascending, from 0 to 1, where q.x (1−u)² + 2 q.y u (1−u) + q.z u² passes 0; 4 if there are none.
vec2 crossings(vec3 q) {
    bool begins = q.x > 0.0, ends = q.z > 0.0;
    if (!begins) q = -q;
    float root = sqrt(max(q.y * q.y - q.x * q.z, 0.0));
    if (begins != ends) {
        float near = q.y + root + 1e-30;
        return vec2(q.y >= 0.0 ? near / (near - q.z) : q.x / (q.x + root - q.y), 4.0);
    }
    if (q.y >= 0.0 || root <= 0.0) return vec2(4.0);
    return vec2(q.x / (q.x - q.y + root), (root - q.y) / (root - q.y + q.z));
}

void begin_segments(float from) {
    iso_part = 0;
    iso_surface = -1;
    iso_begin = iso_next = from;
    kept_matter = vec4(0.0);
}

// The next segment within `inside`, which ends at the border of a part or at a surface.
vec2 segment_of(int row, int i, vec2 inside, vec3 mass) {
    float border = clamp(float(iso_part + 1) / float(STEPS), inside.x, inside.y), end = 2.0;
    // a sheet has its end as far as the ray goes on
    float last = inside.y >= 1.0 ? 2.0 : inside.y;
    int surface = -1;
    for (int k = 0; k < isos; k++) {
        vec2 at = crossings(around[row] - value_of(k) * mass);
        float first = at.x >= iso_next ? at.x : at.y;
        if (first >= iso_next && first < min(last, end)) {
            end = first;
            surface = k;
        }
    }
    bool crosses = end <= border;
    vec2 segment = vec2(iso_begin, crosses ? end : border);
    iso_surface = crosses ? surface : -1;
    // just behind the crossing
    if (crosses) iso_next = max(end * 1.0000003, 1e-30);
    else iso_part++;
    iso_begin = segment.y;
    return segment;
}

// Composites the surface at the end of segment i, `at` in sheets, where the mass and the gradient by mass are such and the
// mask less its edge is `mask`.
void close_segment(int row, int i, float at, float mass, vec3 gradient, float mask) {
    if (iso_surface < 0 || mask < -FLUSH || mass < LEAST_MASS) return;
    vec4 matter = iso_matter[iso_surface];
    vec2 shine = lit_surface(row, iso_lit ? gradient / mass : vec3(0.0), at);
    matter.rgb = matter.rgb * shine.x + matter.a * shine.y;
    vec2 ends = vec2(at, at + THIN);
    if (OWN_PIECE(2 * i + 1)) {
        kept_ends = ends;
        kept_matter = matter;
    }
    add_matter(row, ends, matter);
    light[row] = behind(light[row], matter);
}
