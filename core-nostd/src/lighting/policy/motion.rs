//! Motion-based automatic capture: is this frame worth keeping, sharp, and new in place or in time?
//!
//! LitAR, section 4.3.2. Every C = 300 ms a frame is due. It is compared with the K = 5 poses before it: had the device moved
//! more than 10 cm or turned more than 10 degrees among them, the frame is taken for blurred and left out, and every frame
//! after it is looked at until one is still. That one is captured when it shows what no stored view shows (new in place), or
//! when the view that shows it is old (new in time); then the timer starts anew.
//!
//! The paper prints "10 cm and 10 degrees"; either blurs a picture, so either counts here. It captures every still frame that
//! is due; here one that shows a stored view again waits until that is [`MotionParams::refresh`] old (the paper's behaviour: 0,
//! [`MotionParams::PAPER`]).
//!
//! # Poses, IMU, or both
//!
//! | given | moved | new in place |
//! |---|---|---|
//! | poses | largest distance and angle to the window's poses | no stored view within 5 cm and 5 degrees |
//! | IMU ([`AutoCapture::imu`]) | largest angle to the window's frames by the gyroscope's integral; largest deviation of the accelerometer from gravity | no stored view within 5 degrees; places are not known |
//! | both | the larger of each | as with poses |
//!
//! Only angles between readings of one device are used, so the IMU may be mounted any way. The gyroscope's bias (0.01 rad/s) adds 0.1 degrees over a window; over
//! minutes, without poses, it makes views new that are not: a frame too many, never one too few. The accelerometer cannot tell steady motion from
//! rest; it is a hint of shaking, no more.
//!
//! # Time and gaps
//!
//! Frames farther back than [`MotionParams::max_gap`] are not compared with: after a gap, or at less than a frame a second, a frame counts as still (unless the
//! IMU objects). Time that runs backward empties the window and makes the next frame due; stored views keep their places and
//! count as old. A frame without a pose, where there were poses before, is [`Decision::Blind`]: nobody could place it.
//!
//! Memory: for K = 5, V = 5 at most 1 KiB, held by a test. Cost: K + V distances and arc tangents a frame, a quaternion product an IMU reading.

use core::f32::consts::PI;

use glam::{Quat, Vec3};
use heapless::Deque;

use super::views::{PolicyError, ViewIds, ViewParams, apart, at_least_zero};
use crate::ground::rotation;
use crate::ground::units::Timestamp;
use crate::sensing::camera::Pose;

/// Standard gravity, m/s^2.
pub const GRAVITY: f32 = 9.806_65;

/// When a frame is due, still, and new.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionParams {
    /// Least time from one capture to the next, seconds, 0 or more: the paper's C. Default 0.3. Counted in whole microseconds, as
    /// are all times here.
    pub interval: f32,
    /// More than this (metres, 0 or more) within the window blurs. Default 0.1.
    pub max_translation: f32,
    /// More than this (radians, 0 to pi) within the window blurs. Default 10 degrees.
    pub max_rotation: f32,
    /// A deviation of the specific force from [`GRAVITY`] beyond this (m/s^2, 0 or more) blurs; infinite turns it off. Default 3:
    /// above a calm walk, below a jolt.
    pub max_shake: f32,
    /// Oldest frame, and longest silence of the IMU, that still says something of now; seconds, 0 or more. Default 1.
    pub max_gap: f32,
    /// A view is captured anew when this old; seconds, 0 or more. Default 1; the paper's 0; infinite: never.
    pub refresh: f32,
    /// What counts as the same view. Default 5 cm and 5 degrees.
    pub view: ViewParams,
}

impl MotionParams {
    /// As the paper's, but views are not captured anew more often than each second.
    pub const DEFAULT: Self = Self {
        interval: 0.3,
        max_translation: 0.1,
        max_rotation: 10.0 * PI / 180.0,
        max_shake: 3.0,
        max_gap: 1.0,
        refresh: 1.0,
        view: ViewParams::DEFAULT,
    };
    /// The paper's: every still frame that is due is captured.
    pub const PAPER: Self = Self { refresh: 0.0, ..Self::DEFAULT };

