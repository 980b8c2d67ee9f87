// Closes the sheets of ROWS pixels below `first`, nearest first: moves each sheet's values to its place, and classifies,
// lights and composites the matter around it. Twin of splatgl/reference/sheets.py.
// Distances along a ray are in sheets from first_sheet. Without steps a sheet holds emission and optical depth; with
// steps the sums, by mass, of gradient (world axes, per mean spacing) and value.
// switch SHADING 0    gradients are lit
// switch CLIPPED 0    planes clip rays
// switch MASKED 0     a mask keeps parts of rays
// switch LIMITED 0    meshes limit rays
// switch LAYERED 0    the matter is kept for layers_over.comp
// switch NEAR 0       sheets around the eye are planes
// switch CARD 0       few registers count more than few instructions
// switch PIECE 0      one part of a sheet is kept for layers_join.frag
// switch ISO 0        there are iso-surfaces
// switch REGIONS 0    there is matter in regions of value and gradient
#constant LEAST_MASS  // a place with less mass holds no value
#constant EDGE        // share of each of three sheets, besides its weight, in what lies between them
#constant CENTERED    // shares of full_mass from which a value is moved to its sheet's place: not at all,
#constant WHOLLY      // wholly
#constant AMID        // voxels from the first and last layer up to which a value is not moved
#constant FLUSH       // a ray nearer to a face of the box lies in it, voxels,
#constant GRAZING_RAY // if it leaves the face by less than this share of its length
#include "turns.glsl"
#include "sheets.glsl"
#include "transfer_lookup.glsl"
#include "regions.glsl" if REGIONS else "regions_off.glsl"
#include "clip_ray.glsl" if CLIPPED else "clip_ray_off.glsl"
#include "mask_ray.glsl" if MASKED else "mask_ray_off.glsl"
#include "depth_limits.glsl" if LIMITED else "depth_limits_off.glsl"
#include "layer_matter.glsl" if LAYERED else "layer_matter_off.glsl"
#include "near_sheets.glsl" if NEAR else "near_sheets_off.glsl"

uniform vec3 box_low;  // the volume's box from the eye, index axes
uniform vec3 box_high;
uniform vec2 shell;    // only matter between these places is drawn
// of an attenuated maximum: a value's share of the window is x value + y; z: attenuation per reference length
uniform vec3 window_share;

// whether sheets hold a gradient's component along the ray instead of the gradient, where nothing else needs it
const bool ALONG = CARD == 1 && STEPS > 0 && SHADING == 0 && WEIGHTED == 0 && ISO == 0 && REGIONS == 0;
// the component of a gradient, or of a sum of gradients, along a pixel's ray
#define ALONG_RAY(row, gradient) (ALONG ? (gradient).x : dot(gradient, toward[row]))

// of a pixel's ray: its ends in the box; reference lengths per sheet; unit vector, world axes
vec2 ends[ROWS];
float lengths[ROWS];
vec3 toward[ROWS];
// its place among voxels at sheet 0, voxels per sheet, and how the layers of voxels, and planes half as far apart, move
// and spread a sheet's values
vec3 layer_first[ROWS], layer_step[ROWS];
#include "sheet_shading.glsl"
mat2x3 layers[ROWS], half_layers[ROWS];
// the open sheets of a pixel, nearest first, and their masses
vec4 sum0[ROWS], sum1[ROWS], sum2[ROWS], sum3[ROWS];
vec4 masses[ROWS];
// of the last two closed sheets the sums (before: the last, middle: the one before it), and half-way before them (start);
// without steps, start is the last sheet. And their masses (held) and spreads, start first: how much further than other
// sheets they spread even matter, in sheets²
vec4 start[ROWS], middle[ROWS], before[ROWS];
vec3 held[ROWS];
vec3 spread[ROWS];
// values by mass around the sheet that is closed next
vec3 around[ROWS];
// of a sheet's parts, the number of the one that is kept, its matter and its ends, in sheets
int own_part;
vec4 kept_matter;
vec2 kept_ends;
// a pixel's light; of blends of one value the joined value and its length, see join_value and join_attenuated
vec4 light[ROWS];
#include "iso_surfaces.glsl" if ISO else "iso_surfaces_off.glsl"

// Moves on what open_sheets.glsl keeps.
void turn_sheets() {
    TURN(vec4, sum0)
    TURN(vec4, sum1)
    TURN(vec4, sum2)
    TURN(vec4, sum3)
    TURN(vec4, masses)
    TURN(vec4, middle)
    TURN(vec4, before)
    TURN(vec3, held)
    TURN(vec3, spread)
}

