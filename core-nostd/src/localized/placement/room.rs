//! Is the box free? Looks through every pixel of it.
//!
//! A pixel matters when it has no reading, or one that stands over the support and nearer than the box's far end: only those
//! are asked where their ray leaves the box. How many pixels look through the box at all is counted when a share is wanted, by
//! its two ends in each row (the box is convex).

use glam::{Vec2, Vec3};

use super::{NoPlace, PlaceParams};
use crate::ground::geometry::{OrientedBox, Plane};
use crate::ground::math;
use crate::ground::rotation::rotate_back;
use crate::sensing::camera::Intrinsics;
use crate::sensing::depth::{DepthSample, HolePolicy};
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;
use crate::skipping::pyramid::{FINEST_TILE, Pyramid};

/// The box as the cube from -1 to 1, seen along the rays of pixels.
struct Cube {
    camera: Intrinsics,
    /// The camera.
    eye: Vec3,
    /// What a ray's x, y and z move, in the box's own axes.
    across: Vec3,
    down: Vec3,
    ahead: Vec3,
}

impl Cube {
    fn new<D: DepthSample>(frame: &DepthFrame<'_, D>, room: &OrientedBox) -> Self {
        let pose = frame.pose_or_identity();
        // In parts of the box's half size.
        let to_box = |v: Vec3| rotate_back(room.rotation, v) / room.half;
        let axis = |v: Vec3| to_box(pose.direction_to_world(v));
        Self {
            camera: *frame.intrinsics(),
            eye: to_box(pose.translation() - room.centre),
            across: axis(Vec3::X),
            down: axis(Vec3::Y),
            ahead: axis(Vec3::Z),
        }
    }

    /// Depth at which the pixel's ray leaves the box; `None` when it misses.
    fn leaves(&self, x: usize, y: usize) -> Option<f32> {
        let ray = self.camera.ray(Vec2::new(x as f32, y as f32));
        leaves_cube(self.eye, self.across * ray.x + self.down * ray.y + self.ahead)
    }

    /// Pixels of a row whose rays meet the box: all between the first and the last that does.
    fn through(&self, first: usize, last: usize, y: usize) -> u32 {
        let meets = |x: &usize| self.leaves(*x, y).is_some();
        let Some(first) = (first..=last).find(meets) else { return 0 };
        let last = (first..=last).rev().find(meets).unwrap_or(first);
        (last - first + 1) as u32
    }
}

/// Whether the box is in the view and free. `plane` is the support in the camera's frame.
pub(super) fn check<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    pyramid: Option<&Pyramid<'_, D>>,
    room: &OrientedBox,
    plane: &Plane,
    clearance: f32,
    params: &PlaceParams,
    work: &mut Work,
) -> Result<(), NoPlace> {
    let pose = frame.pose_or_identity();
    let (mut low, mut high, mut farthest) = ((usize::MAX, usize::MAX), (0, 0), 0.0_f32);
    for corner in room.corners() {
        let corner = pose.to_camera(corner);
        let (x, y) = frame.pixel_of(corner).ok_or(NoPlace::OutsideView)?;
        low = (low.0.min(x), low.1.min(y));
        high = (high.0.max(x), high.1.max(y));
        farthest = math::max(farthest, corner.z);
    }
    let cube = Cube::new(frame, room);
    let k = frame.intrinsics();
    let normal = plane.normal();
    let above = plane.distance(Vec3::ZERO) - clearance;
    // Height over the clearance of a reading z: above + z (normal . ray).
    let (mut hidden, mut holes) = (0_u32, 0_u32);
    for ty in low.1 / FINEST_TILE..=high.1 / FINEST_TILE {
        let rows = within(ty, low.1, high.1);
        for tx in low.0 / FINEST_TILE..=high.0 / FINEST_TILE {
            let columns = within(tx, low.0, high.0);
            let count = (columns.len() * rows.len()) as u32;
            // No reading of the tile is nearer than the box's far end: nothing to see there.
            let beyond = pyramid.and_then(|p| p.cell(0, tx, ty)).is_some_and(|cell| {
                let (near, far) = (cell.min.metres(frame.unit()), cell.max.metres(frame.unit()));
                cell.holes == 0 && near >= farthest && far > 0.0
            });
            if beyond {
                work.skipped = work.skipped.saturating_add(count);
                continue;
            }
            work.done = work.done.saturating_add(count);
            for y in rows.clone() {
                let slope = normal.y * ((y as f32 - k.cy()) / k.fy()) + normal.z;
                let readings = frame.depth().row(y).get(columns.clone()).unwrap_or(&[]);
                for (x, value) in columns.clone().zip(readings) {
                    let z = value.metres(frame.unit());
                    if z == 0.0 {
                        holes += u32::from(cube.leaves(x, y).is_some());
                    } else if z < farthest
                        && above + z * (normal.x * ((x as f32 - k.cx()) / k.fx()) + slope) > 0.0
                        && cube.leaves(x, y).is_some_and(|leaves| z < leaves)
                    {
                        hidden += 1;
                    }
                }
            }
        }
    }
    // The shares are of all pixels; without anything hidden or unknown they are 0 however many there are.
    let mut rows = low.1..=high.1;
    let through: u32 = if hidden + holes > 0 {
        rows.map(|y| cube.through(low.0, high.0, y)).sum()
    } else {
        u32::from(rows.any(|y| cube.through(low.0, high.0, y) > 0))
    };
    let share = |n: u32| if through > 0 { n as f32 / through as f32 } else { 0.0 };
    match params.holes {
        HolePolicy::Solid => hidden += holes,
        HolePolicy::Unknown if !(share(holes) <= params.max_unknown) => {
            return Err(NoPlace::Unknown { holes: share(holes) });
        }
        HolePolicy::Unknown | HolePolicy::Free => {}
    }
    // A box that no pixel looks through is smaller than a pixel: nothing is known of it.
    if through == 0 {
        return Err(NoPlace::Unknown { holes: 1.0 });
    }
    if share(hidden) <= params.max_hidden { Ok(()) } else { Err(NoPlace::Blocked { hidden: share(hidden) }) }
}

/// The pixels of a tile from `low` to `high`.
fn within(tile: usize, low: usize, high: usize) -> core::ops::Range<usize> {
    let first = tile * FINEST_TILE;
    first.max(low)..(first + FINEST_TILE).min(high + 1)
}

/// Where a ray from outside or inside leaves the cube from -1 to 1, in lengths of `way`; `None` when it misses.
fn leaves_cube(eye: Vec3, way: Vec3) -> Option<f32> {
    // A zero component gives infinities of the right sign; NaN only in the plane of a face, where either answer is right.
    let (a, b) = ((-Vec3::ONE - eye) / way, (Vec3::ONE - eye) / way);
    let [near, far] = [math::min, math::max].map(|of| [of(a.x, b.x), of(a.y, b.y), of(a.z, b.z)]);
    let enter = math::max(near[0], math::max(near[1], near[2]));
    let leave = math::min(far[0], math::min(far[1], far[2]));
    (leave > 0.0 && enter <= leave).then_some(leave)
}
