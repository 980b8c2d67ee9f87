// The state of a card's sort, which no pass reads back: numbers of entries and the sizes of the next dispatches.
#constant SORT_LANES
#constant SORT_BLOCK  // entries that a group sorts
layout(std430, binding = 0) buffer Work {
    uint entries;     // pairs to sort
    uint drawn;       // splats that the order by sheets shows, which come first
    uint most;        // most pairs that a part of the picture needed
    uint total;       // pairs that were counted last
    uvec4 by_entry;   // groups of a pass with one lane an entry,
    uvec4 by_block;   // and of one with SORT_BLOCK entries a group
};

uint blocks_of(uint number) {
    return (number + SORT_BLOCK - 1u) / SORT_BLOCK;
}

void set_entries(uint number) {
    entries = number;
    by_entry = uvec4((number + SORT_LANES - 1u) / SORT_LANES, 1u, 1u, 0u);
    by_block = uvec4(blocks_of(number), 1u, 1u, 0u);
}
