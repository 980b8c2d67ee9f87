// The open sheets of ROWS pixels below `first`, and what closing the nearest adds to their light.
// Twin of splatgl/reference/sheets.py.
// switch SHADING 0
// switch WEIGHTED 0
// switch LAYERED 0
// switch CLIPPED 0
// switch MASKED 0
// switch LIMITED 0
// switch NEAR 0
#constant LEAST_MASS  // below which a place holds no value
#constant EDGE        // share of each sheet, besides its weight, in what lies between three
#constant CENTERED    // shares of full_mass from which a value is moved to its sheet's place: not at all,
#constant WHOLLY      // wholly
#constant AMID        // voxels from the first and last layer up to which it is not moved
#constant CELLS       // of the classification table
#constant TABLE_ROW   // ends of cells along its rows
#constant WEIGHTS     // cells of the table of weights by gradient, in the rows behind
#constant MOST_CLIPS
#constant FACE        // voxels along a ray behind a cut that are lit as its face
#constant GRAZING_RAY // a ray that leaves a face by less than this share of its length lies in it,
#constant FLUSH       // if it begins within so many voxels of it
#constant MASK_EDGE   // the mask at which matter ends
#constant MASK_ZERO   // what a byte holds for components 0 and, beyond it, 1
#constant MASK_ONE
#constant MASK_SURE   // gradients from which on they light faces of a mask that they fit
#include "sheets.glsl"
#include "light.glsl"
#include "depth_limits.glsl"
#if LAYERED == 1
#include "layers.glsl"
uniform uint layer;             // whose matter is kept,
uniform uint band;              // of so many pixels,
uniform uint room;              // in so many pages
uniform float thin;             // most optical depth of a piece that is joined from several
uint kept_tile, kept_column;
// a pixel's matter that is not kept yet, and its ends
vec4 waiting[ROWS];
vec2 waiting_ends[ROWS];

// Keeps a pixel's matter for layers_over.comp; beyond the room it is only counted.
void keep(int row) {
    if (waiting[row].a < 1e-30) return;
    uint head = head_of(layer, band, kept_pixel(kept_tile, uint(row), kept_column));
    uvec4 piece = packed_piece(waiting_ends[row], waiting[row], style.brightest);
    if (keep_piece(head, room, piece)) waiting[row] = vec4(0.0);
}

// Adds matter between two places, in sheets from the first, to what waits if both are thin.
void add_matter(int row, vec2 ends, vec4 matter) {
    if (matter.a < 1e-8) return;
    bool joins = ends.x <= waiting_ends[row].y && ends.y < waiting_ends[row].x + LONGEST_PIECE;
    if (waiting[row].a > 0.0 && !(joins && waiting[row].a + matter.a < thin)) keep(row);
    if (waiting[row].a == 0.0) waiting_ends[row].x = ends.x;
    waiting_ends[row].y = ends.y;
    waiting[row] += matter;
}
#endif

// extinction · linear RGB, and extinction, per reference length: integrals until the ends of its cells
uniform usampler2D class_table;
uniform vec2 class_scale;       // a value's place in the table is x value + y
uniform float class_unit;       // of the table's integrals, per cell
uniform vec4 class_before;      // beyond its ends
uniform vec4 class_behind;
uniform vec2 class_seen;        // the places between which there is any matter
uniform vec2 weight_scale;      // a gradient's place in the table of weights is x |gradient| + y
uniform vec3 box_low;           // the volume's box from the eye, index axes
uniform vec3 box_high;
uniform vec2 shell;             // only matter between these is drawn, in sheets from the first
#if CLIPPED == 1
// planes: of the volume's inside, index offsets i from the eye with dot(clip.xyz, i) ≥ clip.w are kept
uniform int clips;
uniform vec4 clip[MOST_CLIPS];
uniform vec3 clip_normal[MOST_CLIPS];  // unit, world
// of a pixel's ray: the normal of the plane behind which it begins, and the end of the face there, in sheets; or 0
vec4 face[ROWS];
#endif

