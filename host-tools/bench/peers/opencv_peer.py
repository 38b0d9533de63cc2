"""OpenCV's RgbdNormals and depthTo3d.

Every normal is timed from the depth image: all methods but LINEMOD take points only, so depthTo3d is part of them. `cache()`, what
OpenCV computes once for a camera, is not timed, and outputs are written to memory that is there already. Holes are NaN in metres
and 0 in millimetres, as OpenCV wants them. LINEMOD's threshold is OpenCV's default for millimetres, the same length for metres.
"""

import cv2
import numpy as np

from worker import Method

NAME, VERSION = "OpenCV", cv2.__version__
cv2.setNumThreads(1)

# Name, window, label. FALS and SRI ask for a window; the other two ignore it. A window of 1 makes FALS answer noise.
NORMALS = [
    ("FALS", 3, "OpenCV FALS 3"),
    ("FALS", 5, "OpenCV FALS 5"),
    ("FALS", 7, "OpenCV FALS 7"),
    ("SRI", 3, "OpenCV SRI 3"),
    ("SRI", 5, "OpenCV SRI 5"),
    ("SRI", 7, "OpenCV SRI 7"),
    ("LINEMOD", 5, "OpenCV LINEMOD"),
    ("CROSS_PRODUCT", 5, "OpenCV cross"),
]


def methods(frame):
    matrix = frame.matrix.astype(np.float32)
    depth = frame.depth if frame.in_millimetres else frame.metres(np.nan)
    shape = (frame.height, frame.width, 4)
    points = np.zeros(shape, np.float32)

    def to_points():
        return cv2.depthTo3d(depth, matrix, points)

    yield Method("points", "depthTo3d", "OpenCV depthTo3d", to_points, lambda answer: answer)
    for name, window, label in NORMALS:
        method = getattr(cv2, f"RgbdNormals_RGBD_NORMALS_METHOD_{name}", None)
        if method is None:
            continue
        threshold = 50.0 if frame.in_millimetres else 0.05
        estimator = cv2.RgbdNormals.create(
            frame.height, frame.width, cv2.CV_32F, matrix, window, threshold, method
        )
        estimator.cache()
        yield Method("normals", f"{name}-{window}".lower(), label, of(estimator, name, depth, to_points, shape), lambda a: a)


def of(estimator, name, depth, to_points, shape):
    normals = np.zeros(shape, np.float32)
    if name == "LINEMOD":
        return lambda: estimator.apply(depth, normals)
    return lambda: estimator.apply(to_points(), normals)
