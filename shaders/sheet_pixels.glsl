// Composites the sheets of a tile on a graphics card: each invocation draws one pixel, from batches of splats that all
// share, until it is opaque or behind its box.
#include "staged_splats.glsl"
#include "tile_states.glsl"
#define FAR_SHEET 0x7fffffff  // behind all sheets

// Whether the pixel is opaque, or the sheet that is closed next, and all behind it, show nothing of the volume's box.
bool is_opaque() {
    return IN_ORDER && light[0].a > opaque;
}

bool is_behind(int current) {
    return STEPS > 0 && (float(current) - 1.5 >= ends[0].y || ends[0].x >= ends[0].y);
}

// Adds `count` staged splats to the pixel, and closes the sheets that they have passed, or all if no more splats follow.
// Returns whether the pixel needs no more.
bool add_batch(Ray ray, uint count, bool last, inout int current, inout int holding) {
    for (uint i = 0u;;) {
        int base = i < count ? sheet_base(staged_matters[i].a) : last ? FAR_SHEET : current;
        if (base > current && holding > 0) {
            if (take_sheet(0, current)) close_sheet(0, current);
            current++;
            holding--;
            if (is_opaque() || is_behind(current)) return true;
        } else if (i < count && STEPS > 0 && float(base + SHEETS) < floor(ends[0].x)) {
            // all of its sheets are before the box
            i++;
        } else if (i < count) {
            current = max(base, current);
            Joined it = staged_splat(i);
            add_splat(0, it, ray, sheet_weights(it.last - float(current)));
            // classified after, what they hold reaches a sheet further, which the next one ends
            holding = max(holding, SHEETS + (STEPS > 0 ? 2 : 0));
            i++;
        } else return false;
    }
}

void composite_tile(uvec4 mine, uint lane) {
    uint tile = mine.x, at = mine.y, end = mine.z;
    uint state = open[tile];
    // the sheets around the eye may have no list
    bool waits = mine.w == 1u && (state == CONTINUED || NEAR == 1);
    if (state == CLOSED || (at == end && !waits)) return;
    ivec2 pixel = first_pixel(tile, lane);
    first = vec2(pixel) + 0.5;
    set_column(tile, lane);
    Ray ray = ray_of(first);
    open_pixel(0);
    begin_matter(0, state == CONTINUED);
    coverage = table_quad(vec3(0.0)).coverage;
    // the nearest open sheet, and how many sheets from it on may hold something
    int current = 0, holding = 0;
    bool begun = false;
    if (CARRIED == 1 && state == CONTINUED) {
        light[0] = imageLoad(target, pixel);
        read_pixel(tile, 0);
        read_column(tile, current, holding, begun);
    }
    if (NEAR == 1 && !begun) {
        current = planes().x;
        holding = planes().y;
    }
    bool inside = all(lessThan(pixel, imageSize(target)));
    bool ended = !inside || is_opaque() || is_behind(current), counted = false;
    if (lane == 0u) finished = 0u;
    begin_state();
    do {
        uint count = min(end - at, BATCH);
        if (lane < count) stage_splat(lane, at + lane);
        wait_for_all();
        at += count;
        if (!ended) ended = add_batch(ray, count, mine.w == 1u && at == end, current, holding);
        if (ended && !counted) atomicAdd(finished, 1u);
        counted = ended;
        wait_for_all();
    } while (at < end && finished < uint(LANES));
    end_matter(0);
    if (inside) imageStore(target, pixel, mine.w == 1u && !partial ? shown(light[0]) : light[0]);
    // one value is shown of what is in the box when the list is complete
    bool is_done = is_opaque() || (is_behind(current) && (mine.w == 1u || !ONE_VALUE));
    set_state(tile, inside && !is_done);
    if (CARRIED == 1 && mine.w == 0u) {
        write_pixel(tile, 0);
        write_column(tile, current, holding);
    }
}
