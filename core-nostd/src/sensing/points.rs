//! Every pixel's point (DepthLab Eq. 1 and 2), one row at a time: the depth image as an organised point cloud.
//!
//! A pixel's point is its depth times its ray. In the camera's frame the rays' x are the same in every row: a table made once
//! a frame. Turned into the world, a ray is linear along the row. So a point costs three to nine multiplications and no
//! division. Points are those of [`DepthFrame::point`] within 2 ulps of their distance, and those of [`DepthFrame::world_point`] within
//! 12 (held by a test); holes are NaN.
//!
//! Memory: [`scratch_len`] floats, four rows (2.5 kB at 160 pixels of width, 10 kB at 640). Cost: README's figures.

use core::fmt;

use glam::Vec3;

use crate::ground::lanes::vectorised;
use crate::sensing::camera::Pose;
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

/// Which frame points are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Space {
    /// The camera's: x right, y down, z forward.
    #[default]
    Camera,
    /// The world, by the frame's pose (without one, the camera's).
    World,
}

/// One row of points, metres; NaN in holes.
#[derive(Debug, Clone, Copy)]
pub struct PointRow<'a> {
    /// First coordinate.
    pub x: &'a [f32],
    /// Second coordinate.
    pub y: &'a [f32],
    /// Third coordinate.
    pub z: &'a [f32],
}

/// Why there are no points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PointsError {
    /// The scratch slice is too short.
    Scratch {
        /// Floats needed ([`scratch_len`]).
        needed: usize,
        /// Floats given.
        got: usize,
    },
    /// The output slice is too short.
    Output {
        /// Points needed: one a pixel.
        needed: usize,
        /// Points given.
        got: usize,
    },
}

impl fmt::Display for PointsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scratch { needed, got } => write!(f, "points need {needed} floats of scratch, got {got}"),
            Self::Output { needed, got } => write!(f, "there are {needed} pixels but room for {got} points"),
        }
    }
}

impl core::error::Error for PointsError {}

/// Floats of scratch needed for images of this width.
#[must_use]
pub const fn scratch_len(width: usize) -> usize {
    width.saturating_mul(4)
}

/// Computes every pixel's point and hands each row, top to bottom, to `each(y, row)`. Returns how many pixels have a point.
///
/// # Errors
/// [`PointsError::Scratch`].
///
/// ```
/// use isobath::sensing::{camera::Intrinsics, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// use isobath::sensing::points::{rows, scratch_len, Space};
/// let wall = DepthArray::<160, 120>::filled(2000);
/// let frame = DepthFrame::new(wall.view(), DepthUnit::MILLIMETRE, Intrinsics::new(120.0, 120.0, 79.5, 59.5)?);
/// let mut scratch = [0.0; scratch_len(160)];
/// let mut right = f32::MIN;
/// let points = rows(&frame, Space::Camera, &mut scratch, |_, row| right = right.max(row.x[159]))?;
/// assert_eq!((points, right), (160 * 120, 1.325)); // 79.5 / 120 * 2 m
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
pub fn rows<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    space: Space,
    scratch: &mut [f32],
    each: impl FnMut(usize, PointRow<'_>),
) -> Result<usize, PointsError> {
    match space {
        Space::Camera => walk::<D, false>(frame, scratch, each),
        Space::World => walk::<D, true>(frame, scratch, each),
    }
}

fn walk<D: DepthSample, const WORLD: bool>(
    frame: &DepthFrame<'_, D>,
    scratch: &mut [f32],
    mut each: impl FnMut(usize, PointRow<'_>),
) -> Result<usize, PointsError> {
    let (width, height) = frame.size();
    let (table, rest) = table(frame, scratch)?;
    let (x, rest) = rest.split_at_mut_checked(width).unwrap_or_default();
    let (y, z) = rest.split_at_mut_checked(width).unwrap_or_default();
    let unit = frame.unit().metres();
    let lines = Lines::of(frame, WORLD);
    let mut points = 0;
    for row in 0..height {
        let line = lines.at(row);
        points += vectorised(
            #[inline(always)]
            || {
                let depth = frame.depth().row(row).iter().zip(table.iter());
                let mut there = 0_u32;
                for (((px, py), pz), (&value, &ray)) in x.iter_mut().zip(y.iter_mut()).zip(z.iter_mut()).zip(depth) {
                    [*px, *py, *pz] = line.point::<D, WORLD>(value, ray, unit);
                    there += u32::from(value.is_valid());
                }
                there as usize
            },
        );
        each(row, PointRow { x, y, z });
    }
    Ok(points)
}

/// As [`rows`], written as one array of points, row by row.
///
/// # Errors
/// [`PointsError`] when scratch is short ([`scratch_len`]) or `out` has less than one place a pixel.
pub fn packed<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    space: Space,
    scratch: &mut [f32],
    out: &mut [[f32; 3]],
) -> Result<usize, PointsError> {
    match space {
        Space::Camera => pack::<D, false>(frame, scratch, out),
        Space::World => pack::<D, true>(frame, scratch, out),
    }
}

fn pack<D: DepthSample, const WORLD: bool>(
    frame: &DepthFrame<'_, D>,
    scratch: &mut [f32],
    out: &mut [[f32; 3]],
) -> Result<usize, PointsError> {
    let (width, height) = frame.size();
    let (needed, got) = (width.saturating_mul(height), out.len());
    if got < needed {
        return Err(PointsError::Output { needed, got });
    }
    let (table, _) = table(frame, scratch)?;
    let unit = frame.unit().metres();
    let lines = Lines::of(frame, WORLD);
    let mut points = 0;
    for (row, out) in out.chunks_exact_mut(width.max(1)).take(height).enumerate() {
        let line = lines.at(row);
        points += vectorised(
            #[inline(always)]
            || {
                let mut there = 0_u32;
                for (to, (&value, &ray)) in out.iter_mut().zip(frame.depth().row(row).iter().zip(table.iter())) {
                    *to = line.point::<D, WORLD>(value, ray, unit);
                    there += u32::from(value.is_valid());
                }
                there as usize
            },
        );
    }
    Ok(points)
}

