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

// of each layer: its place in sheets at depth 0, sheets per depth; its nearest piece that is left, and its matter
float offset[LAYERS], rate[LAYERS];
float near[LAYERS], far[LAYERS];
vec4 matter[LAYERS];
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
    left[n] = kept_heads[head + 2u];
    at[n] = 0u;
}

// Takes a layer's next piece.
void take(int n) {
    near[n] = far[n] = NOTHING;
    if (left[n] == 0u) return;
    uvec4 words = kept_pages[page[n] * uint(PAGE) + at[n]];
    vec2 ends = (ends_of_piece(words) - offset[n]) / rate[n];
    near[n] = ends.x;
    far[n] = max(ends.y, ends.x);
    matter[n] = matter_of_piece(words, brightest[n]);
    left[n]--;
    at[n]++;
    if (at[n] == uint(PAGE - 1)) {
        at[n] = 0u;
        page[n] = kept_pages[(page[n] + 1u) * uint(PAGE) - 1u].x;
    }
}

void main() {
    uint tile = gl_WorkGroupID.x, lane = gl_LocalInvocationID.x;
    ivec2 corner = origin + ivec2(tile % uint(tiles.x), tile / uint(tiles.x)) * ivec2(COLUMNS, TILE_ROWS);
    corner += ivec2(lane % uint(COLUMNS), lane / uint(COLUMNS));
    for (int row = 0; row < ROWS; row++) {
        ivec2 pixel = corner + ivec2(0, row);
        for (int n = 0; n < LAYERS; n++) {
            set_layer(n, vec2(pixel) + 0.5, head_of(uint(n), band, kept_pixel(tile, uint(row), lane)));
            take(n);
        }
        vec4 light = vec4(0.0);
        while (light.a < opaque) {
            float begin = NOTHING;
            for (int n = 0; n < LAYERS; n++) begin = min(begin, near[n]);
            if (begin >= NOTHING) break;
            // until the next end or beginning
            float end = NOTHING;
            for (int n = 0; n < LAYERS; n++) end = min(end, near[n] > begin ? near[n] : far[n]);
            vec4 sum = vec4(0.0);
            for (int n = 0; n < LAYERS; n++) {
                if (near[n] > begin) continue;
                float share = far[n] > end ? (end - begin) / (far[n] - begin) : 1.0;
                sum += matter[n] * share;
                matter[n] *= 1.0 - share;
                near[n] = end;
                if (far[n] <= end) take(n);
            }
            light = behind(light, sum);
        }
        imageStore(target, pixel, light);
    }
}
