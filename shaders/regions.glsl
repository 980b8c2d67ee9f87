// Matter in regions of the plane of value and gradient magnitude, as means over straight lines.
// Twin of splatgl/splat/regions.py.
// Places are values, in cells of the classification table, and gradients, in record values per mean spacing.
#constant MOST_REGIONS
#constant GAUSSIAN     // 1 / (2 deviation²) of a Gaussian over half its box
uniform int region_count;
uniform vec4 region_limits[MOST_REGIONS];  // lowest and highest value, and gradient
uniform vec4 region_matter[MOST_REGIONS];  // emission and extinction per reference length; of an image 1
uniform int region_shape[MOST_REGIONS];    // 0 box, 1 triangle, 2 Gaussian, 3 image
uniform ivec2 image_size;                  // columns and rows
uniform float image_unit;                  // matter per integer step of the image

// The magnitude of a gradient, of sums by mass.
float steepness(vec3 slope, float mass) {
    return length(slope) / max(mass, 1e-30);
}

// How far a place lies within the four sides of a region; negative outside.
vec4 region_depths(int n, vec2 at) {
    vec4 limits = region_limits[n];
    float narrower = region_shape[n] != 1 ? 0.0
        : 0.5 * (limits.y - limits.x) * (limits.w - at.y) / (limits.w - limits.z);
    return vec4(at.x - limits.x - narrower, limits.y - narrower - at.x, at.y - limits.z, limits.w - at.y);
}

// A place within a region: values from −1 to 1, gradients from 0 to 1.
vec2 region_place(int n, vec2 at) {
    vec4 limits = region_limits[n];
    return vec2((at.x - 0.5 * (limits.x + limits.y)) / (0.5 * (limits.y - limits.x)),
                (at.y - limits.z) / (limits.w - limits.z));
}

// Extinction over the largest one, at a place within a region.
float region_density(int n, vec2 at) {
    float y = 2.0 * at.y - 1.0;
    return region_shape[n] == 2 ? exp(-GAUSSIAN * (at.x * at.x + y * y)) : max(1.0 - abs(at.x) / max(at.y, 1e-12), 0.0);
}

// Integral of the density between two shares of a line.
float region_integral(int n, vec2 first, vec2 last, float low, float high) {
    float middle = 0.5 * (low + high), beside = 0.387298335 * (high - low);
    return (high - low) * (5.0 / 18.0 * region_density(n, mix(first, last, middle - beside))
                         + 4.0 / 9.0 * region_density(n, mix(first, last, middle))
                         + 5.0 / 18.0 * region_density(n, mix(first, last, middle + beside)));
}

// The table's texel of a cell end of the image, behind the weights by gradient.
uvec4 image_texel(int row, int end) {
    int rows = CELLS / TABLE_ROW + 1 + WEIGHTS / TABLE_ROW + 1;
    return class_texel(rows * TABLE_ROW + row * (image_size.x + 1) + end);
}

// Mean matter of the image between two shares of a line.
vec4 image_mean(vec2 first, vec2 last, float low, float high) {
    float columns = float(image_size.x), middle = mix(first.y, last.y, 0.5 * (low + high));
    int row = clamp(int(floor(middle * float(image_size.y))), 0, image_size.y - 1);
    float begin = (mix(first.x, last.x, low) + 1.0) * 0.5 * columns, end = (mix(first.x, last.x, high) + 1.0) * 0.5 * columns;
    int a = clamp(int(floor(begin)), 0, image_size.x - 1), b = clamp(int(floor(end)), 0, image_size.x - 1);
    uvec4 below_a = image_texel(row, a), below_b = image_texel(row, b);
    vec4 at_a = vec4(image_texel(row, a + 1) - below_a) * image_unit, at_b = vec4(image_texel(row, b + 1) - below_b) * image_unit;
    vec4 between = vec4(ivec4(below_b - below_a)) * image_unit + (end - float(b)) * at_b - (begin - float(a)) * at_a;
    return a == b ? at_a : max(between / (end - begin), vec4(0.0));
}

// Emission and optical depth of `length_` reference lengths, over which places move straight from first to last.
vec4 mean_matter(vec2 first, vec2 last, float length_) {
    vec4 total = vec4(0.0);
    for (int k = 0; k < region_count; k++) {
        int n = min(k, region_count - 1);
        vec4 before = region_depths(n, first), behind = region_depths(n, last);
        vec4 at = before / mix(before - behind, vec4(1.0), equal(before, behind));
        vec4 from = mix(vec4(0.0), mix(at, vec4(2.0), lessThan(behind, vec4(0.0))), lessThan(before, vec4(0.0)));
        vec4 until = mix(vec4(1.0), at, lessThan(behind, vec4(0.0)));
        float low = max(max(from.x, from.y), max(from.z, from.w)), high = min(min(until.x, until.y), min(until.z, until.w));
        if (low > 1.0 || high < low) continue;
        vec4 mean = region_matter[n];
        if (region_shape[n] > 0) {
            vec2 a = region_place(n, first), b = region_place(n, last);
            float middle = region_shape[n] == 2 ? 0.5 * (low + high)
                : clamp(a.x / (a.x == b.x ? 1.0 : a.x - b.x), low, high);
            if (region_shape[n] == 3) mean = image_mean(a, b, low, high);
            else mean *= (region_integral(n, a, b, low, middle) + region_integral(n, a, b, middle, high)) / max(high - low, 1e-30);
        }
        total += mean * (high - low);
    }
    return total * length_;
}
