// Composites the splats of a tile on a processor: each invocation draws a column of pixels.
#define AT(row) (corner + ivec2(0, row))
#define BEGIN(row) \
    light[row] = CARRIED == 1 ? imageLoad(target, AT(row)) : vec4(0.0); ray[row] = ray_of(first + vec2(0.0, row));
#define ADD_SPLAT(row) light[row] = join_splat(light[row], splat.rgb, blended(splat.a * share_at(it, ray[row], row)));
#define JOIN_ALL(splat_) { Joined it = splat_; choose(it); EACH(ADD_SPLAT) }
#define END(row) imageStore(target, AT(row), light[row]);
#define EACH(what) what(0) what(1) what(2) what(3) what(4) what(5) what(6) what(7)

void composite_tile(uvec4 mine, uint lane) {
    uint tile = mine.x, at = mine.y, end = mine.z;
    ivec2 corner = first_pixel(tile, lane);
    first = vec2(corner) + 0.5;
    vec4 light[ROWS];
    Ray ray[ROWS];
    EACH(BEGIN)
    // equal for all splats unless bent: only parallel views use this path with antialiasing
    coverage = table_quad(vec3(0.0)).coverage;
    float least = 0.0;
    for (; at < end; at += 4u) {
        uvec4 four = texelFetch(list, listed_at(at), 0);
        // all four are read before the first is blended, to hide latency; beyond the list's end the first repeats with
        // zero depth
        Joined next[4];
        next[0] = scaled(read_splat(four.x));
        next[1] = scaled(read_splat(at + 1u < end ? four.y : four.x));
        next[2] = scaled(read_splat(at + 2u < end ? four.z : four.x));
        next[3] = scaled(read_splat(at + 3u < end ? four.w : four.x));
        if (at + 1u >= end) next[1].splat.a = 0.0;
        if (at + 2u >= end) next[2].splat.a = 0.0;
        if (at + 3u >= end) next[3].splat.a = 0.0;
        JOIN_ALL(next[0])
        JOIN_ALL(next[1])
        JOIN_ALL(next[2])
        JOIN_ALL(next[3])
        least = min(min(min(light[0].a, light[1].a), min(light[2].a, light[3].a)),
                    min(min(light[4].a, light[5].a), min(light[6].a, light[7].a)));
        if (IN_ORDER && least > opaque) break;
    }
    EACH(END)
    if (!IN_ORDER || least <= opaque) open[tile] = 1u;
}