#if MASKED == 1
uniform sampler3D mask_field;   // of voxels 1 or 0, and the gradient of it smoothed
uniform vec3 mask_low;          // its first voxel from the eye, index axes
// of a pixel's ray: its place in the mask at the first sheet, and voxels per sheet
vec3 mask_first[ROWS], mask_step[ROWS];

vec4 mask_at(int row, float sheet) {
    return trilinear(mask_field, mask_first[row] + mask_step[row] * sheet);
}

// What is kept of a part, where the mask less MASK_EDGE is m at its ends, and linear between; all of what lies in a face.
vec2 kept_part(vec2 part, vec2 m) {
    if (max(abs(m.x), abs(m.y)) < FLUSH) return part;
    float cross = mix(part.x, part.y, m.x / (m.x == m.y ? 1.0 : m.x - m.y));
    if (m.x >= 0.0) return vec2(part.x, m.y >= 0.0 ? part.y : cross);
    return m.y >= 0.0 ? vec2(cross, part.y) : part.xx;
}

// The share of light by the mask's normal; by the gradient of values the rest.
float face_share(vec3 gradient, vec3 normal) {
    float size2 = dot(gradient, gradient), face2 = dot(normal, normal), along = dot(gradient, normal);
    float alike = along * along / max(size2 * face2, 1e-30) * (size2 / (size2 + MASK_SURE * MASK_SURE));
    return sqrt(face2) * (1.0 - alike);
}
#endif

#if NEAR == 1
uniform sampler2D near_sums;    // see near_field.frag
uniform sampler2D near_masses;
uniform ivec2 near_sheets;      // first of the sheets that are planes, and the one behind the last
uniform vec2 near_grid;         // 1 over pixels between two rays, and rows of a sheet
uniform float near_top;         // the picture's row of the band's first

// A sheet's sums and mass, if it is a plane.
void take_near(int row, int sheet, inout vec4 sums, inout float mass) {
    if (sheet >= near_sheets.y) return;
    vec2 at = (first + vec2(0.0, float(row) + near_top) - 0.5) * near_grid.x + 0.5;
    at.y += near_grid.y * float(sheet - near_sheets.x);
    at /= vec2(textureSize(near_sums, 0));
    bool ahead = sheet >= near_sheets.x;
    sums = ahead ? textureLod(near_sums, at, 0.0) : vec4(0.0);
    mass = ahead ? textureLod(near_masses, at, 0.0).r : 0.0;
}
#endif

// the open sheets of a pixel, nearest first, and their masses
vec4 sum0[ROWS], sum1[ROWS], sum2[ROWS], sum3[ROWS];
vec4 masses[ROWS];
// of a pixel, by mass: gradient and value of the last two sheets that were taken, and half-way between the first of them
// and the one before it; classified before, the last one's sum. And their masses, in the order of places
vec4 start[ROWS], middle[ROWS], before[ROWS];
vec3 held[ROWS];
// how much further than others the sheets spread even matter, in sheets², likewise
vec3 spread[ROWS];
// values by mass around the sheet that is closed next
vec3 around[ROWS];
// or, until all sheets are closed, of blends of one value: it, or their sum by length, and the length
vec4 light[ROWS];
// of a pixel's ray: its place among voxels at the first sheet, voxels per sheet, and what the layers of voxels, and planes
// half as far apart, do to sheets
vec3 layer_first[ROWS], layer_step[ROWS];
mat2x3 layers[ROWS], half_layers[ROWS];
#if CUED
// of a pixel's ray: its cell at the first sheet, and cells per sheet
vec3 first_cell[ROWS], cell_step[ROWS];
#endif
// of a pixel's ray: its ends in the box, in sheets from the first; reference lengths per sheet; unit world direction
vec2 ends[ROWS];
float lengths[ROWS];
vec3 toward[ROWS];

