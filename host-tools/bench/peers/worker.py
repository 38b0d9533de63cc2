"""Answers `isobath bench --peers` on behalf of one other library: `worker.py opencv | open3d | realsense | kornia`.

A request is one line on standard input, words with a space between; an answer is one line of JSON on standard output.

    hello                                   {"peer": "OpenCV", "version": "5.0.0"}
    frame W H f32|u16 FX FY CX CY PATH      {"methods": [{"row": "normals", "id": "fals-5", "label": "OpenCV FALS 5"}, ...]}
    run ID REPEATS                          {"cpu_ns": 5012345, "wall_ns": 5013000}
    result ID PATH                          {"written": 921600}
    quit

A frame is a file of W x H little-endian values, rows from the top: f32 metres or u16 millimetres, 0 is no reading. A result is
a file of W x H x 3 little-endian f32: the normal, or the point in metres, of every pixel in the camera's frame (x right, y down,
z forward); NaN or zeros where there is none. Any request may be answered {"error": "why"}; the worker lives on.

What `run` times is all that a user of the library calls for every frame: from a depth image in the library's own type, with holes
as the library wants them, to the answer in memory. Reading the file and making that image is not timed, nor is what is done
once for a camera. Time is the whole process's processor time; the process is bound to one core, so threads can't hide.
"""

import gc
import importlib
import json
import os
import sys
import time

# Before any library starts its threads.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "TBB_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ[name] = "1"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import numpy as np  # noqa: E402


class Frame:
    """A depth image and its camera."""

    def __init__(self, width, height, kind, fx, fy, cx, cy, path):
        self.width, self.height = int(width), int(height)
        self.fx, self.fy, self.cx, self.cy = float(fx), float(fy), float(cx), float(cy)
        values = np.fromfile(path, {"f32": "<f4", "u16": "<u2"}[kind])
        self.depth = values.reshape(self.height, self.width)
        self.matrix = np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])

    @property
    def in_millimetres(self):
        return self.depth.dtype == np.uint16

    def metres(self, hole):
        """Metres as f32, with `hole` where there is no reading."""
        if self.in_millimetres:
            metres = self.depth.astype(np.float32) * np.float32(0.001)
        else:
            metres = self.depth.copy()
        metres[self.depth == 0] = hole
        return metres


class Method:
    """`run` does a frame's work and returns the answer in the library's type; `array` turns that into W x H x 3 f32."""

    def __init__(self, row, name, label, run, array):
        self.row, self.id, self.label, self.run, self.array = row, name, label, run, array


def timed(run, repeats):
    gc.collect()
    gc.disable()
    try:
        wall, cpu = time.perf_counter_ns(), time.process_time_ns()
        for _ in range(repeats):
            run()
        cpu, wall = time.process_time_ns() - cpu, time.perf_counter_ns() - wall
    finally:
        gc.enable()
    return {"cpu_ns": cpu, "wall_ns": wall}


def written(method, path, frame):
    array = np.ascontiguousarray(method.array(method.run())[..., :3], dtype="<f4")
    if array.size != frame.width * frame.height * 3:
        raise ValueError(f"{method.id} answered {array.shape}")
    array.tofile(path)
    return {"written": array.size}


def main():
    # Libraries print to standard output at times: answers go to a copy of it, everything else to standard error.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    peer = importlib.import_module(f"{sys.argv[1]}_peer")
    frame, methods = None, {}
    for line in sys.stdin:
        words = line.split()
        try:
            match words:
                case ["hello"]:
                    answer = {"peer": peer.NAME, "version": peer.VERSION}
                case ["frame", width, height, kind, fx, fy, cx, cy, *_]:
                    # The path is the rest of the line: it may hold spaces.
                    frame = Frame(width, height, kind, fx, fy, cx, cy, line.rstrip("\n").split(" ", 8)[8])
                    methods = {m.id: m for m in peer.methods(frame)}
                    answer = {"methods": [{"row": m.row, "id": m.id, "label": m.label} for m in methods.values()]}
                case ["run", name, repeats]:
                    answer = timed(methods[name].run, int(repeats))
                case ["result", name, *_]:
                    answer = written(methods[name], line.rstrip("\n").split(" ", 2)[2], frame)
                case ["quit"]:
                    return
                case _:
                    answer = {"error": f"not understood: {line.strip()!r}"}
        except Exception as error:  # Whatever a library throws is an answer; a crash ends the process, which is seen too.
            answer = {"error": " ".join(f"{type(error).__name__}: {error}".split())[:300]}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
