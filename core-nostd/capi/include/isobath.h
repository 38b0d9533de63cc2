/* isobath: depth cameras turned into answers. GENERATED from the Rust sources by `cargo xtask header`; do not edit.
 *
 * A context lives in your memory; nothing is allocated. Functions return an isobath_status: 0, or below 0 what is wrong with the
 * call, and then write nothing. What was found in the world is the `outcome` of the answer, with every case named.
 * Null and misaligned pointers and memory that is no context are errors; any other pointer must point to what it should.
 * One context serves one caller at a time, except that functions taking `const isobath_context *` may run at the same time.
 *
 * Units: metres, radians, pixels, nanoseconds. Right-handed; camera x right, y down, z forward; poses are camera-to-world;
 * pixel centres at integers; depth is along the camera's axis; depth 0 and 65535 are "no reading". */

#ifndef ISOBATH_H
#define ISOBATH_H

#include <stddef.h>
#include <stdint.h>

/**
 * What a context's memory must be aligned to, bytes.
 */
#define ISOBATH_ALIGNMENT 8

/**
 * Longest side of a depth image, pixels.
 */
#define ISOBATH_MAX_SIDE 8192

/**
 * Most cells of a map: columns x rows.
 */
#define ISOBATH_MAX_CELLS 16777216

/**
 * Bytes of a context without image and map.
 */
#define ISOBATH_HEADER_BYTES 168

/**
 * What a function returns: 0, or what is wrong with the call. What was found in the world is in the answer.
 */
enum isobath_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * The answer was written.
     */
    ISOBATH_STATUS_OK = 0,
    /**
     * A pointer that must not be null is.
     */
    ISOBATH_STATUS_ERROR_NULL = -1,
    /**
     * A pointer is not aligned for what it points to; memory for a context, not to ISOBATH_ALIGNMENT.
     */
    ISOBATH_STATUS_ERROR_MISALIGNED = -2,
    /**
     * Less memory than isobath_context_size says.
     */
    ISOBATH_STATUS_ERROR_TOO_LITTLE_MEMORY = -3,
    /**
     * A side of the image is 0 or above ISOBATH_MAX_SIDE, or the map has more than ISOBATH_MAX_CELLS cells or a side of 0.
     */
    ISOBATH_STATUS_ERROR_SIZE = -4,
    /**
     * Bytes from row to row: below two a pixel, odd, or so large that the image would not fit in memory.
     */
    ISOBATH_STATUS_ERROR_STRIDE = -5,
    /**
     * A focal length or principal point is not usable: not finite, or a focal length below 0.001 px in size.
     */
    ISOBATH_STATUS_ERROR_CAMERA = -6,
    /**
     * Metres per depth unit are not within 1e-6 to 1e3 (millimetres: 0.001).
     */
    ISOBATH_STATUS_ERROR_UNIT = -7,
    /**
     * A pose has a number that is not finite, or its quaternion's length is not 1 to 1 %.
     */
    ISOBATH_STATUS_ERROR_POSE = -8,
    /**
     * The map's cell size, axes or centre are not usable.
     */
    ISOBATH_STATUS_ERROR_GRID = -9,
    /**
     * Not a context: never initialised, moved after it was, or overwritten.
     */
    ISOBATH_STATUS_ERROR_CONTEXT = -10,
    /**
     * No frame has been pushed yet, or isobath_begin_frame has not been followed by isobath_end_frame.
     */
    ISOBATH_STATUS_ERROR_NO_FRAME = -11,
    /**
     * The context was made without a map.
     */
    ISOBATH_STATUS_ERROR_NO_MAP = -12,
    /**
     * A parameter is out of its documented range.
     */
    ISOBATH_STATUS_ERROR_PARAMETER = -13,
    /**
     * Memory that must not overlap the context does.
     */
    ISOBATH_STATUS_ERROR_OVERLAP = -14,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum isobath_status isobath_status;