// Centre of a pixel in the band. STRIDE: pixels of the view from one row to the next.
vec2 center_of(int row) {
    return first + vec2(0.0, float(row) * STRIDE);
}

// Sums of gradients and values as sheets hold them. One value takes no gradients.
vec4 held_sums(int row, vec4 sums) {
    if (ONE_VALUE) return vec4(0.0, 0.0, 0.0, sums.a);
    return ALONG ? vec4(dot(sums.rgb, toward[row]), 0.0, 0.0, sums.a) : sums;
}

// Sets the variables of a pixel's ray.
void set_ray(int row) {
    vec2 pixel = center_of(row);
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
    // a parallel view begins at the eye's plane, too
    near = max(near, 0.0);
    float offset = PERSPECTIVE == 1 ? 0.0 : dot(start, sheet_direction);
    face[row].xyz = clip_ray(start, direction, 1.0, near, far);
    face[row].w = (near + FACE + offset) / thickness - first_sheet;
    vec2 drawn = within_depths(vec2(near, far), ivec2(pixel), speed);
    near = drawn.x;
    far = drawn.y;
    vec3 at_first = start + direction * (first_sheet * thickness - offset);
    if (STEPS > 0) {
        layer_first[row] = at_first - box_low - 0.5;
        layer_step[row] = direction * thickness;
        layers[row] = layer_terms(direction, 1.0);
        half_layers[row] = layer_terms(direction, 2.0);
    }
    set_mask_ray(row, at_first, direction * thickness);
    first_cell[row] = cell_at(at_first);
    cell_step[row] = cell_at(start + direction * ((first_sheet + 1.0) * thickness - offset)) - first_cell[row];
    lengths[row] = length(along) / speed * thickness / style.opacity_length;
    ends[row] = clamp((vec2(near, max(far, near)) + offset) / thickness - first_sheet, shell.x, shell.y);
    mat3 eye_from_world = mat3(frame.eye_from_world[0].xyz, frame.eye_from_world[1].xyz, frame.eye_from_world[2].xyz);
    toward[row] = normalize(along) * eye_from_world;
}

// The color that a pixel shows after its last sheet: its light, or the class of its value over the reference length.
vec4 shown(vec4 light) {
    if (!ONE_VALUE) return light;
    float value = joined_value(light);
    if (JOIN == JOIN_ATTENUATED) value = (value - window_share.y) / window_share.x;
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
    mat2x3 layer = layers[row], half_ = half_layers[row];
    // twelve registers, which ambient occlusion and shadows need
    if (CARD == 1 && CUED == 1) {
        layer = layer_terms(layer_step[row] / thickness, 1.0);
        half_ = layer_terms(layer_step[row] / thickness, 2.0);
    }
    float lag = dot(layer[0], sine) + 2.0 * dot(half_[0], sine * cosine);
    further = dot(layer[1], cosine) + dot(half_[1], 1.0 - 2.0 * sine * sine) - 2.0 * lag * lag;
    if (PERSPECTIVE == 1 && !is_plane(sheet)) lag += bulge(float(sheet) + first_sheet);
    float relative = mass / full_mass;
    float share = clamp(amid, 0.0, 1.0) * clamp((relative - CENTERED) / (WHOLLY - CENTERED), 0.0, 1.0);
    float even = 1.0 + share * (1.0 / max(relative, CENTERED) - 1.0);
    // gradients of the sheets beside it count, too
    further *= share * clamp(amid - 1.0, 0.0, 1.0);
    sums.a += share * lag * even * ALONG_RAY(row, sums.rgb) * lengths[row] * style.opacity_length;
    mass *= even;
    return sums * even;
}

