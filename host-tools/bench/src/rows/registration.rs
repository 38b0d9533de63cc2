//! Where did drifted views truly stand? Corrected poses against the true ones.

use std::hint::black_box;

use isobath::glam::{Quat, Vec3};
use isobath::ground::image::ImageView;
use isobath::lighting::registration::{Outcome, Progress, Registration, RegistrationParams, ViewReport, scratch_len};
use isobath::sensing::camera::Pose;
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath_sim::{Rigid, Trajectory, core_pose};

use crate::input::{Depth, Input, Random, Sensor};
use crate::row::{Measure, Method, Row, Score};

/// Five views on a walk, the first where it is, the others 5 cm and 5 degrees off in random directions.
pub(crate) const REGISTRATION: Row = Row {
    name: "lighting-registration",
    title: "Poses of five views, corrected",
    unit: "run",
    errors: &[
        Measure {
            unit: "mm",
            name: "off",
            what: "mean distance of the corrected cameras from the true ones",
            shown: true,
        },
        Measure {
            unit: "mdeg",
            name: "turned",
            what: "mean angle of the corrected cameras from the true ones",
            shown: true,
        },
        Measure { unit: "mm", name: "worst", what: "largest distance", shown: true },
        Measure { unit: "mdeg", name: "most", what: "largest angle", shown: false },
        Measure {
            unit: "per 100",
            name: "refused",
            what: "views not corrected, or not in all six directions",
            shown: true,
        },
    ],
    sensors: Sensor::ALL,
    scenes: &["wall", "corner", "desk", "living-room", "corridor"],
    methods,
    answers: None,
};

const VIEWS: usize = 5;
/// Drifts that are tried.
const TRIALS: usize = 5;
/// Drift of each view.
const SHIFT: f32 = 0.05;
const TURN: f32 = 0.087_266_46;

/// What is registered: images, and where they were truly taken.
struct Views<'a> {
    input: &'a Input,
    depth: Vec<Depth>,
    truth: Vec<Pose>,
    /// For each trial.
    tracked: Vec<Vec<Pose>>,
}

fn direction(random: &mut Random) -> Vec3 {
    loop {
        let v = Vec3::from_array([(); 3].map(|()| random.between(-1.0, 1.0) as f32));
        if (0.1..1.0).contains(&v.length()) {
            return v / v.length();
        }
    }
}

impl<'a> Views<'a> {
    fn new(input: &'a Input) -> Self {
        let walk = Trajectory::walk(input.scene.view());
        let places: Vec<Rigid> = (0..VIEWS).map(|i| walk.at(i as f64).pose).collect();
        let depth = places.iter().enumerate().map(|(i, place)| {
            let truth = input.scene.render_geometry(0.0, &input.camera, place);
            input.sensor.sense(&truth, &input.camera, input.seed, i as u64)
        });
        let depth = depth.collect();
        let truth: Vec<Pose> = places.iter().map(|p| core_pose(p).unwrap_or(Pose::IDENTITY)).collect();
        let mut random = Random::new(input.seed ^ 0xd21f);
        let mut drifted = |(i, p): (usize, &Pose)| {
            if i == 0 {
                return *p;
            }
            let turn = Quat::from_axis_angle(direction(&mut random), TURN);
            Pose::new(turn * p.rotation(), p.translation() + direction(&mut random) * SHIFT).unwrap_or(*p)
        };
        let tracked = (0..TRIALS).map(|_| truth.iter().enumerate().map(&mut drifted).collect()).collect();
        Self { input, depth, truth, tracked }
    }

    /// Floats of memory.
    fn memory(&self) -> Vec<f32> {
        let (width, height) = self.input.size();
        vec![0.0; VIEWS * scratch_len(width, height)]
    }

    fn set(&self, registration: &mut Registration<'_, VIEWS>, view: usize, pose: Pose) {
        match &self.depth[view] {
            Depth::U16(depth) => self.set_from(registration, view, depth, DepthUnit::MILLIMETRE, pose),
            Depth::F32(depth) => self.set_from(registration, view, depth, DepthUnit::METRE, pose),
        }
    }

    fn set_from<D: DepthSample>(
        &self,
        registration: &mut Registration<'_, VIEWS>,
        view: usize,
        depth: &[D],
        unit: DepthUnit,
        pose: Pose,
    ) {
        let (width, height) = self.input.size();
        let image = ImageView::new(depth, width, height).unwrap_or(ImageView::EMPTY);
        let frame = DepthFrame::new(image, unit, self.input.intrinsics).with_pose(pose);
        // An image too small for it is registered by nobody, and scored as refused.
        let _ = registration.set(view, &frame, &self.input.sensor.noise());
    }