#else
typedef int32_t isobath_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What is known of the ground at a point.
 */
enum isobath_ground_outcome
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Its height.
     */
    ISOBATH_GROUND_OUTCOME_KNOWN = 0,
    /**
     * Nothing was seen there.
     */
    ISOBATH_GROUND_OUTCOME_UNKNOWN = 1,
    /**
     * The point is off the map.
     */
    ISOBATH_GROUND_OUTCOME_OUTSIDE_MAP = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum isobath_ground_outcome isobath_ground_outcome;
#else
typedef int32_t isobath_ground_outcome;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * Whether there is a way.
 */
enum isobath_path_outcome
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * There is.
     */
    ISOBATH_PATH_OUTCOME_FOUND = 0,
    /**
     * There is none over known, free ground.
     */
    ISOBATH_PATH_OUTCOME_NO_PATH = 1,
    /**
     * The start is off the map.
     */
    ISOBATH_PATH_OUTCOME_START_OUTSIDE = 2,
    /**
     * Nothing is known of the ground at the start.
     */
    ISOBATH_PATH_OUTCOME_START_UNKNOWN = 3,
    /**
     * The start is, or is too near to, an obstacle.
     */
    ISOBATH_PATH_OUTCOME_START_BLOCKED = 4,
    /**
     * The goal is off the map.
     */
    ISOBATH_PATH_OUTCOME_GOAL_OUTSIDE = 5,
    /**
     * Nothing is known of the ground at the goal.
     */
    ISOBATH_PATH_OUTCOME_GOAL_UNKNOWN = 6,
    /**
     * The goal is, or is too near to, an obstacle.
     */
    ISOBATH_PATH_OUTCOME_GOAL_BLOCKED = 7,
    /**
     * There is a way, but `points` is too short: as many as fit, from the start on, were written; see `needed`.
     */
    ISOBATH_PATH_OUTCOME_POINTS_EXCEEDED = 8,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum isobath_path_outcome isobath_path_outcome;
#else
typedef int32_t isobath_path_outcome;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What a hit test found.
 */
enum isobath_hit_outcome
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * A surface.
     */
    ISOBATH_HIT_OUTCOME_HIT = 0,
    /**
     * The pixel has no reading.
     */
    ISOBATH_HIT_OUTCOME_NO_DEPTH = 1,
    /**
     * The position is outside the depth image.
     */
    ISOBATH_HIT_OUTCOME_OUTSIDE_VIEW = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum isobath_hit_outcome isobath_hit_outcome;
#else
typedef int32_t isobath_hit_outcome;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What is known of a pixel's normal.
 */
enum isobath_normal_outcome
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * A normal.
     */
    ISOBATH_NORMAL_OUTCOME_FOUND = 0,
    /**
     * The pixel has no reading.
     */
    ISOBATH_NORMAL_OUTCOME_NO_DEPTH = 1,
    /**
     * Too few of its neighbours have readings on the same surface.
     */
    ISOBATH_NORMAL_OUTCOME_NO_NORMAL = 2,
    /**
     * The pixel is outside the depth image.
     */
    ISOBATH_NORMAL_OUTCOME_OUTSIDE_VIEW = 3,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum isobath_normal_outcome isobath_normal_outcome;
#else
typedef int32_t isobath_normal_outcome;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What became of a ray.
 */
enum isobath_ray_outcome
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * It hit a surface that the camera sees.
     */
    ISOBATH_RAY_OUTCOME_HIT = 0,
    /**
     * It went behind a surface, and may have hit something there; the point is where it was first behind.
     */
    ISOBATH_RAY_OUTCOME_HIT_OCCLUDED = 1,
    /**
     * It stayed in front of everything seen.
     */
    ISOBATH_RAY_OUTCOME_MISS = 2,
    /**
     * It passed a hole, and hit nothing that is known.
     */
    ISOBATH_RAY_OUTCOME_NO_DEPTH = 3,
    /**
     * It never was in the view.
     */
    ISOBATH_RAY_OUTCOME_OUTSIDE_VIEW = 4,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum isobath_ray_outcome isobath_ray_outcome;