// Values by mass half-way before the sheet that was taken before the last, there, and half-way behind: less by what further
// spread adds where gradients change along the ray.
vec3 values_around(int row) {
    vec4 last = 0.5 * (middle[row] + before[row]);
    vec3 values = vec3(start[row].a, middle[row].a, last.a);
    if (ONE_VALUE) return values;
    vec2 bend = vec2(ALONG_RAY(row, middle[row].rgb - start[row].rgb), ALONG_RAY(row, last.rgb - middle[row].rgb));
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

// A pixel's joined values, and those at the ends and in the middle of a part of its ray.
vec4 join_values(int row, vec3 values, float length_) {
    if (JOIN == JOIN_ATTENUATED) {
        vec3 parts = clamp(values * window_share.x + window_share.y, 0.0, 1.0);
        return join_attenuated(light[row], parts, length_, length_ * lengths[row] * window_share.z);
    }
    // Simpson's rule for the mean, and nearly the extremes
    vec4 joined = join_value(light[row], values.x, length_ / 6.0);
    joined = join_value(joined, values.y, length_ / 1.5);
    return join_value(joined, values.z, length_ / 6.0);
}

// Takes the values of the nearest open sheet, number `current`, and opens another; classified after, true if matter
// around the one before it can be seen.
bool take_sheet(int row, int current) {
    bool seen = true;
    if (STEPS == 0) start[row] = sum0[row];
    else {
        take_plane(center_of(row), current, sum0[row], masses[row].x);
        if (ALONG && is_plane(current)) sum0[row] = held_sums(row, sum0[row]);
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
        seen = inside && (ONE_VALUE ? any(greaterThan(held[row], vec3(0.0))) : within || meets_iso(row, mass));
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
        vec2 within = clamp(ends[row] - float(current), -0.5, 0.5);
        if (LIMITED == 1) start[row] *= within.y - within.x;
        kept_ends = float(current) + vec2(-0.5, 0.5);
        kept_matter = start[row];
        add_matter(row, kept_ends, start[row]);
        light[row] = behind(light[row], start[row]);
    } else {
        float origin = float(current) - 1.5;
        vec4 last = 0.5 * (middle[row] + before[row]);
        vec3 mass = vec3(held[row].xy, 0.5 * (held[row].y + held[row].z));
        // values by mass; and their places in the table
        vec3 places = around[row] * class_scale.x + class_scale.y * mass;
        // the part within the box
        vec2 inside = clamp(ends[row] - origin, 0.0, 1.0);
        float from = clamp(float(FIRST_SEGMENT) / float(STEPS), inside.x, inside.y);
        vec3 shares = spline_shares(from);
        Until begin = class_until(dot(places, shares) / max(dot(mass, shares), 1e-30));
        mat3 slopes = mat3(start[row].rgb, middle[row].rgb, last.rgb);
        float steep = steepness(slopes * shares, dot(mass, shares));
        float mask = mask_above(row, origin + from);
        begin_segments(from);
        for (int i = FIRST_SEGMENT; i < SEGMENTS; i++) {
            vec2 part = segment_of(row, i, inside, mass);
            if (mask_part(row, origin, part, mask)) {
                shares = spline_shares(part.x);
                begin = class_until(dot(places, shares) / max(dot(mass, shares), 1e-30));
                steep = steepness(slopes * shares, dot(mass, shares));
            }
            vec3 mean_shares = spline_shares(0.5 * (part.x + part.y)), last_shares = spline_shares(part.y);
            float mean_mass = dot(mass, mean_shares), last_mass = max(dot(mass, last_shares), 1e-30);
            float length_ = mean_mass >= LEAST_MASS ? part.y - part.x : 0.0;
            if (ONE_VALUE) {
                vec3 values = around[row] * mat3(shares, mean_shares, last_shares);
                values /= vec3(max(dot(mass, shares), 1e-30), max(mean_mass, 1e-30), last_mass);
                light[row] = join_values(row, values, length_);
            } else {
                Until end = class_until(dot(places, last_shares) / last_mass);
                vec4 matter = class_mean(begin, end);
                vec3 gradient = slopes * mean_shares / max(mean_mass, 1e-30);
                matter = weighed(matter, gradient, length_ * lengths[row]);
                float steep_end = steepness(slopes * last_shares, last_mass);
                matter += mean_matter(vec2(begin.place, steep), vec2(end.place, steep_end), length_ * lengths[row]);
                begin = end;
                steep = steep_end;
                vec2 at = origin + part;
                if (SHADING == 1 || CUED == 1) {
                    vec2 light = light_of(row, gradient, at.x, at.y);
                    matter.rgb = matter.rgb * light.x + (LIGHT == 1 ? matter.a * light.y : 0.0);
                }
                if (OWN_PIECE(2 * i)) {
                    kept_ends = at;
                    kept_matter = matter;
                }
                add_matter(row, at, matter);
                light[row] = behind(light[row], matter);
                vec3 at_end = mat3(start[row].rgb, middle[row].rgb, last.rgb) * last_shares;
                close_segment(row, i, at.y, last_mass, at_end, mask);
            }
            shares = last_shares;
        }
    }
}
