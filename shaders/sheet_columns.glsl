// Composites the sheets of a tile on a processor: each invocation draws a column of pixels, whose sheets end together.
// Four entries of a list from one on, beyond its end the first again, and its first sheet.
int next_base(uint at, uint end, out uvec4 names) {
    at = min(at, end - 1u);
    uvec4 low = LIST_TEXEL(listed_at(at)), high = LIST_TEXEL(listed_at(at + 4u));
    bool one = (at & 1u) > 0u, two = (at & 2u) > 0u;
    uvec4 from = one ? uvec4(low.yzw, high.x) : low;
    uvec2 then = one ? high.yz : high.xy;
    names = two ? uvec4(from.zw, then) : from;
    for (uint i = 1u; i < 4u; i++) names[i] = at + i < end ? names[i] : names.x;
    ivec2 texel = texel_of(names.x);
    return sheet_base(uintBitsToFloat(PACKED == 1 ? TEXEL(shapes, texel).w : texelFetch(matters, texel, 0).w));
}

#if ROWS == 1
#define EACH(what) what(0)
#else
#define EACH(what) what(0) what(1) what(2) what(3) what(4) what(5) what(6) what(7)
#endif
// Once for all rows, the last first, whose values turns.glsl moves to row 0: what stores takes long to compile.
#define IN_TURN for (int turn = turns - 1; turn >= 0; turn--)
#define AT(row) (corner + ivec2(0, row))
#define BEGIN(row) ray[row] = ray_of(center_of(row)); open_pixel(row);
#define LIGHT_UP_TO(row) light[row] = LIGHT_AT(AT(row));
#define ADD(row) add_four(row, four, ray[row], weights);
#define TAKE(row) if (take_sheet(row, current)) seen = true;
#define SPAN(row) span = vec2(min(span.x, ends[row].x), max(span.y, ends[row].y));
#define CLOSE(row) close_sheet(row, current - 1);

// Returns whether a condition holds in any column of the subgroup, which then stays together; without votes, in this one.
bool any_column(bool so) {
#ifdef GL_ARB_shader_group_vote
    return anyInvocationARB(so);
#else
    return so;
#endif
}

float least_opacity() {
#if ROWS == 1
    return light[0].a;
#else
    return min(min(min(light[0].a, light[1].a), min(light[2].a, light[3].a)),
               min(min(light[4].a, light[5].a), min(light[6].a, light[7].a)));
#endif
}

// Whether light passes any pixel of the subgroup.
bool any_open() {
    return !IN_ORDER || any_column(least_opacity() <= opaque);
}

void composite_tile(uvec4 mine, uint lane) {
    uint tile = mine.x, at = mine.y, end = mine.z;
    bool is_continued = mine.w > 1u;
    mine.w &= 1u;
    ivec2 corner = first_pixel(tile, lane);
    first = (vec2(corner) + 0.5) * stride;
    Ray ray[ROWS];
    // as no constant, so that compilers keep the loops
    int turns = tiles.x > 0 ? ROWS : 0;
    EACH(BEGIN)
    if (LAYERED == 1) IN_TURN {
        turn_matter();
        set_column(tile, lane + uint(turn) * COLUMNS);
        begin_matter(0, is_continued);
    }
    coverage = table_quad(vec3(0.0)).coverage;
    // the nearest open sheet, and how many sheets from it on may hold something
    int current = 0, holding = 0;
    bool begun = false;
    if (CARRIED == 1 && is_continued) {
        EACH(LIGHT_UP_TO)
        // of opaque ones, nothing is kept
        if (!any_open()) return;
        IN_TURN {
            turn_sheets();
            read_pixel(tile, turn);
        }
        read_column(tile, current, holding, begun);
    }
    if (NEAR == 1 && !begun) {
        current = planes().x;
        holding = planes().y;
    }
    float least = 0.0;
    uvec4 names;
    // the volume's box along the rays, in sheets; its nearest splats may be before it
    vec2 span = vec2(-1e9, 1e9);
    if (STEPS > 0) {
        span = vec2(1e9, -1e9);
        EACH(SPAN)
        for (uint then = (at & ~3u) + 4u; then < end; then += 4u) {
            if (any_column(float(next_base(then, end, names) + SHEETS) >= floor(span.x))) break;
            at = then;
        }
    }
    int next = next_base(at, end, names);
    while (at < end || (mine.w == 1u && holding > 0)) {
        bool seen = false, waits = false, behind = false;
        do {
            if (holding <= 0) current = max(next, current);
            do {
                // the sheets around the eye may have no list
                if (NEAR == 1 && at >= end) break;
                Joined four[4] = Joined[4](read_splat(names.x), read_splat(names.y), read_splat(names.z),
                                           read_splat(names.w));
                vec4 weights[4];
                uint passed = at;
                for (uint i = 0u; i < 4u; i++) {
                    // in turn: rounding where the list was sorted may have put one before its sheet
                    bool now = at + i == passed && at + i < end && sheet_base(four[i].last) <= current;
                    weights[i] = now ? sheet_weights(four[i].last - float(current)) : vec4(0.0);
                    passed += uint(now);
                }
                EACH(ADD)
                // classified after, what they hold reaches a sheet further, which the next one ends
                if (passed > at) holding = max(holding, SHEETS + (STEPS > 0 ? 2 : 0));
                at = passed;
                next = next_base(at, end, names);
            } while (at < end && next <= current);
            // a list that continues may hold more of this sheet
            waits = at >= end && mine.w == 0u;
            if (waits) break;
            EACH(TAKE)
            seen = any_column(seen);
            current++;
            holding--;
            behind = STEPS > 0 && !any_column(float(current) - 1.5 < span.y);
        } while (!seen && !behind && (at < end || holding > 0));
        if (waits) break;
        EACH(CLOSE)
        if (behind) {
            // nothing more is in the box; one value is shown of it when the list is complete
            if (mine.w == 1u || !ONE_VALUE) least = 2.0;
            break;
        }
        if (!IN_ORDER) continue;
        least = least_opacity();
        if (!any_column(least <= opaque)) break;
    }
    if (LAYERED == 1) IN_TURN {
        turn_matter();
        set_column(tile, lane + uint(turn) * COLUMNS);
        end_matter(0);
    }
    IN_TURN {
        TURN(vec4, light)
        SET_LIGHT(AT(turn), mine.w == 1u && !partial ? shown(light[0]) : light[0]);
    }
    if (least <= opaque) STAY_OPEN(tile);
    // of all columns, as those behind the box go on with the others
    if (CARRIED == 1 && mine.w == 0u && any_open()) {
        IN_TURN {
            turn_sheets();
            write_pixel(tile, turn);
        }
        write_column(tile, current, holding);
    }
}
