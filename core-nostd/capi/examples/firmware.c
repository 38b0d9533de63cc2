/* Where a firmware engineer begins: one static block of memory, one frame a call, four questions.
 *
 *     cargo xtask c-library thumbv7em-none-eabihf            # makes target/thumbv7em-none-eabihf/c-library/libisobath_capi.a
 *     arm-none-eabi-gcc -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16 -I core-nostd/capi/include \
 *         firmware.c target/thumbv7em-none-eabihf/c-library/libisobath_capi.a -Wl,--gc-sections ...
 *
 * The library needs memcpy, memset, memcmp and nothing else; it brings its own where your C library has none. It runs on a PC too
 * (`cargo xtask c-library` without a target), which is what the tests do with this file: main() stands in for the sensor. */
#include "isobath.h"

#include <stdio.h>

/* 160 x 120 pixels; 3.2 m x 3.2 m of floor at 5 cm. 146,528 bytes; without the floor (0, 0) 48,224.
 * Of uint64_t, so that it is aligned to ISOBATH_ALIGNMENT. Zeroed: it costs no flash. */
enum { WIDTH = 160, HEIGHT = 120, CELLS = 64 };
static uint64_t memory[ISOBATH_CONTEXT_BYTES(WIDTH, HEIGHT, CELLS, CELLS) / 8];
static isobath_context *context;

/* Once, at start-up. Every function returns a status: ISOBATH_STATUS_OK (0), or below 0 what was wrong with the call. These are
 * mistakes in the program: check them all while you write it. */
static isobath_status start(void) {
    isobath_camera camera = {120.0f, 120.0f, 79.5f, 59.5f}; /* pixels; from your calibration */
    isobath_map map;
    isobath_status status = isobath_map_defaults(&map);
    if (status != ISOBATH_STATUS_OK) return status;
    map.centre.z = -1.5f; /* the world: y up, the camera looks along -z at start */
    map.columns = map.rows = CELLS;
    status = isobath_init(memory, sizeof memory, &camera, WIDTH, HEIGHT, 0.001f /* millimetres */, &map, &context);
    if (status != ISOBATH_STATUS_OK) return status;
    return isobath_set_noise(context, 0.002f, 0.005f, 0.0f); /* a time-of-flight sensor, for the error bars */
}

/* Where the sensor's DMA writes: the context's own image, so that nothing is copied. Between this and end_frame there is no frame
 * to ask about. (If your sensor has its own buffer: isobath_push_frame copies from it instead.) */
static uint16_t *dma_target(void) {
    uint16_t *pixels = NULL;
    return isobath_begin_frame(context, &pixels) == ISOBATH_STATUS_OK ? pixels : NULL;
}

/* Called when the transfer is done, with the pose that your tracking found. Mind your data cache, if there is one. */
static isobath_status on_frame(const isobath_pose *pose, int64_t time_ns) {
    isobath_hit hit;
    isobath_box chair = {{0.0f, 0.45f, -1.2f}, {0.25f, 0.45f, 0.25f}, {0.0f, 0.0f, 0.0f, 1.0f}};
    isobath_vote_answer room;
    isobath_vec3 from = {-0.5f, 0.0f, -1.5f}, to = {0.5f, 0.0f, -1.6f}, way[32];
    isobath_path_answer path;
    isobath_status status = isobath_end_frame(context, pose, time_ns);
    if (status != ISOBATH_STATUS_OK) return status;

    /* What is at the middle of the view? What was found is in the outcome: a hole is an answer, not an error. */
    status = isobath_hit_test(context, 79.5f, 59.5f, &hit);
    if (status != ISOBATH_STATUS_OK) return status;
    switch (hit.outcome) {
        case ISOBATH_HIT_OUTCOME_HIT:
            printf("%s %.2f m off, give or take %.3f m\n", hit.has_normal && hit.normal.y > 0.99f ? "floor" : "something", hit.range,
                   hit.sigma_z);
            break;
        case ISOBATH_HIT_OUTCOME_NO_DEPTH: printf("nobody knows\n"); break;
        default: printf("outside the view\n"); break;
    }

    /* Does a chair, 1.2 m ahead, collide with the room? NULL: the default parameters. */
    status = isobath_vote(context, &chair, NULL, &room);
    if (status != ISOBATH_STATUS_OK) return status;
    printf("the chair's place is %s\n", room.verdict == ISOBATH_VERDICT_FREE      ? "free"
                                        : room.verdict == ISOBATH_VERDICT_BLOCKED ? "taken"
                                                                                  : "not seen");

    /* How does one walk a metre across the floor? The map grows with every frame that is integrated. */
    status = isobath_integrate(context, NULL);
    if (status != ISOBATH_STATUS_OK) return status;
    status = isobath_path(context, &from, &to, NULL, way, sizeof way / sizeof way[0], &path);
    if (status != ISOBATH_STATUS_OK) return status;
    if (path.outcome == ISOBATH_PATH_OUTCOME_FOUND)
        printf("the way has %u corners and %.2f m\n", (unsigned)path.count, path.length);
    else
        printf("no way: outcome %d\n", (int)path.outcome);
    return ISOBATH_STATUS_OK;
}

/* The PC's stand-in for a sensor: a floor, seen from 1.4 m above it, looking down by 45 degrees along -z. */
int main(void) {
    /* Camera to world: x right; y, down in the image, and z, forward, both lean down by 45 degrees. */
    const float half = 0.70710678f;
    isobath_pose pose = {{0.92387953f, 0.0f, 0.0f, 0.38268343f}, {0.0f, 1.4f, 0.0f}};
    uint16_t *pixels;
    isobath_status status = start();
    if (status == ISOBATH_STATUS_OK && (pixels = dma_target()) != NULL) {
        for (int y = 0; y < HEIGHT; y++) {
            float down = half * (((float)y - 59.5f) / 120.0f) + half; /* of the ray with z = 1 */
            for (int x = 0; x < WIDTH; x++) pixels[y * WIDTH + x] = down > 0.3f ? (uint16_t)(1400.0f / down) : 0;
        }
        status = on_frame(&pose, 0);
    }
    if (status != ISOBATH_STATUS_OK) printf("%s\n", isobath_status_text(status));
    return status != ISOBATH_STATUS_OK;
}