#else
typedef int32_t isobath_ray_outcome;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * Whether there is room.
 */
enum isobath_verdict
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Enough of the box would be visible.
     */
    ISOBATH_VERDICT_FREE = 0,
    /**
     * Enough of it would be hidden in or behind what is there.
     */
    ISOBATH_VERDICT_BLOCKED = 1,
    /**
     * Too few of its points could be judged.
     */
    ISOBATH_VERDICT_UNKNOWN = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum isobath_verdict isobath_verdict;
#else
typedef int32_t isobath_verdict;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * Whether there is a place.
 */
enum isobath_place_outcome
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * There is.
     */
    ISOBATH_PLACE_OUTCOME_FOUND = 0,
    /**
     * The spot, or a corner of the box, is not in the view.
     */
    ISOBATH_PLACE_OUTCOME_OUTSIDE_VIEW = 1,
    /**
     * No surface is seen there, or too little of it.
     */
    ISOBATH_PLACE_OUTCOME_NO_SURFACE = 2,
    /**
     * The surface is too steep: see `tilt`.
     */
    ISOBATH_PLACE_OUTCOME_TOO_STEEP = 3,
    /**
     * The surface is too rough: see `flatness`.
     */
    ISOBATH_PLACE_OUTCOME_TOO_ROUGH = 4,
    /**
     * The surface ends, or is not seen, within the footprint: see `coverage`.
     */
    ISOBATH_PLACE_OUTCOME_TOO_SMALL = 5,
    /**
     * Something is in the box, or hides part of it: see `hidden`.
     */
    ISOBATH_PLACE_OUTCOME_BLOCKED = 6,
    /**
     * Too many of the box's pixels have no reading: see `unknown`.
     */
    ISOBATH_PLACE_OUTCOME_UNKNOWN = 7,
    /**
     * Another reason, which this interface does not know yet.
     */
    ISOBATH_PLACE_OUTCOME_OTHER = 8,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum isobath_place_outcome isobath_place_outcome;
#else
typedef int32_t isobath_place_outcome;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What a pixel without a reading, or a cell that nobody saw, means.
 */
enum isobath_holes
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Nothing is known there, and the answer says so.
     */
    ISOBATH_HOLES_UNKNOWN = 0,
    /**
     * Something is there: the cautious choice.
     */
    ISOBATH_HOLES_SOLID = 1,
    /**
     * Nothing is there.
     */
    ISOBATH_HOLES_FREE = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum isobath_holes isobath_holes;
#else
typedef int32_t isobath_holes;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * All that isobath keeps between two calls, in the caller's memory. Opaque: C sees the name only.
 */
typedef struct isobath_context isobath_context;

/**
 * A point in metres, or a direction.
 */
typedef struct isobath_vec3 {
    /**
     * Camera: right.
     */
    float x;
    /**
     * Camera: down.
     */
    float y;
    /**
     * Camera: forward.
     */
    float z;
} isobath_vec3;

/**
 * Where the ground is mapped, and how.
 */
typedef struct isobath_map {
    /**
     * The map's middle in the world, metres; its height is height 0. Default 0 0 0.
     */
    struct isobath_vec3 centre;
    /**
     * Up in the world, any length but 0. Default 0 1 0.
     */
    struct isobath_vec3 up;
    /**
     * Along the map's rows' numbers, a world direction not along up. Default 0 0 -1.
     */
    struct isobath_vec3 forward;
    /**
     * Side of a cell, metres, 0.001 to 1000. Default 0.05.
     */
    float cell;
    /**
     * Cells to the right. Default 64; 0 and 0: no map.
     */
    uint32_t columns;
    /**
     * Cells forward. Default 64.
     */
    uint32_t rows;
    /**
     * Free height that a walker needs, metres, above 0; what hangs higher does not block. Default 1.
     */
    float clearance;
    /**
     * Readings further above or below the map's plane are left out, metres, above 0. Default 3.
     */
    float reach;
    /**
     * Every n-th pixel of every n-th row is read, 1 or more. Default 1.
     */
    uint32_t pixel_step;
} isobath_map;