    fn check(&self) -> Result<(), PolicyError> {
        at_least_zero("interval", self.interval)?;
        at_least_zero("max_translation", self.max_translation)?;
        at_least_zero("max_shake", self.max_shake)?;
        at_least_zero("max_gap", self.max_gap)?;
        at_least_zero("refresh", self.refresh)?;
        if !(self.max_rotation >= 0.0 && self.max_rotation <= PI) {
            return Err(PolicyError { name: "max_rotation", value: self.max_rotation });
        }
        self.view.check()
    }
}

impl Default for MotionParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// What makes a frame worth it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Why {
    /// There is none yet.
    First,
    /// No stored view shows what it shows.
    NewPlace,
    /// The view that shows it is old.
    NewTime,
}

/// What to do with a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Decision {
    /// Keep it; the timer starts anew.
    Capture {
        /// What makes it worth it.
        why: Why,
        /// The view it is, 0 to V - 1: a frame captured before with this id is to be replaced.
        view: u16,
    },
    /// The last capture is too fresh.
    TooSoon {
        /// When a frame is due.
        next: Timestamp,
    },
    /// The device moves, the frame is likely blurred; ask again with the next.
    Moving {
        /// Largest distance to a pose of the window, metres.
        translation: f32,
        /// Largest angle to a frame of the window, radians.
        rotation: f32,
        /// Largest deviation of the specific force from gravity within the window, m/s^2; 0 without an IMU.
        shake: f32,
    },
    /// It shows what a stored view shows, and that is fresh.
    NotNew {
        /// That view.
        view: u16,
        /// When it will be old.
        next: Timestamp,
    },
    /// Nothing tells where the device is: it had a pose before and has none now, or there is neither pose nor IMU.
    Blind,
}

impl Decision {
    /// The view to store the frame as; `None` when it is not to be kept.
    #[must_use]
    pub const fn captured(&self) -> Option<u16> {
        match self {
            Self::Capture { view, .. } => Some(*view),
            _ => None,
        }
    }
}

/// A frame of the window.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Past {
    time: Timestamp,
    pose: Option<Pose>,
    /// The gyroscope's integral then, and which integral: two are compared only within one.
    turn: Quat,
    integral: u32,
    /// Largest deviation from gravity between the frame before and this one.
    shake: f32,
}

/// What the IMU said.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Inertial {
    last: Option<(Timestamp, Vec3)>,
    turn: Quat,
    integral: u32,
    shake: f32,
}

/// The policy: K frames to look back at, V views to tell apart (each at least 1: else it does not compile).
///
/// ```
/// use glam::{Quat, Vec3};
/// use isobath::ground::units::Timestamp;
/// use isobath::lighting::policy::motion::{AutoCapture, Decision, MotionParams, Why};
/// use isobath::sensing::camera::Pose;
/// let mut policy = AutoCapture::<5, 5>::new(MotionParams::default())?;
/// let mut offer = |x: f32, millis: i64| {
///     let pose = Pose::new(Quat::IDENTITY, Vec3::X * x).unwrap();
///     policy.offer(Some(&pose), Timestamp::from_nanos(millis * 1_000_000))
/// };
/// assert_eq!(offer(0.0, 0), Decision::Capture { why: Why::First, view: 0 });
/// assert!(matches!(offer(0.0, 100), Decision::TooSoon { next } if next.as_nanos() == 300_000_000));
/// assert!(matches!(offer(0.0, 300), Decision::NotNew { view: 0, .. }));
/// assert!(matches!(offer(0.5, 333), Decision::Moving { .. }));
/// # for i in 0..4 { assert!(matches!(offer(0.5, 366 + 33 * i), Decision::Moving { .. })); }
/// assert_eq!(offer(0.5, 500), Decision::Capture { why: Why::NewPlace, view: 1 });
/// # Ok::<(), isobath::lighting::policy::views::PolicyError>(())
/// ```
#[derive(Debug, Clone)]
pub struct AutoCapture<const K: usize = 5, const V: usize = 5> {
    params: MotionParams,
    window: Deque<Past, K>,
    views: ViewIds<V>,
    captured: [Timestamp; V],
    imu: Inertial,
    /// When a frame is due.
    due: Timestamp,
    /// Whether anything was captured.
    started: bool,
    /// Whether a pose was ever offered.
    posed: bool,
    /// The integral that the views were captured in, when there were no poses.
    views_integral: u32,
}

