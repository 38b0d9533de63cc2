//! The orientation filter against the optical truth of two BROAD recordings, against the `f64` implementation that others use (`vqf-rs`), and
//! against simulated hands. `cargo test -p isobath-tests --test imu -- --nocapture` prints the figures; times are the bench's (`isobath bench --filter orientation`).

use glam::{DQuat, Quat};
use isobath::ground::units::Timestamp;
use isobath::sensing::imu::ImuCalibration;
use isobath::sensing::imu::calibration::Triad;
use isobath::sensing::imu::offset::{OffsetEstimate, OffsetParams, TimeOffset};
use isobath::sensing::imu::vqf::{Vqf, VqfParams};
use isobath_bench::inertial::{BROAD, Errors, Naive, Trial, broad, double, simulated};
use vqf_rs::VQF;

fn ours(trial: &Trial, field: bool) -> Vec<DQuat> {
    let mut filter = Vqf::new(VqfParams::DEFAULT).expect("the defaults");
    trial.run(|s| {
        filter.update(s);
        double(if field { filter.orientation_north().expect("there is a field") } else { filter.orientation() })
    })
}

fn theirs(trial: &Trial, field: bool) -> Vec<DQuat> {
    let mut filter = VQF::new(trial.period, None, None, None);
    trial.run(|s| {
        let wide = |v: glam::Vec3| v.as_dvec3().to_array();
        filter.update(wide(s.rate), wide(s.force), s.field.filter(|_| field).map(wide));
        let q = if field { filter.quat_9d() } else { filter.quat_6d() };
        DQuat::from_xyzw(q.1, q.2, q.3, q.0)
    })
}

/// As good as the reference implementation, and far better than the naive filter; both recordings, with and without magnetometer.
#[test]
fn inclination_on_the_broad_recordings() {
    for number in BROAD {
        let Some(trial) = broad(number) else {
            println!("skipped: no shared data");
            return;
        };
        let mut naive = Naive::new(trial.period);
        let simple = trial.score(trial.run(|s| naive.update(s)));
        println!("BROAD {number:02}: complementary filter      inclination {:.3} degrees", simple.inclination);
        for field in [false, true] {
            let a = trial.score(ours(&trial, field));
            let b = trial.score(theirs(&trial, field));
            let label = if field { "magnetometer" } else { "6D" };
            let say = |who: &str, e: Errors| {
                println!(
                    "BROAD {number:02}: {who} {label:12} inclination {:.4} degrees, total {:.4}",
                    e.inclination, e.total
                );
            };
            say("isobath", a);
            say("vqf-rs ", b);
            assert!(a.inclination <= b.inclination + 1e-4, "{a:?} {b:?}");
            if field {
                assert!(a.total <= b.total, "{a:?} {b:?}");
            }
            assert!(a.inclination < 0.5 * simple.inclination);
        }
    }
}

/// The uncertainty that comes with gravity is of the size of its error.
#[test]
fn gravity_knows_how_well_it_is_known() {
    let recorded = BROAD.iter().filter_map(|&n| Some((format!("BROAD {n:02}"), broad(n)?)));
    for (name, trial) in recorded.chain([("simulated".to_owned(), simulated(3))]) {
        let mut filter = Vqf::new(VqfParams::DEFAULT).expect("the defaults");
        let mut sum = (0.0, 0.0, 0);
        for (s, truth) in trial.samples.iter().zip(&trial.truth) {
            filter.update(s);
            let gravity = filter.gravity().expect("there was a reading");
            if let Some(truth) = truth {
                let up = truth.conjugate() * glam::DVec3::Z;
                let off = up.angle_between(gravity.up.as_dvec3());
                sum = (sum.0 + off * off, sum.1 + f64::from(gravity.sigma).powi(2), sum.2 + 1);
            }
        }
        let rms = |s: f64| (s / f64::from(sum.2)).sqrt().to_degrees();
        let ratio = rms(sum.0) / rms(sum.1);
        println!("{name}: error {:.3} degrees, predicted {:.3}, ratio {ratio:.2}", rms(sum.0), rms(sum.1));
        assert!((0.5..1.5).contains(&ratio), "{name}: {ratio}");
    }
}