/**
 * What became of a frame's readings.
 */
typedef struct isobath_integrated {
    /**
     * Readings that moved a cell.
     */
    uint32_t used;
    /**
     * Readings more than the clearance above their cell's lowest.
     */
    uint32_t overhead;
    /**
     * Readings off the map, or beyond its reach.
     */
    uint32_t outside;
    /**
     * Pixels without a reading.
     */
    uint32_t holes;
} isobath_integrated;

/**
 * The answer of isobath_ground_at. Heights: metres above the map's centre, along up; 0 unless known.
 */
typedef struct isobath_ground {
    /**
     * What is known.
     */
    isobath_ground_outcome outcome;
    /**
     * Lowest reading.
     */
    float min;
    /**
     * Highest reading below the clearance.
     */
    float max;
    /**
     * Mean of the readings.
     */
    float mean;
    /**
     * Readings that took part.
     */
    uint32_t support;
} isobath_ground;

/**
 * Who walks.
 */
typedef struct isobath_walker {
    /**
     * Metres kept from obstacles, 0 or more. Default 0.2.
     */
    float radius;
    /**
     * Highest step up or down, metres, above 0. Default 0.2.
     */
    float max_step;
    /**
     * Steepest slope, radians, above 0 and below pi / 2. Default 0.61.
     */
    float max_slope;
    /**
     * Cost of a metre up or down in metres of level walking, 0 or more. Default 1.
     */
    float climb_cost;
    /**
     * An isobath_holes: cells that nobody saw. Default unknown: not walked on.
     */
    int32_t unknown;
} isobath_walker;

/**
 * The answer of isobath_path; what does not apply is 0.
 */
typedef struct isobath_path_answer {
    /**
     * Whether there is a way.
     */
    isobath_path_outcome outcome;
    /**
     * Points written.
     */
    uint32_t count;
    /**
     * Points that the way has.
     */
    uint32_t needed;
    /**
     * Length of the way, metres.
     */
    float length;
    /**
     * Its cost before it was straightened, metres of level walking.
     */
    float cost;
    /**
     * Cells that the search expanded.
     */
    uint32_t expanded;
} isobath_path_answer;

/**
 * The answer of isobath_hit_test. Without a hit everything is 0 but the outcome, the time and, in a hole, the pixel.
 */
typedef struct isobath_hit {
    /**
     * What was found.
     */
    isobath_hit_outcome outcome;
    /**
     * 1 when `normal` is one.
     */
    uint32_t has_normal;
    /**
     * Column of the reading.
     */
    uint32_t pixel_x;
    /**
     * Row of the reading.
     */
    uint32_t pixel_y;
    /**
     * Where, in the world, metres.
     */
    struct isobath_vec3 point;
    /**
     * The same in the camera's frame, metres.
     */
    struct isobath_vec3 camera_point;
    /**
     * In the world, unit length, facing the camera.
     */
    struct isobath_vec3 normal;
    /**
     * Depth along the camera's axis, metres.
     */
    float z;
    /**
     * Length of the ray from the camera, metres.
     */
    float range;
    /**
     * One standard deviation of `z`, metres (isobath_set_noise).
     */
    float sigma_z;
    /**
     * Readings that the normal rests on.
     */
    uint32_t normal_support;
    /**
     * RMS distance of those readings from the fitted surface, metres.
     */
    float normal_residual;
    /**
     * Always 0.
     */
    uint32_t reserved;
    /**
     * Of the frame, as pushed, nanoseconds.
     */
    int64_t time_ns;
} isobath_hit;

/**
 * The answer of isobath_normal; without a normal, 0 but for the outcome.
 */
