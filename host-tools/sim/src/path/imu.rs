//! Accelerometer and gyroscope along a trajectory, in the camera's axes (the sensor sits in the camera's centre).
//!
//! The accelerometer measures specific force, R' (a - g): at rest it reads 9.81 m/s² upwards. Errors follow the usual model: a constant
//! bias, a bias that wanders (random walk), and white noise given as a density.

use super::Trajectory;
use crate::maths::{V3, v3};
use crate::random::Random;

/// Gravity, world, metres a second squared.
pub const GRAVITY: V3 = v3(0.0, -9.806_65, 0.0);

/// Errors of an inertial sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuModel {
    /// Samples a second.
    pub rate: f64,
    /// White noise of the accelerometer, m/s² per root Hz.
    pub accelerometer_noise: f64,
    /// White noise of the gyroscope, rad/s per root Hz.
    pub gyroscope_noise: f64,
    /// Standard deviation of the accelerometer's constant bias, m/s².
    pub accelerometer_bias: f64,
    /// Standard deviation of the gyroscope's constant bias, rad/s.
    pub gyroscope_bias: f64,
    /// Random walk of the accelerometer's bias, m/s² per root second.
    pub accelerometer_walk: f64,
    /// Random walk of the gyroscope's bias, rad/s per root second.
    pub gyroscope_walk: f64,
}

impl ImuModel {
    /// No errors; 200 samples a second.
    pub const EXACT: Self = Self {
        rate: 200.0,
        accelerometer_noise: 0.0,
        gyroscope_noise: 0.0,
        accelerometer_bias: 0.0,
        gyroscope_bias: 0.0,
        accelerometer_walk: 0.0,
        gyroscope_walk: 0.0,
    };
    /// A phone's sensor (of the kind of the BMI160): 200 samples a second.
    pub const PHONE: Self = Self {
        rate: 200.0,
        accelerometer_noise: 1.8e-3,
        gyroscope_noise: 1.2e-4,
        accelerometer_bias: 0.05,
        gyroscope_bias: 3e-3,
        accelerometer_walk: 3e-4,
        gyroscope_walk: 2e-5,
    };
}

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// Nanoseconds since the simulation's start.
    pub time: i64,
    /// Specific force, m/s², camera axes.
    pub force: V3,
    /// Angular rate, rad/s, camera axes.
    pub rate: V3,
}

