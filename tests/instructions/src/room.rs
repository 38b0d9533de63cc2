//! What the kernels look at: a floor, a back wall, a box on the floor, a hole in a hundred pixels; seen level from 1.2 m.

use isobath::glam::{Vec3, vec2};
use isobath::ground::image::ImageView;
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;

/// Columns.
pub(crate) const WIDTH: usize = 320;
/// Rows.
pub(crate) const HEIGHT: usize = 240;
/// Pixels.
pub(crate) const PIXELS: usize = WIDTH * HEIGHT;
/// Of the camera above the floor, metres.
const EYE: f32 = 1.2;
/// Of the back wall from the camera, metres.
const WALL: f32 = 4.0;
/// Of the box from the camera, metres.
const BOX: f32 = 1.8;

/// The room in millimetres and in metres.
pub(crate) struct Room {
    pub(crate) millimetres: Vec<u16>,
    pub(crate) metres: Vec<f32>,
    camera: Intrinsics,
    pose: Pose,
}

impl Room {
    /// As an exact sensor sees it.
    pub(crate) fn new() -> Self {
        let f = WIDTH as f32 * 0.82;
        let camera = Intrinsics::new(f, f, WIDTH as f32 / 2.0 - 0.5, HEIGHT as f32 / 2.0 - 0.5);
        let camera = camera.unwrap_or_else(|e| unreachable!("a camera of constants: {e}"));
        let pose = Pose::looking_at(Vec3::new(0.0, EYE, 0.0), Vec3::new(0.0, EYE, -1.0), Vec3::Y);
        let pose = pose.unwrap_or_else(|| unreachable!("a level view"));
        let metres: Vec<f32> = (0..PIXELS)
            .map(|i| {
                let (x, y) = (i % WIDTH, i / WIDTH);
                let ray = camera.ray(vec2(x as f32, y as f32));
                let floor = if ray.y > 0.0 { EYE / ray.y } else { f32::INFINITY };
                let in_box = ray.x.abs() < 0.15 && ray.y > -0.1 && floor > BOX;
                // One pixel in a hundred is a hole.
                let hole = (x * 7919 + y * 104_729) % 101 == 0;
                if hole { 0.0 } else { floor.min(if in_box { BOX } else { WALL }) }
            })
            .collect();
        let millimetres = metres.iter().map(|&z| (z * 1000.0) as u16).collect();
        Self { millimetres, metres, camera, pose }
    }

    /// As a Kinect sees it: noise of 1.425e-3 z² metres, always the same.
    pub(crate) fn noisy() -> Self {
        let mut room = Self::new();
        let mut random = Random(1);
        for z in &mut room.metres {
            // Near enough to a normal distribution: the sum of twelve.
            let gauss = (0..12).map(|_| random.unit()).sum::<f32>() - 6.0;
            *z += 1.425e-3 * *z * *z * gauss;
        }
        room
    }

    /// The frame of `u16` millimetres.
    pub(crate) fn coarse(&self) -> DepthFrame<'_, u16> {
        self.frame(&self.millimetres, DepthUnit::MILLIMETRE)
    }

    /// The frame of `f32` metres.
    pub(crate) fn fine(&self) -> DepthFrame<'_, f32> {
        self.frame(&self.metres, DepthUnit::METRE)
    }

    fn frame<'a, D: DepthSample>(&self, depth: &'a [D], unit: DepthUnit) -> DepthFrame<'a, D> {
        let view = ImageView::new(depth, WIDTH, HEIGHT).unwrap_or_else(|e| unreachable!("one value a pixel: {e}"));
        DepthFrame::new(view, unit, self.camera).with_pose(self.pose)
    }
}

/// Pixels here and there, always the same, in no order that a branch predictor or a cache would like.
pub(crate) fn pixels(count: usize) -> impl Iterator<Item = (usize, usize)> {
    (1..=count).map(|i| i * 7919 % PIXELS).map(|i| (i % WIDTH, i / WIDTH))
}

struct Random(u64);

impl Random {
    /// 0 to 1 (Knuth's linear congruence, its upper bits).
    const fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1_u64 << 24) as f32
    }
}
