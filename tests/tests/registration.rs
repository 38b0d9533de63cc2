//! Registration on the simulated living room: how near the truth do drifted poses come back?
//!
//! Five views, the first stays, each of the others is moved by 5 cm and turned by 5 degrees in a random direction. Error is that
//! of the corrected poses seen from the first view.

use std::time::Instant;

use glam::{Mat3, Quat, Vec3};
use isobath::ground::image::ImageView;
use isobath::lighting::registration::{Progress, Registration, RegistrationParams, ViewReport, scratch_len};
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::frame::DepthFrame;
use isobath_sim::{Rigid, Scene, SensorModel, Trajectory, V3};

const VIEWS: usize = 5;

/// Five views of a scene, sensed, with their true poses.
struct Views {
    size: (usize, usize),
    unit: DepthUnit,
    intrinsics: Intrinsics,
    depth: Vec<Vec<u16>>,
    truth: Vec<Pose>,
}

fn vec3(v: V3) -> Vec3 {
    Vec3::from(v.to_f32())
}

fn pose(p: &Rigid) -> Pose {
    let r = &p.rotation;
    Pose::new(Quat::from_mat3(&Mat3::from_cols(vec3(r.x), vec3(r.y), vec3(r.z))), vec3(p.translation)).unwrap()
}

fn views(scene: &Scene, poses: &[Rigid], size: (usize, usize), sensor: &str, unit: f32) -> Views {
    let camera = scene.camera(size.0, size.1).unwrap();
    let sensor: SensorModel = sensor.parse().unwrap();
    let depth = poses.iter().enumerate().map(|(i, p)| {
        let truth = scene.render_geometry(0.0, &camera, p);
        let sensed = sensor.sense(&truth, &camera, 7, i as u64);
        let step = |z: &f64| {
            let n = (z / f64::from(unit)).round();
            if (1.0..65_535.0).contains(&n) { n as u16 } else { 0 }
        };
        sensed.z.iter().map(step).collect()
    });
    Views {
        size,
        unit: DepthUnit::new(unit).unwrap(),
        intrinsics: Intrinsics::new(camera.fx as f32, camera.fy as f32, camera.cx as f32, camera.cy as f32).unwrap(),
        depth: depth.collect(),
        truth: poses.iter().map(pose).collect(),
    }
}

/// A random unit vector.
fn direction(s: &mut u64) -> Vec3 {
    loop {
        let v = Vec3::from_array([(); 3].map(|()| {
            *s ^= *s << 13;
            *s ^= *s >> 7;
            *s ^= *s << 17;
            (*s >> 40) as f32 / 8_388_608.0 - 1.0
        }));
        if (0.1..1.0).contains(&v.length()) {
            return v / v.length();
        }
    }
}

fn drifted(pose: &Pose, seed: &mut u64, shift: f32, turn: f32) -> Pose {
    let turn = Quat::from_axis_angle(direction(seed), turn);
    Pose::new(turn * pose.rotation(), pose.translation() + direction(seed) * shift).unwrap()
}

/// Millimetres and degrees.
fn error(pose: &Pose, truth: &Pose) -> (f64, f64) {
    let d = pose.relative_to(truth);
    let r = d.rotation();
    let angle = 2.0 * f64::from(Vec3::new(r.x, r.y, r.z).length()).min(1.0).asin();
    (1e3 * f64::from(d.translation().length()), angle.to_degrees())
}

impl Views {
    /// Registers; reports, milliseconds to prepare one view, and to register.
    fn register(&self, tracked: &[Pose], noise: &DepthNoise) -> (Vec<ViewReport>, f64, f64) {
        let mut memory = vec![0.0; VIEWS * scratch_len(self.size.0, self.size.1)];
        let mut registration = Registration::<VIEWS>::new(&mut memory, RegistrationParams::default());
        let start = Instant::now();
        for (i, (depth, pose)) in self.depth.iter().zip(tracked).enumerate() {
            let view = ImageView::new(depth, self.size.0, self.size.1).unwrap();
            let frame = DepthFrame::new(view, self.unit, self.intrinsics).with_pose(*pose);
            registration.set(i, &frame, noise).unwrap();
        }
        let prepared = start.elapsed().as_secs_f64() * 1e3 / VIEWS as f64;
        let start = Instant::now();
        registration.start(&[0]).unwrap();
        assert_eq!(registration.step(usize::MAX), Progress::Done);
        let time = start.elapsed().as_secs_f64() * 1e3;
        ((0..self.depth.len()).map(|i| registration.report(i).unwrap()).collect(), prepared, time)
    }
}

