// The open sheets of ROWS pixels below `first`, and what closing the nearest adds to their light.
// Twin of splatgl/truth/sheets.py.
// switch SHADING 0
#constant LEAST_MASS  // below which a sheet holds no value
#constant ENTRIES     // of the classification table
#constant TABLE_ROW   // entries along its rows
#include "sheets.glsl"

uniform sampler2D class_table;  // linear RGB, extinction per mean spacing
uniform vec2 class_scale;       // a value's place between entries is x value + y
uniform vec3 box_low;           // the volume's box from the eye, index axes
uniform vec3 box_high;

// the open sheets of a pixel, nearest first, and their masses
vec4 sum0[ROWS], sum1[ROWS], sum2[ROWS], sum3[ROWS];
vec4 masses[ROWS];
// of a pixel: the value and gradient on the sheet before, or 0; whether there is one
vec4 before[ROWS];
float known[ROWS];
vec4 light[ROWS];
// of a pixel's ray: its ends in the box, in sheets from the first; mean spacings per sheet; unit world direction
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
    // away from 0, where a ray is always or never inside
    direction = mix(direction, vec3(1e-20), lessThan(abs(direction), vec3(1e-20)));
    vec3 a = (box_low - start) / direction, b = (box_high - start) / direction;
    vec3 low = min(a, b), high = max(a, b);
    float near = max(low.x, max(low.y, low.z)), far = min(high.x, min(high.y, high.z));
    // a parallel view begins at its eye's plane, too
    near = max(near, 0.0);
    float offset = PERSPECTIVE == 1 ? 0.0 : dot(start, sheet_direction);
    ends[row] = (vec2(near, max(far, near)) + offset) / thickness - first_sheet;
    lengths[row] = length(along) / speed * thickness;
    mat3 eye_from_world = mat3(frame.eye_from_world[0].xyz, frame.eye_from_world[1].xyz, frame.eye_from_world[2].xyz);
    toward[row] = normalize(along) * eye_from_world;
}

vec4 class_at(int entry) {
    return texelFetch(class_table, ivec2(entry % TABLE_ROW, entry / TABLE_ROW), 0);
}

// Light that reaches the eye from `length_` mean spacings of matter of that gradient and value behind `light`.
vec4 over(vec4 light, vec4 field, float length_, vec3 toward) {
    float place = clamp(field.a * class_scale.x + class_scale.y, 0.0, float(ENTRIES - 1));
    int entry = min(int(place), ENTRIES - 2);
    vec4 matter = mix(class_at(entry), class_at(entry + 1), place - float(entry));
    if (SHADING == 1) {
        float size2 = dot(field.rgb, field.rgb);
        float cosine = min(abs(dot(field.rgb, toward)) * inversesqrt(max(size2, 1e-37)), 1.0);
        matter.rgb *= size2 > 0.0 ? style.ambient + style.diffuse * cosine : 1.0;
    }
    return light + (1.0 - light.a) * one_minus_exp(matter.a * length_) * vec4(matter.rgb, 1.0);
}

// Composites the nearest open sheet of a pixel, number `current`, and opens another.
void close_sheet(int row, int current) {
    if (STEPS == 0) {
        vec4 sum = sum0[row];
        float share = sum.a > 1e-30 ? one_minus_exp(sum.a) / sum.a : 1.0;
        light[row] += (1.0 - light[row].a) * share * sum;
    } else {
        bool valid = masses[row].x >= LEAST_MASS;
        vec4 mean = valid ? sum0[row] / masses[row].x : before[row];
        vec4 start = known[row] > 0.0 ? before[row] : mean;
        bool some = valid || known[row] > 0.0;
        for (int i = 0; i < STEPS; i++) {
            float low = float(current - 1) + float(i) / float(STEPS);
            float length_ = min(ends[row].y, low + 1.0 / float(STEPS)) - max(ends[row].x, low);
            length_ = some ? max(length_, 0.0) * lengths[row] : 0.0;
            light[row] = over(light[row], mix(start, mean, (float(i) + 0.5) / float(STEPS)), length_, toward[row]);
        }
        before[row] = mean;
        known[row] = valid ? 1.0 : 0.0;
    }
    sum0[row] = sum1[row];
    sum1[row] = SHEETS > 2 ? sum2[row] : vec4(0.0);
    sum2[row] = SHEETS > 3 ? sum3[row] : vec4(0.0);
    sum3[row] = vec4(0.0);
    masses[row] = vec4(masses[row].yzw, 0.0);
}