/// The readings from time 0 for `seconds`, the last one included.
#[must_use]
pub fn imu_samples(trajectory: &Trajectory, model: &ImuModel, seed: u64, seconds: f64) -> Vec<ImuSample> {
    if !(model.rate > 0.0 && model.rate <= 1e6 && (0.0..=1e6).contains(&seconds)) {
        return Vec::new();
    }
    let random = Random::new(seed).stream(0x1111);
    let draw = |stream: u64, index: u64| {
        let r = random.stream(stream);
        v3(r.normal(3 * index), r.normal(3 * index + 1), r.normal(3 * index + 2))
    };
    let (mut force_bias, mut rate_bias) = (draw(0, 0) * model.accelerometer_bias, draw(1, 0) * model.gyroscope_bias);
    let (root_rate, root_step) = (model.rate.sqrt(), (1.0 / model.rate).sqrt());
    let count = libm::floor(seconds * model.rate + 1e-9) as u64;
    let mut out = Vec::with_capacity(count as usize + 1);
    for i in 0..=count {
        let time = libm::round(i as f64 * 1e9 / model.rate) as i64;
        let motion = trajectory.at(time as f64 * 1e-9);
        let force = motion.pose.rotation.undo(motion.acceleration - GRAVITY);
        out.push(ImuSample {
            time,
            force: force + force_bias + draw(2, i) * (model.accelerometer_noise * root_rate),
            rate: motion.rate + rate_bias + draw(3, i) * (model.gyroscope_noise * root_rate),
        });
        force_bias += draw(4, i) * (model.accelerometer_walk * root_step);
        rate_bias += draw(5, i) * (model.gyroscope_walk * root_step);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::Rotation;
    use crate::scene::View;

    /// Strapdown integration over pairs of samples: the attitude by Magnus' fourth-order turn, velocity and place by Simpson's rule.
    fn integrate(trajectory: &Trajectory, samples: &[ImuSample]) -> (V3, Rotation) {
        let start = trajectory.at(0.0);
        let (mut p, mut v, mut r) = (start.pose.translation, start.velocity, start.pose.rotation);
        for s in samples.windows(3).step_by(2) {
            let [a, b, c] = [s[0], s[1], s[2]];
            let h = (c.time - a.time) as f64 * 1e-9;
            let turn = (a.rate + b.rate * 4.0 + c.rate) * (h / 6.0) + a.rate.cross(c.rate) * (h * h / 12.0);
            let half = (a.rate * 5.0 + b.rate * 8.0 - c.rate) * (h / 24.0);
            let (r_half, r_next) = (r.then(&Rotation::from_vector(half)), r.then(&Rotation::from_vector(turn)));
            let accelerations =
                [r.apply(a.force) + GRAVITY, r_half.apply(b.force) + GRAVITY, r_next.apply(c.force) + GRAVITY];
            p += v * h + (accelerations[0] + accelerations[1] * 2.0) * (h * h / 6.0);
            v += (accelerations[0] + accelerations[1] * 4.0 + accelerations[2]) * (h / 6.0);
            r = r_next;
        }
        (p, r)
    }

    #[test]
    fn ten_seconds_integrate_back_to_the_trajectory() {
        let view = View { eye: v3(1.0, 1.5, 2.0), target: v3(-0.5, 0.7, -1.0), roam: [0.4, 0.3] };
        for t in [
            Trajectory::walk(&view),
            Trajectory::shake(view.eye, view.target),
            Trajectory::orbit(view.target, 0.5, 1.4, 8.0, 0.3),
            Trajectory::still(view.eye, view.target),
        ] {
            let samples = imu_samples(&t, &ImuModel::EXACT, 1, 10.0);
            assert_eq!(samples.len(), 2001);
            let (p, r) = integrate(&t, &samples);
            let end = t.at(10.0).pose;
            let (far, turned) = ((p - end.translation).length(), r.transposed().then(&end.rotation).angle());
            println!("after 10 s off by {far:e} m, {:e} degrees", turned.to_degrees());
            assert!(far < 1e-3, "{far} m");
            assert!(turned.to_degrees() < 0.01, "{} degrees", turned.to_degrees());
        }
    }

    #[test]
    fn errors_are_as_large_as_the_model_says_and_seeded() {
        let t = Trajectory::still(V3::ZERO, v3(0.0, 0.0, -1.0));
        let model =
            ImuModel { accelerometer_bias: 0.0, gyroscope_bias: 0.0, accelerometer_walk: 0.0, ..ImuModel::PHONE };
        let samples = imu_samples(&t, &model, 5, 50.0);
        assert_eq!(samples, imu_samples(&t, &model, 5, 50.0));
        assert_ne!(samples, imu_samples(&t, &model, 6, 50.0));
        let n = samples.len() as f64;
        // At rest, image y down: the force is -y.
        let squares: f64 = samples.iter().map(|s| (s.force.y + 9.806_65) * (s.force.y + 9.806_65)).sum();
        let expected = 1.8e-3 * 200.0_f64.sqrt();
        assert!(((squares / n).sqrt() / expected - 1.0).abs() < 0.03);
        let squares: f64 = samples.iter().map(|s| s.rate.x * s.rate.x).sum();
        assert!(((squares / n).sqrt() / (1.2e-4 * 200.0_f64.sqrt()) - 1.0).abs() < 0.03);
        // Of many wandering biases, the spread after 4 s and after 16 s, and none at the start.
        let wandering = ImuModel { accelerometer_walk: 3e-4, gyroscope_walk: 2e-5, ..ImuModel::EXACT };
        let spread = |seconds: f64| {
            let ends = (0..400).map(|seed| imu_samples(&t, &wandering, seed, seconds).last().copied().unwrap());
            let (force, rate) = ends.fold((0.0, 0.0), |(f, r), s| (f + s.force.x * s.force.x, r + s.rate.z * s.rate.z));
            [(force / 400.0).sqrt(), (rate / 400.0).sqrt()]
        };
        assert!(spread(0.0)[1] == 0.0 && spread(0.0)[0] < 1e-12);
        for seconds in [4.0_f64, 16.0] {
            let [force, rate] = spread(seconds);
            assert!((force / (3e-4 * seconds.sqrt()) - 1.0).abs() < 0.12, "{force}");
            assert!((rate / (2e-5 * seconds.sqrt()) - 1.0).abs() < 0.12, "{rate}");
        }
        let biased = imu_samples(&t, &ImuModel::PHONE, 5, 1.0);
        let mean = biased.iter().map(|s| s.rate.x).sum::<f64>() / biased.len() as f64;
        assert!(mean.abs() > 1e-5 && mean.abs() < 0.02);
        assert!(imu_samples(&t, &ImuModel { rate: 0.0, ..model }, 5, 1.0).is_empty());
    }
}
