//! Where do rain and snow land? A pool of particles that fall, hit the scene, rest and start anew (DepthLab, "Other use
//! cases": weather that collides with the real surroundings).
//!
//! Each step moves a falling particle along its velocity; the ray cast tests the whole way of the step, so that a fast drop
//! does not pass through a surface between two steps. A particle that hits rests for a life time (the age, 0 to 1, is for
//! drawing the ripple or the melting flake), then starts again where the wind blows into the box. One that leaves the
//! box starts again at once. The same seed and the same calls give the same weather, on every target.
//!
//! Memory: 24 bytes a particle in the pool, nothing else. Cost: one short ray cast (a few pixels) per falling particle in
//! the view and a step; outside the view particles are only moved, and the report counts both. Error: a particle lands
//! where the ray hits; the straight way of one step stands for the flutter's curve.

use core::f32::consts::TAU;

use glam::{Quat, Vec3};

use crate::ground::geometry::{OrientedBox, Ray};
use crate::ground::math;
use crate::ground::rotation::{length, rotate, rotate_back, unit};
use crate::localized::raycast::{RayOutcome, RayParams, cast};
use crate::sensing::depth::{DepthSample, HolePolicy};
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;
use crate::skipping::pyramid::Pyramid;

/// How particles fall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParticleParams {
    /// Where it rains: the box in the world, metres, in which particles start and outside of which they end.
    pub region: OrientedBox,
    /// Which way is down in the world; any length but zero.
    pub down: Vec3,
    /// Final speed of the fall, m/s. Rain 9, snow 1; at least 0.
    pub speed: f32,
    /// Wind in the world, m/s. Default none.
    pub wind: Vec3,
    /// Speed of the sideways flutter, m/s. Rain 0, snow 0.4; at least 0.
    pub flutter: f32,
    /// How long a particle rests where it hit, seconds. Rain 0.4, snow 4; 0 or less ends it with the step after it hit.
    pub life: f32,
    /// How far before a particle's place each step's test begins, metres. Default 0.05. A surface that noise brings towards
    /// the camera between two frames would otherwise pass over the particle; at least 0.
    pub tail: f32,
    /// How far behind a surface still hits it, metres along the optical axis. Default 0.3.
    pub thickness: f32,
    /// What a hole means. Default [`HolePolicy::Free`]: particles fall on through.
    pub holes: HolePolicy,
}

impl ParticleParams {
    /// Rain in a box, falling `down`.
    #[must_use]
    pub const fn rain(region: OrientedBox, down: Vec3) -> Self {
        Self {
            region,
            down,
            speed: 9.0,
            wind: Vec3::ZERO,
            flutter: 0.0,
            life: 0.4,
            tail: 0.05,
            thickness: 0.3,
            holes: HolePolicy::Free,
        }
    }

    /// Snow in a box, falling `down`.
    #[must_use]
    pub const fn snow(region: OrientedBox, down: Vec3) -> Self {
        Self { speed: 1.0, flutter: 0.4, life: 4.0, ..Self::rain(region, down) }
    }
}

/// What a particle does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    /// It has no place yet: the pool was never stepped.
    Unborn,
    /// It falls.
    Falling {
        /// It is behind a surface, where it should not be drawn.
        hidden: bool,
    },
    /// It rests where it hit.
    Landed {
        /// 0 at the impact to 1 at the end of its life.
        age: f32,
    },
}

/// One drop or flake.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Particle {
    /// Place in the world, metres.
    pub position: Vec3,
    /// What it does.
    pub phase: Phase,
    /// Phase of its flutter, radians.
    swing: f32,
}

/// What a step did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StepReport {
    /// Particles falling after the step.
    pub falling: u32,
    /// Particles at rest after the step.
    pub landed: u32,
    /// Particles that hit something during the step.
    pub hits: u32,
    /// Particles that started anew during the step.
    pub respawned: u32,
    /// Ray casts done, and falling particles moved without one because they are outside the view.
    pub work: Work,
}