void set_ray(int row) {
    vec2 pixel = first + vec2(0.0, float(row));
    vec3 ray = ray_at(pixel);
    vec3 along = PERSPECTIVE == 1 ? ray : vec3(0.0, 0.0, 1.0);
    vec3 start = PERSPECTIVE == 1 ? vec3(0.0) : index_from_eye() * vec3(ray.xy, 0.0);
    vec3 direction = index_from_eye() * along;
    float speed = length(direction);
    direction /= speed;
    float near = -1e9, far = 1e9;
    if (STEPS > 0) {
        vec3 flush = mix(vec3(0.0), vec3(FLUSH), lessThan(abs(direction), vec3(GRAZING_RAY)));
        // away from 0, where a ray is always or never inside
        direction = mix(direction, vec3(1e-20), lessThan(abs(direction), vec3(1e-20)));
        vec3 a = (box_low - flush - start) / direction, b = (box_high + flush - start) / direction;
        vec3 low = min(a, b), high = max(a, b);
        near = max(low.x, max(low.y, low.z));
        far = min(high.x, min(high.y, high.z));
    }
    // a parallel view begins at its eye's plane, too
    near = max(near, 0.0);
#if CLIPPED == 1
    face[row] = vec4(0.0);
    float whole = near;
    for (int i = 0; i < clips; i++) {
        float speed = dot(clip[i].xyz, direction), apart = clip[i].w - dot(clip[i].xyz, start);
        if (abs(speed) < GRAZING_RAY) apart -= FLUSH;
        // a ray along a plane is always or never kept
        float at = apart / (abs(speed) < 1e-20 ? 1e-20 : speed);
        if (speed < 0.0) far = min(far, at);
        else if (at > near) {
            if (at > whole + FLUSH) face[row].xyz = clip_normal[i];
            near = at;
        }
    }
#endif
    float offset = PERSPECTIVE == 1 ? 0.0 : dot(start, sheet_direction);
#if CLIPPED == 1
    face[row].w = (near + FACE + offset) / thickness - first_sheet;
#endif
#if LIMITED == 1
    vec2 drawn = within_depths(vec2(near, far), ivec2(pixel), speed);
    near = drawn.x;
    far = drawn.y;
#endif
    if (STEPS > 0) {
        layer_first[row] = start + direction * (first_sheet * thickness - offset) - box_low - 0.5;
        layer_step[row] = direction * thickness;
        layers[row] = layer_terms(direction, 1.0);
        half_layers[row] = layer_terms(direction, 2.0);
    }
#if MASKED == 1
    mask_first[row] = start + direction * (first_sheet * thickness - offset) - mask_low;
    mask_step[row] = direction * thickness;
#endif
#if CUED
    first_cell[row] = cell_at(start + direction * (first_sheet * thickness - offset));
    cell_step[row] = cell_at(start + direction * ((first_sheet + 1.0) * thickness - offset)) - first_cell[row];
#endif
    lengths[row] = length(along) / speed * thickness / style.opacity_length;
    ends[row] = clamp((vec2(near, max(far, near)) + offset) / thickness - first_sheet, shell.x, shell.y);
    mat3 eye_from_world = mat3(frame.eye_from_world[0].xyz, frame.eye_from_world[1].xyz, frame.eye_from_world[2].xyz);
    toward[row] = normalize(along) * eye_from_world;
}

// A place in the table: its cell, the integral until it, over the cell and from there to the place.
struct Until {
    float place;
    int cell;
    uvec4 below;
    vec4 mean;
    vec4 above;
};

uvec4 class_texel(int cell) {
    uint at = uint(cell);
    return texelFetch(class_table, ivec2(at % uint(TABLE_ROW), at / uint(TABLE_ROW)), 0);
}

Until class_until(float place) {
    float inside = clamp(place, 0.0, float(CELLS));
    Until it;
    it.place = place;
    it.cell = min(int(inside), CELLS - 1);
    it.below = class_texel(it.cell);
    it.mean = vec4(class_texel(it.cell + 1) - it.below) * class_unit;
    vec4 outside = place < 0.0 ? class_before : class_behind;
    it.above = (inside - float(it.cell)) * it.mean + (place - inside) * outside;
    // the last end itself is beyond it: a value exactly at a step is on its upper side
    if (place < 0.0 || place >= float(CELLS)) {
        it.mean = outside;
        it.cell = place < 0.0 ? -1 : CELLS;
    }
    return it;
}

