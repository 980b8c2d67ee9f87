// Composites the matter of several layers along each ray, nearest first: where layers overlap, extinctions and emissions
// add up. Each invocation composites its pixels of a tile. Twin of splatgl/reference/layers.py.
// switch LAYERS 2       number of layers
// switch LANES 8        invocations of a group
// switch ROWS 8         pixels of an invocation, in a column
// switch PERSPECTIVE 1  0: a parallel view
// version 430
layout(local_size_x = LANES) in;
#include "frame.glsl"
#include "optics.glsl"
#include "layer_pages.glsl"
#define NOTHING 1e30

layout(rgba32f, binding = 0) uniform writeonly image2D target;
uniform ivec2 origin;                // the first tile's first pixel
uniform ivec2 tiles;                 // along x and y
uniform float opaque;                // opacity behind which nothing is composited
uniform uint band;                   // pixels of a layer in the heads
uniform mat3 index_from_eye[LAYERS]; // offsets from the eye in units of the frame to index units of each layer
uniform vec3 direction[LAYERS];      // parallel views: unit vector along the rays, index axes
uniform float thickness[LAYERS];     // of sheets, index units
uniform float first_sheet[LAYERS];
uniform float brightest[LAYERS];

// of each layer: its place in sheets at depth 0, sheets per depth; the ends of its nearest piece, far below 0 if another is
// to be taken, and its matter
float offset[LAYERS], rate[LAYERS];
float near[LAYERS], far[LAYERS];
vec4 matter[LAYERS];
uvec4 last[LAYERS];
uint page[LAYERS], at[LAYERS], left[LAYERS];

void set_layer(int n, vec2 pixel, uint head) {
    vec3 ray = vec3((pixel - frame.image_center) * frame.pixel_pitch, 1.0);
    offset[n] = -first_sheet[n];
    if (PERSPECTIVE == 1) rate[n] = length(index_from_eye[n] * ray) / thickness[n];
    else {
        offset[n] += dot(direction[n], index_from_eye[n] * vec3(ray.xy, 0.0)) / thickness[n];
        rate[n] = dot(direction[n], index_from_eye[n][2]) / thickness[n];
    }
    page[n] = kept_heads[head];
    left[n] = kept_heads[head + 1u] + 1u;
    last[n] = last_piece(head);
    at[n] = 0u;
    far[n] = -1.0;
}

// Takes a layer's next piece.
void take(int n) {
    near[n] = far[n] = NOTHING;
    if (left[n] == 0u || last[n].z == 0u) return;
    uvec4 words = last[n];
    if (left[n] > 1u) words = kept_pages[page[n] * uint(PAGE) + at[n]];
    vec2 ends = (ends_of_piece(words) - offset[n]) / rate[n];
    near[n] = ends.x;
    far[n] = max(ends.y, ends.x);
    matter[n] = matter_of_piece(words, brightest[n]);
    left[n]--;
    at[n]++;
    if (at[n] == uint(PAGE - 1) && left[n] > 1u) {
        at[n] = 0u;
        page[n] = kept_pages[(page[n] + 1u) * uint(PAGE) - 1u].x;
    }
}

// written out for each layer: arrays that loops index are in memory, which takes twice as long
#if LAYERS == 2
#define EACH(what) what(0) what(1)
#elif LAYERS == 3
#define EACH(what) what(0) what(1) what(2)
#elif LAYERS == 4
#define EACH(what) what(0) what(1) what(2) what(3)
#elif LAYERS == 5
#define EACH(what) what(0) what(1) what(2) what(3) what(4)
#elif LAYERS == 6
#define EACH(what) what(0) what(1) what(2) what(3) what(4) what(5)
#elif LAYERS == 7
#define EACH(what) what(0) what(1) what(2) what(3) what(4) what(5) what(6)
#elif LAYERS == 8
#define EACH(what) what(0) what(1) what(2) what(3) what(4) what(5) what(6) what(7)
#endif
#define SET(n) set_layer(n, vec2(pixel) + 0.5, head_of(uint(n), band, kept_pixel(tile, uint(row), lane)));
#define TAKE(n) if (far[n] < 0.0) take(n); begin = min(begin, near[n]);
#define END(n) end = min(end, near[n] > begin ? near[n] : far[n]);
#define ADD(n) sum += taken(n, begin, end);

// A layer's matter between two places, of which the first is not before its piece.
vec4 taken(int n, float begin, float end) {
    if (near[n] > begin) return vec4(0.0);
    float share = far[n] > end ? (end - begin) / (far[n] - begin) : 1.0;
    vec4 part = matter[n] * share;
    matter[n] -= part;
    near[n] = end;
    if (far[n] <= end) far[n] = -1.0;
    return part;
}

void main() {
    uint tile = gl_WorkGroupID.x, lane = gl_LocalInvocationID.x;
    ivec2 corner = origin + ivec2(tile % uint(tiles.x), tile / uint(tiles.x)) * ivec2(COLUMNS, TILE_ROWS);
    corner += ivec2(lane % uint(COLUMNS), lane / uint(COLUMNS));
    for (int row = 0; row < ROWS; row++) {
        ivec2 pixel = corner + ivec2(0, row);
        EACH(SET)
        vec4 light = vec4(0.0);
        while (light.a < opaque) {
            float begin = NOTHING;
            EACH(TAKE)
            if (begin >= NOTHING) break;
            // until the next end or beginning
            float end = NOTHING;
            EACH(END)
            vec4 sum = vec4(0.0);
            EACH(ADD)
            light = behind(light, sum);
        }
        imageStore(target, pixel, light);
    }
}
