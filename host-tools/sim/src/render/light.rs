//! Lamps, the sun and shining rectangles: how much of their light falls on a surface, shadows included.

use crate::maths::{Rigid, V3, v3};
use crate::scene::World;
use crate::shape::Ray;

/// A light; numbers are linear red, green, blue.
#[derive(Debug, Clone)]
pub(crate) enum Light {
    /// `intensity`: radiance times square metres.
    Point { at: V3, intensity: V3 },
    /// `irradiance` on a surface that faces it; `from` is unit.
    Sun { from: V3, irradiance: V3 },
    /// Shines to its +z side; seen as `samples` x `samples` points at fixed places, so that there is no noise.
    Area { place: Rigid, size: [f64; 2], radiance: V3, samples: u32 },
}

/// How far above the surface shadow rays start, metres.
const LIFT: f64 = 1e-6;
/// Irradiance below this (in units of the picture's white) is not asked for: a grey surface would be 0.02 % of white brighter.
const FAINT: f64 = 1e-3;

impl Light {
    /// Irradiance at a point with a unit normal. `last` remembers what cast the shadow.
    pub(crate) fn irradiance(&self, world: &World<'_>, point: V3, normal: V3, last: &mut Option<u32>) -> V3 {
        let faint = FAINT / world.scene.exposure;
        match self {
            Self::Point { at, intensity } => {
                let d = *at - point;
                let squared = d.dot(d);
                let light = *intensity * (normal.dot(d) / (squared * squared.sqrt()));
                lit(world, point, normal, d, 1.0, light, faint, last)
            }
            Self::Sun { from, irradiance } => {
                lit(world, point, normal, *from, f64::INFINITY, *irradiance * normal.dot(*from), faint, last)
            }
            Self::Area { place, size, radiance, samples } => {
                let facing = place.rotation.z;
                // Behind the rectangle's plane nothing of it is seen.
                if facing.dot(point - place.translation) <= 0.0 {
                    return V3::ZERO;
                }
                let n = f64::from(*samples);
                let share = size[0] * size[1] / (n * n);
                let mut sum = V3::ZERO;
                for i in 0..samples * samples {
                    let u = (f64::from(i % samples) + 0.5) / n - 0.5;
                    let v = (f64::from(i / samples) + 0.5) / n - 0.5;
                    let d = place.point(v3(u * size[0], v * size[1], 0.0)) - point;
                    let squared = d.dot(d);
                    let cosines = normal.dot(d) * -facing.dot(d) / squared;
                    // No sample counts as nearer than its own patch is wide: a point has no size, a patch has.
                    let light = *radiance * (share * cosines / squared.max(share));
                    sum += lit(world, point, normal, d, 1.0, light, faint, last);
                }
                sum
            }
        }
    }
}

/// `light` unless it is faint, from behind, or blocked before `far` lengths of `d`.
fn lit(world: &World<'_>, point: V3, normal: V3, d: V3, far: f64, light: V3, faint: f64, last: &mut Option<u32>) -> V3 {
    if !(light.x.max(light.y).max(light.z) > faint) || normal.dot(d) <= 0.0 {
        return V3::ZERO;
    }
    let ray = Ray { origin: point + normal * LIFT, direction: d };
    if world.blocked(&ray, 0.0, far * (1.0 - 1e-9), last) { V3::ZERO } else { light }
}