// Mean emission and extinction between two places.
vec4 class_mean(Until first, Until last) {
    // differences of whole numbers are exact
    vec4 between = vec4(ivec4(last.below - first.below)) * class_unit + (last.above - first.above);
    return first.cell == last.cell ? first.mean : max(between * (1.0 / (last.place - first.place)), vec4(0.0));
}

float weight_at(int end) {
    return uintBitsToFloat(class_texel((CELLS / TABLE_ROW + 1) * TABLE_ROW + end).r);
}

// The transfer function's weight of a gradient.
float weight_of(vec3 gradient) {
    float place = clamp(length(gradient) * weight_scale.x + weight_scale.y, 0.0, float(WEIGHTS));
    int cell = min(int(place), WEIGHTS - 1);
    return mix(weight_at(cell), weight_at(cell + 1), place - float(cell));
}

// Extinction of that share of an extinction's opacity, both per reference length.
float weighted(float extinction, float weight) {
    float opacity = one_minus_exp(extinction) * weight;
    if (weight >= 1.0) return extinction;
    float series = opacity * (1.0 + opacity * (0.5 + opacity * (1.0 / 3.0 + opacity * (0.25 + opacity * 0.2))));
    return opacity < 0.05 ? series : -log(1.0 - opacity);
}

// Light of matter with that gradient from sheet `begin` to `end`.
vec2 light_of(int row, vec3 gradient, float begin, float end) {
    vec3 shines = vec3(0.0);
    if (LIGHT == 1)
        for (int axis = 0; axis < 3; axis++) shines[axis] = dot(style.light.xyz, frame.eye_from_world[axis].xyz);
    vec2 share = vec2(1.0);
#if CUED
    vec3 cell = first_cell[row] + cell_step[row] * (0.5 * (begin + end));
    if (SHADING == 0) gradient = vec3(0.0);
    share = reached(cell, gradient, toward[row]);
#endif
    vec2 light = surface_light(gradient, toward[row], shines, share);
    if (SHADING == 0) return light;
#if MASKED == 1
    vec3 normal = (mask_at(row, 0.5 * (begin + end)).gba * 255.0 - MASK_ZERO) / MASK_ONE;
    float shown = face_share(gradient, normal);
    if (shown > 0.0) {
#if CUED
        share = reached(cell, normal, toward[row]);
#endif
        light = mix(light, surface_light(normal, toward[row], shines, share), shown);
    }
#endif
#if CLIPPED == 1
    float faced = clamp((face[row].w - begin) / max(end - begin, 1e-20), 0.0, 1.0);
    if (face[row].xyz != vec3(0.0)) {
#if CUED
        share = reached(cell, face[row].xyz, toward[row]);
#endif
        light = mix(light, surface_light(face[row].xyz, toward[row], shines, share), faced);
    }
#endif
    return light;
}

// `length_` reference lengths of matter of that emission and extinction, with that gradient.
vec4 weighed(vec4 matter, vec3 gradient, float length_) {
    if (WEIGHTED == 1) {
        float weight = weight_of(gradient);
        matter *= matter.a > 1e-30 ? weighted(matter.a, weight) / matter.a : weight;
    }
    return matter * length_;
}

#define ONE_VALUE (JOIN == JOIN_MAX || JOIN == JOIN_MIN || JOIN == JOIN_MEAN)
// A pixel's value and length, and more behind.
vec4 joined(vec4 light, float value, float length_) {
    if (length_ <= 0.0) return light;
    float both = JOIN == JOIN_MEAN ? light.x + value * length_
                                   : JOIN == JOIN_MIN ? min(light.x, value) : max(light.x, value);
    return vec4(JOIN == JOIN_MEAN || light.y > 0.0 ? both : value, light.y + length_, 0.0, 0.0);
}

// What a pixel shows of all its sheets: light, or the class of its value over the reference length.
vec4 shown(vec4 light) {
    if (!ONE_VALUE) return light;
    float value = JOIN == JOIN_MEAN ? light.x / max(light.y, 1e-30) : light.x;
    // a cell around it: without steps from cell to cell
    float place = value * class_scale.x + class_scale.y;
    vec4 matter = class_mean(class_until(place - 0.5), class_until(place + 0.5));
    return light.y > 0.0 ? behind(vec4(0.0), weighed(matter, vec3(0.0), 1.0)) : vec4(0.0);
}