impl<const K: usize, const V: usize> AutoCapture<K, V> {
    /// A policy that has seen nothing.
    ///
    /// # Errors
    /// [`PolicyError`] when a parameter is out of its range.
    pub fn new(params: MotionParams) -> Result<Self, PolicyError> {
        const { assert!(K > 0, "a window of no frames tells no motion") };
        params.check()?;
        Ok(Self {
            params,
            window: Deque::new(),
            views: ViewIds::new(params.view)?,
            captured: [Timestamp::ZERO; V],
            imu: Inertial { last: None, turn: Quat::IDENTITY, integral: 0, shake: 0.0 },
            due: Timestamp::ZERO,
            started: false,
            posed: false,
            views_integral: 0,
        })
    }

    /// Takes a reading of the IMU: angular rate (rad/s) and specific force (m/s^2, about 9.8 upwards at rest), in any one frame
    /// fixed to the device. Call it for each, in order. Readings that are not finite or beyond 1000 rad/s are left out; over a
    /// silence, and when time runs back, the integral starts anew.
    pub fn imu(&mut self, rate: Vec3, force: Vec3, time: Timestamp) {
        let shake = (force.length() - GRAVITY).abs();
        if shake.is_finite() {
            self.imu.shake = self.imu.shake.max(shake);
        }
        if !(rate.length() <= 1000.0) {
            return;
        }
        match self.imu.last {
            Some((before, old)) if time >= before && within(time, before, self.params.max_gap) => {
                // The trapezium: half of either rate.
                let turn = (old + rate) * (0.5 * time.seconds_since(before));
                self.imu.turn =
                    rotation::unit(rotation::product(self.imu.turn, rotation::turned(Quat::IDENTITY, turn)));
            }
            Some(_) => self.imu.integral = self.imu.integral.wrapping_add(1),
            None => {}
        }
        self.imu.last = Some((time, rate));
    }

    /// Takes a frame's pose (`None`: tracking is lost, or there is none) and time: what to do with the frame? A
    /// [`Decision::Capture`] counts as done.
    pub fn offer(&mut self, pose: Option<&Pose>, time: Timestamp) -> Decision {
        if self.window.back().is_some_and(|newest| time < newest.time) {
            self.window.clear();
            self.due = time;
        }
        while self.window.front().is_some_and(|oldest| !within(time, oldest.time, self.params.max_gap)) {
            self.window.pop_front();
        }
        let (translation, rotation, shake) = self.moved(pose);
        self.remember(pose, time);
        if pose.is_some() && !self.posed {
            // Views by the gyroscope alone are no places.
            self.posed = true;
            self.forget_views();
        }
        let Some(place) = pose.copied().or_else(|| self.place_by_gyroscope(time)) else {
            return Decision::Blind;
        };
        if self.started && time < self.due {
            return Decision::TooSoon { next: self.due };
        }
        let p = &self.params;
        // Negated, so that what overflowed counts as motion.
        if !(translation <= p.max_translation && rotation <= p.max_rotation && shake <= p.max_shake) {
            return Decision::Moving { translation, rotation, shake };
        }
        let why = match self.views.find(&place) {
            _ if !self.started => Why::First,
            None => Why::NewPlace,
            Some(view) => {
                let captured = self.captured.get(usize::from(view)).copied().unwrap_or(time);
                let next = captured.saturating_add_nanos(nanos(p.refresh));
                // A capture in the future is one before time ran back.
                if captured <= time && time < next {
                    return Decision::NotNew { view, next };
                }
                Why::NewTime
            }
        };
        let view = self.views.see(&place).id();
        if let Some(captured) = self.captured.get_mut(usize::from(view)) {
            *captured = time;
        }
        self.due = time.saturating_add_nanos(nanos(p.interval));
        self.started = true;
        Decision::Capture { why, view }
    }

