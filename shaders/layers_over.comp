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
layout(std430, binding = 2) readonly buffer Lists { uvec2 lists[]; };  // tile, and a bit for each layer in it
uniform ivec2 origin;                // the first tile's first pixel
uniform ivec2 tiles;                 // along x and y
uniform float stride;                // pixels of the view from one to the next
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

void set_layer(int n, vec2 pixel, uint head, bool holds) {
    vec3 ray = vec3((pixel - frame.image_center) * frame.pixel_pitch, 1.0);
    offset[n] = -first_sheet[n];
    if (PERSPECTIVE == 1) rate[n] = length(index_from_eye[n] * ray) / thickness[n];
    else {
        offset[n] += dot(direction[n], index_from_eye[n] * vec3(ray.xy, 0.0)) / thickness[n];
        rate[n] = dot(direction[n], index_from_eye[n][2]) / thickness[n];
    }
    at[n] = left[n] = 0u;
    if (holds) {
        page[n] = kept_heads[head];
        left[n] = kept_heads[head + 1u] + 1u;
        last[n] = last_piece(head);
    }
    far[n] = -1.0;
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
#define SET(n) set_layer(n, place, head_of(uint(n), band, kept_pixel(tile, uint(row), lane)), (holding >> n & 1u) > 0u);
// the last layer without a piece, and whether there is another
#define FIND(n) if (far[n] < 0.0) { more = taker >= 0; taker = n; }
#define CHOOSE(n) \
    if (taker == n) { \
        from = uvec3(page[n], at[n], left[n]); \
        words = last[n]; \
        scale = vec2(offset[n], rate[n]); \
        bright = brightest[n]; \
    }
#define TAKE(n) \
    if (taker == n) { \
        near[n] = span.x; \
        far[n] = span.y; \
        matter[n] = taken; \
        page[n] = from.x; \
        at[n] = from.y; \
        left[n] = from.z; \
    }
#define BEGIN(n) begin = min(begin, near[n]);
#define END(n) end = min(end, near[n] > begin ? near[n] : far[n]);
#define ADD(n) sum += part_of(n, begin, end);

// A layer's matter between two places, of which the first is not before its piece.
vec4 part_of(int n, float begin, float end) {
    if (near[n] > begin) return vec4(0.0);
    float share = far[n] > end ? (end - begin) / (far[n] - begin) : 1.0;
    vec4 part = matter[n] * share;
    matter[n] -= part;
    near[n] = end;
    if (far[n] <= end) far[n] = -1.0;
    return part;
}

void main() {
    uint tile = lists[gl_WorkGroupID.x].x, holding = lists[gl_WorkGroupID.x].y;
    uint lane = gl_LocalInvocationID.x;
    ivec2 corner = origin + ivec2(tile % uint(tiles.x), tile / uint(tiles.x)) * ivec2(COLUMNS, TILE_ROWS);
    corner += ivec2(lane % uint(COLUMNS), lane / uint(COLUMNS));
    for (int row = 0; row < ROWS; row++) {
        ivec2 pixel = corner + ivec2(0, row);
        vec2 place = (vec2(pixel) + 0.5) * stride;
        EACH(SET)
        vec4 light = vec4(0.0);
        while (light.a < opaque) {
            // a piece at a time: reading one takes as long for all layers, also for those that have one
            int taker = -1;
            bool more = false;
            EACH(FIND)
            uvec3 from = uvec3(0u);
            uvec4 words = uvec4(0u);
            vec2 scale = vec2(0.0, 1.0);
            float bright = 1.0;
            EACH(CHOOSE)
            if (from.z > 1u) {
                words = kept_pages[from.x * uint(PAGE) + from.y];
                from.y++;
                if (from.y == uint(PAGE - 1) && from.z > 2u) {
                    from.xy = uvec2(kept_pages[(from.x + 1u) * uint(PAGE) - 1u].x, 0u);
                }
            }
            vec2 span = (ends_of_piece(words) - scale.x) / scale.y;
            span = from.z == 0u || words.z == 0u ? vec2(NOTHING) : vec2(span.x, max(span.y, span.x));
            vec4 taken = matter_of_piece(words, bright);
            from.z -= min(from.z, 1u);
            EACH(TAKE)
            if (more) continue;
            float begin = NOTHING;
            EACH(BEGIN)
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