    /// All views with the poses of a trial.
    fn set_all(&self, registration: &mut Registration<'_, VIEWS>, trial: usize) {
        for (view, pose) in self.tracked[trial].iter().enumerate() {
            self.set(registration, view, *pose);
        }
    }

    /// Of trials in which `fixed` views stand where they truly were.
    fn score(&self, fixed: &[usize]) -> Score {
        let mut memory = self.memory();
        let mut registration = Registration::<VIEWS>::new(&mut memory, RegistrationParams::default());
        let mut found = Vec::new();
        for trial in 0..TRIALS {
            self.set_all(&mut registration, trial);
            for &view in fixed {
                registration.set_pose(view, self.truth[view]);
            }
            run(&mut registration, fixed);
            found.extend((0..VIEWS).filter(|i| !fixed.contains(i)).map(|i| (registration.report(i), &self.truth[i])));
        }
        let n = found.len() as f64;
        let errors: Vec<(f64, f64)> =
            found.iter().map(|(r, t)| r.as_ref().map_or((f64::NAN, f64::NAN), |r| off(r, t))).collect();
        let (mm, turn) = errors.iter().fold((0.0, 0.0), |sum, e| (sum.0 + e.0 / n, sum.1 + e.1 / n));
        let worst = errors.iter().fold((0.0_f64, 0.0_f64), |worst, e| (worst.0.max(e.0), worst.1.max(e.1)));
        let whole = found.iter().filter(|(r, _)| r.is_some_and(|r| r.outcome == Outcome::Registered)).count() as f64;
        Score::of([mm, turn, worst.0, worst.1, 100.0 * (n - whole) / n])
    }
}

/// Millimetres and thousandths of a degree.
fn off(report: &ViewReport, truth: &Pose) -> (f64, f64) {
    let d = report.pose.relative_to(truth);
    let r = d.rotation();
    let half = f64::from(Vec3::new(r.x, r.y, r.z).length()).min(1.0).asin();
    (1e3 * f64::from(d.translation().length()), 2e3 * half.to_degrees())
}

fn run(registration: &mut Registration<'_, VIEWS>, fixed: &[usize]) {
    if registration.start(fixed).is_ok() {
        while registration.step(usize::MAX) == Progress::Working {}
    }
}

fn methods(input: &Input) -> Vec<Method<'_>> {
    let views = std::rc::Rc::new(Views::new(input));
    let mut out = Vec::new();
    let (v, mut memory) = (views.clone(), views.memory());
    let whole = move || {
        let mut registration = Registration::<VIEWS>::new(&mut memory, RegistrationParams::default());
        v.set_all(&mut registration, 0);
        run(&mut registration, &[0]);
        _ = black_box(registration.report(VIEWS - 1));
    };
    let v = views.clone();
    out.push(Method::new("5 images to poses", 1, whole, move || v.score(&[0])));

    let (v, mut memory) = (views.clone(), views.memory());
    let last = move || {
        // The four before it are in memory from the first time on.
        let mut registration = Registration::<VIEWS>::new(&mut memory, RegistrationParams::default());
        v.set(&mut registration, VIEWS - 1, v.tracked[0][VIEWS - 1]);
        _ = black_box(&registration);
    };
    out.push(Method::new("1 image prepared", 1, last, move || Score::of([f64::NAN; 5])));

    // Prepared once; poses are given anew. Both closures share what they are prepared in, so it lives as long as the program.
    let memory: &'static mut [f32] = Vec::leak(views.memory());
    let mut prepared = Registration::<VIEWS>::new(memory, RegistrationParams::default());
    views.set_all(&mut prepared, 0);
    let prepared = std::rc::Rc::new(std::cell::RefCell::new(prepared));
    for (name, fixed) in [("5 prepared views", &[0][..]), ("1 view to 4", &[0, 1, 2, 3][..])] {
        let (v, p) = (views.clone(), prepared.clone());
        let again = move || {
            let mut registration = p.borrow_mut();
            for (view, pose) in v.tracked[0].iter().enumerate() {
                registration.set_pose(view, if fixed.contains(&view) { v.truth[view] } else { *pose });
            }
            run(&mut registration, fixed);
            _ = black_box(registration.report(VIEWS - 1));
        };
        let v = views.clone();
        out.push(Method::new(name, 1, again, move || v.score(fixed)));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_living_room_is_registered_and_a_wall_refused() {
        let input = Input::new("living-room", Sensor::Millimetres, (320, 240), 1).unwrap();
        let score = Views::new(&input).score(&[0]);
        assert!(score.errors[2] < 3.0 && score.errors[3] < 150.0 && score.errors[4] == 0.0, "{score:?}");
        let input = Input::new("wall", Sensor::Millimetres, (160, 120), 1).unwrap();
        let score = Views::new(&input).score(&[0]);
        assert_eq!(score.errors[4], 100.0, "{score:?}");
    }
}
