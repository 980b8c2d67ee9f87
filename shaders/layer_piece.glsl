// A piece of a layer's matter in four words: its begin, in sheets from the first; red and green; its optical depth; blue
// and its length, at most LONGEST_PIECE. What includes this says how a pair of shares is packed.
uvec4 packed_piece(vec2 ends, vec4 matter, float brightest) {
    vec3 color = matter.rgb / (matter.a * brightest);
    uint last = packed_pair(vec2(color.b, (ends.y - ends.x) / LONGEST_PIECE));
    return uvec4(floatBitsToUint(ends.x), packed_pair(color.rg), floatBitsToUint(matter.a), last);
}

vec4 matter_of_piece(uvec4 words, float brightest) {
    vec3 color = vec3(unpacked_pair(words.y), unpacked_pair(words.w).x);
    return vec4(color * brightest, 1.0) * uintBitsToFloat(words.z);
}

vec2 ends_of_piece(uvec4 words) {
    float begin = uintBitsToFloat(words.x);
    return vec2(begin, begin + unpacked_pair(words.w).y * LONGEST_PIECE);
}
