// Evaluates a moving splat on one pixel's ray. Twin of tests/helpers/streaks.py and splatgl/splat/motion_blur.py.
#include "motion.glsl"
#include "motion_opacity.glsl"

#constant SHORT  // a path shorter than this many voxels is summed by Simpson's rule

// share of a line before its end, and its slope, over |u|/chord and v²/R²; last column: the line's area; this row and the next
uniform sampler2D blur_table;

// A ray's closest pass of a moving kernel, in the kernel's own units.
struct Passing {
    float along;     // offset along the path, from its middle
    float across2;   // and across it, squared
    float size;      // the path's length
    float gain;      // the integral over F
};

// at: the pixel's position at the voxel's depth, relative to the path's middle.
Passing passing(vec3 v, vec2 at, vec2 step_, Inner inner) {
    vec3 ahead = to_index(vec3(0.0, 0.0, 1.0));
    vec3 line = ahead;
    float seconds = 1.0;
    bool widened = PERSPECTIVE == 1 && min(inner.shrink.x, inner.shrink.y) < 1.0;
    if (PERSPECTIVE == 1) {
        vec2 ray = (v.xy + at) / v.z;
        line += inner.axes * (widened ? v.xy / v.z : ray);
        seconds = length(vec3(ray, 1.0));
    }
    vec3 move = inner.axes * step_;
    vec3 r = inner.axes * at;
    float square = dot(line, line);
    float t = -dot(r, line) / square;
    float forward = dot(move, line) / square;
    vec3 across = move - line * forward;
    float size = length(across);
    float one = 1.0 / max(size, 1e-30);
    vec3 heading = across * one;
    float gain = seconds * inner.shrink.x * inner.shrink.y * inversesqrt(square);

    // the path's point nearest to the ray, and the offset from it to the ray
    r += t * line;
    float passed = clamp(dot(r, heading), -0.5 * size, 0.5 * size);
    r -= passed * heading;
    t += passed * one * forward;
    if (widened && ANTIALIAS == 1) {
        // a widened kernel's ray bends: the trapezoid's term changes its position and length
        float toward = dot(r, ahead), distance2 = dot(r, r);
        gain *= 1.0 - (2.0 * t * dot(line, ahead) + toward) / (v.z * square);
        r *= sqrt(max(distance2 + 2.0 * t * t * toward / v.z, 0.0) / max(distance2, 1e-30));
    }
    float further = dot(r, heading);
    return Passing(passed + further, max(dot(r, r) - further * further, 0.0), size, gain);
}

// The same on a quad. at, step_: in voxels on its plane.
Passing passing_on_quad(vec2 at, vec2 step_) {
    float size = length(step_);
    vec2 heading = step_ / max(size, 1e-18);
    float across = dot(at, vec2(-heading.y, heading.x));
    return Passing(dot(at, heading), across * across, size, 1.0);
}

// F/F(0) at the path's point nearest to the ray: the pixel's maximum.
float stretched(Passing p) {
    float beyond = max(abs(p.along) - 0.5 * p.size, 0.0);
    return radial(beyond * beyond + p.across2);
}

// Cubic Hermite interpolation of two values and their slopes per step.
float hermite(vec2 first, vec2 last, float part) {
    float rise = last.x - first.x;
    return first.x + part * (first.y + part * (3.0 * rise - 2.0 * first.y - last.y
                                               + part * (first.y + last.y - 2.0 * rise)));
}

// Share of the line from its middle to t half chords, odd in t.
float share(float t, int row, float part, int last) {
    float along = abs(t) * float(last);
    if (along >= float(last)) return sign(t) * 0.5;
    int column = int(along);
    along -= float(column);
    vec4 low = texelFetch(blur_table, ivec2(column, row), 0), high = texelFetch(blur_table, ivec2(column + 1, row), 0);
    return sign(t) * mix(hermite(low.rg, high.rg, along), hermite(low.ba, high.ba, along), part);
}

// The mean of the footprint along the path, over F(0).
float blurred(Passing p) {
    float near = p.along - 0.5 * p.size, far = p.along + 0.5 * p.size;
    if (p.size <= SHORT) {
        float middle = radial(p.along * p.along + p.across2);
        return middle + (radial(near * near + p.across2) - 2.0 * middle + radial(far * far + p.across2)) / 6.0;
    }
    float radius2 = style.radius * style.radius;
    float chord = sqrt(max(radius2 - p.across2, 1e-12));
    if (p.across2 >= radius2 || near >= chord || far <= -chord) return 0.0;
    ivec2 texels = textureSize(blur_table, 0);
    float place = p.across2 * (float(texels.y) / radius2);
    int row = min(int(place), texels.y - 1);
    place -= float(row);
    vec4 line = texelFetch(blur_table, ivec2(texels.x - 1, row), 0);
    float area = hermite(line.rg, line.ba, place);
    int last = texels.x - 2;
    return area * (share(far / chord, row, place, last) - share(near / chord, row, place, last)) / p.size;
}

float streak_shape(Passing p) {
    if (MOTION == MOTION_EXACT) return p.gain * blurred(p);
    return p.gain * stretched(p) / (1.0 + p.size * frame.weaken);
}
