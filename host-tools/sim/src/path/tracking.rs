//! Poses as a tracker reports them: white noise on each, and a drift that grows like a random walk.

use crate::maths::{Rigid, Rotation, V3, v3};
use crate::random::Random;

/// Errors of reported poses; all standard deviations for each axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseNoise {
    /// Metres, each pose on its own.
    pub position: f64,
    /// Radians, each pose on its own.
    pub rotation: f64,
    /// Metres per root second, adding up.
    pub drift_position: f64,
    /// Radians per root second, adding up.
    pub drift_rotation: f64,
}

impl PoseNoise {
    /// Poses are exact.
    pub const NONE: Self = Self { position: 0.0, rotation: 0.0, drift_position: 0.0, drift_rotation: 0.0 };
    /// A phone's visual-inertial tracking: 1 mm and 0.05 degrees of jitter, 2 mm and 0.03 degrees of drift in the first second.
    pub const PHONE: Self = Self { position: 1e-3, rotation: 8.7e-4, drift_position: 2e-3, drift_rotation: 5e-4 };

    /// Whether poses stay exact.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }
}

fn draw(random: Random, index: u64) -> V3 {
    v3(random.normal(3 * index), random.normal(3 * index + 1), random.normal(3 * index + 2))
}

/// The pose that the tracker reports for frame `index`, `step` seconds after the one before.
pub(crate) fn reported(pose: &Rigid, noise: &PoseNoise, seed: u64, index: u64, step: f64) -> Rigid {
    if noise.is_none() {
        return *pose;
    }
    let random = Random::new(seed).stream(0x2222);
    let root = step.max(0.0).sqrt();
    let (mut moved, mut turned) = (V3::ZERO, V3::ZERO);
    // Frame 0 defines the tracker's world: it has not drifted yet.
    for i in 1..=index {
        moved += draw(random.stream(0), i) * (noise.drift_position * root);
        turned += draw(random.stream(1), i) * (noise.drift_rotation * root);
    }
    moved += draw(random.stream(2), index) * noise.position;
    turned += draw(random.stream(3), index) * noise.rotation;
    Rigid { rotation: pose.rotation.then(&Rotation::from_vector(turned)), translation: pose.translation + moved }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drift_grows_with_the_root_of_time() {
        let noise = PoseNoise { drift_position: 0.01, ..PoseNoise::NONE };
        let spread = |index: u64| {
            let squares: f64 = (0..300)
                .map(|seed| reported(&Rigid::IDENTITY, &noise, seed, index, 0.1).translation.x)
                .map(|x| x * x)
                .sum();
            (squares / 300.0).sqrt()
        };
        assert_eq!(spread(0), 0.0);
        assert!((spread(10) / 0.01 - 1.0).abs() < 0.15 && (spread(90) / 0.03 - 1.0).abs() < 0.15);
        assert_eq!(reported(&Rigid::IDENTITY, &PoseNoise::NONE, 1, 50, 0.1), Rigid::IDENTITY);
    }
}