// A sheet's sums as if even matter had the same mass everywhere, with the value moved by the gradient from the mean place
// of even matter to the sheet's own; further: how much further than others it spreads even matter.
vec4 centered(int row, int sheet, vec4 sums, inout float mass, out float further) {
    further = 0.0;
    if (ONE_VALUE) return sums;
    vec3 place = layer_first[row] + layer_step[row] * float(sheet);
    // near the first and last layer gradients are of faces
    vec3 inward = min(place, box_high - box_low - 1.0 - place);
    float amid = min(min(inward.x, inward.y), inward.z) - AMID;
    vec3 sine = layer_wave(place), cosine = layer_wave(place + 0.25);
    float lag = dot(layers[row][0], sine) + 2.0 * dot(half_layers[row][0], sine * cosine);
    further = dot(layers[row][1], cosine) + dot(half_layers[row][1], 1.0 - 2.0 * sine * sine) - 2.0 * lag * lag;
#if NEAR == 1
    if (sheet >= near_sheets.y)
#endif
    if (PERSPECTIVE == 1) lag += bulge(float(sheet) + first_sheet);
    float relative = mass / full_mass;
    float share = clamp(amid, 0.0, 1.0) * clamp((relative - CENTERED) / (WHOLLY - CENTERED), 0.0, 1.0);
    float even = 1.0 + share * (1.0 / max(relative, CENTERED) - 1.0);
    // gradients of the sheets beside it count, too
    further *= share * clamp(amid - 1.0, 0.0, 1.0);
    sums.a += share * lag * even * dot(sums.rgb, toward[row]) * lengths[row] * style.opacity_length;
    mass *= even;
    return sums * even;
}

// Values by mass half-way before the sheet that was taken before the last, there, and half-way behind: less by what further
// spread adds where gradients change along the ray.
vec3 values_around(int row) {
    vec4 last = 0.5 * (middle[row] + before[row]);
    vec3 values = vec3(start[row].a, middle[row].a, last.a);
    if (ONE_VALUE) return values;
    vec2 bend = vec2(dot(middle[row].rgb - start[row].rgb, toward[row]), dot(last.rgb - middle[row].rgb, toward[row]));
    bend *= lengths[row] * style.opacity_length;
    vec3 further = vec3(spread[row].xy, 0.5 * (spread[row].y + spread[row].z));
    vec2 at_ends = bend * further.xz;
    float amid = dot(further, vec3(0.25, 0.5, 0.25)) * (bend.x + bend.y) - 0.5 * (at_ends.x + at_ends.y);
    return values - vec3(at_ends.x, amid, at_ends.y);
}

// Weights of three sums of what lies between the first place, 0, and the last, 1.
vec3 spline_shares(float u) {
    return vec3((1.0 - u) * (1.0 - u), 2.0 * u * (1.0 - u), u * u) + EDGE;
}

// Takes the values of the nearest open sheet, number `current`, and opens another; classified after, true if matter
// around the one before it can be seen.
bool take_sheet(int row, int current) {
    bool seen = true;
    if (STEPS == 0) start[row] = sum0[row];
    else {
#if NEAR == 1
        take_near(row, current, sum0[row], masses[row].x);
#endif
        start[row] = 0.5 * (middle[row] + before[row]);
        middle[row] = before[row];
        float further;
        before[row] = centered(row, current, sum0[row], masses[row].x, further);
        held[row] = vec3(0.5 * (held[row].y + held[row].z), held[row].z, masses[row].x);
        spread[row] = vec3(0.5 * (spread[row].y + spread[row].z), spread[row].z, further);
        // whether any of the values, by mass, is a place in the table between those with matter; some mass at least
        vec3 mass = vec3(held[row].xy, 0.5 * (held[row].y + held[row].z));
        around[row] = values_around(row);
        vec3 places = around[row] * class_scale.x + class_scale.y * mass;
        vec2 limits = clamp(class_seen, -1e38, 1e38) + vec2(-1e-2, 1e-2);
        bool within = any(greaterThan(places, limits.x * mass)) && any(lessThan(places, limits.y * mass));
        // the part around it, within the box
        bool inside = ends[row].x < float(current) - 0.5 && ends[row].y > float(current) - 1.5;
        seen = inside && (ONE_VALUE ? any(greaterThan(held[row], vec3(0.0))) : within);
    }
    sum0[row] = sum1[row];
    sum1[row] = SHEETS > 2 ? sum2[row] : vec4(0.0);
    sum2[row] = SHEETS > 3 ? sum3[row] : vec4(0.0);
    sum3[row] = vec4(0.0);
    masses[row] = vec4(masses[row].yzw, 0.0);
    return seen;
}

