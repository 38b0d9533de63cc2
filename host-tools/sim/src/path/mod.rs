//! How the camera moves, and what that does to its inertial sensor and its tracking.
//!
//! Each of the six degrees of freedom (x, y, z; yaw, pitch, roll) is a straight line plus sines: smooth, with exact derivatives, so
//! that an IMU computed from them integrates back to the poses.
//!
//! | file | idea |
//! |---|---|
//! | `mod` | curves, trajectories, and the ones to choose from |
//! | `imu` | accelerometer and gyroscope along a trajectory |
//! | `tracking` | poses as a tracker reports them: noise and drift |

pub(crate) mod imu;
pub(crate) mod tracking;

use std::f64::consts::{PI, TAU};

use crate::error::SimError;
use crate::maths::{Rigid, Rotation, V3, v3};
use crate::scene::View;

/// One sine: `amplitude` sin(2 pi `hertz` t + `phase`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sine {
    /// In the curve's unit.
    pub amplitude: f64,
    /// Turns a second.
    pub hertz: f64,
    /// Radians.
    pub phase: f64,
}

/// A straight line plus sines, over seconds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Curve {
    /// Value at time 0, sines aside.
    pub start: f64,
    /// Change a second.
    pub slope: f64,
    /// The sines.
    pub sines: Vec<Sine>,
}

impl Curve {
    /// The same value for ever.
    #[must_use]
    pub const fn constant(start: f64) -> Self {
        Self { start, slope: 0.0, sines: Vec::new() }
    }

    fn with(mut self, amplitude: f64, hertz: f64, phase: f64) -> Self {
        self.sines.push(Sine { amplitude, hertz, phase });
        self
    }

    /// Value, first and second derivative at a time in seconds.
    #[must_use]
    pub fn at(&self, time: f64) -> [f64; 3] {
        let mut sum = [self.start + self.slope * time, self.slope, 0.0];
        for s in &self.sines {
            let w = TAU * s.hertz;
            let (sin, cos) = libm::sincos(w * time + s.phase);
            sum[0] += s.amplitude * sin;
            sum[1] += s.amplitude * w * cos;
            sum[2] -= s.amplitude * w * w * sin;
        }
        sum
    }
}

/// A camera's motion: where it is and how it is turned, at any time.
///
/// With yaw, pitch and roll 0 the camera looks along world -z, image top up; yaw turns it to the left, pitch up.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trajectory {
    /// World x, y, z, metres.
    pub position: [Curve; 3],
    /// Yaw, pitch, roll, radians.
    pub angles: [Curve; 3],
}

/// A trajectory at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Camera-to-world.
    pub pose: Rigid,
    /// World, metres a second.
    pub velocity: V3,
    /// World, metres a second squared.
    pub acceleration: V3,
    /// In the camera's frame, radians a second.
    pub rate: V3,
}

impl Trajectory {
    /// The motion at a time in seconds.
    #[must_use]
    pub fn at(&self, time: f64) -> Motion {
        let [x, y, z] = [0, 1, 2].map(|i| self.position[i].at(time));
        let [yaw, pitch, roll] = [0, 1, 2].map(|i| self.angles[i].at(time));
        let body = Rotation::from_yaw_pitch_roll(yaw[0], pitch[0], roll[0]);
        // Of the frame x right, y up, z backward, in itself: roll's axis is its own z, pitch's is x before the roll, yaw's is
        // y before pitch and roll.
        let unroll = Rotation::from_yaw_pitch_roll(0.0, 0.0, roll[0]);
        let unpitch = Rotation::from_yaw_pitch_roll(0.0, pitch[0], 0.0);
        let rate = unroll.undo(unpitch.undo(V3::UP * yaw[1]) + v3(pitch[1], 0.0, 0.0)) + v3(0.0, 0.0, roll[1]);
        // The camera's y points down, its z forward.
        let rotation = Rotation { x: body.x, y: -body.y, z: -body.z };
        Motion {
            pose: Rigid { rotation, translation: v3(x[0], y[0], z[0]) },
            velocity: v3(x[1], y[1], z[1]),
            acceleration: v3(x[2], y[2], z[2]),
            rate: v3(rate.x, -rate.y, -rate.z),
        }
    }

