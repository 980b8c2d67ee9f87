// Moves an array's values on by a row, the last to the first.
#define UP(of) of[7] = of[6]; of[6] = of[5]; of[5] = of[4]; of[4] = of[3]; of[3] = of[2]; of[2] = of[1]; of[1] = of[0];
#if ROWS == 1
#define TURN(kind, of)
#else
#define TURN(kind, of) { kind last_ = of[7]; UP(of) of[0] = last_; }
#endif
