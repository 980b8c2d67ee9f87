// Composites a slab of the matter of several layers along each ray, nearest first: where layers overlap, extinctions and
// emissions add up. Twin of splatgl/reference/layers.py.
// switch LAYERS 2       number of layers
// switch PERSPECTIVE 1  0: a parallel view
#include "frame.glsl"
#include "optics.glsl"
#include "layer_slots.glsl"
#define NOTHING 1e30

uniform usampler2D pieces;
uniform ivec3 slot_size;             // of a slot, texels, and slots side by side
uniform int band_top;                // the picture's row at which the band begins
uniform vec2 slab;                   // its ends, in sheets of the first layer
uniform mat3 index_from_eye[LAYERS]; // offsets from the eye in units of the frame to index units of each layer
uniform vec3 direction[LAYERS];      // parallel views: unit vector along the rays, index axes
uniform float thickness[LAYERS];     // of sheets, index units
uniform float first_sheet[LAYERS];
uniform float brightest[LAYERS];
uniform vec3 box_eye[LAYERS];        // boxes: the eye among the voxels
uniform ivec4 slots[LAYERS];         // first slot, slots, parts of a sheet (0: boxes), and a large multiple of the slots
uniform float shift[LAYERS];         // sheets from a part's begin to the sheet that keeps it
uniform bool uneven[LAYERS];         // whether parts of a sheet differ in length: whole sheets are read

// of each layer: its place in sheets at depth 0, sheets per depth; number of its next piece and of its last; ends and
// matter of its nearest piece that is left
float offset[LAYERS], rate[LAYERS];
int at[LAYERS], last[LAYERS];
float near[LAYERS], far[LAYERS];
vec4 matter[LAYERS];

out vec4 fragment;  // linear premultiplied

// Sets the places of a layer's ray.
void set_layer(int n, vec3 ray) {
    vec3 across = PERSPECTIVE == 1 ? vec3(0.0) : index_from_eye[n] * vec3(ray.xy, 0.0);
    vec3 along = PERSPECTIVE == 1 ? index_from_eye[n] * ray : index_from_eye[n][2];
    offset[n] = PERSPECTIVE == 1 ? 0.0 : dot(direction[n], across) / thickness[n];
    offset[n] -= first_sheet[n];
    rate[n] = (PERSPECTIVE == 1 ? length(along) : dot(direction[n], along)) / thickness[n];
    near[n] = far[n] = NOTHING;
}

// Sets the numbers of the layer's pieces between two depths.
void set_range(int n, vec3 ray, vec2 depths) {
    vec2 places = offset[n] + rate[n] * depths;
    if (uneven[n]) places = (floor(places + shift[n]) + vec2(0.0, 1.0)) * float(slots[n].z) - vec2(0.0, 0.5);
    else if (slots[n].z > 0) places = (places + shift[n]) * float(slots[n].z);
    else {
        vec3 across = PERSPECTIVE == 1 ? vec3(0.0) : index_from_eye[n] * vec3(ray.xy, 0.0);
        vec3 along = PERSPECTIVE == 1 ? index_from_eye[n] * ray : index_from_eye[n][2], signs = signs_of(along);
        places = dot(signs, box_eye[n] + across) + dot(signs, along) * depths + vec2(-2.0, 2.0);
    }
    at[n] = int(floor(places.x));
    last[n] = int(floor(places.y));
}

// Takes a layer's next piece, if it lies between two depths.
void take(int n, ivec2 pixel, vec2 depths) {
    int slot = slots[n].x + (at[n]++ + slots[n].w) % slots[n].y;
    uvec4 words = texelFetch(pieces, pixel + ivec2(slot % slot_size.z, slot / slot_size.z) * slot_size.xy, 0);
    vec2 whole = (ends_of_piece(words) - offset[n]) / rate[n];
    vec2 ends = vec2(max(whole.x, depths.x), min(whole.y, depths.y));
    matter[n] = matter_of_piece(words, brightest[n]);
    if (matter[n].a < LEAST_DEPTH || ends.y <= ends.x) return;
    matter[n] *= (ends.y - ends.x) / (whole.y - whole.x);
    near[n] = ends.x;
    far[n] = ends.y;
}

void main() {
    vec3 ray = vec3((gl_FragCoord.xy - frame.image_center) * frame.pixel_pitch, 1.0);
    ivec2 pixel = ivec2(gl_FragCoord.xy) - ivec2(0, band_top);
    for (int n = 0; n < LAYERS; n++) set_layer(n, ray);
    vec2 depths = (slab - offset[0]) / rate[0];
    for (int n = 0; n < LAYERS; n++) set_range(n, ray, depths);
    vec4 light = vec4(0.0);
    // one loop: llvmpipe loses pixels of one within it
    while (true) {
        float begin = NOTHING;
        bool waits = false;
        for (int n = 0; n < LAYERS; n++) {
            if (near[n] >= NOTHING && at[n] <= last[n]) {
                take(n, pixel, depths);
                waits = waits || near[n] >= NOTHING;
            }
            begin = min(begin, near[n]);
        }
        if (waits) continue;
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
            near[n] = far[n] <= end ? NOTHING : end;
        }
        light = behind(light, sum);
    }
    fragment = light;
}