    /// Standing still at `eye`, looking at `target`.
    #[must_use]
    pub fn still(eye: V3, target: V3) -> Self {
        let d = target - eye;
        let yaw = libm::atan2(-d.x, -d.z);
        let pitch = libm::atan2(d.y, (d.x * d.x + d.z * d.z).sqrt());
        Self { position: [eye.x, eye.y, eye.z].map(Curve::constant), angles: [yaw, pitch, 0.0].map(Curve::constant) }
    }

    /// Held in a hand that trembles: some millimetres and half a degree, at 1 to 9 Hz.
    #[must_use]
    pub fn shake(eye: V3, target: V3) -> Self {
        let mut t = Self::still(eye, target);
        for (i, curve) in t.position.iter_mut().enumerate() {
            let p = i as f64;
            let c = std::mem::take(curve);
            *curve =
                c.with(0.004, 1.3 + 0.2 * p, p).with(0.0015, 4.7 + 0.3 * p, 2.0 + p).with(0.0004, 8.9, 1.0 + 2.0 * p);
        }
        for (i, curve) in t.angles.iter_mut().enumerate() {
            let p = i as f64;
            let c = std::mem::take(curve);
            *curve = c.with(0.008, 1.1 + 0.3 * p, 0.5 + p).with(0.003, 5.3 + 0.4 * p, p).with(0.0008, 8.1, 3.0 * p);
        }
        t
    }

    /// Walking a figure of eight around the eye, as wide as the view allows, once in 12 s, bobbing and swaying with the steps and
    /// looking about.
    #[must_use]
    pub fn walk(view: &View) -> Self {
        let mut t = Self::still(view.eye, view.target);
        let add = |curve: &mut Curve, sines: &[[f64; 3]]| {
            let c = std::mem::take(curve);
            *curve = sines.iter().fold(c, |c, s| c.with(s[0], s[1], s[2]));
        };
        let lap = 1.0 / 12.0;
        let [x, y, z] = &mut t.position;
        add(x, &[[view.roam[0], lap, 0.0], [0.008, 0.95, 0.4]]);
        add(y, &[[0.012, 1.9, 0.0]]);
        add(z, &[[view.roam[1], 2.0 * lap, 0.0]]);
        let [yaw, pitch, roll] = &mut t.angles;
        add(yaw, &[[0.16, lap, 0.0], [0.01, 0.95, 1.0]]);
        add(pitch, &[[0.05, 0.11, 0.0], [0.006, 1.9, 1.0]]);
        add(roll, &[[0.012, 0.95, 0.0]]);
        t
    }

    /// Around a place, looking at it, `height` metres above the world's origin, one turn in `period` seconds. `phase`
    /// (radians) 0 begins on the +z side.
    #[must_use]
    pub fn orbit(centre: V3, radius: f64, height: f64, period: f64, phase: f64) -> Self {
        let hertz = 1.0 / period;
        let still = |v: f64| Curve::constant(v);
        Self {
            position: [
                still(centre.x).with(radius, hertz, phase),
                still(height),
                still(centre.z).with(radius, hertz, phase + 0.5 * PI),
            ],
            angles: [
                Curve { start: phase, slope: TAU * hertz, sines: Vec::new() },
                still(libm::atan2(centre.y - height, radius)),
                still(0.0),
            ],
        }
    }
}

/// Body heights (metres) and steps of the lighting paper's observations.
const PEOPLE: [f64; 3] = [1.6, 1.7, 1.8];
const STEPS: [f64; 3] = [0.5, 1.0, 1.5];

/// The 72 observations of the lighting paper (`LitAR`, 6.2.1): 8 positions on a circle around a place, at 0.8 of the heights 160, 170 and
/// 180 cm, at 0.5, 1 and 1.5 steps of 0.3 of the height. Camera-to-world; heights outermost, then radii, then positions. The floor
/// is at height 0.
#[must_use]
pub fn orbit_stations(centre: V3) -> Vec<Rigid> {
    let mut out = Vec::with_capacity(72);
    for person in PEOPLE {
        for steps in STEPS {
            let circle = Trajectory::orbit(centre, steps * 0.3 * person, 0.8 * person, 8.0, 0.0);
            out.extend((0..8).map(|i| circle.at(f64::from(i)).pose));
        }
    }
    out
}

