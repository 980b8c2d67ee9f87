// Adds the splats of a tile's list to the open sheets of pixels.
// Composites a tile's list. mine: its element of lists; lane: the invocation.
void composite_tile(uvec4 mine, uint lane);

// A splat's share of a pixel, and what it adds to sheets times their weights.
float valued(Joined it, Ray ray, int row) {
    choose(it);
    return share_at(it, ray, float(row) * STRIDE) * (STEPS == 0 ? it.splat.a : 1.0);
}

vec4 term_of(int row, Joined it) {
    return STEPS == 0 ? vec4(it.splat.rgb, 1.0) : held_sums(row, it.splat);
}

// Adds four splats at once: sums are stored under a mask, which takes longer than to add them up.
void add_four(int row, Joined four[4], Ray ray, vec4 weights[4]) {
    vec4 v = vec4(valued(four[0], ray, row), valued(four[1], ray, row), valued(four[2], ray, row),
                  valued(four[3], ray, row));
    mat4 shares = mat4(weights[0] * v.x, weights[1] * v.y, weights[2] * v.z, weights[3] * v.w);
    mat4 terms = mat4(term_of(row, four[0]), term_of(row, four[1]), term_of(row, four[2]), term_of(row, four[3]));
    mat4 by_sheet = transpose(shares);
    sum0[row] += terms * by_sheet[0];
    sum1[row] += terms * by_sheet[1];
    if (SHEETS > 2) sum2[row] += terms * by_sheet[2];
    if (SHEETS > 3) sum3[row] += terms * by_sheet[3];
    if (STEPS > 0) masses[row] += shares * vec4(1.0);
}

// Adds a splat to a pixel's open sheets, by a weight in each.
void add_splat(int row, Joined it, Ray ray, vec4 weights) {
    vec4 shares = weights * valued(it, ray, row), term = term_of(row, it);
    sum0[row] += term * shares.x;
    sum1[row] += term * shares.y;
    if (SHEETS > 2) sum2[row] += term * shares.z;
    if (SHEETS > 3) sum3[row] += term * shares.w;
    if (STEPS > 0) masses[row] += shares;
}

void open_pixel(int row) {
    sum0[row] = sum1[row] = sum2[row] = sum3[row] = masses[row] = vec4(0.0);
    middle[row] = before[row] = vec4(0.0);
    held[row] = spread[row] = vec3(0.0);
    light[row] = vec4(0.0);
    if (STEPS > 0 || LIMITED == 1) set_ray(row);
}
