// Computes quads more exactly than Table 1: before z_k with the true distance from the ray (form c), beyond it with the
// ellipse of perspective space and the trapezoid's first-order term (b′).
// Twin of splatgl/splat/footprint.py. All lengths in mean voxel spacings, in eye axes; g and τ in index axes.
#include "quads.glsl"
#include "optics.glsl"
#constant FIRST_ORDER  // terms beyond the box's stretch are left out where they change a footprint by more than this share

// Contents of a Quad's bend, cubic and mixed.
// Before z_k, bend = (1/|v|², 0, 0, 0): D² = r²/(1 + r²/|v|²).  Beyond it:
// cubes, bend = (−γ, κ, λ, β): D² = r² + κ r.x³, value × (1 + λ r.x + β r.x² + γ r.y²);
// others, bend = (−1, 0, λ.x, λ.y): value × (1 + λ·r) × the length of the pixel's ray, and
// D² = r² + (cubic.xy·r)(cubic.zw·r)² + (mixed.xy·r)(mixed.zw·r)(cubic.zw·r), where only one axis is stretched

// Before z_k d² = |v×U|²/|v+U|² on any plane through the centre v; on the one perpendicular to v it is
// U²/(1 + U²/|v|²). Returns the radius there of the silhouette of the sphere of radius R.
float near_reach(float far2) {
    return style.radius * sqrt(far2 / max(far2 - style.radius * style.radius, 1e-6 * far2));
}

Quad near_quad(vec3 axis_1, vec3 axis_2, float far2) {
    return Quad(axis_1, axis_2, near_reach(far2), 1.0, 1.0, vec4(1.0 / far2, 0.0, 0.0, 0.0), vec4(0.0), vec4(0.0));
}

// Beyond z_k, on the plane at the voxel's depth: in stretched space the pixel's ray is a straight line with the voxel's
// slope; along it the depth is t + t²/z to first order.
Quad cubic_quad(vec3 v, bool widened) {
    float out_ = length(v.xy);
    vec3 radial = out_ > 0.0 ? vec3(v.xy / out_, 0.0) : vec3(1.0, 0.0, 0.0);
    vec3 across = vec3(-radial.y, radial.x, 0.0);
    float far2 = dot(v, v);
    if (!widened) return near_quad((radial * v.z - vec3(0.0, 0.0, out_)) * inversesqrt(far2), across, far2);
    // a_v = c/(z m) and q_v = √(1 + a²); the ellipse is q times as long along c
    float m = max(1.0, smallest_axis(v.z));
    float a = out_ / (v.z * m);
    float q = sqrt(1.0 + a * a);
    float a_q = a / q;
    float coverage = 1.0 / (m * m);
    float sec2 = far2 / (v.z * v.z);
    // the cubic term moves the rim outwards by less than this share
    float cubic = -2.0 * a_q * a_q * a_q / v.z;
    float reach = style.radius * (1.0 - cubic * style.radius);
    // ratio of the ray lengths of pixel and voxel, sec_p/sec_v, to second order, and the trapezoid's term
    float across_step = m / v.z;
    float along_step = across_step * q;
    float turn = out_ / v.z * along_step / sec2;
    float trapezoid = 3.0 * a_q / (q * q * v.z);
    vec4 bend = vec4(-across_step * across_step / (2.0 * sec2), cubic, turn + trapezoid,
                     along_step * along_step / (2.0 * sec2 * sec2) + turn * trapezoid);
    // share of the peak on a ray of that slant
    if (PEAK == 1) bend = vec4(-1e-30, cubic, trapezoid, 0.0);
    return Quad(radial * (m * q), across * m, reach, coverage * sqrt(sec2) / q, coverage, bend, vec4(0.0), vec4(0.0));
}

