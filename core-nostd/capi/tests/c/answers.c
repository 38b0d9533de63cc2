/* Asks the library everything once and prints the answers, floats as their bits. tests/c_program.rs compares them with what the
 * Rust API answers. Valid as C11 and as C++14. */
#include "isobath.h"
#include "scenes.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint64_t memory[ISOBATH_CONTEXT_BYTES(WIDTH, HEIGHT, COLUMNS, ROWS) / 8];
static uint16_t padded[HEIGHT][WIDTH + PAD];

static void must(isobath_status status, const char *what) {
    if (status != ISOBATH_STATUS_OK) {
        printf("%s: %s\n", what, isobath_status_text(status));
        exit(1);
    }
}

static void number(float f) {
    uint32_t bits;
    memcpy(&bits, &f, sizeof bits);
    printf(" %08x", (unsigned)bits);
}

static void vec(isobath_vec3 v) {
    number(v.x);
    number(v.y);
    number(v.z);
}

static void quat(isobath_quat q) {
    number(q.x);
    number(q.y);
    number(q.z);
    number(q.w);
}

static isobath_vec3 vec3(float x, float y, float z) {
    isobath_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static void push(isobath_context *context, uint16_t (*pixel)(uint32_t, uint32_t), const isobath_pose *pose) {
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH + PAD; x++) padded[y][x] = x < WIDTH ? pixel(x, y) : (uint16_t)12345;
    must(isobath_push_frame(context, &padded[0][0], sizeof padded[0], pose, 1234567890123), "push");
}

static void hits(const isobath_context *context) {
    static const float at[][2] = {{20.3f, 10.4f}, {48.0f, 36.0f}, {0.0f, 0.0f}, {95.4f, 71.4f}, {96.0f, 3.0f}, {-0.6f, 3.0f}};
    for (size_t i = 0; i < sizeof at / sizeof at[0]; i++) {
        isobath_hit hit;
        must(isobath_hit_test(context, at[i][0], at[i][1], &hit), "hit");
        printf("hit %d %u %u %u", (int)hit.outcome, (unsigned)hit.has_normal, (unsigned)hit.pixel_x, (unsigned)hit.pixel_y);
        vec(hit.point);
        vec(hit.camera_point);
        vec(hit.normal);
        number(hit.z);
        number(hit.range);
        number(hit.sigma_z);
        printf(" %u", (unsigned)hit.normal_support);
        number(hit.normal_residual);
        printf(" %lld\n", (long long)hit.time_ns);
    }
}

static void normals(const isobath_context *context) {
    static const uint32_t at[][3] = {{20, 10, 0}, {20, 10, 5}, {0, 0, 5}, {39, 35, 2}, {96, 0, 0}, {47, 37, 7}};
    for (size_t i = 0; i < sizeof at / sizeof at[0]; i++) {
        isobath_normal_answer n;
        must(isobath_normal(context, at[i][0], at[i][1], at[i][2], &n), "normal");
        printf("normal %d %u", (int)n.outcome, (unsigned)n.support);
        vec(n.normal);
        vec(n.camera_normal);
        number(n.residual);
        printf("\n");
    }
}

static void rays(const isobath_context *context) {
    static const float to[][3] = {{0.1f, 0.2f, 3.0f}, {-0.5f, -0.3f, 2.0f}, {0.0f, 0.0f, -1.0f}, {0.9f, 0.0f, 1.0f}, {0.3f, 0.0f, 2.0f}};
    for (size_t i = 0; i < sizeof to / sizeof to[0]; i++) {
        for (int32_t holes = 0; holes < 3; holes++) {
            isobath_vec3 origin = vec3(-0.3f, 0.05f, 0.1f), direction = vec3(to[i][0], to[i][1], to[i][2]);
            isobath_ray_hit hit;
            must(isobath_ray_cast(context, &origin, &direction, 20.0f, holes, &hit), "ray");
            printf("ray %d", (int)hit.outcome);
            vec(hit.point);
            number(hit.distance);
            printf(" %u %u", (unsigned)hit.pixel_x, (unsigned)hit.pixel_y);
            number(hit.z);
            printf(" %u %u %u\n", (unsigned)hit.passed_behind, (unsigned)hit.from_hole, (unsigned)hit.left_view);
        }
    }
}

static void votes(const isobath_context *context) {
    static const float at[] = {0.5f, 0.95f, 1.4f, 2.5f, -1.0f};
    for (size_t i = 0; i < sizeof at / sizeof at[0]; i++) {
        isobath_box box;
        isobath_vote_answer vote;
        box.centre = vec3(0.02f, 0.01f, at[i]);
        box.half = vec3(0.1f, 0.08f, 0.1f);
        box.rotation.x = box.rotation.z = 0.0f;
        box.rotation.y = 0.6f;
        box.rotation.w = 0.8f;
        must(isobath_vote(context, &box, NULL, &vote), "vote");
        printf("vote %d %u %u %u %u %u\n", (int)vote.verdict, (unsigned)vote.visible, (unsigned)vote.hidden, (unsigned)vote.holes,
               (unsigned)vote.outside, (unsigned)vote.behind_camera);
    }
}

