/* The frames that answers.c and the Rust test both make: integers only, so that they are the same to the last bit. */
#ifndef SCENES_H
#define SCENES_H

#include <stdint.h>

enum { WIDTH = 96, HEIGHT = 72, PAD = 5, COLUMNS = 40, ROWS = 40 };

/* A slanted wall with holes, a nearer block in its middle. Millimetres. */
static uint16_t wall(uint32_t x, uint32_t y) {
    if ((x * 7 + y * 13) % 31 == 0) return 0;
    if (x >= 40 && x < 56 && y >= 30 && y < 44) return 900;
    return (uint16_t)(1500 + 3 * x + 2 * y);
}

/* A floor seen from straight above, 2 m off, with a step across most of it. Millimetres. */
static uint16_t floor_from_above(uint32_t x, uint32_t y) {
    if (x % 9 == 0 && y % 8 == 0) return 65535;
    if (y >= 32 && y < 40 && x < 60) return 1500;
    return 2000;
}

#endif
