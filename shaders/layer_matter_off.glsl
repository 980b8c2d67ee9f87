// Twin of layer_matter.glsl for a volume alone: keeps nothing.
void set_column(uint tile, uint lane) {}

void begin_matter(int row, bool continues) {}

void turn_matter() {}

void end_matter(int row) {}

void add_matter(int row, vec2 ends, vec4 matter) {}
