//! The inertial module in the image.

use core::hint::black_box;

use isobath::glam::{Quat, Vec3};
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::Pose;
use isobath::sensing::imu::calibration::{ImuCalibration, Triad, mounting_of};
use isobath::sensing::imu::gravity::camera_pose;
use isobath::sensing::imu::offset::{OffsetParams, TimeOffset};
use isobath::sensing::imu::rest::{RestBias, RestParams};
use isobath::sensing::imu::screen::{ScreenParams, ScreenTurn, Turn};
use isobath::sensing::imu::vqf::{Vqf, VqfParams};
use isobath::sensing::imu::{ImuSample, Step};

/// Each call once; how many answered.
pub(crate) fn exercise(pose: &Pose) -> Option<usize> {
    let triad = Triad { bias: black_box(Vec3::X), ..Triad::IDENTITY };
    let mounting = mounting_of(black_box([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])).ok()?;
    let calibration = ImuCalibration::new(triad, triad, triad, mounting, black_box(3)).ok()?;
    let mut filter = Vqf::new(black_box(VqfParams::DEFAULT)).ok()?;
    let mut alone = RestBias::new(black_box(RestParams::DEFAULT)).ok()?;
    let mut screen = ScreenTurn::new(black_box(ScreenParams::DEFAULT)).ok()?;
    let mut offset = TimeOffset::<64, 16>::new(black_box(OffsetParams::DEFAULT)).ok()?;
    filter.set_bias(black_box(Vec3::X), black_box(0.1));
    let mut sum = 0;
    for i in 0..black_box(3) {
        let time = Timestamp::from_nanos(black_box(i));
        let field = black_box(Some(Vec3::Y));
        let sample = calibration.apply(&ImuSample { time, rate: black_box(Vec3::X), force: black_box(Vec3::Y), field });
        sum += usize::from(filter.update(&sample) != Step::Refused) + usize::from(alone.update(&sample).is_used());
        offset.imu(&sample);
        offset.camera(black_box(Quat::IDENTITY), time);
        black_box((alone.bias(), alone.sigma(), filter.bias(), filter.bias_sigma(), filter.is_field_disturbed()));
        black_box((filter.orientation_north(), filter.orientation_at(black_box(time)), filter.is_at_rest()));
        if let Some(gravity) = filter.gravity() {
            black_box((gravity.in_world(mounting, pose), camera_pose(filter.orientation(), mounting)));
            sum += usize::from(screen.update(gravity.in_camera(mounting)) == Turn::Left);
        }
    }
    Some(sum + offset.estimate().map_or(0, |e| usize::from(e.intervals)))
}