/// `N` particles and their random numbers.
///
/// ```
/// use glam::{vec3, Quat};
/// use isobath::ground::geometry::OrientedBox;
/// use isobath::localized::particles::{ParticleParams, ParticlePool};
/// use isobath::sensing::{camera::Intrinsics, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// static WALL: DepthArray<160, 120> = DepthArray::filled(2000);
/// let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5)?;
/// let frame = DepthFrame::new(WALL.view(), DepthUnit::MILLIMETRE, k);
/// // Blown at the wall: down is away from the camera here.
/// let region = OrientedBox { centre: vec3(0.0, 0.0, 2.0), half: vec3(0.5, 0.5, 1.5), rotation: Quat::IDENTITY };
/// let rain = ParticleParams::rain(region, vec3(0.0, 0.0, 1.0));
/// let mut pool = ParticlePool::<100>::new(42);
/// let mut hits = 0;
/// for _ in 0..30 {
///     hits += pool.step(&frame, None, &rain, 1.0 / 30.0).hits;
/// }
/// assert!(hits > 100);
/// # Ok::<(), isobath::sensing::camera::intrinsics::IntrinsicsError>(())
/// ```
#[derive(Debug, Clone)]
pub struct ParticlePool<const N: usize> {
    particles: [Particle; N],
    random: Random,
}

/// Longest step, seconds: beyond it a frame was surely lost and the weather goes on from where it was.
const MAX_STEP: f32 = 1.0;
/// Swings of the flutter, radians per second.
const SWING_RATE: f32 = 2.5;

impl<const N: usize> ParticlePool<N> {
    /// A pool whose particles are born, all over the box, at the first step.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        let unborn = Particle { position: Vec3::ZERO, phase: Phase::Unborn, swing: 0.0 };
        Self { particles: [unborn; N], random: Random::new(seed) }
    }

    /// The particles, always in the same order.
    #[must_use]
    pub const fn particles(&self) -> &[Particle] {
        &self.particles
    }

    /// Moves everything on by `dt` seconds (0 to 1; beyond is taken as the nearer end, NaN as 0). Does nothing but count
    /// when a number in the parameters is not finite.
    pub fn step<D: DepthSample>(
        &mut self,
        frame: &DepthFrame<'_, D>,
        pyramid: Option<&Pyramid<'_, D>>,
        params: &ParticleParams,
        dt: f32,
    ) -> StepReport {
        let mut report = StepReport::default();
        let dt = if dt > 0.0 { dt.min(MAX_STEP) } else { 0.0 };
        if let Some(weather) = Weather::new(params) {
            let view = View::new(frame);
            for particle in &mut self.particles {
                step_one(particle, &mut self.random, frame, pyramid, &view, params, &weather, dt, &mut report);
            }
        }
        for particle in &self.particles {
            match particle.phase {
                Phase::Unborn => {}
                Phase::Falling { .. } => report.falling += 1,
                Phase::Landed { .. } => report.landed += 1,
            }
        }
        report
    }
}

fn step_one<D: DepthSample>(
    particle: &mut Particle,
    random: &mut Random,
    frame: &DepthFrame<'_, D>,
    pyramid: Option<&Pyramid<'_, D>>,
    view: &View,
    params: &ParticleParams,
    weather: &Weather,
    dt: f32,
    report: &mut StepReport,
) {
    match particle.phase {
        Phase::Unborn => {
            particle.position = weather.anywhere(random);
            particle.swing = random.unit() * TAU;
            particle.phase = Phase::Falling { hidden: false };
        }
        Phase::Landed { age } => {
            let age = if params.life > 0.0 { age + dt / params.life } else { 1.0 };
            // Also ends what is no number.
            if age < 1.0 {
                particle.phase = Phase::Landed { age };
            } else {
                weather.respawn(particle, random);
                report.respawned += 1;
            }
            return;
        }
        Phase::Falling { .. } => {}
    }
    particle.swing = (particle.swing + SWING_RATE * dt) % TAU;
    let from = particle.position;
    let way = weather.velocity(particle.swing) * dt;
    let to = from + way;
    let tail = way.normalize_or_zero() * params.tail.max(0.0);
    particle.position = to;
    if view.misses(from - tail, to) {
        report.work.skipped += 1;
        particle.phase = Phase::Falling { hidden: false };
    } else if let Some(ray) = Ray::new(from - tail, way) {
        report.work.done += 1;
        let reach = way.length() + tail.length();
        let cast_params = RayParams { max_distance: reach, thickness: params.thickness, holes: params.holes };
        match cast(frame, pyramid, &ray, &cast_params).outcome {
            RayOutcome::Hit(hit) => {
                particle.position = hit.point;
                particle.phase = Phase::Landed { age: 0.0 };
                report.hits += 1;
                return;
            }
            outcome => {
                let hidden = matches!(outcome, RayOutcome::HitOccluded { .. });
                particle.phase = Phase::Falling { hidden };
            }
        }
    }
    if !weather.inside(to) {
        weather.respawn(particle, random);
        report.respawned += 1;
    }
}