// Composites the sheet that was taken last, number `current`; classified after, what lies around the one before it.
void close_sheet(int row, int current) {
    if (STEPS == 0) {
#if LIMITED == 1
        vec2 within = clamp(ends[row] - float(current), -0.5, 0.5);
        start[row] *= within.y - within.x;
#endif
#if LAYERED == 1
        add_matter(row, float(current) + vec2(-0.5, 0.5), start[row]);
#endif
        light[row] = behind(light[row], start[row]);
    } else {
        float origin = float(current) - 1.5;
        vec4 last = 0.5 * (middle[row] + before[row]);
        vec3 mass = vec3(held[row].xy, 0.5 * (held[row].y + held[row].z));
        // values by mass; and their places in the table
        vec3 places = around[row] * class_scale.x + class_scale.y * mass;
        // the part within the box
        vec2 inside = clamp(ends[row] - origin, 0.0, 1.0);
        vec3 shares = spline_shares(inside.x);
        Until begin = class_until(dot(places, shares) / max(dot(mass, shares), 1e-30));
#if MASKED == 1
        float kept = mask_at(row, origin + inside.x).r - MASK_EDGE;
#endif
        for (int i = 0; i < STEPS; i++) {
            vec2 part = clamp(vec2(float(i), float(i + 1)) / float(STEPS), inside.x, inside.y);
#if MASKED == 1
            float kept_then = mask_at(row, origin + part.y).r - MASK_EDGE;
            part = kept_part(part, vec2(kept, kept_then));
            kept = kept_then;
            shares = spline_shares(part.x);
            begin = class_until(dot(places, shares) / max(dot(mass, shares), 1e-30));
#endif
            vec3 mean_shares = spline_shares(0.5 * (part.x + part.y)), last_shares = spline_shares(part.y);
            float mean_mass = dot(mass, mean_shares), last_mass = max(dot(mass, last_shares), 1e-30);
            float length_ = mean_mass >= LEAST_MASS ? part.y - part.x : 0.0;
            if (ONE_VALUE) {
                // Simpson's rule for the mean, and nearly the extremes
                float first_mass = max(dot(mass, shares), 1e-30);
                light[row] = joined(light[row], dot(around[row], shares) / first_mass, length_ / 6.0);
                light[row] = joined(light[row], dot(around[row], mean_shares) / max(mean_mass, 1e-30), length_ / 1.5);
                light[row] = joined(light[row], dot(around[row], last_shares) / last_mass, length_ / 6.0);
            } else {
                Until end = class_until(dot(places, last_shares) / last_mass);
                vec4 matter = class_mean(begin, end);
                begin = end;
                vec3 gradient = mat3(start[row].rgb, middle[row].rgb, last.rgb) * mean_shares / max(mean_mass, 1e-30);
                matter = weighed(matter, gradient, length_ * lengths[row]);
                vec2 at = origin + part;
                if (SHADING == 1 || CUED) {
                    vec2 light = light_of(row, gradient, at.x, at.y);
                    matter.rgb = matter.rgb * light.x + (LIGHT == 1 ? matter.a * light.y : 0.0);
                }
#if LAYERED == 1
                add_matter(row, at, matter);
#endif
                light[row] = behind(light[row], matter);
            }
            shares = last_shares;
        }
    }
}
