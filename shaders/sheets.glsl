// Divides index space into sheets of equal distance from the eye. Twin of splatgl/splat/sheets.py.
// switch SHEETS 0  sheets that share a splat; 0: splats composite one by one
// switch STEPS 0   parts of a sheet that are classified; 0: splats are classified before
#include "ellipse.glsl"

uniform vec3 sheet_eye;        // the eye from frame.base, index axes
uniform vec3 sheet_direction;  // parallel views: unit vector along the rays, index axes
uniform float thickness;       // of a sheet, index units
uniform float first_sheet;     // sheets are counted from this one

// a kernel's variance in depth, voxels², and coefficients of its Fourier transform's root; and a sheet's mass of even matter
uniform float kernel_variance;
uniform vec4 kernel_spectrum;
uniform float full_mass;

// Distance over thickness, in sheets from the first, of a splat at a grid position.
float sheet_place(vec3 position) {
    vec3 i = position - frame.base.xyz - sheet_eye;
    return (PERSPECTIVE == 1 ? length(i) : dot(i, sheet_direction)) / thickness - first_sheet;
}

// The first of the sheets that share a splat.
int sheet_base(float place) {
    return int(floor(place + (SHEETS == 3 ? 0.5 : 0.0))) - (SHEETS - 1) / 2;
}

// Shares of the sheets base, base + 1, …: a B-spline; t = place − base.
vec4 sheet_weights(float t) {
    if (SHEETS == 2) {
        float f = clamp(t, 0.0, 1.0);
        return vec4(1.0 - f, f, 0.0, 0.0);
    }
    if (SHEETS == 3) {
        float g = clamp(t - 1.0, -0.5, 0.5);
        return vec4(0.5 * (0.5 - g) * (0.5 - g), 0.75 - g * g, 0.5 * (0.5 + g) * (0.5 + g), 0.0);
    }
    float g = clamp(t - 1.0, 0.0, 1.0), q = 1.0 - g;
    return vec4(q * q * q / 6.0, 2.0 / 3.0 - g * g * (1.0 - g / 2.0), 2.0 / 3.0 - q * q * (1.0 - q / 2.0), g * g * g / 6.0);
}

// The share of the sheet at 0.
float sheet_share(float place) {
    int number = -sheet_base(place);
    vec4 weights = sheet_weights(place + float(number));
    return number >= 0 && number < SHEETS ? weights[number] : 0.0;
}

// See Sheets.layer_terms, of one order; direction: a ray's unit vector, index axes.
mat2x3 layer_terms(vec3 direction, float order) {
    const float PI = 3.14159265;
    float count = float(SHEETS);
    vec3 f = max(abs(direction) * (thickness * order), vec3(0.1));
    vec3 box = sin(PI * f) / (PI * f), slope = (cos(PI * f) - box) / f;
    vec3 bend = -PI * PI * box - 2.0 * slope / f;
    vec3 power = SHEETS == 2 ? vec3(1.0) : SHEETS == 3 ? box : box * box;
    vec3 second = (count - 1.0) * slope * slope + box * bend;
    vec3 x = min(order * order * (1.0 - direction * direction), vec3(1.0));
    vec4 c = kernel_spectrum;
    vec3 root = 1.0 + x * (c.x + x * (c.y + x * (c.z + x * c.w)));
    vec3 share = count * power * root * root;
    vec3 spread = second / (-2.0 * PI * PI) - box * box / 6.0;
    return mat2x3(share * box * slope * sign(direction) / -PI, share * spread);
}

// sin(2π place).
vec3 layer_wave(vec3 place) {
    vec3 x = 0.5 - fract(place);
    x *= 8.0 - 16.0 * abs(x);
    return x * (0.775 + 0.225 * abs(x));
}

// Distance from the mean place of even matter on a ray in a sheet, a sphere around the eye, to the sheet's place, in
// sheets. sheet: its number from the eye.
float bulge(float sheet) {
    return kernel_variance / (thickness * thickness * max(sheet, 1.0));
}