/// What of the parameters is the same for all particles.
struct Weather {
    region: OrientedBox,
    /// Without the flutter, m/s.
    fall: Vec3,
    /// The two directions of the flutter, m/s.
    sway: (Vec3, Vec3),
}

impl Weather {
    fn new(params: &ParticleParams) -> Option<Self> {
        let down = params.down.try_normalize()?;
        let OrientedBox { centre, half, rotation } = params.region;
        let rotation = (rotation.is_finite() && length(rotation) > 0.0).then(|| unit(rotation))?;
        let (u, v) = down.any_orthonormal_pair();
        let flutter = params.flutter.max(0.0);
        let weather = Self {
            region: OrientedBox { centre, half: half.abs(), rotation },
            fall: down * params.speed.max(0.0) + params.wind,
            sway: (u * flutter, v * flutter),
        };
        // The sum is finite only when each is (and far from overflow).
        let sum = centre.abs() + half.abs() + weather.fall.abs() + Vec3::splat(flutter + params.tail.abs());
        (sum.length() < 1e9).then_some(weather)
    }

    fn velocity(&self, swing: f32) -> Vec3 {
        self.fall + self.sway.0 * math::sin(swing) + self.sway.1 * math::cos(0.7 * swing)
    }

    fn local(&self, point: Vec3) -> Vec3 {
        rotate_back(self.region.rotation, point - self.region.centre)
    }

    fn inside(&self, point: Vec3) -> bool {
        // A hair wider, so that a particle born on the face is inside.
        self.local(point).abs().cmple(self.region.half * 1.001 + Vec3::splat(1e-4)).all()
    }

    fn anywhere(&self, random: &mut Random) -> Vec3 {
        let r = Vec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
        self.region.centre + rotate(self.region.rotation, r * self.region.half)
    }

    /// Where the fall enters the box on its way to a random point of it: every part of the box keeps its share of drops.
    fn respawn(&self, particle: &mut Particle, random: &mut Random) {
        let point = self.anywhere(random);
        let (p, v) = (self.local(point), rotate_back(self.region.rotation, self.fall));
        let mut back = f32::INFINITY;
        for axis in 0..3 {
            let pick = |v: Vec3| v.to_array().get(axis).copied().unwrap_or(0.0);
            let (p, v, half) = (pick(p), pick(v), pick(self.region.half));
            if v != 0.0 {
                back = back.min((p + half * v.signum()).abs() / v.abs());
            }
        }
        let back = if back.is_finite() { back } else { 0.0 };
        *particle = Particle {
            position: point - self.fall * back,
            phase: Phase::Falling { hidden: false },
            swing: random.unit() * TAU,
        };
    }
}

/// The walls of the view as planes through the camera, not normalised, facing inwards.
struct View {
    walls: [Vec3; 5],
    /// The camera's rotation and place.
    to_camera: (Quat, Vec3),
}

impl View {
    fn new<D: DepthSample>(frame: &DepthFrame<'_, D>) -> Self {
        let (k, (w, h)) = (frame.intrinsics(), frame.size());
        let pose = frame.pose_or_identity();
        let walls = [
            Vec3::new(k.fx(), 0.0, k.cx() + 0.5),
            Vec3::new(-k.fx(), 0.0, w as f32 - 0.5 - k.cx()),
            Vec3::new(0.0, k.fy(), k.cy() + 0.5),
            Vec3::new(0.0, -k.fy(), h as f32 - 0.5 - k.cy()),
            Vec3::Z,
        ];
        Self { walls, to_camera: (pose.rotation(), pose.translation()) }
    }

    /// Whether both ends of a segment lie beyond the same wall. (Some segments that miss are not told: they are cast.)
    fn misses(&self, a: Vec3, b: Vec3) -> bool {
        let (turn, place) = self.to_camera;
        let (a, b) = (rotate_back(turn, a - place), rotate_back(turn, b - place));
        self.walls.iter().any(|wall| wall.dot(a) < 0.0 && wall.dot(b) < 0.0)
    }
}