/// x of every column's ray, and the scratch that is left.
fn table<'s, D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    scratch: &'s mut [f32],
) -> Result<(&'s [f32], &'s mut [f32]), PointsError> {
    let width = frame.size().0;
    let needed = scratch_len(width);
    let got = scratch.len();
    let Some((table, rest)) = scratch.get_mut(..needed).and_then(|scratch| scratch.split_at_mut_checked(width)) else {
        return Err(PointsError::Scratch { needed, got });
    };
    let k = frame.intrinsics();
    for (i, ray) in table.iter_mut().enumerate() {
        *ray = (i as f32 - k.cx()) / k.fx();
    }
    Ok((table, rest))
}

/// The rays of all rows.
struct Lines {
    cy: f32,
    fy: f32,
    /// Columns of the rotation, and where the camera stands.
    axes: [Vec3; 3],
    origin: Vec3,
}

/// The rays of one row: a + b times the column's x.
struct Line {
    a: [f32; 3],
    b: [f32; 3],
    origin: [f32; 3],
}

impl Lines {
    fn of<D: DepthSample>(frame: &DepthFrame<'_, D>, world: bool) -> Self {
        let k = frame.intrinsics();
        let pose = if world { frame.pose_or_identity() } else { Pose::IDENTITY };
        let axes = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| pose.direction_to_world(axis));
        Self { cy: k.cy(), fy: k.fy(), axes, origin: pose.translation() }
    }

    fn at(&self, row: usize) -> Line {
        let [x, y, z] = self.axes;
        Line {
            a: (y * ((row as f32 - self.cy) / self.fy) + z).to_array(),
            b: x.to_array(),
            origin: self.origin.to_array(),
        }
    }
}

impl Line {
    #[inline(always)]
    fn point<D: DepthSample, const WORLD: bool>(&self, value: D, ray: f32, unit: f32) -> [f32; 3] {
        // A hole's NaN goes on into all three.
        let z = if value.is_valid() { value.number() * unit } else { f32::NAN };
        let [ax, ay, az] = self.a;
        if !WORLD {
            return [ray * z, ay * z, z];
        }
        let ([bx, by, bz], [ox, oy, oz]) = (self.b, self.origin);
        [(ax + bx * ray) * z + ox, (ay + by * ray) * z + oy, (az + bz * ray) * z + oz]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::image::ImageView;
    use crate::sensing::camera::Intrinsics;
    use crate::sensing::depth::DepthUnit;
    use glam::{Quat, vec3};
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    proptest! {
        #[test]
        fn rows_and_packed_are_the_frame_s_points(w in 0_usize..40, h in 0_usize..12, seed in any::<u64>(), turn in -3.0_f32..3.0, tilt in -1.0_f32..1.0) {
            let mut state = seed | 1;
            let depth: Vec<u16> = (0..w * h).map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let v = (state >> 48) as u16;
                if v.is_multiple_of(7) { 0 } else if v.is_multiple_of(11) { u16::MAX } else { v }
            }).collect();
            let k = Intrinsics::new(30.0, -31.0, 8.0, 5.0).unwrap();
            let pose = Pose::new(Quat::from_rotation_y(turn) * Quat::from_rotation_x(tilt), vec3(3.0, -1.0, 20.0)).unwrap();
            let frame = DepthFrame::new(ImageView::new(&depth, w, h).unwrap(), DepthUnit::MILLIMETRE, k).with_pose(pose);
            for space in [Space::Camera, Space::World] {
                let mut scratch = vec![0.0; scratch_len(w)];
                let mut all = vec![[0.0_f32; 3]; w * h];
                let n = packed(&frame, space, &mut scratch, &mut all).unwrap();
                prop_assert_eq!(n, depth.iter().filter(|v| v.is_valid()).count());
                let m = rows(&frame, space, &mut scratch, |y, row| {
                    for x in 0..w {
                        let got = [row.x[x], row.y[x], row.z[x]];
                        assert_eq!(got.map(f32::to_bits), all[y * w + x].map(f32::to_bits));
                        let truth = if space == Space::World { frame.world_point(x, y) } else { frame.point(x, y) };
                        match truth {
                            None => assert!(got.iter().all(|v| v.is_nan())),
                            Some(p) => {
                                let reach = frame.point(x, y).unwrap().length() + if space == Space::World { 21.0 } else { 0.0 };
                                let ulp = reach * f32::EPSILON;
                                let bound = if space == Space::World { 12.0 } else { 2.0 } * ulp;
                                assert!((Vec3::from(got) - p).length() <= bound, "{got:?} {p}");
                            }
                        }
                    }
                }).unwrap();
                prop_assert_eq!(n, m);
            }
        }
    }

    #[test]
    fn memory_must_suffice() {
        let depth = [1000_u16; 6];
        let k = Intrinsics::new(30.0, 31.0, 8.0, 5.0).unwrap();
        let frame = DepthFrame::new(ImageView::new(&depth, 3, 2).unwrap(), DepthUnit::MILLIMETRE, k);
        let error = rows(&frame, Space::Camera, &mut [0.0; 11], |_, _| ()).unwrap_err();
        assert_eq!(error, PointsError::Scratch { needed: 12, got: 11 });
        let error = packed(&frame, Space::Camera, &mut [0.0; 12], &mut [[0.0; 3]; 5]).unwrap_err();
        assert_eq!(error, PointsError::Output { needed: 6, got: 5 });
    }
}
