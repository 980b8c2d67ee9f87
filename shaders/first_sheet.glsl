// The sheet by which splats are sorted.
uniform int near_base;  // of splats with a lower first sheet, no sheet is drawn
uniform vec4 edges;     // slopes, or lengths, of the left, upper, right and lower edge of the pixels that are drawn

// The first of `number` sheets of a splat at a grid position; `number` if it is beyond the edges or not drawn.
uint first_sheet_of(vec3 position, uint number) {
    vec3 v = eye_from_index() * (position - frame.base.xyz) - frame.eye_from_base.xyz;
    bool drawn = reaches(v, edges) && (PERSPECTIVE == 0 || v.z > -frame.depth_reach);
    int base = sheet_base(sheet_place(position));
    return drawn && base >= near_base ? uint(clamp(base, 0, int(number) - 1)) : number;
}