    /// The views there are, by id.
    #[must_use]
    pub const fn views(&self) -> &ViewIds<V> {
        &self.views
    }

    /// The parameters.
    #[must_use]
    pub const fn params(&self) -> &MotionParams {
        &self.params
    }

    /// Forgets what it saw.
    pub fn reset(&mut self) {
        self.window.clear();
        self.views.reset();
        self.imu = Inertial { last: None, turn: Quat::IDENTITY, integral: 0, shake: 0.0 };
        (self.started, self.posed, self.views_integral) = (false, false, 0);
    }

    /// How far from the window's frames: metres, radians, m/s^2.
    fn moved(&self, pose: Option<&Pose>) -> (f32, f32, f32) {
        let (mut translation, mut rotation, mut shake) = (0.0_f32, 0.0_f32, self.imu.shake);
        for (index, past) in self.window.iter().enumerate() {
            if let (Some(now), Some(then)) = (pose, past.pose) {
                let (metres, radians) = apart(&then, now);
                (translation, rotation) = (translation.max(metres), rotation.max(radians));
            }
            if self.imu.last.is_some() && past.integral == self.imu.integral {
                rotation = rotation.max(rotation::way(past.turn, self.imu.turn).length());
            }
            // The oldest frame's shaking was before the window.
            if index > 0 {
                shake = shake.max(past.shake);
            }
        }
        (translation, rotation, shake)
    }

    /// Into the window, once for each time.
    fn remember(&mut self, pose: Option<&Pose>, time: Timestamp) {
        if let Some(newest) = self.window.back_mut().filter(|newest| newest.time == time) {
            newest.shake = newest.shake.max(self.imu.shake);
        } else {
            if self.window.is_full() {
                self.window.pop_front();
            }
            let Inertial { turn, integral, shake, .. } = self.imu;
            // There is room: one was taken out.
            let _ = self.window.push_back(Past { time, pose: pose.copied(), turn, integral, shake });
        }
        self.imu.shake = 0.0;
    }

    /// A pose that is right in its rotation, from the IMU's first reading on; `None` when there was ever a better one, or the IMU
    /// is silent.
    fn place_by_gyroscope(&mut self, time: Timestamp) -> Option<Pose> {
        let (last, _) = self.imu.last?;
        if self.posed || !within(time, last, self.params.max_gap) {
            return None;
        }
        if self.views_integral != self.imu.integral {
            self.views_integral = self.imu.integral;
            self.forget_views();
        }
        Pose::new(self.imu.turn, Vec3::ZERO).ok()
    }

    fn forget_views(&mut self) {
        self.views.reset();
    }
}

/// Whether two times are at most so many seconds apart.
fn within(a: Timestamp, b: Timestamp, seconds: f32) -> bool {
    a.as_nanos().saturating_sub(b.as_nanos()).saturating_abs() <= nanos(seconds)
}