typedef struct isobath_normal_answer {
    /**
     * What was found.
     */
    isobath_normal_outcome outcome;
    /**
     * Readings it rests on.
     */
    uint32_t support;
    /**
     * Unit length, in the world, facing the camera.
     */
    struct isobath_vec3 normal;
    /**
     * The same in the camera's frame.
     */
    struct isobath_vec3 camera_normal;
    /**
     * RMS distance of the readings from the fitted surface, metres.
     */
    float residual;
} isobath_normal_answer;

/**
 * The answer of isobath_ray_cast; what does not apply is 0.
 */
typedef struct isobath_ray_hit {
    /**
     * What became of it.
     */
    isobath_ray_outcome outcome;
    /**
     * Where, in the world, metres.
     */
    struct isobath_vec3 point;
    /**
     * Metres from the ray's origin.
     */
    float distance;
    /**
     * Column of the pixel.
     */
    uint32_t pixel_x;
    /**
     * Row of the pixel.
     */
    uint32_t pixel_y;
    /**
     * Depth of the point along the camera's axis, metres.
     */
    float z;
    /**
     * Hit: 1 when it went behind another surface before.
     */
    uint32_t passed_behind;
    /**
     * Hit: 1 when the pixel is a hole taken as solid.
     */
    uint32_t from_hole;
    /**
     * Miss: 1 when it left the view before its end.
     */
    uint32_t left_view;
} isobath_ray_hit;

/**
 * How isobath_vote votes.
 */
typedef struct isobath_vote_params {
    /**
     * Up in the world, any length but 0: tells the box's sides from its top. Default 0 1 0.
     */
    struct isobath_vec3 up;
    /**
     * How far behind a reading a point still counts as visible, metres. Default 0.12.
     */
    float tolerance;
    /**
     * Share of hidden votes from which the box is blocked, 0 to 1. Default 0.5.
     */
    float threshold;
    /**
     * Share of the points that must vote, 0 to 1. Default 0.5.
     */
    float min_voters;
    /**
     * An isobath_holes: what a pixel without a reading votes. Default unknown: nothing.
     */
    int32_t holes;
} isobath_vote_params;

/**
 * A rotation, unit length (to 1 %); none is 0 0 0 1.
 */
typedef struct isobath_quat {
    /**
     * i
     */
    float x;
    /**
     * j
     */
    float y;
    /**
     * k
     */
    float z;
    /**
     * Real part.
     */
    float w;
} isobath_quat;

/**
 * A box in the world.
 */
typedef struct isobath_box {
    /**
     * Its middle, metres.
     */
    struct isobath_vec3 centre;
    /**
     * Half its size along its own axes, metres; not negative.
     */
    struct isobath_vec3 half;
    /**
     * Its axes to the world's.
     */
    struct isobath_quat rotation;
} isobath_box;

/**
 * The answer of isobath_vote: a verdict and the thirteen votes it rests on.
 */
typedef struct isobath_vote_answer {
    /**
     * The answer.
     */
    isobath_verdict verdict;
    /**
     * Points in front of the reading, or behind it within the tolerance.
     */
    uint32_t visible;
    /**
     * Points further behind the reading.
     */
    uint32_t hidden;
    /**
     * Points on pixels without a reading.
     */
    uint32_t holes;
    /**
     * Points outside the image.
     */
    uint32_t outside;
    /**
     * Points not in front of the camera.
     */
    uint32_t behind_camera;
} isobath_vote_answer;

/**
 * What place isobath_place looks for.
 */