/// PCG-XSH-RR 64/32 (O'Neill 2014): small, even, and the same on every target.
#[derive(Debug, Clone)]
struct Random(u64);

impl Random {
    const fn new(seed: u64) -> Self {
        Self(Self::advance(seed.wrapping_add(1_442_695_040_888_963_407)))
    }

    const fn advance(state: u64) -> u64 {
        state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407)
    }

    const fn next(&mut self) -> u32 {
        let old = self.0;
        self.0 = Self::advance(old);
        let word = (((old >> 18) ^ old) >> 27) as u32;
        word.rotate_right((old >> 59) as u32)
    }

    /// From 0 to below 1.
    fn unit(&mut self) -> f32 {
        (self.next() >> 8) as f32 * (1.0 / 16_777_216.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::image::ImageView;
    use crate::sensing::camera::{Intrinsics, Pose};
    use crate::sensing::depth::DepthUnit;
    use std::vec;
    use std::vec::Vec;

    /// A floor 1.2 m below a camera that looks level along z (y down), and nothing above the horizon.
    fn floor() -> Vec<f32> {
        (0..160 * 120).map(|i| ((i / 160) as f32 - 59.5) / 120.0).map(|y| if y > 0.0 { 1.2 / y } else { 0.0 }).collect()
    }

    fn frame(data: &[f32]) -> DepthFrame<'_, f32> {
        let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5).unwrap();
        DepthFrame::new(ImageView::new(data, 160, 120).unwrap(), DepthUnit::METRE, k)
    }

    const REGION: OrientedBox =
        OrientedBox { centre: Vec3::new(0.0, 0.0, 5.0), half: Vec3::new(2.0, 2.0, 2.0), rotation: Quat::IDENTITY };

    #[test]
    fn rain_lands_on_the_floor_however_long_the_step() {
        let data = floor();
        for (pose, dt) in [
            (Pose::IDENTITY, 0.03),
            (Pose::IDENTITY, 0.4),
            (Pose::new(Quat::from_rotation_z(0.4), Vec3::new(1.0, 2.0, -1.0)).unwrap(), 0.1),
        ] {
            let frame = frame(&data).with_pose(pose);
            let region =
                OrientedBox { centre: pose.to_world(REGION.centre), half: REGION.half, rotation: pose.rotation() };
            let rain = ParticleParams {
                wind: pose.direction_to_world(Vec3::X),
                ..ParticleParams::rain(region, pose.direction_to_world(Vec3::Y))
            };
            let mut pool = ParticlePool::<200>::new(1);
            let (mut hits, mut gone) = (0, 0);
            for _ in 0..60 {
                let report = pool.step(&frame, None, &rain, dt);
                assert_eq!(report.falling + report.landed, 200);
                hits += report.hits;
                for p in pool.particles() {
                    let q = pose.to_camera(p.position);
                    match p.phase {
                        Phase::Landed { age } => {
                            assert!((0.0..1.0).contains(&age));
                            assert!((q.y - 1.2).abs() < 0.02, "rests at {q}");
                        }
                        Phase::Falling { hidden } => {
                            // Within the view nothing gets through the floor; at its rim a drop may come in below.
                            let inside = q.z > 3.2 && (q.x / q.z).abs() < 0.3;
                            gone += u32::from(inside && q.y > 1.25 && !hidden);
                            assert!((q - REGION.centre).abs().max_element() < 2.01 + 10.0 * dt);
                        }
                        Phase::Unborn => panic!(),
                    }
                }
            }
            assert!(hits > 300, "{hits}");
            // Those born below the floor, in the first step, fall out of the box without a trace.
            assert!(gone < 60, "{gone}");
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_weather() {
        assert_eq!(size_of::<Particle>(), 24);
        let data = floor();
        let snow = ParticleParams::snow(REGION, Vec3::Y);
        let run = |seed, pyramid: bool| {
            let frame = frame(&data);
            let mut cells = vec![crate::skipping::pyramid::Cell::EMPTY; 1609];
            let built = Pyramid::build(frame.depth(), &mut cells).unwrap();
            let mut pool = ParticlePool::<50>::new(seed);
            for _ in 0..100 {
                pool.step(&frame, pyramid.then_some(&built), &snow, 0.033);
            }
            pool.particles().to_vec()
        };
        assert_eq!(run(7, false), run(7, false));
        assert_eq!(run(7, false), run(7, true), "skipping changes nothing");
        assert_ne!(run(7, false), run(8, false));
        // Snow strays from the straight fall.
        assert!(run(7, false).iter().any(|p| matches!(p.phase, Phase::Landed { .. })));
    }

    #[test]
    fn outside_the_view_nothing_is_cast() {
        let data = floor();
        let behind = OrientedBox { centre: Vec3::new(0.0, 0.0, -5.0), ..REGION };
        let mut pool = ParticlePool::<50>::new(3);
        for _ in 0..20 {
            let report = pool.step(&frame(&data), None, &ParticleParams::rain(behind, Vec3::Y), 0.05);
            assert_eq!((report.work.done, report.hits), (0, 0));
            assert_eq!(report.work.skipped, 50);
        }
    }

    #[test]
    fn landed_particles_live_their_time_and_start_on_the_windward_side() {
        let data = floor();
        let rain = ParticleParams { life: 0.5, wind: Vec3::X * 3.0, ..ParticleParams::rain(REGION, Vec3::Y) };
        let weather = Weather::new(&rain).unwrap();
        let mut random = Random::new(5);
        let mut particle = Particle { position: Vec3::ZERO, phase: Phase::Unborn, swing: 0.0 };
        for _ in 0..500 {
            weather.respawn(&mut particle, &mut random);
            let p = weather.local(particle.position);
            assert!(weather.inside(particle.position));
            assert!((p.y + 2.0).abs() < 1e-4 || (p.x + 2.0).abs() < 1e-4, "{p}");
        }
        let mut pool = ParticlePool::<1>::new(5);
        let mut rested = 0;
        for _ in 0..400 {
            let before = pool.particles()[0];
            pool.step(&frame(&data), None, &rain, 0.1);
            let after = pool.particles()[0];
            match (before.phase, after.phase) {
                (Phase::Landed { age: a }, Phase::Landed { age: b }) => {
                    assert!((b - a - 0.2).abs() < 1e-6 && after.position == before.position);
                    rested += 1;
                }
                (Phase::Landed { age }, _) => assert!(age > 0.79, "{age}"),
                _ => {}
            }
        }
        assert!(rested > 20, "{rested}");
    }

    #[test]
    fn numbers_that_are_none_change_nothing() {
        let data = floor();
        let good = ParticleParams::rain(REGION, Vec3::Y);
        let bad_region = |region| ParticleParams { region, ..good };
        for bad in [
            ParticleParams { down: Vec3::ZERO, ..good },
            ParticleParams { down: Vec3::NAN, ..good },
            ParticleParams { wind: Vec3::NAN, ..good },
            ParticleParams { speed: f32::INFINITY, ..good },
            ParticleParams { flutter: f32::INFINITY, ..good },
            ParticleParams { tail: f32::NAN, ..good },
            bad_region(OrientedBox { centre: Vec3::NAN, ..REGION }),
            bad_region(OrientedBox { half: Vec3::INFINITY, ..REGION }),
            bad_region(OrientedBox { rotation: Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..REGION }),
        ] {
            let mut pool = ParticlePool::<9>::new(1);
            assert_eq!(pool.step(&frame(&data), None, &bad, 0.1), StepReport::default(), "{bad:?}");
        }
        let mut pool = ParticlePool::<9>::new(1);
        for dt in [f32::NAN, -1.0, f32::INFINITY, 0.0, 1e-30] {
            let report = pool.step(&frame(&data), None, &ParticleParams { life: f32::NAN, ..good }, dt);
            assert_eq!(report.falling + report.landed, 9);
            assert!(pool.particles().iter().all(|p| p.position.is_finite()));
        }
        let mut none = ParticlePool::<0>::new(1);
        assert_eq!(none.step(&frame(&data), None, &good, 0.1), StepReport::default());
        let empty = DepthFrame::<f32>::new(ImageView::EMPTY, DepthUnit::METRE, *frame(&data).intrinsics());
        assert_eq!(pool.step(&empty, None, &good, 0.1).hits, 0);
    }
}
