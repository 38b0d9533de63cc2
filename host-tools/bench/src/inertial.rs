//! Readings of an inertial sensor with the true orientation beside them: recorded (two trials of the BROAD set, optical truth) and simulated.
//!
//! BROAD (Laidig, Caruso, Cereatti, Seel 2021, doi 10.3390/data6070072) is scored as its authors do: only where the trial says that there is movement and the
//! cameras saw the sensor, in the earth's frame, with the frames as they are. Inclination is the angle between the two verticals, total
//! the angle of the whole rotation.

use std::path::Path;

use isobath::glam::{DQuat, DVec3, Quat, Vec3};
use isobath::ground::units::Timestamp;
use isobath::sensing::imu::ImuSample;
use isobath_sim::{Curve, ImuModel, Sine, Trajectory, imu_samples};

/// A recording or a simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Seconds between readings.
    pub period: f64,
    /// What the sensor said.
    pub samples: Vec<ImuSample>,
    /// From the sensor to the earth (z up; recorded ones: y north) at each reading, where it is known and counts.
    pub truth: Vec<Option<DQuat>>,
}

/// Root mean square errors of a trial, degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// Between the verticals.
    pub inclination: f64,
    /// Of the whole rotation.
    pub total: f64,
}

/// BROAD's trials that are there: their numbers.
pub const BROAD: [u8; 2] = [3, 27];

/// A trial of BROAD; `None` where there is no shared data.
#[must_use]
pub fn broad(number: u8) -> Option<Trial> {
    let name = match number {
        3 => "03_undisturbed_slow_rotation_C",
        27 => "27_disturbed_phone_vibration_B",
        _ => return None,
    };
    let folder = crate::recordings::root().join("broad_imu");
    let [rate, force, field] =
        ["imu_gyr", "imu_acc", "imu_mag"].map(|part| floats(&folder.join(format!("{name}.{part}.npy")), 3));
    let truth = floats(&folder.join(format!("{name}.opt_quat.npy")), 4)?;
    let movement = body(&folder.join(format!("{name}.movement.npy")))?;
    let vector = |v: &[f32]| Vec3::from_slice(v);
    let triples = rate?.into_iter().zip(force?).zip(field?).enumerate();
    let samples = triples.map(|(i, ((rate, force), field))| ImuSample {
        // 2000 / 7 Hz.
        time: Timestamp::from_nanos(i as i64 * 3_500_000),
        rate: vector(&rate),
        force: vector(&force),
        field: Some(vector(&field)),
    });
    let truth = truth.iter().zip(&movement).map(|(q, &moves)| {
        let q = [q[1], q[2], q[3], q[0]].map(f64::from);
        (moves != 0 && q.iter().all(|x| x.is_finite())).then(|| DQuat::from_array(q).normalize())
    });
    Some(Trial { period: 0.0035, samples: samples.collect(), truth: truth.collect() })
}

/// What follows an npy file's header.
fn body(path: &Path) -> Option<Vec<u8>> {
    let bytes = std::fs::read(path).ok()?;
    let header = usize::from(u16::from_le_bytes([*bytes.get(8)?, *bytes.get(9)?]));
    Some(bytes.get(10 + header..)?.to_vec())
}

