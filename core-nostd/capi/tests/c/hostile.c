/* Calls that should never be made: each must return its code, write nothing, and crash nowhere. Valid as C11 and as C++14. */
#include "isobath.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { W = 16, H = 12, C = 8 };

static int failures = 0;

static void expect(isobath_status got, isobath_status want, const char *what, int line) {
    if (got != want) {
        printf("line %d: %s: %d (%s), expected %d (%s)\n", line, what, (int)got, isobath_status_text(got), (int)want,
               isobath_status_text(want));
        failures++;
    }
}
#define EXPECT(call, name) expect((call), ISOBATH_STATUS_##name, #call, __LINE__)

/* A pointer one byte on: made without the cast that compilers warn of. */
static void *askew(void *pointer) { return (char *)pointer + 1; }

int main(void) {
    const size_t bytes = isobath_context_size(W, H, C, C);
    /* Exactly as much as is asked for, so that a checker sees every byte beyond. */
    uint64_t *memory = (uint64_t *)malloc(bytes), *other = (uint64_t *)malloc(bytes + 8);
    uint16_t *depth = (uint16_t *)malloc(2 * W * H + 2);
    isobath_camera camera = {15.0f, 15.0f, 7.5f, 5.5f}, bad;
    isobath_map map, wrong;
    isobath_context *context = NULL, *garbage = (isobath_context *)other;
    isobath_hit hit;
    isobath_normal_answer normal;
    isobath_ray_hit ray;
    isobath_vote_answer vote;
    isobath_place_wish wish;
    isobath_place_answer place;
    isobath_ground ground;
    isobath_walker walker;
    isobath_path_answer path;
    isobath_vec3 zero = {0.0f, 0.0f, 0.0f}, ahead = {0.0f, 0.0f, 1.0f}, nan3 = {NAN, 0.0f, 0.0f}, points[4];
    isobath_box box = {{0.0f, 0.0f, 1.0f}, {0.1f, 0.1f, 0.1f}, {0.0f, 0.0f, 0.0f, 1.0f}}, crooked;
    isobath_pose pose = {{0.0f, 0.0f, 0.0f, 1.0f}, {0.0f, 0.0f, 0.0f}}, unposed = pose;
    uint16_t *image = NULL;

    if (!memory || !other || !depth) return 2;
    for (size_t i = 0; i < W * H; i++) depth[i] = 1000;

    /* Sizes. */
    if (isobath_context_size(0, H, 0, 0) || isobath_context_size(W, 0, 0, 0) || isobath_context_size(ISOBATH_MAX_SIDE + 1, 1, 0, 0) ||
        isobath_context_size(UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT32_MAX) || isobath_context_size(W, H, 0, 1) ||
        isobath_context_size(W, H, 65536, 65536)) {
        printf("sizes that can't be have a size\n");
        failures++;
    }

    /* Defaults. */
    EXPECT(isobath_map_defaults(NULL), ERROR_NULL);
    EXPECT(isobath_place_defaults((isobath_place_wish *)askew(&wish)), ERROR_MISALIGNED);
    EXPECT(isobath_map_defaults(&map), OK);
    EXPECT(isobath_place_defaults(&wish), OK);
    EXPECT(isobath_walker_defaults(&walker), OK);
    map.columns = map.rows = C;

    /* Init. */
    EXPECT(isobath_init(NULL, bytes, &camera, W, H, 0.001f, &map, &context), ERROR_NULL);
    EXPECT(isobath_init(memory, bytes, NULL, W, H, 0.001f, &map, &context), ERROR_NULL);
    EXPECT(isobath_init(memory, bytes, &camera, W, H, 0.001f, &map, NULL), ERROR_NULL);
    EXPECT(isobath_init(askew(other), bytes, &camera, W, H, 0.001f, &map, &context), ERROR_MISALIGNED);
    EXPECT(isobath_init((char *)other + 4, bytes, &camera, W, H, 0.001f, &map, &context), ERROR_MISALIGNED);
    EXPECT(isobath_init(memory, bytes, (isobath_camera *)askew(&camera), W, H, 0.001f, &map, &context), ERROR_MISALIGNED);
    EXPECT(isobath_init(memory, bytes - 1, &camera, W, H, 0.001f, &map, &context), ERROR_TOO_LITTLE_MEMORY);
    EXPECT(isobath_init(memory, 0, &camera, W, H, 0.001f, &map, &context), ERROR_TOO_LITTLE_MEMORY);
    EXPECT(isobath_init(memory, bytes, &camera, 0, H, 0.001f, &map, &context), ERROR_SIZE);
    EXPECT(isobath_init(memory, bytes, &camera, W, UINT32_MAX, 0.001f, &map, &context), ERROR_SIZE);
    for (int i = 0; i < 5; i++) {
        bad = camera;
        if (i == 0) bad.fx = NAN;
        if (i == 1) bad.fy = 0.0f;
        if (i == 2) bad.cx = INFINITY;
        if (i == 3) bad.cy = NAN;
        if (i == 4) bad.fx = 1e-30f;
        EXPECT(isobath_init(memory, bytes, &bad, W, H, 0.001f, &map, &context), ERROR_CAMERA);
    }
    EXPECT(isobath_init(memory, bytes, &camera, W, H, 0.0f, &map, &context), ERROR_UNIT);
    EXPECT(isobath_init(memory, bytes, &camera, W, H, NAN, &map, &context), ERROR_UNIT);
    wrong = map;
    wrong.rows = UINT32_MAX;
    EXPECT(isobath_init(memory, bytes, &camera, W, H, 0.001f, &wrong, &context), ERROR_SIZE);
    wrong = map;
    wrong.rows = 0;
    EXPECT(isobath_init(memory, bytes, &camera, W, H, 0.001f, &wrong, &context), ERROR_SIZE);
    wrong = map;
    wrong.cell = NAN;
    EXPECT(isobath_init(memory, bytes, &camera, W, H, 0.001f, &wrong, &context), ERROR_GRID);
    wrong = map;
    wrong.forward = wrong.up;
    EXPECT(isobath_init(memory, bytes, &camera, W, H, 0.001f, &wrong, &context), ERROR_GRID);
    wrong = map;
    wrong.pixel_step = 0;
    EXPECT(isobath_init(memory, bytes, &camera, W, H, 0.001f, &wrong, &context), ERROR_PARAMETER);
    wrong = map;
    wrong.clearance = NAN;
    EXPECT(isobath_init(memory, bytes, &camera, W, H, 0.001f, &wrong, &context), ERROR_PARAMETER);
    if (context != NULL) {
        printf("an init that failed wrote the context\n");
        failures++;
    }

    /* What is no context. */
    memset(other, 0, bytes);
    for (int i = 0; i < 3; i++) {
        if (i == 1) memset(other, 0xff, bytes);
        if (i == 2) memset(other, 0xa5, bytes);
        EXPECT(isobath_hit_test(garbage, 1.0f, 1.0f, &hit), ERROR_CONTEXT);
        EXPECT(isobath_push_frame(garbage, depth, 2 * W, NULL, 0), ERROR_CONTEXT);
        EXPECT(isobath_path(garbage, &zero, &ahead, NULL, points, 4, &path), ERROR_CONTEXT);
    }
    EXPECT(isobath_hit_test(NULL, 1.0f, 1.0f, &hit), ERROR_NULL);
    EXPECT(isobath_integrate(NULL, NULL), ERROR_NULL);
    EXPECT(isobath_hit_test((isobath_context *)askew(memory), 1.0f, 1.0f, &hit), ERROR_MISALIGNED);

    /* Before a frame. */
    EXPECT(isobath_init(memory, bytes, &camera, W, H, 0.001f, &map, &context), OK);
    EXPECT(isobath_hit_test(context, 1.0f, 1.0f, &hit), ERROR_NO_FRAME);
    EXPECT(isobath_normal(context, 1, 1, 0, &normal), ERROR_NO_FRAME);
    EXPECT(isobath_ray_cast(context, &zero, &ahead, 20.0f, 0, &ray), ERROR_NO_FRAME);
    EXPECT(isobath_vote(context, &box, NULL, &vote), ERROR_NO_FRAME);
    wish.half = box.half;
    EXPECT(isobath_place(context, 1, 1, &wish, &place), ERROR_NO_FRAME);
    EXPECT(isobath_integrate(context, NULL), ERROR_NO_FRAME);
    EXPECT(isobath_path(context, &zero, &zero, NULL, points, 4, &path), OK);
    if (path.outcome != ISOBATH_PATH_OUTCOME_START_UNKNOWN) {
        printf("a path over nothing: %d\n", (int)path.outcome);
        failures++;
    }

    /* Frames. */
    EXPECT(isobath_push_frame(context, NULL, 2 * W, NULL, 0), ERROR_NULL);
    EXPECT(isobath_push_frame(context, (uint16_t *)askew(depth), 2 * W, NULL, 0), ERROR_MISALIGNED);
    EXPECT(isobath_push_frame(context, depth, 2 * W - 2, NULL, 0), ERROR_STRIDE);
    EXPECT(isobath_push_frame(context, depth, 2 * W + 1, NULL, 0), ERROR_STRIDE);
    EXPECT(isobath_push_frame(context, depth, 0, NULL, 0), ERROR_STRIDE);
    EXPECT(isobath_push_frame(context, depth, SIZE_MAX - 1, NULL, 0), ERROR_STRIDE);
    EXPECT(isobath_push_frame(context, depth, SIZE_MAX / 2 - 1, NULL, 0), ERROR_STRIDE);
    unposed.rotation.w = 2.0f;
    EXPECT(isobath_push_frame(context, depth, 2 * W, &unposed, 0), ERROR_POSE);
    unposed.rotation.w = NAN;
    EXPECT(isobath_push_frame(context, depth, 2 * W, &unposed, 0), ERROR_POSE);
    unposed = pose;
    unposed.position.y = INFINITY;
    EXPECT(isobath_push_frame(context, depth, 2 * W, &unposed, 0), ERROR_POSE);
    EXPECT(isobath_push_frame(context, depth, 2 * W, (isobath_pose *)askew(&pose), 0), ERROR_MISALIGNED);
    EXPECT(isobath_hit_test(context, 1.0f, 1.0f, &hit), ERROR_NO_FRAME);
    EXPECT(isobath_begin_frame(context, NULL), ERROR_NULL);
    EXPECT(isobath_begin_frame(context, &image), OK);
    EXPECT(isobath_push_frame(context, image, 2 * W, NULL, 0), ERROR_OVERLAP);
    EXPECT(isobath_hit_test(context, 1.0f, 1.0f, &hit), ERROR_NO_FRAME);
    EXPECT(isobath_end_frame(context, &unposed, 0), ERROR_POSE);
    EXPECT(isobath_end_frame(context, &pose, 0), OK);
    EXPECT(isobath_hit_test(context, 1.0f, 1.0f, &hit), OK);
    if (hit.outcome != ISOBATH_HIT_OUTCOME_NO_DEPTH) {
        printf("an image of zeros has a hit\n");
        failures++;
    }
    EXPECT(isobath_push_frame(context, depth, 2 * W, &pose, INT64_MIN), OK);

    /* Questions. */
    EXPECT(isobath_hit_test(context, 1.0f, 1.0f, NULL), ERROR_NULL);
    EXPECT(isobath_hit_test(context, 1.0f, 1.0f, (isobath_hit *)askew(&hit)), ERROR_MISALIGNED);
    EXPECT(isobath_hit_test(context, NAN, INFINITY, &hit), OK);
    if (hit.outcome != ISOBATH_HIT_OUTCOME_OUTSIDE_VIEW || hit.time_ns != INT64_MIN) {
        printf("a position that is no number is in the view\n");
        failures++;
    }
    EXPECT(isobath_normal(context, 1, 1, 8, &normal), ERROR_PARAMETER);
    EXPECT(isobath_normal(context, UINT32_MAX, UINT32_MAX, 7, &normal), OK);
    EXPECT(isobath_ray_cast(context, &zero, &zero, 20.0f, 0, &ray), ERROR_PARAMETER);
    EXPECT(isobath_ray_cast(context, &nan3, &ahead, 20.0f, 0, &ray), ERROR_PARAMETER);
    EXPECT(isobath_ray_cast(context, &zero, &ahead, NAN, 0, &ray), ERROR_PARAMETER);
    EXPECT(isobath_ray_cast(context, &zero, &ahead, 20.0f, 3, &ray), ERROR_PARAMETER);
    EXPECT(isobath_ray_cast(context, NULL, &ahead, 20.0f, 0, &ray), ERROR_NULL);
    crooked = box;
    crooked.rotation.w = 0.0f;
    EXPECT(isobath_vote(context, &crooked, NULL, &vote), ERROR_POSE);
    crooked = box;
    crooked.half.y = -1.0f;
    EXPECT(isobath_vote(context, &crooked, NULL, &vote), ERROR_PARAMETER);
    EXPECT(isobath_vote(context, NULL, NULL, &vote), ERROR_NULL);
    wish.half.x = 0.0f;
    EXPECT(isobath_place(context, 1, 1, &wish, &place), ERROR_PARAMETER);
    wish.half.x = NAN;
    EXPECT(isobath_place(context, 1, 1, &wish, &place), ERROR_PARAMETER);
    wish.half.x = 0.1f;
    wish.upright = 2;
    EXPECT(isobath_place(context, 1, 1, &wish, &place), ERROR_PARAMETER);
    EXPECT(isobath_place(context, 1, 1, NULL, &place), ERROR_NULL);
    EXPECT(isobath_ground_at(context, &nan3, &ground), OK);
    if (ground.outcome != ISOBATH_GROUND_OUTCOME_OUTSIDE_MAP) {
        printf("a point that is no number is on the map\n");
        failures++;
    }
    EXPECT(isobath_set_noise(context, -1.0f, 0.0f, 0.0f), ERROR_PARAMETER);
    EXPECT(isobath_set_noise(context, 0.0f, NAN, 0.0f), ERROR_PARAMETER);

    /* Paths. */
    EXPECT(isobath_integrate(context, NULL), OK);
    EXPECT(isobath_path(context, &zero, &zero, NULL, NULL, 4, &path), ERROR_NULL);
    EXPECT(isobath_path(context, &zero, &zero, NULL, NULL, 0, &path), OK);
    EXPECT(isobath_path(context, &zero, &zero, NULL, (isobath_vec3 *)askew(points), 4, &path), ERROR_MISALIGNED);
    EXPECT(isobath_path(context, &zero, &zero, NULL, (isobath_vec3 *)memory, 4, &path), ERROR_OVERLAP);
    EXPECT(isobath_path(context, &nan3, &zero, NULL, points, 4, &path), OK);
    walker.max_slope = 2.0f;
    EXPECT(isobath_path(context, &zero, &zero, &walker, points, 4, &path), ERROR_PARAMETER);
    EXPECT(isobath_walker_defaults(&walker), OK);
    walker.unknown = -1;
    EXPECT(isobath_path(context, &zero, &zero, &walker, points, 4, &path), ERROR_PARAMETER);
    wrong = map;
    wrong.columns = C + 1;
    EXPECT(isobath_map_restart(context, &wrong), ERROR_SIZE);
    wrong = map;
    wrong.centre.x = NAN;
    EXPECT(isobath_map_restart(context, &wrong), ERROR_GRID);
    EXPECT(isobath_map_restart(context, NULL), ERROR_NULL);

    /* Moved, overwritten, made anew. */
    memcpy(other, memory, bytes);
    EXPECT(isobath_hit_test(garbage, 1.0f, 1.0f, &hit), ERROR_CONTEXT);
    for (size_t i = 0; i < ISOBATH_HEADER_BYTES; i++) {
        ((unsigned char *)memory)[i] ^= 0x10;
        EXPECT(isobath_hit_test(context, 1.0f, 1.0f, &hit), ERROR_CONTEXT);
        ((unsigned char *)memory)[i] ^= 0x10;
    }
    EXPECT(isobath_hit_test(context, 1.0f, 1.0f, &hit), OK);
    /* The parts behind the header are data: whatever is written there is an answer, not a crash. */
    for (int fill = 0; fill < 256; fill += 51) {
        memset((char *)memory + ISOBATH_HEADER_BYTES, fill, bytes - ISOBATH_HEADER_BYTES);
        wish.upright = 0;
        EXPECT(isobath_hit_test(context, 8.0f, 6.0f, &hit), OK);
        EXPECT(isobath_ray_cast(context, &zero, &ahead, 20.0f, 0, &ray), OK);
        EXPECT(isobath_place(context, 8, 6, &wish, &place), OK);
        EXPECT(isobath_path(context, &zero, &zero, NULL, points, 4, &path), OK);
        EXPECT(isobath_integrate(context, NULL), OK);
        EXPECT(isobath_map_fade(context), OK);
    }

    /* Without a map. */
    EXPECT(isobath_init(memory, bytes, &camera, W, H, 0.001f, NULL, &context), OK);
    EXPECT(isobath_push_frame(context, depth, 2 * W, NULL, 0), OK);
    EXPECT(isobath_hit_test(context, 1.0f, 1.0f, &hit), OK);
    EXPECT(isobath_integrate(context, NULL), ERROR_NO_MAP);
    EXPECT(isobath_path(context, &zero, &zero, NULL, points, 4, &path), ERROR_NO_MAP);
    EXPECT(isobath_ground_at(context, &zero, &ground), ERROR_NO_MAP);
    EXPECT(isobath_map_fade(context), ERROR_NO_MAP);
    EXPECT(isobath_map_restart(context, &map), ERROR_NO_MAP);

    for (int32_t status = -20; status < 3; status++)
        if (!isobath_status_text(status)[0]) failures++;
    free(memory);
    free(other);
    free(depth);
    printf("%d failures\n", failures);
    return failures != 0;
}