/// Which way the camera takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CameraPath {
    /// Walks where nothing moves in the scene; stands still where something does.
    #[default]
    Auto,
    /// Stands still.
    Still,
    /// Walks about: [`Trajectory::walk`].
    Walk,
    /// Trembles: [`Trajectory::shake`].
    Shake,
    /// Circles a place in 8 s: a person of 1.7 m, one step away ([`Trajectory::orbit`]).
    Orbit,
    /// Jumps from one of the 72 [`orbit_stations`] to the next with each frame. There is no IMU for this.
    Stations,
}

impl std::str::FromStr for CameraPath {
    type Err = SimError;

    fn from_str(text: &str) -> Result<Self, SimError> {
        Ok(match text {
            "auto" => Self::Auto,
            "static" | "still" => Self::Still,
            "walk" => Self::Walk,
            "shake" => Self::Shake,
            "orbit" => Self::Orbit,
            "stations" => Self::Stations,
            _ => {
                return Err(SimError::option(format!(
                    "there is no trajectory {text:?}; give auto, static, walk, shake, orbit or stations"
                )));
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view() -> View {
        View { eye: v3(1.0, 1.5, 2.0), target: v3(-0.5, 0.7, -1.0), roam: [0.4, 0.3] }
    }

    #[test]
    fn standing_still_is_looking_at() {
        let v = view();
        let (a, b) = (Trajectory::still(v.eye, v.target).at(3.0).pose, Rigid::looking_at(v.eye, v.target));
        assert!(a.rotation.transposed().then(&b.rotation).angle() < 1e-14 && a.translation == b.translation);
    }

    #[test]
    fn derivatives_are_those_of_the_motion() {
        let v = view();
        for t in
            [Trajectory::walk(&v), Trajectory::shake(v.eye, v.target), Trajectory::orbit(v.target, 0.5, 1.4, 8.0, 0.3)]
        {
            for i in 0..50 {
                let (time, h) = (0.37 * f64::from(i), 1e-5);
                let (a, m, b) = (t.at(time - h), t.at(time), t.at(time + h));
                let velocity = (b.pose.translation - a.pose.translation) / (2.0 * h);
                assert!((velocity - m.velocity).length() < 1e-8);
                assert!(((b.velocity - a.velocity) / (2.0 * h) - m.acceleration).length() < 1e-6);
                // R(t)' R(t + 2h) is a turn by the rate in the camera's frame.
                let turned = a.pose.rotation.then(&Rotation::from_vector(m.rate * (2.0 * h)));
                assert!(turned.transposed().then(&b.pose.rotation).angle() < 1e-10);
            }
        }
    }

    #[test]
    fn orbits_look_at_their_place_and_stations_are_the_papers() {
        let centre = v3(0.3, 0.5, -0.4);
        let stations = orbit_stations(centre);
        assert_eq!(stations.len(), 72);
        for (i, s) in stations.iter().enumerate() {
            let p = s.undo_point(centre);
            assert!(p.x.abs() < 1e-12 && p.y.abs() < 1e-12 && p.z > 0.0, "{i} {p:?}");
            let person = PEOPLE[i / 24];
            assert!((s.translation.y - 0.8 * person).abs() < 1e-12);
            let across = v3(s.translation.x - centre.x, 0.0, s.translation.z - centre.z).length();
            assert!((across - STEPS[i / 8 % 3] * 0.3 * person).abs() < 1e-12);
        }
        assert!((stations[0].translation - stations[4].translation).length() > 0.47, "opposite each other");
        assert!(
            "orbit".parse::<CameraPath>().is_ok()
                && "fly".parse::<CameraPath>().unwrap_err().to_string().contains("walk")
        );
    }
}