/// Rows of little-endian `f32`.
fn floats(path: &Path, columns: usize) -> Option<Vec<Vec<f32>>> {
    let numbers: Vec<f32> = body(path)?.chunks_exact(4).map(|c| f32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect();
    Some(numbers.chunks_exact(columns).map(<[f32]>::to_vec).collect())
}

/// Three minutes in a hand that looks around by up to 60 degrees and moves by up to 20 cm, after five seconds of rest; a phone's sensor, 200 Hz, its bias included.
/// Everything counts but the rest.
#[must_use]
pub fn simulated(seed: u64) -> Trial {
    const REST: f64 = 5.0;
    let sines = |amplitude: f64, hertz: f64, phase: f64| Sine { amplitude, hertz, phase };
    let curve = |i: f64, size: f64, speed: f64| Curve {
        start: 0.3 * i,
        slope: 0.0,
        sines: vec![
            sines(size, speed * (0.31 + 0.07 * i), i),
            sines(0.4 * size, speed * (0.83 + 0.11 * i), 2.0 + i),
            sines(0.1 * size, speed * (2.3 + 0.2 * i), 1.0 - i),
        ],
    };
    let moving = Trajectory {
        position: [0.0, 1.0, 2.0].map(|i| curve(i, 0.14, 0.6)),
        angles: [0.0, 1.0, 2.0].map(|i| curve(i, 0.7, 0.7)),
    };
    let still = {
        let at = |c: &Curve| Curve::constant(c.at(0.0)[0]);
        let [x, y, z] = &moving.position;
        let [a, b, c] = &moving.angles;
        Trajectory { position: [at(x), at(y), at(z)], angles: [at(a), at(b), at(c)] }
    };
    let model = ImuModel::PHONE;
    let period = 1.0 / model.rate;
    // One seed: the same bias in rest and motion.
    let rest = imu_samples(&still, &model, seed, REST);
    let after = imu_samples(&moving, &model, seed, 180.0);
    let mut trial = Trial { period, samples: Vec::new(), truth: Vec::new() };
    let mut push = |s: &isobath_sim::ImuSample, at: i64, truth: Option<DQuat>| {
        let vector = |v: isobath_sim::V3| Vec3::new(v.x as f32, v.y as f32, v.z as f32);
        let time = Timestamp::from_nanos(at);
        trial.samples.push(ImuSample { time, rate: vector(s.rate), force: vector(s.force), field: None });
        trial.truth.push(truth);
    };
    // The simulator's up is y; the filter's is z.
    let to_z = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let truth = |rotation: isobath_sim::Rotation| to_z * DQuat::from_array(rotation.quaternion());
    for s in rest.iter().take((REST / period) as usize) {
        push(s, s.time, None);
    }
    for s in &after {
        let pose = moving.at(s.time as f64 * 1e-9).pose;
        push(s, s.time + (REST * 1e9) as i64, Some(truth(pose.rotation)));
    }
    trial
}

impl Trial {
    /// Scores orientations, sensor to earth, one a reading.
    #[must_use]
    pub fn score(&self, answers: impl IntoIterator<Item = DQuat>) -> Errors {
        let (mut inclination, mut total, mut count) = (0.0, 0.0, 0.0);
        for (answer, truth) in answers.into_iter().zip(&self.truth) {
            let Some(truth) = truth else { continue };
            let off = answer.normalize() * truth.conjugate();
            let tilt = 2.0 * (off.x.hypot(off.y)).atan2(off.w.hypot(off.z));
            let whole = 2.0 * DVec3::new(off.x, off.y, off.z).length().atan2(off.w.abs());
            (inclination, total, count) = (inclination + tilt * tilt, total + whole * whole, count + 1.0);
        }
        let rms = |sum: f64| (sum / count).sqrt().to_degrees();
        Errors { inclination: rms(inclination), total: rms(total) }
    }

    /// The orientations that a filter gives, one a reading.
    pub fn run(&self, mut filter: impl FnMut(&ImuSample) -> DQuat) -> Vec<DQuat> {
        self.samples.iter().map(&mut filter).collect()
    }
}

/// A core quaternion in double precision.
#[must_use]
pub fn double(q: Quat) -> DQuat {
    DQuat::from_array(q.to_array().map(f64::from))
}

/// The complementary filter that everybody writes first: integrate the gyroscope, and go a little of the way to where the accelerometer says that up is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Naive {
    period: f64,
    orientation: DQuat,
    started: bool,
}

impl Naive {
    /// Time constant of the way to the accelerometer, seconds: a thousandth at each of BROAD's readings.
    const TIME: f64 = 3.5;

    /// A filter for readings so many seconds apart.
    #[must_use]
    pub const fn new(period: f64) -> Self {
        Self { period, orientation: DQuat::IDENTITY, started: false }
    }

    /// Takes a reading; gives the orientation.
    pub fn update(&mut self, sample: &ImuSample) -> DQuat {
        let turn = sample.rate.as_dvec3() * self.period;
        self.orientation *= DQuat::from_scaled_axis(turn);
        let up = (self.orientation * sample.force.as_dvec3()).normalize_or(DVec3::Z);
        let share = if self.started { self.period / Self::TIME } else { 1.0 };
        self.started = true;
        let way = DQuat::from_rotation_arc(up, DVec3::Z);
        self.orientation = (DQuat::IDENTITY.slerp(way, share) * self.orientation).normalize();
        self.orientation
    }
}
