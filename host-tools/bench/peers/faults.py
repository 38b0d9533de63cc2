"""What other libraries make of hostile input: run by hand, `target/peers/venv/bin/python host-tools/bench/peers/faults.py`.

Every case runs in a child process, so that a crash is a line of the table as any other. The frames: a plane that faces the camera at
2 m, or a floor 1.4 m below a level camera, 640x480, focal length 522 px, principal point (319.5, 239.5) unless said otherwise.
"""

import importlib
import json
import os
import subprocess
import sys
import tempfile

import numpy as np

import worker

W, H, F = 640, 480, 522.0
PEERS = ["opencv", "open3d", "pcl"]
PCL = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../../target/peers/pcl-worker")


def frame(depth, cx=None, cy=None, as_it_is=False):
    """A worker's frame without a file; `as_it_is` leaves a library's own form of a hole to the library."""
    made = worker.Frame.__new__(worker.Frame)
    made.depth = depth
    made.height, made.width = depth.shape
    made.fx = made.fy = F
    made.cx = (made.width - 1) / 2 if cx is None else cx
    made.cy = (made.height - 1) / 2 if cy is None else cy
    if as_it_is:
        made.metres = lambda _hole: depth.copy()
    made.matrix = np.array([[F, 0, made.cx], [0, F, made.cy], [0, 0, 1]])
    return made


def wall(width=W, height=H):
    return np.full((height, width), 2.0, np.float32)


def plane(cx=(W - 1) / 2, cy=(H - 1) / 2, tilt=60.0, width=W, height=H):
    """A plane tilted about the vertical, 2 m ahead, by the camera whose principal point is given; and its normal."""
    normal = np.array([np.sin(np.radians(tilt)), 0, -np.cos(np.radians(tilt))])
    x, y = np.meshgrid((np.arange(width) - cx) / F, (np.arange(height) - cy) / F)
    z = 2.0 * normal[2] / (x * normal[0] + y * normal[1] + normal[2])
    return np.where((z > 0) & (z < 20), z, 0).astype(np.float32), normal


def floor():
    """A floor 1.4 m below a level camera, to 20 m; nothing above the horizon."""
    y = np.broadcast_to(((np.arange(H) - (H - 1) / 2) / F)[:, None], (H, W))
    with np.errstate(divide="ignore"):
        z = np.where(y > 0, 1.4 / y, 0)
    return np.where(z < 20, z, 0).astype(np.float32)


def answers(peer, made):
    """Every method's normals by id; a text where the library refuses."""
    if peer == "pcl":
        yield from of_pcl(made)
        return
    try:
        methods = list(importlib.import_module(f"{peer}_peer").methods(made))
    except Exception as error:
        yield "set-up", refusal(error)
        return
    for method in methods:
        if method.row == "normals" and method.id != "knn":
            try:
                yield method.id, np.asarray(method.array(method.run()), np.float64)[..., :3]
            except Exception as error:
                yield method.id, refusal(error)


def refusal(error):
    lines = [line for line in str(error).splitlines() if "rror" in line] or [str(error)]
    return " ".join(f"refused: {lines[0]}".split())[:120]


def of_pcl(made):
    """The same through PCL's worker: a new process for every method, as the first may take it along."""
    with tempfile.TemporaryDirectory() as folder:
        raw, result = os.path.join(folder, "frame"), os.path.join(folder, "result")
        made.depth.tofile(raw)
        kind = "u16" if made.in_millimetres else "f32"
        given = f"frame {made.width} {made.height} {kind} {made.fx} {made.fy} {made.cx} {made.cy} {raw}\n"
        ask = lambda more: subprocess.run([PCL], input=given + more, capture_output=True, text=True, timeout=60)
        for method in json.loads(ask("").stdout)["methods"]:
            if method["row"] != "normals":
                continue
            done = ask(f"result {method['id']} {result}\n")
            if done.returncode:
                yield method["id"], f"killed by signal {-done.returncode} {done.stderr.strip()[-80:]}"
            elif "error" in (said := json.loads(done.stdout.splitlines()[-1])):
                yield method["id"], f"refused: {said['error']}"
            else:
                normals = np.fromfile(result, "<f4").reshape(made.height, made.width, 3)
                yield method["id"], normals.astype(np.float64)


def there(normals):
    return np.isfinite(normals).all(-1) & (normals != 0).any(-1)


def share(mask):
    return f"{100 * mask.mean():.2f} %"


def off(normals, truth):
    """Mean angle to the truth in degrees."""
    ok = there(normals)
    length = np.linalg.norm(normals[ok], axis=-1)
    cosine = np.abs(normals[ok] @ truth) / length
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean() if ok.any() else float("nan")