typedef struct isobath_place_wish {
    /**
     * Half of the box's width, height and depth, metres, 0.0005 to 500. No default.
     */
    struct isobath_vec3 half;
    /**
     * Up in the world, any length but 0. Default 0 1 0.
     */
    struct isobath_vec3 up;
    /**
     * Where the box's z axis looks, a world direction; 0 0 0, the default: towards the camera.
     */
    struct isobath_vec3 facing;
    /**
     * 0, the default: it lies flat on its support; 1: it stands straight up, whatever the support's tilt.
     */
    int32_t upright;
    /**
     * Largest angle between the support's normal and up, radians. Default 0.17.
     */
    float max_tilt;
    /**
     * Largest RMS distance of the support's readings from its plane, metres. Default 0.015.
     */
    float max_roughness;
    /**
     * Least share of the footprint that lies on the support, 0 to 1. Default 0.8.
     */
    float min_coverage;
    /**
     * What rises above the support by less is part of it, metres. Default 0.02.
     */
    float clearance;
    /**
     * Largest share of the box's pixels that may hold something in or before it, 0 to 1. Default 0.
     */
    float max_hidden;
    /**
     * Largest share of the box's pixels that may be holes, 0 to 1. Default 0.2.
     */
    float max_unknown;
    /**
     * An isobath_holes. Default unknown: counted against max_unknown.
     */
    int32_t holes;
} isobath_place_wish;

/**
 * The answer of isobath_place; what does not apply is 0.
 */
typedef struct isobath_place_answer {
    /**
     * Whether there is a place, or why not.
     */
    isobath_place_outcome outcome;
    /**
     * Found: the box in the world, y up, z facing, standing on its support.
     */
    struct isobath_box pose;
    /**
     * Found: the support's normal in the world, up.
     */
    struct isobath_vec3 plane_normal;
    /**
     * Found: a point of the support, world, metres.
     */
    struct isobath_vec3 plane_point;
    /**
     * RMS distance of the support's readings from its plane, metres.
     */
    float flatness;
    /**
     * Angle between the support's normal and up, radians.
     */
    float tilt;
    /**
     * Share of the footprint that lies on the support, 0 to 1.
     */
    float coverage;
    /**
     * Share of the box's pixels that hold something in or before it, 0 to 1.
     */
    float hidden;
    /**
     * Share of the box's pixels without a reading, 0 to 1.
     */
    float unknown;
} isobath_place_answer;

/**
 * The pinhole that depth was seen through, pixels. Depth of a distorted lens must be straightened first.
 */
typedef struct isobath_camera {
    /**
     * Horizontal focal length, pixels.
     */
    float fx;
    /**
     * Vertical focal length, pixels.
     */
    float fy;
    /**
     * Principal point from the first pixel's centre, pixels.
     */
    float cx;
    /**
     * Principal point from the first pixel's centre, pixels.
     */
    float cy;
} isobath_camera;

/**
 * Where the camera stands: camera-to-world.
 */
typedef struct isobath_pose {
    /**
     * Camera axes to world axes.
     */
    struct isobath_quat rotation;
    /**
     * The camera in the world, metres.
     */
    struct isobath_vec3 position;
} isobath_pose;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * A static, English, zero-terminated text for a status; never null, whatever the number.
 */
const char *isobath_status_text(int32_t status);

/**
 * The library's version, as "0.1.0"; static, never null.
 */
const char *isobath_version(void);

/**
 * Bytes of memory a context takes, for an image of `width` x `height` pixels and a map of `columns` x `rows` cells (0 and 0:
 * without map, and so without paths); 0 when a size is not allowed. ISOBATH_CONTEXT_BYTES says the same at compile time.
 */
size_t isobath_context_size(uint32_t width,
                            uint32_t height,
                            uint32_t columns,
                            uint32_t rows);

/**
 * Writes the defaults: 3.2 m x 3.2 m around the world's origin at 5 cm.
 */
isobath_status isobath_map_defaults(struct isobath_map *map);

/**
 * Lays the map elsewhere, of nothing known: when tracking starts anew, or the user has walked off it. It must not have more
 * cells than the context was made with.
 */
isobath_status isobath_map_restart(struct isobath_context *context,
                                   const struct isobath_map *map);