Quad far_quad(vec3 v) {
    Ellipse ellipse = voxel_ellipse(vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0));
    // offsets across the view shrink by f along axes narrower than a pixel; the narrower one always is
    float still_1 = v.z > frame.beyond.x ? 0.0 : 1.0;
    vec2 f = min(vec2(1.0), ellipse.width / max(smallest_axis(v.z), 1e-30));
    f.x = mix(f.x, 1.0, still_1);
    vec2 slope = vec2(dot(v, ellipse.axis_1), dot(v, ellipse.axis_2)) / v.z;
    vec3 o1 = to_index(ellipse.axis_1 * f.x);
    vec3 o2 = to_index(ellipse.axis_2 * f.y);
    vec3 depth = to_index(vec3(0.0, 0.0, 1.0));
    vec3 line = o1 * slope.x + o2 * slope.y + depth;
    float line2 = dot(line, line);

    // local coordinates across the line; e: the corresponding steps on the plane
    vec3 g1, g2;
    perpendicular_axes(line * inversesqrt(line2), g1, g2);
    mat2 local = mat2(dot(g1, o1), dot(g2, o1), dot(g1, o2), dot(g2, o2));
    mat2 e = inverse(local);
    vec3 step_1 = ellipse.axis_1 * e[0].x + ellipse.axis_2 * e[0].y;
    vec3 step_2 = ellipse.axis_1 * e[1].x + ellipse.axis_2 * e[1].y;
    float gain = f.x * f.y * inversesqrt(line2);

    // t₀ = τ·r: the line's closest point to the centre
    vec3 off_1 = o1 * e[0].x + o2 * e[0].y;
    vec3 off_2 = o1 * e[1].x + o2 * e[1].y;
    vec2 tau = -vec2(dot(off_1, line), dot(off_2, line)) / line2;
    // an axis that is not stretched keeps the pixel's slope, slope + (ε·r)/z, and bends with the depth
    vec3 still_axis = o1 * still_1;
    vec2 epsilon = still_1 * vec2(e[0].x, e[1].x);
    vec3 curve = depth + o1 * (still_1 * slope.x);
    vec2 gamma = vec2(dot(g1, curve), dot(g2, curve));
    vec2 pi_ = vec2(dot(g1, still_axis), dot(g2, still_axis));
    // and lacks one factor of its width: a further z/z_v under the integral
    vec2 sloped = (tau * still_1 - (gamma + 2.0 * tau * dot(line, curve)) / line2) / v.z;
    // PEAK divides by the peak on a ray of the same slant; the other modes use the integral itself
    if (PEAK == 0) sloped -= epsilon * (dot(line, still_axis) / (v.z * line2));
    vec4 cubic = vec4(gamma * (2.0 / v.z), tau);
    vec4 mixed = vec4(pi_ * (2.0 / v.z), epsilon);
    // the cubic terms move the rim outwards by less than this
    float shift = length(cubic.xy) * dot(tau, tau) + length(mixed.xy) * length(epsilon) * length(tau);
    float reach = style.radius * (1.0 + shift * style.radius);
    if (max(shift, length(sloped)) * style.radius > FIRST_ORDER) {
        // near, slanted long voxels: the first-order terms are invalid
        cubic = mixed = vec4(0.0);
        sloped = vec2(0.0);
        reach = style.radius;
    }
    return Quad(step_1, step_2, reach, gain, f.x * f.y, vec4(-1.0, 0.0, sloped), cubic, mixed);
}

// Returns whether antialiasing widens the voxel. float32 decides correctly for every splat.
bool is_widened(vec3 v) {
    return ANTIALIAS == 1 && v.z > frame.beyond.y;
}

Quad exact_quad(vec3 v) {
    if (CUBIC == 1) return cubic_quad(v, is_widened(v));
    if (is_widened(v)) return far_quad(v);
    vec3 f1, f2, i = index_from_eye() * v;
    float far2 = dot(i, i);
    perpendicular_axes(i * inversesqrt(far2), f1, f2);
    return near_quad(eye_from_index() * f1, eye_from_index() * f2, far2);
}

Quad splat_quad(vec3 v) {
    if (ALIGN == ALIGN_EXACT) return exact_quad(v);
    return table_quad(v);
}