/// Seconds, 0 or more, as nanoseconds, in whole microseconds: 0.3 in `f32` is 12 ns more than 300 ms, and frames come on the dot.
fn nanos(seconds: f32) -> i64 {
    ((f64::from(seconds) * 1e6 + 0.5) as i64).saturating_mul(1000)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::math;
    use proptest::prelude::*;
    use std::vec::Vec;

    type Policy = AutoCapture<5, 5>;

    fn policy(params: MotionParams) -> Policy {
        Policy::new(params).unwrap()
    }

    fn at(millis: i64) -> Timestamp {
        Timestamp::from_nanos(millis * 1_000_000)
    }

    fn pose(x: f32, degrees: f32) -> Pose {
        Pose::new(Quat::from_rotation_y(degrees.to_radians()), Vec3::X * x).unwrap()
    }

    const REST: Vec3 = Vec3::new(0.0, GRAVITY, 0.0);

    #[test]
    fn the_papers_captures_every_300_ms_at_rest() {
        let mut p = policy(MotionParams::PAPER);
        let captures: Vec<i64> =
            (0..=90).map(|i| i * 20).filter(|&t| p.offer(Some(&pose(0.0, 0.0)), at(t)).captured() == Some(0)).collect();
        assert_eq!(captures, [0, 300, 600, 900, 1200, 1500, 1800]);
        // Ours leaves a fresh view alone.
        let mut p = policy(MotionParams::DEFAULT);
        let captures: Vec<i64> =
            (0..=90).map(|i| i * 20).filter(|&t| p.offer(Some(&pose(0.0, 0.0)), at(t)).captured() == Some(0)).collect();
        assert_eq!(captures, [0, 1000]);
    }

    /// 30 Hz, K = 5: the window is a sixth of a second; 10 cm in it are 0.6 m/s, 10 degrees 60 degrees a second.
    #[test]
    fn who_moves_fast_is_skipped_until_still() {
        // Speeds, and how many frames after the stop the window is clean.
        for (metres, degrees, moves) in [
            (0.5, 0.0, None),
            (0.7, 0.0, Some(0)),
            (1.4, 0.0, Some(2)),
            (0.0, 50.0, None),
            (0.0, 70.0, Some(0)),
            (0.0, 140.0, Some(2)),
        ] {
            let mut p = policy(MotionParams::PAPER);
            let frame = |i: i64| pose(metres * i as f32 / 30.0, degrees * i as f32 / 30.0);
            let answers: Vec<Decision> = (0..=30).map(|i| p.offer(Some(&frame(i)), at(i * 100 / 3))).collect();
            assert_eq!(answers[0], Decision::Capture { why: Why::First, view: 0 });
            assert!(answers[1..9].iter().all(|a| matches!(a, Decision::TooSoon { .. })));
            if moves.is_none() {
                assert_eq!(answers[9].captured(), Some(1), "{:?}", answers[9]);
                continue;
            }
            assert!(answers[9..].iter().all(|a| matches!(a, Decision::Moving { .. })), "{answers:?}");
            let after: Vec<bool> =
                (31..=36).map(|i| p.offer(Some(&frame(30)), at(i * 100 / 3)).captured().is_some()).collect();
            assert_eq!(after.iter().position(|c| *c), moves, "{after:?}");
        }
    }

    #[test]
    fn a_blurred_frame_is_not_counted_as_a_place() {
        let mut p = policy(MotionParams::default());
        p.offer(Some(&pose(0.0, 0.0)), at(0));
        let Decision::Moving { translation, rotation, shake } = p.offer(Some(&pose(0.5, 20.0)), at(400)) else {
            panic!()
        };
        assert!((translation - 0.5).abs() < 1e-6 && (rotation.to_degrees() - 20.0).abs() < 1e-3 && shake == 0.0);
        assert_eq!(p.views().len(), 1);
    }

    #[test]
    fn the_imu_alone_decides() {
        let mut p = policy(MotionParams { refresh: f32::INFINITY, ..MotionParams::PAPER });
        assert_eq!(p.offer(None, at(0)), Decision::Blind, "neither pose nor IMU");
        // Two seconds still, one turning by 90 degrees, two still; 200 Hz, frames at 30 Hz.
        let mut captures = Vec::new();
        let mut frame = 0;
        let mut moving = 0;
        for i in 0..1000_i64 {
            let t = i * 5;
            let rate = if (2000..3000).contains(&t) { PI / 2.0 } else { 0.0 };
            p.imu(Vec3::new(0.0, 0.0, rate), REST, at(t));
            if t >= frame * 100 / 3 {
                frame += 1;
                match p.offer(None, at(t)) {
                    Decision::Capture { why, view } => captures.push((t, why, view)),
                    Decision::Moving { rotation, .. } => {
                        moving += 1;
                        assert!(rotation < 16_f32.to_radians());
                    }
                    _ => {}
                }
            }
        }
        assert!((20..32).contains(&moving), "{moving}");
        let whys: Vec<Why> = captures.iter().map(|c| c.1).collect();
        assert_eq!((whys[0], captures[0].0), (Why::First, 0));
        assert!(whys[1..].iter().all(|w| *w == Why::NewPlace));
        assert!(captures.last().unwrap().0 > 3000, "{captures:?}");
        // The integral itself: a right angle.
        let angle = rotation::way(Quat::IDENTITY, p.imu.turn).length();
        assert!((angle - PI / 2.0).abs() < 1e-4, "{angle}");
        // Silent for longer than the gap: it says nothing any more.
        assert_eq!(p.offer(None, at(7000)), Decision::Blind);
    }

    #[test]
    fn the_imu_sees_what_poses_do_not() {
        let still = pose(0.0, 0.0);
        let mut p = policy(MotionParams::PAPER);
        p.imu(Vec3::ZERO, REST, at(0));
        p.offer(Some(&still), at(0));
        // A tracker that holds its pose while the device turns 20 degrees.
        p.imu(Vec3::ZERO, REST, at(100));
        for i in 1..=40 {
            p.imu(Vec3::Y * 20_f32.to_radians() / 0.2, REST, at(i * 5 + 100));
        }
        p.offer(Some(&still), at(200));
        let Decision::Moving { rotation, translation, .. } = p.offer(Some(&still), at(300)) else { panic!() };
        assert!((rotation.to_degrees() - 20.0).abs() < 1.5 && translation == 0.0);
        // A jolt, still in the window two frames later, gone with it.
        let mut p = policy(MotionParams::PAPER);
        p.offer(Some(&still), at(0));
        p.offer(Some(&still), at(280));
        p.imu(Vec3::ZERO, REST + Vec3::Y * 5.0, at(290));
        for i in 0..5 {
            let d = p.offer(Some(&still), at(300 + i * 10));
            assert!(matches!(d, Decision::Moving { shake, .. } if (shake - 5.0).abs() < 1e-5), "{i} {d:?}");
        }
        assert!(p.offer(Some(&still), at(360)).captured().is_some());
        // Not with the hint off.
        let mut p = policy(MotionParams { max_shake: f32::INFINITY, ..MotionParams::PAPER });
        p.imu(Vec3::ZERO, Vec3::splat(1e30), at(0));
        assert!(p.offer(Some(&still), at(0)).captured().is_some());
    }

    #[test]
    fn time_that_stands_runs_back_or_jumps() {
        let still = pose(0.0, 0.0);
        let mut p = policy(MotionParams::default());
        assert!(p.offer(Some(&still), at(10_000)).captured().is_some());
        assert_eq!(p.offer(Some(&still), at(10_000)), Decision::TooSoon { next: at(10_300) });
        // Back: due at once, and what was captured in the future is old.
        assert_eq!(p.offer(Some(&still), at(50)), Decision::Capture { why: Why::NewTime, view: 0 });
        assert_eq!(p.offer(Some(&still), at(60)), Decision::TooSoon { next: at(350) });
        // A jump over a gap: nothing to compare with.
        assert_eq!(p.offer(Some(&pose(3.0, 0.0)), at(5000)), Decision::Capture { why: Why::NewPlace, view: 1 });
        // A lost tracker, and what comes after.
        assert_eq!(p.offer(None, at(5400)), Decision::Blind);
        assert!(matches!(p.offer(Some(&pose(3.0, 0.0)), at(5433)), Decision::NotNew { view: 1, .. }));
        // At the ends of time.
        for t in [i64::MIN, i64::MAX, i64::MIN] {
            assert!(p.offer(Some(&still), Timestamp::from_nanos(t)).captured().is_some());
        }
        p.reset();
        assert_eq!(p.offer(Some(&still), at(0)), Decision::Capture { why: Why::First, view: 0 });
    }

    #[test]
    fn places_by_gyroscope_are_no_places_once_there_are_poses() {
        let mut p = policy(MotionParams::default());
        p.imu(Vec3::ZERO, REST, at(0));
        assert!(p.offer(None, at(0)).captured().is_some());
        assert_eq!(p.offer(Some(&pose(0.0, 0.0)), at(400)), Decision::Capture { why: Why::NewPlace, view: 0 });
        p.imu(Vec3::ZERO, REST, at(800));
        assert_eq!(p.offer(None, at(800)), Decision::Blind);
    }

    #[test]
    fn impossible_parameters_are_refused() {
        let d = MotionParams::DEFAULT;
        for (p, name) in [
            (MotionParams { interval: -1.0, ..d }, "interval"),
            (MotionParams { max_translation: f32::NAN, ..d }, "max_translation"),
            (MotionParams { max_rotation: 4.0, ..d }, "max_rotation"),
            (MotionParams { max_shake: -0.1, ..d }, "max_shake"),
            (MotionParams { max_gap: f32::NAN, ..d }, "max_gap"),
            (MotionParams { refresh: f32::NAN, ..d }, "refresh"),
            (MotionParams { view: ViewParams { translation: -1.0, rotation: 0.0 }, ..d }, "translation"),
        ] {
            assert_eq!(Policy::new(p).unwrap_err().name, name);
        }
        assert!(size_of::<Policy>() <= 1024, "{}", size_of::<Policy>());
    }

    /// The policy over again, as a list of all frames, in the plainest words.
    fn plainly(frames: &[(f32, f32, i64)], k: usize, params: &MotionParams) -> Vec<bool> {
        let mut captured: Vec<bool> = Vec::new();
        let mut last: Option<i64> = None;
        for (i, (x, degrees, t)) in frames.iter().enumerate() {
            let window = &frames[i.saturating_sub(k)..i];
            let still = window.iter().filter(|(_, _, then)| t - then <= 1000).all(|(a, b, _)| {
                (x - a).abs() <= params.max_translation && (degrees - b).abs() <= params.max_rotation.to_degrees()
            });
            let take = still && last.is_none_or(|l| t - l >= 300);
            if take {
                last = Some(*t);
            }
            captured.push(take);
        }
        captured
    }

    proptest! {
        #[test]
        fn agrees_with_the_plain_form(steps in proptest::collection::vec((-9_i32..9, -9_i32..9, 1_i64..400), 1..80)) {
            let (mut x, mut degrees, mut t) = (0, 0, 0);
            // On odd half steps, so that no sum falls on a limit, where rounding decides.
            let frames: Vec<(f32, f32, i64)> = steps.iter().map(|(dx, dd, dt)| {
                (x, degrees, t) = (x + dx, degrees + dd, t + dt);
                (x as f32 * 0.0137, degrees as f32 * 1.37, t)
            }).collect();
            let mut p = policy(MotionParams::PAPER);
            let got: Vec<bool> =
                frames.iter().map(|&(x, d, t)| p.offer(Some(&pose(x, d)), at(t)).captured().is_some()).collect();
            prop_assert_eq!(got, plainly(&frames, 5, &MotionParams::PAPER));
        }

        #[test]
        fn hostile_input_is_answered(
            calls in proptest::collection::vec((any::<bool>(), any::<[f32; 3]>(), any::<i64>(), any::<bool>()), 0..60),
            limits in any::<[f32; 5]>(),
        ) {
            let [interval, max_translation, max_shake, max_gap, refresh] = limits.map(f32::abs);
            let params = MotionParams { interval, max_translation, max_shake, max_gap, refresh, ..Default::default() };
            let Ok(mut p) = AutoCapture::<2, 1>::new(params) else { return Ok(()) };
            for (imu, v, t, posed) in calls {
                let (v, t) = (Vec3::from(v), Timestamp::from_nanos(t));
                if imu {
                    p.imu(v, v, t);
                } else {
                    let pose = Pose::new(Quat::IDENTITY, v).ok().filter(|_| posed);
                    p.offer(pose.as_ref(), t);
                }
                prop_assert!(math::sqrt(p.imu.turn.length_squared()) > 0.99 && p.imu.shake.is_finite());
            }
        }
    }
}