/**
 * Adds the frame's readings to the map, at its pose. Once a frame, when paths are asked for: about 20 ns a reading on a desktop
 * core. `report` may be null.
 */
isobath_status isobath_integrate(struct isobath_context *context,
                                 struct isobath_integrated *report);

/**
 * Lets what is not seen again fade from the map: call it once a second or so.
 */
isobath_status isobath_map_fade(struct isobath_context *context);

/**
 * How high is the ground below or above a world point (metres)?
 */
isobath_status isobath_ground_at(const struct isobath_context *context,
                                 const struct isobath_vec3 *point,
                                 struct isobath_ground *ground);

/**
 * Writes the defaults: a small character.
 */
isobath_status isobath_walker_defaults(struct isobath_walker *walker);

/**
 * How does one walk there? Plans over what isobath_integrate has mapped, needs no frame.
 *
 * from, to: world, metres; their heights do not matter. walker: null for the defaults.
 * points: receives the corners, start and goal included, at ground height, world, metres; may be null when capacity is 0.
 *
 * See isobath_init; `points` holds `capacity` of them. Memory up to there is overwritten, beyond `count` with nothing of use.
 */
isobath_status isobath_path(struct isobath_context *context,
                            const struct isobath_vec3 *from,
                            const struct isobath_vec3 *to,
                            const struct isobath_walker *walker,
                            struct isobath_vec3 *points,
                            size_t capacity,
                            struct isobath_path_answer *path);

/**
 * What is behind a position of the depth image? `x`, `y`: pixels, fractions count, centres at integers.
 */
isobath_status isobath_hit_test(const struct isobath_context *context, float x, float y, struct isobath_hit *hit);

/**
 * Which way does the surface at a pixel face? `radius`: pixels around it that are fitted, 0 (five pixels, exact on clean depth)
 * to 7; 5 suits single points of a real sensor.
 */
isobath_status isobath_normal(const struct isobath_context *context,
                              uint32_t x,
                              uint32_t y,
                              uint32_t radius,
                              struct isobath_normal_answer *normal);

/**
 * What does a ray hit? `origin`: world, metres. `direction`: world, any length but 0. `max_distance`: metres, default choice 20.
 * `holes`: an isobath_holes.
 */
isobath_status isobath_ray_cast(const struct isobath_context *context,
                                const struct isobath_vec3 *origin,
                                const struct isobath_vec3 *direction,
                                float max_distance,
                                int32_t holes,
                                struct isobath_ray_hit *hit);

/**
 * Writes the defaults.
 */
isobath_status isobath_vote_defaults(struct isobath_vote_params *params);

/**
 * Does a box collide with what is seen? By majority of its corners, middle and sides. `params`: null for the defaults.
 */
isobath_status isobath_vote(const struct isobath_context *context,
                            const struct isobath_box *object,
                            const struct isobath_vote_params *params,
                            struct isobath_vote_answer *verdict);

/**
 * Writes the defaults; set `half` afterwards.
 */
isobath_status isobath_place_defaults(struct isobath_place_wish *wish);

/**
 * Does a box fit on the surface seen at a pixel, and how does it stand there?
 */
isobath_status isobath_place(const struct isobath_context *context,
                             uint32_t x,
                             uint32_t y,
                             const struct isobath_place_wish *wish,
                             struct isobath_place_answer *found);

/**
 * Makes a context of caller memory, which must stay where it is for as long as the context is used. Nothing has to be given
 * back: free or reuse the memory when done.
 *
 * memory: at least isobath_context_size(width, height, columns, rows) bytes, aligned to ISOBATH_ALIGNMENT.
 * camera: of the depth image. width, height: pixels. metres_per_unit: of depth values, 0.001 for millimetres.
 * map: where the ground is mapped for isobath_path; null for none.
 * context: receives the context (the memory's address).
 *
 * As for every function here: what is neither null nor misaligned points to what it says, unused by others during the call.
 */