def one_hole(n):
    near = np.s_[220:261, 300:341]
    lost = (~there(n)[near]).sum() - (not there(n)[240, 320])
    with np.errstate(all="ignore"):
        angle = np.degrees(np.arccos(np.clip(-n[..., 2] / np.linalg.norm(n, axis=-1), -1, 1)))
    angle[~there(n)] = 0
    worst, hole = angle[near].max(), "answered" if there(n)[240, 320] else "left"
    return f"{lost} neighbours lost, the worst {worst:.2f} degrees off ({np.median(angle):.2f} is usual), the hole {hole}"


def hole():
    depth = wall()
    depth[240, 320] = 0
    return depth


def square():
    depth = wall()
    depth[200:280, 280:360] = 0
    return depth


def with_value(value):
    depth = wall()
    depth[200:280, 280:360] = value
    return depth


def millimetres(value):
    depth = np.full((H, W), 2000, np.uint16)
    depth[200:280, 280:360] = value
    return depth


def inside(n):
    block = np.s_[200:280, 280:360]
    return f"{share(there(n)[block])} of the area answered"


def facing(n):
    x, y = np.meshgrid((np.arange(W) - (W - 1) / 2) / F, (np.arange(H) - (H - 1) / 2) / F)
    ok = there(n) & (floor() > 0)
    away = (n[..., 0] * x + n[..., 1] * y + n[..., 2]) > 0
    return f"{share(away[ok])} face away, {off(np.where(ok[..., None], n, np.nan), np.array([0, -1.0, 0])):.2f} degrees off in the mean"


def lengths(n):
    length = np.linalg.norm(n[there(n)], axis=-1)
    return f"lengths {length.min():.3f} to {length.max():.3f}" if length.size else "nothing"


def count(n):
    return f"{int(there(n).sum())} of {n.shape[0] * n.shape[1]} pixels answered"


def tilted(cx, cy):
    depth, normal = plane(cx, cy)
    return frame(depth, cx, cy), lambda n: f"{off(n, normal):.4f} degrees off in the mean"


CASES = {
    "one hole in a wall": lambda: (frame(hole()), one_hole),
    "a square of holes in a wall": lambda: (frame(square()), inside),
    "a square of 0 mm": lambda: (frame(millimetres(0)), inside),
    "a square of 0 m handed over as it is": lambda: (frame(with_value(0.0), as_it_is=True), inside),
    "a square of NaN handed over as it is": lambda: (frame(with_value(np.nan), as_it_is=True), inside),
    "a square of infinity": lambda: (frame(with_value(np.inf)), inside),
    "a square of -1 m": lambda: (frame(with_value(-1.0)), inside),
    "a square of 65535 mm": lambda: (frame(millimetres(65535)), inside),
    "a floor to the horizon": lambda: (frame(floor()), facing),
    "principal point on a pixel": lambda: tilted(320.0, 240.0),
    "principal point off by half a pixel": lambda: tilted(319.5, 239.5),
    "principal point at .95": lambda: tilted(319.95, 239.95),
    "lengths on a tilted plane": lambda: (frame(plane(tilt=75.0)[0]), lengths),
    "1x1": lambda: (frame(wall(1, 1)), count),
    "2x2": lambda: (frame(wall(2, 2)), count),
    "3x3": lambda: (frame(wall(3, 3)), count),
    "empty": lambda: (frame(np.zeros((0, 0), np.float32)), count),
    "nothing but holes": lambda: (frame(np.zeros((H, W), np.float32)), count),
}


def child(peer, case):
    made, say = CASES[case]()
    for name, normals in answers(peer, made):
        print(f"  {peer} {name}: {normals if isinstance(normals, str) else say(normals)}", flush=True)


def main():
    if len(sys.argv) == 3:
        return child(sys.argv[1], sys.argv[2])
    for case in CASES:
        print(case)
        for peer in PEERS:
            command = [sys.executable, "-W", "ignore", os.path.abspath(__file__), peer, case]
            try:
                done = subprocess.run(command, capture_output=True, text=True, timeout=120)
            except subprocess.TimeoutExpired:
                print(f"  {peer}: no end in 120 s")
                continue
            print(done.stdout, end="")
            if done.returncode:
                last = done.stderr.strip().splitlines()[-1:] or [""]
                how = f"killed by signal {-done.returncode}" if done.returncode < 0 else "ended"
                print(f"  {peer}: {how} after the above: {last[0][:110]}")


if __name__ == "__main__":
    main()