fn walk(scene: &Scene) -> Vec<Rigid> {
    let walk = Trajectory::walk(scene.view());
    [0.0, 1.0, 2.0, 3.0, 4.0].map(|t| walk.at(t).pose).to_vec()
}

fn orbit(scene: &Scene) -> Vec<Rigid> {
    let place = *scene.places().values().next().unwrap();
    let circle = Trajectory::orbit(place, 0.3 * 1.7, 0.8 * 1.7, 8.0, 0.0);
    [0.0, 0.5, 1.0, 1.5, 2.0].map(|t| circle.at(t).pose).to_vec()
}

#[test]
fn living_room() {
    let scene = Scene::open("living-room").unwrap();
    println!("{:?}", scene.places());
    let sizes: &[(usize, usize)] = &[(1024, 768), (160, 120)];
    for (way, poses) in [("walk", walk(&scene)), ("orbit", orbit(&scene))] {
        for &size in sizes {
            for (sensor, unit, noise) in [
                ("none", 0.000_2, DepthNoise::NONE),
                ("none", 0.001, DepthNoise::NONE),
                ("kinect", 0.001, DepthNoise::KINECT),
                ("kinect-full", 0.001, DepthNoise::KINECT),
                ("tof", 0.001, DepthNoise::TIME_OF_FLIGHT),
            ] {
                let views = views(&scene, &poses, size, sensor, unit);
                let mut seed = 0x9e37_79b9_u64;
                let (mut worst, mut sum, mut n, mut ms, mut prep) =
                    ((0.0_f64, 0.0_f64), (0.0, 0.0), 0, 0.0_f64, 0.0_f64);
                let mut bad = 0;
                for trial in 0..25 {
                    let tracked: Vec<Pose> = views
                        .truth
                        .iter()
                        .enumerate()
                        .map(|(i, p)| if i == 0 { *p } else { drifted(p, &mut seed, 0.05, 5.0_f32.to_radians()) })
                        .collect();
                    let (reports, prepared, time) = views.register(&tracked, &noise);
                    (ms, prep) = (ms.max(time), prep.max(prepared));
                    for (i, (r, truth)) in reports.iter().zip(&views.truth).enumerate().skip(1) {
                        let e = error(&r.pose, truth);
                        worst = (worst.0.max(e.0), worst.1.max(e.1));
                        sum = (sum.0 + e.0, sum.1 + e.1);
                        n += 1;
                        bad += usize::from(e.0 > 3.0 || e.1 > 0.15);
                        if std::env::var_os("VERBOSE").is_some() && (trial == 0 || e.0 > 10.0) {
                            println!(
                                "   {trial} view {i}: {:.2} mm {:.3} deg {:?} it {} rms {:.2} mm inl {:.2} n {} info {:.4} {:.4} unk {}",
                                e.0,
                                e.1,
                                r.outcome,
                                r.iterations,
                                r.rms * 1e3,
                                r.inliers,
                                r.matched,
                                r.directions[0].information,
                                r.directions[1].information,
                                r.unknown
                            );
                        }
                    }
                }
                println!(
                    "{way} {size:?} {sensor} {unit}: mean {:.2} mm {:.3} deg, worst {:.2} mm {:.3} deg, {bad}/{n} beyond; {prep:.2} ms a view, {ms:.2} ms",
                    sum.0 / n as f64,
                    sum.1 / n as f64,
                    worst.0,
                    worst.1
                );
            }
        }
    }
}