/// The same inputs through the `f64` implementation: what single precision and the other forms of the same formulas cost.
#[test]
fn single_precision_costs_little() {
    for (name, trial) in [("simulated".to_owned(), simulated(1))]
        .into_iter()
        .chain(BROAD.iter().filter_map(|&n| Some((format!("BROAD {n:02}"), broad(n)?))))
    {
        let (mut tilt, mut most) = (0.0_f64, 0.0_f64);
        for (i, (a, b)) in ours(&trial, false).into_iter().zip(theirs(&trial, false)).enumerate() {
            let off = a * b.conjugate();
            let inclination = 2.0 * off.x.hypot(off.y).atan2(off.w.hypot(off.z));
            most = most.max(inclination.to_degrees());
            // After the start, which counts readings in the one and seconds in the other.
            if i as f64 * trial.period > 10.0 {
                tilt = tilt.max(inclination.to_degrees());
            }
        }
        println!("{name}: verticals differ by at most {tilt:.5} degrees ({most:.5} in the first ten seconds)");
        assert!(tilt < 0.05 && most < 0.2, "{name}: {tilt} {most}");
    }
}

/// The gyroscope's delay against the cameras, from the speeds of both: every tenth optical orientation (28.6 Hz) against all readings.
fn delay(trial: &Trial) -> OffsetEstimate {
    let mut offset = Box::new(TimeOffset::<32_768, 4096>::new(OffsetParams::DEFAULT).expect("the defaults"));
    for (i, (s, truth)) in trial.samples.iter().zip(&trial.truth).enumerate().skip(15_000).take(32_000) {
        offset.imu(s);
        if let (0, Some(q)) = (i % 10, truth) {
            let q = q.as_quat();
            offset.camera(Quat::from_xyzw(q.x, q.y, q.z, q.w), s.time);
        }
    }
    offset.estimate().expect("a lively motion")
}

/// Crosswise, so that no recording is scored with what it told of itself: the delay that the one shows, applied to the other, lowers its error; that is what the
/// calibration's time offset and `orientation_at` are for. The error against the best that stamps alone allow.
#[test]
fn the_delay_found_on_one_recording_improves_the_other() {
    let (Some(slow), Some(shaken)) = (broad(3), broad(27)) else { return };
    let (of_slow, of_shaken) = (delay(&slow), delay(&shaken));
    println!("delay on BROAD 03: {of_slow:?}\ndelay on BROAD 27: {of_shaken:?}");
    assert!((of_slow.nanos - of_shaken.nanos).abs() < 1_000_000);
    for (number, trial, found) in [(3, &slow, of_shaken), (27, &shaken, of_slow)] {
        let plain = trial.score(ours(trial, true));
        let t = Triad::IDENTITY;
        let calibration = ImuCalibration::new(t, t, t, Quat::IDENTITY, found.nanos).expect("a calibration");
        let mut filter = Vqf::new(VqfParams::DEFAULT).expect("the defaults");
        let answers = trial.run(|s| {
            filter.update(&calibration.apply(s));
            // What is asked for is the time of the optical truth; and north by the filter's own heading.
            let tilted = filter.orientation_at(Timestamp::from_nanos(s.time.as_nanos())).expect("milliseconds ahead");
            let heading =
                double(filter.orientation_north().expect("a field")) * double(filter.orientation()).conjugate();
            heading * double(tilted)
        });
        let better = trial.score(answers);
        println!(
            "BROAD {number:02}: inclination {:.4} degrees, with the other's delay {:.4}; total {:.4}, {:.4}",
            plain.inclination, better.inclination, plain.total, better.total
        );
        assert!(better.inclination < plain.inclination && better.total < plain.total);
    }
}