isobath_status isobath_init(void *memory,
                            size_t bytes,
                            const struct isobath_camera *camera,
                            uint32_t width,
                            uint32_t height,
                            float metres_per_unit,
                            const struct isobath_map *map,
                            struct isobath_context **context);

/**
 * Takes a frame: copies its depth, builds the pyramid. What was asked about the last frame stays the caller's.
 *
 * depth: rows of `width` values, `stride_in_bytes` from row to row (2 * width when tightly packed); 0 and 65535 are holes.
 * pose: where the camera stood, camera-to-world; null when unknown (the world is then the camera's frame).
 * time_ns: of exposure, nanoseconds since any epoch; given back in answers, read by nothing.
 *
 * See isobath_init; `depth` holds (height - 1) * stride_in_bytes + 2 * width bytes.
 */
isobath_status isobath_push_frame(struct isobath_context *context,
                                  const uint16_t *depth,
                                  size_t stride_in_bytes,
                                  const struct isobath_pose *pose,
                                  int64_t time_ns);

/**
 * Gives the context's own depth image to write to: `*depth` receives `width * height` values, tightly packed. Until
 * isobath_end_frame there is no frame, and questions about it return ISOBATH_STATUS_ERROR_NO_FRAME; the map and paths can be used.
 *
 * See isobath_init. The image must not be written any more once isobath_end_frame is called.
 */
isobath_status isobath_begin_frame(struct isobath_context *context,
                                   uint16_t **depth);

/**
 * Closes what isobath_begin_frame opened: the image is complete. `pose` and `time_ns` as for isobath_push_frame.
 */
isobath_status isobath_end_frame(struct isobath_context *context, const struct isobath_pose *pose, int64_t time_ns);

/**
 * The sensor's noise, for the error bars: sigma(z) = constant + linear * z + quadratic * z^2, in metres, and the unit's rounding
 * on top. Default: structured light, 0, 0, 1.425e-3. A typical time-of-flight sensor: 0.002, 0.005, 0. None may be negative.
 */
isobath_status isobath_set_noise(struct isobath_context *context,
                                 float constant,
                                 float linear,
                                 float quadratic);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ISOBATH_H */

/* Bytes of a context, at compile time: ISOBATH_CONTEXT_BYTES(160, 120, 64, 64) is isobath_context_size(160, 120, 64, 64), for sizes
 * that are allowed. So that a context can be static:
 *
 *     static uint64_t memory[ISOBATH_CONTEXT_BYTES(160, 120, 64, 64) / 8];
 */
#define ISOBATH_TILES_(w, h, t) ((((size_t)(w) + (t) - 1) / (t)) * (((size_t)(h) + (t) - 1) / (t)))
#define ISOBATH_LEVEL_(w, h, t) (((size_t)(w) > (t) / 2 || (size_t)(h) > (t) / 2) ? ISOBATH_TILES_(w, h, t) : 0)
#define ISOBATH_PYRAMID_(w, h) \
    (ISOBATH_TILES_(w, h, 4) + ISOBATH_LEVEL_(w, h, 8) + ISOBATH_LEVEL_(w, h, 16) + ISOBATH_LEVEL_(w, h, 32) + \
     ISOBATH_LEVEL_(w, h, 64) + ISOBATH_LEVEL_(w, h, 128) + ISOBATH_LEVEL_(w, h, 256) + ISOBATH_LEVEL_(w, h, 512) + \
     ISOBATH_LEVEL_(w, h, 1024) + ISOBATH_LEVEL_(w, h, 2048) + ISOBATH_LEVEL_(w, h, 4096) + ISOBATH_LEVEL_(w, h, 8192))
#define ISOBATH_CONTEXT_BYTES(w, h, columns, rows) \
    ((ISOBATH_HEADER_BYTES + 24 * (size_t)(columns) * (size_t)(rows) + 2 * (size_t)(w) * (size_t)(h) + \
      6 * ISOBATH_PYRAMID_(w, h) + 7) / 8 * 8)
