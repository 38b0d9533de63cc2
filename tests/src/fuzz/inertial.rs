//! The inertial module: readings of any numbers at any times through calibration, filter, rest, screen and time offset.

use arbitrary::{Arbitrary, Result, Unstructured};
use isobath::glam::Quat;
use isobath::ground::units::Timestamp;
use isobath::sensing::imu::calibration::{ImuCalibration, Triad, mounting_of};
use isobath::sensing::imu::gravity::camera_pose;
use isobath::sensing::imu::offset::{OffsetParams, TimeOffset};
use isobath::sensing::imu::rest::{RestBias, RestParams};
use isobath::sensing::imu::screen::{ScreenParams, ScreenTurn};
use isobath::sensing::imu::vqf::{MagneticParams, Vqf, VqfParams};
use isobath::sensing::imu::{ImuSample, Step};

use super::{number, quat, vec3};

/// A parameter: as documented by default, or any number.
fn wild(u: &mut Unstructured<'_>, plain: f32) -> Result<f32> {
    if u.ratio(3, 4)? { Ok(plain) } else { number(u) }
}

fn triad(u: &mut Unstructured<'_>) -> Result<Triad> {
    if u.ratio(1, 2)? {
        return Ok(Triad { bias: vec3(u)?, ..Triad::IDENTITY });
    }
    Ok(Triad { matrix: [vec3(u)?.to_array(), vec3(u)?.to_array(), vec3(u)?.to_array()], bias: vec3(u)? })
}

fn params(u: &mut Unstructured<'_>) -> Result<VqfParams> {
    let d = VqfParams::DEFAULT;
    let m = MagneticParams::DEFAULT;
    Ok(VqfParams {
        time: wild(u, d.time)?,
        motion_bias: bool::arbitrary(u)?,
        rest_bias: bool::arbitrary(u)?,
        bias_start: wild(u, d.bias_start)?,
        bias_time: wild(u, d.bias_time)?,
        bias_motion: wild(u, d.bias_motion)?,
        bias_vertical: wild(u, d.bias_vertical)?,
        bias_rest: wild(u, d.bias_rest)?,
        rest: RestParams { smoothing: wild(u, 0.5)?, max_bias: wild(u, d.rest.max_bias)?, ..d.rest },
        magnetic: MagneticParams {
            time: wild(u, m.time)?,
            reject: bool::arbitrary(u)?,
            smoothing: wild(u, m.smoothing)?,
            rejection_factor: wild(u, m.rejection_factor)?,
            max_gap: wild(u, m.max_gap)?,
            ..m
        },
        max_gap: wild(u, d.max_gap)?,
        force_error: wild(u, d.force_error)?,
    })
}

fn turned(q: Quat) -> bool {
    (q.length() - 1.0).abs() < 1e-3
}

fn all(u: &mut Unstructured<'_>) -> Result<()> {
    let Ok(mut filter) = Vqf::new(params(u)?) else { return Ok(()) };
    let mounting = if let Ok(q) = mounting_of([vec3(u)?.to_array(), vec3(u)?.to_array(), vec3(u)?.to_array()]) {
        assert!(turned(q), "{q}");
        q
    } else {
        quat(u)?
    };
    let calibration = ImuCalibration::new(triad(u)?, triad(u)?, triad(u)?, mounting, i64::arbitrary(u)?);
    let calibration = calibration.unwrap_or(ImuCalibration::IDENTITY);
    let screen = ScreenParams { hysteresis: wild(u, 0.26)?, flat: wild(u, 0.44)? };
    let mut screen = ScreenTurn::new(screen).or_else(|_| ScreenTurn::new(ScreenParams::DEFAULT)).expect("the defaults");
    let mut alone = RestBias::new(RestParams::DEFAULT).expect("the defaults");
    let wanted = OffsetParams {
        reach: wild(u, 0.1)?,
        step: wild(u, 0.005)?,
        min_intervals: 8,
        max_gap: wild(u, 0.15)?,
        min_motion: wild(u, 0.15)?,
        ..OffsetParams::DEFAULT
    };
    let offset = TimeOffset::<64, 16>::new(wanted);
    let mut offset = offset.unwrap_or_else(|_| TimeOffset::new(OffsetParams::DEFAULT).expect("the defaults"));
    let mut now = 0_i64;
    while !u.is_empty() {
        now = if u.ratio(7, 8)? { now.saturating_add(u.int_in_range(0..=20_000_000)?) } else { i64::arbitrary(u)? };
        let time = Timestamp::from_nanos(now);
        let field = if u.ratio(1, 3)? { Some(vec3(u)?) } else { None };
        let raw = ImuSample { time, rate: vec3(u)?, force: vec3(u)?, field };
        let sample = calibration.apply(&raw);
        let before = filter;
        let step = filter.update(&sample);
        assert!(step != Step::Refused || filter == before, "a refused reading changed something");
        assert!(sample.is_usable() || step == Step::Refused);
        let q = filter.orientation();
        assert!(turned(q) && filter.orientation_north().is_none_or(turned), "{q}");
        assert!(filter.bias().is_finite() && filter.bias_sigma() >= 0.0);
        assert!(filter.orientation_at(Timestamp::from_nanos(now.wrapping_mul(2))).is_none_or(turned));
        if let Some(gravity) = filter.gravity() {
            assert!((gravity.up.length() - 1.0).abs() < 2e-3 && gravity.sigma >= 0.0, "{gravity:?}");
            let pose = camera_pose(q, mounting);
            let _ = (screen.update(gravity.in_camera(mounting)), gravity.in_world(mounting, &pose));
        }
        alone.update(&sample);
        assert!(alone.bias().is_finite() && alone.sigma() >= 0.0);
        offset.imu(&sample);
        if u.ratio(1, 4)? {
            offset.camera(quat(u)?, time);
        }
        if u.ratio(1, 16)? {
            filter.set_bias(vec3(u)?, number(u)?);
            screen.update(vec3(u)?);
        }
    }
    match offset.estimate() {
        Ok(found) => assert!(found.sigma.is_finite() && found.correlation <= 1.0 && found.nanos.abs() < 1_200_000_000),
        Err(why) => assert!(!why.to_string().is_empty()),
    }
    Ok(())
}

/// Readings in.
pub fn imu(data: &[u8]) {
    let _ = all(&mut Unstructured::new(data));
}
