// Twin of open_sheets.glsl for lists that one dispatch completes: keeps nothing.
void read_pixel(uint tile, int row) {}

void write_pixel(uint tile, int row) {}

void read_column(uint tile, out int current, out int holding, out bool begun) {
    current = holding = 0;
    begun = false;
}

void write_column(uint tile, int current, int holding) {}