static void places(const isobath_context *context, isobath_vec3 up) {
    static const uint32_t at[][2] = {{70, 20}, {30, 55}, {48, 36}, {2, 2}, {70, 55}, {200, 3}, {0, 0}};
    for (size_t i = 0; i < sizeof at / sizeof at[0]; i++) {
        isobath_place_wish wish;
        isobath_place_answer place;
        must(isobath_place_defaults(&wish), "place defaults");
        wish.half = vec3(0.1f, 0.15f, 0.1f);
        wish.up = up;
        must(isobath_place(context, at[i][0], at[i][1], &wish, &place), "place");
        printf("place %d", (int)place.outcome);
        vec(place.pose.centre);
        vec(place.pose.half);
        quat(place.pose.rotation);
        vec(place.plane_normal);
        vec(place.plane_point);
        number(place.flatness);
        number(place.tilt);
        number(place.coverage);
        number(place.hidden);
        number(place.unknown);
        printf("\n");
    }
}

static void walks(isobath_context *context) {
    static const float way[][4] = {
        {-0.4f, -0.5f, -0.4f, 0.5f}, {-0.4f, -0.5f, 0.3f, -0.5f}, {0.5f, -0.5f, 0.5f, 0.5f}, {5.0f, 0.0f, 0.0f, 0.0f}, {0.0f, -0.5f, 0.97f, 0.97f}, {0.0f, 0.0f, 0.5f, 0.5f},
    };
    isobath_integrated report;
    must(isobath_integrate(context, &report), "integrate");
    printf("integrated %u %u %u %u\n", (unsigned)report.used, (unsigned)report.overhead, (unsigned)report.outside, (unsigned)report.holes);
    must(isobath_integrate(context, NULL), "integrate");
    for (int i = -3; i < 4; i++) {
        isobath_vec3 point = vec3(0.3f * (float)i, 7.0f, 0.2f * (float)i);
        isobath_ground ground;
        must(isobath_ground_at(context, &point, &ground), "ground");
        printf("ground %d", (int)ground.outcome);
        number(ground.min);
        number(ground.max);
        number(ground.mean);
        printf(" %u\n", (unsigned)ground.support);
    }
    for (size_t i = 0; i < sizeof way / sizeof way[0]; i++) {
        for (size_t capacity = 2; capacity <= 16; capacity += 14) {
            isobath_vec3 from = vec3(way[i][0], 0.0f, way[i][1]), to = vec3(way[i][2], 0.0f, way[i][3]), points[16];
            isobath_walker walker;
            isobath_path_answer path;
            must(isobath_walker_defaults(&walker), "walker defaults");
            walker.radius = 0.1f;
            must(isobath_path(context, &from, &to, &walker, points, capacity, &path), "path");
            printf("path %d %u %u", (int)path.outcome, (unsigned)path.count, (unsigned)path.needed);
            number(path.length);
            number(path.cost);
            printf(" %u", (unsigned)path.expanded);
            for (uint32_t p = 0; p < path.count; p++) vec(points[p]);
            printf("\n");
        }
    }
}

int main(void) {
    isobath_context *context = NULL;
    isobath_camera camera = {80.0f, 81.0f, 47.5f, 35.5f};
    isobath_map map;
    isobath_pose above, askew;
    uint16_t *image;

    printf("version %s\n", isobath_version());
    printf("size %zu %zu %zu\n", isobath_context_size(WIDTH, HEIGHT, COLUMNS, ROWS), isobath_context_size(160, 120, 64, 64),
           isobath_context_size(160, 120, 0, 0));
    for (uint32_t w = 1; w < 8192; w = w * 5 / 3 + 1)
        for (uint32_t h = 1; h < 8192; h = h * 7 / 4 + 1)
            if (isobath_context_size(w, h, w % 7, w % 7 ? 11 : 0) != ISOBATH_CONTEXT_BYTES(w, h, w % 7, w % 7 ? 11 : 0))
                printf("the macro is wrong at %u x %u\n", (unsigned)w, (unsigned)h);

    must(isobath_map_defaults(&map), "map defaults");
    map.centre = vec3(0.0f, 0.0f, 0.0f);
    map.columns = COLUMNS;
    map.rows = ROWS;
    must(isobath_init(memory, sizeof memory, &camera, WIDTH, HEIGHT, 0.001f, &map, &context), "init");

    /* A wall, from a camera that stands askew. */
    askew.rotation.x = 0.1f;
    askew.rotation.y = -0.2f;
    askew.rotation.z = 0.05f;
    askew.rotation.w = 0.974f;
    askew.position = vec3(1.5f, -0.25f, 3.0f);
    push(context, wall, &askew);
    hits(context);
    normals(context);
    must(isobath_set_noise(context, 0.002f, 0.005f, 0.0f), "noise");
    hits(context);

    /* The same without a pose, written straight into the context. */
    must(isobath_begin_frame(context, &image), "begin");
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) image[i] = wall(i % WIDTH, i / WIDTH);
    must(isobath_end_frame(context, NULL, 1234567890123), "end");
    hits(context);
    rays(context);
    votes(context);
    places(context, vec3(0.0f, 0.0f, -1.0f));

    /* A floor from above: the camera looks along -y, its image's top towards -z. */
    above.rotation.x = 0.70710678f;
    above.rotation.y = above.rotation.z = 0.0f;
    above.rotation.w = 0.70710678f;
    above.position = vec3(0.0f, 2.0f, 0.0f);
    push(context, floor_from_above, &above);
    places(context, vec3(0.0f, 1.0f, 0.0f));
    walks(context);
    must(isobath_map_fade(context), "fade");
    map.centre = vec3(0.2f, 0.0f, 0.1f);
    must(isobath_map_restart(context, &map), "restart");
    walks(context);
    return 0;
}
