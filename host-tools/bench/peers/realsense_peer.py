"""librealsense's processing blocks: its point cloud. It has no normals.

Frames enter through a software device. Its depth is 16-bit only, so there is no method for metres as f32. The decimation, spatial,
temporal and hole-filling filters answer questions that isobath has no feature for; they are not compared.
"""

import numpy as np
import pyrealsense2 as rs

from worker import Method

NAME, VERSION = "librealsense", rs.__version__


def depth_frame(frame):
    """The frame in librealsense's own type; what holds it must live as long."""
    lens = rs.intrinsics()
    lens.width, lens.height = frame.width, frame.height
    lens.fx, lens.fy, lens.ppx, lens.ppy = frame.fx, frame.fy, frame.cx, frame.cy
    lens.model, lens.coeffs = rs.distortion.none, [0.0] * 5
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fps = rs.stream.depth, 0, 0, 30
    stream.width, stream.height, stream.bpp, stream.fmt = frame.width, frame.height, 2, rs.format.z16
    stream.intrinsics = lens
    device = rs.software_device()
    sensor = device.add_sensor("depth")
    profile = sensor.add_video_stream(stream)
    sensor.add_read_only_option(rs.option.depth_units, 0.001)
    queue = rs.frame_queue(1)
    sensor.open(profile)
    sensor.start(queue)
    sent = rs.software_video_frame()
    sent.stride, sent.bpp, sent.timestamp, sent.frame_number = 2 * frame.width, 2, 0.0, 1
    sent.domain, sent.profile, sent.depth_units = rs.timestamp_domain.hardware_clock, profile.as_video_stream_profile(), 0.001
    sent.pixels = np.ascontiguousarray(frame.depth)
    sensor.on_video_frame(sent)
    return queue.wait_for_frame(5000).as_depth_frame(), (device, sensor, queue)


def methods(frame):
    if not frame.in_millimetres:
        return
    depth, held = depth_frame(frame)
    block = rs.pointcloud()

    def array(points, _held=held):
        vertices = np.asanyarray(points.get_vertices()).view(np.float32)
        return vertices.reshape(frame.height, frame.width, 3)

    yield Method("points", "pointcloud", "librealsense", lambda: block.calculate(depth), array)
