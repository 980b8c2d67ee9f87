// A pass of a stable radix sort of pairs by four bits of their first word, on a card: counts the digits of each block of
// SORT_BLOCK pairs, or moves the pairs to their places. Between the two, card_scan.comp sums the counts.
// switch COUNTING 0  only counts
// switch LAST 0      writes the second words to an image
// version 430
#constant SORT_LANES
#constant ABREAST
layout(local_size_x = SORT_LANES) in;
#include "group_scan.glsl"
#include "card_work.glsl"
#define DIGITS 16u

// of each digit and block: the number of pairs; then of those before them
layout(std430, binding = 1) buffer Counts { uint counts[]; };
layout(std430, binding = 2) readonly buffer Pairs { uvec2 pairs[]; };
layout(std430, binding = 4) writeonly buffer Sorted { uvec2 sorted[]; };
layout(r32ui, binding = 0) writeonly uniform uimage2D order;
uniform uint shift;  // bits below the digit

shared uint begins[DIGITS];
shared uint last_digit;

void main() {
    uint lane = gl_LocalInvocationID.x, block = gl_WorkGroupID.x, blocks = blocks_of(entries);
    uint first = block * SORT_BLOCK, end = min(first + SORT_BLOCK, entries);
    if (lane < DIGITS) begins[lane] = COUNTING == 1 ? 0u : counts[lane * blocks + block];
    wait_for_all();
    for (uint start = first; start < end; start += SORT_LANES) {
        uint n = start + lane;
        uvec2 pair = n < end ? pairs[n] : uvec2(0u);
        uint digit = n < end ? (pair.x >> shift) & (DIGITS - 1u) : DIGITS;
        if (COUNTING == 1) {
            if (digit < DIGITS) atomicAdd(begins[digit], 1u);
        } else {
            // one byte a digit: all lanes but the last have at most 255 before or with them
            uvec4 one = uvec4(equal(uvec4(digit / 4u), uvec4(0u, 1u, 2u, 3u))) << (digit % 4u * 8u);
            scan_group(one);
            if (lane == SORT_LANES - 1u) last_digit = digit;
            wait_for_all();
            if (digit < DIGITS) {
                uint place = begins[digit] + ((scanned_before()[digit / 4u] >> (digit % 4u * 8u)) & 0xffu);
                if (LAST == 1) imageStore(order, ivec2(place % ABREAST, place / ABREAST), uvec4(pair.y));
                else sorted[place] = pair;
            }
            wait_for_all();
            if (lane < DIGITS) {
                uint others = (scanned[SORT_LANES - 2u][lane / 4u] >> (lane % 4u * 8u)) & 0xffu;
                begins[lane] += others + uint(last_digit == lane);
            }
        }
        wait_for_all();
    }
    if (COUNTING == 1 && lane < DIGITS) counts[lane * blocks + block] = begins[lane];
}
