"""Open3D's vertex and normal maps, point clouds from depth, and normals of nearest neighbours.

Holes are 0, as Open3D wants them. Timed is what its documentation asks for on every frame: clip_transform (the later steps expect
its output), then the map or cloud; outputs are new memory each time, as its interface knows no other way. A cloud leaves pixels
without a reading out; the answer is put back into its image outside the timed part.
"""

import numpy as np
import open3d as o3d

from worker import Method

NAME, VERSION = "Open3D", o3d.__version__
o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)

# Beyond any depth of the bench, metres: noise makes kilometres of a horizon.
FAR = 1e6
# How many neighbours estimate_normals looks at by default.
NEIGHBOURS = 30


def methods(frame):
    image = o3d.t.geometry.Image(o3d.core.Tensor.from_numpy(np.ascontiguousarray(frame.depth[..., None])))
    camera = o3d.core.Tensor(frame.matrix)
    scale = 1000.0 if frame.in_millimetres else 1.0
    eye = o3d.core.Tensor([0.0, 0.0, 0.0], o3d.core.float32)

    def vertices(sigma=None):
        clipped = image.clip_transform(scale, 0.0, FAR, 0.0)
        if sigma:
            clipped = clipped.filter_bilateral(5, sigma, 5.0)
        return clipped.create_vertex_map(camera, 0.0)

    def cloud():
        return o3d.t.geometry.PointCloud.create_from_depth_image(image, camera, depth_scale=scale, depth_max=FAR)

    def neighbours():
        points = cloud()
        points.estimate_normals(NEIGHBOURS)
        points.orient_normals_towards_camera_location(eye)
        return points

    def of_map(answer):
        return answer.as_tensor().numpy()

    def of_cloud(name):
        def array(answer):
            out = np.full((frame.height, frame.width, 3), np.nan, np.float32)
            out[(frame.depth > 0) & (frame.depth / scale < FAR)] = answer.point[name].numpy()
            return out

        return array

    yield Method("points", "vertex-map", "Open3D vertex map", vertices, of_map)
    yield Method("points", "cloud", "Open3D cloud", cloud, of_cloud("positions"))
    yield Method("normals", "map", "Open3D map", lambda: vertices().create_normal_map(0.0), of_map)
    yield Method("normals", "bilateral", "Open3D bilateral", lambda: vertices(0.05).create_normal_map(0.0), of_map)
    yield Method("normals", "knn", f"Open3D {NEIGHBOURS} nearest", neighbours, of_cloud("normals"))
