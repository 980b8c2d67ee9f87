// Looks up the transfer function of values between two places of its pre-integrated table, and its weight by gradient.
// Twin of splatgl/splat/preintegration.py.
// Matter is a vec4: emission (extinction · linear RGB) and extinction, both per reference length.
// switch WEIGHTED 0    the transfer function has a weight by gradient
#constant CELLS        // of the table
#constant TABLE_ROW    // cell ends in a row of the texture
#constant WEIGHTS      // cells of the weights by gradient, in the texture's last rows
#include "optics.glsl"

// at each cell end the integral of matter up to it, in units of class_unit
#ifndef CLASS_TEXEL
#define CLASS_TEXEL(at) texelFetch(class_table, at, 0)
uniform usampler2D class_table;
#endif
uniform vec2 class_scale;       // the table's place of a value is x value + y
uniform float class_unit;       // matter per integer step of the table, per cell
uniform vec4 class_before;      // matter below the table's first place
uniform vec4 class_behind;      // and above its last
uniform vec2 class_seen;        // places between which there is any matter
uniform vec2 weight_scale;      // a gradient's place in the weights is x |gradient| + y

// A place in the table: its cell; the integral up to the cell, the mean over it, and the rest up to the place.
struct Until {
    float place;
    int cell;
    uvec4 below;
    vec4 mean;
    vec4 above;
};

uvec4 class_texel(int cell) {
    uint at = uint(cell);
    return CLASS_TEXEL(ivec2(at % uint(TABLE_ROW), at / uint(TABLE_ROW)));
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
    // the last end itself is outside: a value exactly at a step is on its upper side
    if (place < 0.0 || place >= float(CELLS)) {
        it.mean = outside;
        it.cell = place < 0.0 ? -1 : CELLS;
    }
    return it;
}

// Mean matter between two places.
vec4 class_mean(Until first, Until last) {
    // differences of integers are exact
    vec4 between = vec4(ivec4(last.below - first.below)) * class_unit + (last.above - first.above);
    return first.cell == last.cell ? last.mean : max(between * (1.0 / (last.place - first.place)), vec4(0.0));
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

// The extinction whose opacity is `weight` times that of `extinction`, both per reference length.
float weighted(float extinction, float weight) {
    float opacity = one_minus_exp(extinction) * weight;
    if (weight >= 1.0) return extinction;
    float series = opacity * (1.0 + opacity * (0.5 + opacity * (1.0 / 3.0 + opacity * (0.25 + opacity * 0.2))));
    return opacity < 0.05 ? series : -log(1.0 - opacity);
}

// Optical depth and emission of `length_` reference lengths of matter with a gradient.
vec4 weighed(vec4 matter, vec3 gradient, float length_) {
    if (WEIGHTED == 1) {
        float weight = weight_of(gradient);
        matter *= matter.a > 1e-30 ? weighted(matter.a, weight) / matter.a : weight;
    }
    return matter * length_;
}
