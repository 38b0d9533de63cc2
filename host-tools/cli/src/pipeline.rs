//! The main job: every frame through every answer, with the calls and the memory that firmware would use.
//!
//! The stages work in memory taken once, before the first frame ([`Memory`]), and allocate nothing; only what is kept for the
//! report between them does. Each stage is timed on its own, and says how much work it did and how much it skipped. The stages, in the order in which they need each other:
//!
//! | stage | question | needs |
//! |---|---|---|
//! | pyramid | how near and far is each tile? | depth |
//! | normals | which way does each pixel face? | depth |
//! | ground | where is the floor? | depth, up |
//! | reticle | how does the cursor lie at the centre? | depth |
//! | rays | where do 25 rays from a hand end? | depth, pyramid |
//! | chair votes | does a chair collide here? where 32 taps meet level ground | depth, up |
//! | stool places | does a stool fit here, level and wholly in sight? at 32 taps | depth, pyramid, up |
//! | height map | how high is the ground, cell by cell? | depth, ground |
//! | path | how does one walk across? | height map |
//! | light | what light falls on the object placed first? | colour, up, a place |

use std::time::Instant;

use isobath::glam::{Mat3, Quat, Vec2, Vec3};
use isobath::ground::geometry::{OrientedBox, Plane, Ray};
use isobath::ground::image::ImageViewMut;
use isobath::lighting::equirect::MapFrame;
use isobath::lighting::far::harmonics::Harmonics;
use isobath::lighting::policy::motion::{AutoCapture, MotionParams};
use isobath::lighting::{Drawn, Observed, Preset, Session};
use isobath::localized::collision::{Collision, CollisionParams, Verdict, box_points, vote};
use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams, IntegrateReport};
use isobath::localized::hit::{Hit, HitOutcome, HitParams, hit_test};
use isobath::localized::normals::NormalParams;
use isobath::localized::normals::dense::{rows, scratch_len};
use isobath::localized::placement::{NoPlace, PlaceParams, Placement, Spot, place};
use isobath::localized::plane::ground::{GroundEstimate, GroundParams, estimate_ground};
use isobath::localized::planner::{Node, Plan, Planner, Walker};
use isobath::localized::raycast::{RayOutcome, RayParams, cast};
use isobath::localized::reticle::{Reticle, ReticleHit, ReticleParams, ReticleState};
use isobath::sensing::depth::{DepthSample, HolePolicy};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::Work;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath_sim::LinearImage;

use crate::failure::{Failure, Outcome};
use crate::lighting;

/// Cells of the height map along a side.
pub(crate) const MAP_CELLS: usize = 128;
/// Side of a cell, metres.
pub(crate) const MAP_CELL: f32 = 0.05;
/// Corners that a path may have.
const CORNERS: usize = 64;
/// What is put where a user taps: a chair, judged by majority vote; metres (across, up, along).
pub(crate) const CHAIR: Vec3 = Vec3::new(0.5, 0.9, 0.5);
/// And a stool, which must stand level and wholly in sight.
pub(crate) const STOOL: Vec3 = Vec3::new(0.3, 0.4, 0.3);
/// Taps across and down, over the lower half of the image.
const TAPS: (usize, usize) = (8, 4);
/// How high above the reticle's point an object is lit, metres.
const ABOVE: f32 = 0.15;
/// Largest angle of a tapped surface from level, as a cosine (25 degrees).
const LEVEL: f32 = 0.906;
/// Rays of the fan, along each side of the view.
const FAN: usize = 5;
/// How far below the camera the ground is taken to be when none is seen, metres: a standing person's eyes.
pub(crate) const STANDING: f32 = 1.5;
/// Half of the points hidden is much for a chair: a fifth blocks it here.
const STRICT: CollisionParams =
    CollisionParams { tolerance: 0.12, threshold: 0.2, min_voters: 0.5, holes: HolePolicy::Unknown };
/// Who walks: a small character, as the corridors that one camera sees are narrow.
pub(crate) const WALKER: Walker = Walker { radius: 0.15, ..Walker::DEFAULT };

/// The stages that are timed.
pub(crate) const STAGES: [&str; 10] = [
    "pyramid",
    "normals",
    "ground plane",
    "reticle",
    "rays",
    "chair votes",
    "stool places",
    "height map",
    "path",
    "light",
];
const PYRAMID: usize = 0;
const NORMALS: usize = 1;
const GROUND: usize = 2;
const RETICLE: usize = 3;
const RAYS: usize = 4;
const VOTES: usize = 5;
const PLACES: usize = 6;
const HEIGHT_MAP: usize = 7;
const PATH: usize = 8;
const LIGHT: usize = 9;
/// Sizes of the light's session.
const LIGHT_PRESET: Preset = Preset::LOW;

/// What one unit of a stage's work is.
pub(crate) const WORK_UNITS: [&str; STAGES.len()] =
    ["pixels", "pixels", "pixels", "", "pixels", "points", "pixels", "pixels", "cells", "pixels"];

/// A tap on the image, and what may stand there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tap {
    pub(crate) pixel: (usize, usize),
    /// The chair and its verdict, where the surface is level.
    pub(crate) chair: Option<(OrientedBox, Collision)>,
    pub(crate) stool: Result<Placement, NoPlace>,
}

/// What an object's place gives to the object, and why it is there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lit {
    pub(crate) map: MapFrame,
    pub(crate) why: &'static str,
    /// What the frame gave; `None` when it showed nothing new, or the camera moved too fast.
    pub(crate) observed: Option<Observed>,
    pub(crate) drawn: Drawn,
    /// Far anchors seen so far, and the share of all directions with near points.
    pub(crate) seen: usize,
    pub(crate) near_share: f32,
    /// Of the map, in its axes.
    pub(crate) harmonics: Harmonics,
}

/// What one frame gave.
#[derive(Debug)]
pub(crate) struct Findings {
    /// Where the camera stood, where it looked, and which way was up, world.
    pub(crate) camera: Vec3,
    pub(crate) axis: Vec3,
    pub(crate) up: Vec3,
    pub(crate) pixels: usize,
    pub(crate) readings: usize,
    /// Pixels with a normal, and those of them within 15 degrees of up.
    pub(crate) normals: usize,
    pub(crate) level: usize,
    pub(crate) ground: Result<GroundEstimate, String>,
    pub(crate) hit: HitOutcome,
    pub(crate) reticle: ReticleState,
    pub(crate) rays: Vec<(Ray, RayOutcome)>,
    pub(crate) taps: Vec<Tap>,
    pub(crate) map: IntegrateReport,
    pub(crate) map_known: usize,
    pub(crate) plan: Plan,
    pub(crate) ends: (Vec3, Vec3),
    /// The path's corners, world, metres.
    pub(crate) path: Vec<Vec3>,
    pub(crate) light: Result<Lit, &'static str>,
    /// Work of each stage, where it counts any.
    pub(crate) work: [Option<Work>; STAGES.len()],
    /// Nanoseconds of each stage.
    pub(crate) times: [u64; STAGES.len()],
}

impl Findings {
    pub(crate) const fn hit(&self) -> Option<&Hit> {
        self.hit.hit()
    }

    /// Chairs with their verdicts.
    pub(crate) fn chairs(&self) -> impl Iterator<Item = (&OrientedBox, Verdict)> {
        self.taps.iter().filter_map(|t| t.chair.as_ref()).map(|(chair, vote)| (chair, vote.verdict))
    }

    /// Places for the stool.
    pub(crate) fn stools(&self) -> impl Iterator<Item = &OrientedBox> {
        self.taps.iter().filter_map(|t| t.stool.as_ref().ok()).map(|p| &p.pose)
    }
}

/// All memory of the main job, taken once. The sizes are what a firmware image would set aside as statics.
#[derive(Debug)]
pub(crate) struct Memory<D: DepthSample> {
    pyramid: Vec<Cell<D>>,
    scratch: Vec<f32>,
    map: Vec<HeightCell>,
    nodes: Vec<Node>,
    queue: Vec<u32>,
    corners: [Vec3; CORNERS],
    light: lighting::Memory,
    light_map: Vec<[f32; 3]>,
}

impl<D: DepthSample> Memory<D> {
    pub(crate) fn new(width: usize, height: usize) -> Self {
        Self {
            pyramid: vec![Cell::EMPTY; cells_needed(width, height)],
            scratch: vec![0.0; scratch_len(width)],
            map: vec![HeightCell::UNKNOWN; MAP_CELLS * MAP_CELLS],
            nodes: vec![Node::EMPTY; MAP_CELLS * MAP_CELLS],
            queue: Vec::with_capacity(MAP_CELLS * MAP_CELLS),
            corners: [Vec3::ZERO; CORNERS],
            light: lighting::Memory::new(LIGHT_PRESET),
            light_map: vec![[0.0; 3]; LIGHT_PRESET.map_pixels()],
        }
    }

    /// What the memory is for, and its bytes.
    pub(crate) fn bytes(&self) -> [(&'static str, usize); 8] {
        [
            ("depth pyramid", size_of_val(self.pyramid.as_slice())),
            ("rows of normals", size_of_val(self.scratch.as_slice())),
            ("height map", size_of_val(self.map.as_slice())),
            ("planner", size_of_val(self.nodes.as_slice())),
            ("path corners", size_of_val(&self.corners)),
            ("reticle", size_of::<Reticle>()),
            ("light", self.light.bytes().iter().map(|part| part.1).sum()),
            ("light map", size_of_val(self.light_map.as_slice())),
        ]
    }
}

/// The world as the main job sees it: which way is up, where the map lies, who asks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct World {
    pub(crate) up: Vec3,
    pub(crate) grid: Grid,
    /// Whether the grid lies on ground that was seen; otherwise [`STANDING`] metres below the camera.
    pub(crate) grounded: bool,
    /// Whether frames share this world. If not, each lights an object of its own.
    pub(crate) moves: bool,
}

/// Runs the stages over frames.
#[derive(Debug)]
pub(crate) struct Pipeline<'m, D: DepthSample> {
    world: World,
    pyramid: &'m mut [Cell<D>],
    scratch: &'m mut [f32],
    map: HeightMap<'m>,
    nodes: &'m mut [Node],
    queue: &'m mut Vec<u32>,
    corners: &'m mut [Vec3],
    /// The last ground found, for frames that show none.
    ground: Option<Plane>,
    reticle: Reticle,
    /// Until an object stands somewhere for all frames.
    light: Option<&'m mut lighting::Memory>,
    session: Option<(Session<'m>, &'static str)>,
    /// Which frames the session takes.
    capture: AutoCapture,
    light_map: &'m mut [[f32; 3]],
}

/// Measures one stage.
struct Watch<'t>(&'t mut [u64; STAGES.len()]);

impl Watch<'_> {
    fn time<T>(&mut self, stage: usize, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        // The answer passes through, so that the compiler can't leave the work out.
        let answer = std::hint::black_box(work());
        self.0[stage] = u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        answer
    }
}

impl<'m, D: DepthSample> Pipeline<'m, D> {
    pub(crate) fn new(memory: &'m mut Memory<D>, world: World) -> Outcome<Self> {
        let params = HeightMapParams::DEFAULT;
        let map = HeightMap::new(world.grid, &mut memory.map, params).map_err(|e| Failure::of(&e, "height map"))?;
        Ok(Self {
            world,
            pyramid: &mut memory.pyramid,
            scratch: &mut memory.scratch,
            map,
            nodes: &mut memory.nodes,
            queue: &mut memory.queue,
            corners: &mut memory.corners,
            ground: None,
            reticle: Reticle::new(ReticleParams::DEFAULT).map_err(|e| Failure::of(&e, "reticle"))?,
            light: Some(&mut memory.light),
            session: None,
            capture: AutoCapture::new(MotionParams::DEFAULT).map_err(|e| Failure::of(&e, "light"))?,
            light_map: &mut memory.light_map,
        })
    }

    /// The environment map of the object that was lit last.
    pub(crate) fn light_map(&self) -> LinearImage {
        let (width, height) = LIGHT_PRESET.map;
        LinearImage { width, height, pixels: self.light_map.to_vec() }
    }

    pub(crate) const fn grounded(&self) -> bool {
        self.world.grounded
    }

    pub(crate) const fn map(&self) -> &HeightMap<'m> {
        &self.map
    }

    /// Starts a new world: the map and the last ground are forgotten.
    pub(crate) fn forget(&mut self, world: World) -> Outcome {
        self.world = world;
        self.ground = None;
        self.reticle.reset();
        self.map.restart(world.grid).map_err(|e| Failure::of(&e, "height map"))
    }

    /// Where one could stand, as the last plan saw it.
    pub(crate) fn walkable(&self, column: usize, row: usize) -> bool {
        column < MAP_CELLS && self.nodes.get(row * MAP_CELLS + column).is_some_and(Node::is_walkable)
    }

    /// Every stage, once.
    pub(crate) fn frame(&mut self, frame: &DepthFrame<'_, D>) -> Outcome<Findings> {
        let failed = |e: &dyn std::error::Error| Failure::of(e, format!("frame {}", frame.sequence()));
        let up = self.world.up;
        let mut times = [0; STAGES.len()];
        let mut work = [None; STAGES.len()];
        let mut watch = Watch(&mut times);
        let (width, height) = frame.size();

        let pyramid = watch.time(PYRAMID, || Pyramid::build(frame.depth(), self.pyramid)).map_err(|e| failed(&e))?;
        work[PYRAMID] = Some(Work { done: (width * height) as u32, skipped: 0 });

        // What firmware would do with normals: look at each row while it is hot, and keep a number.
        let camera_up = frame.pose_or_identity().direction_to_camera(up).to_array();
        let (mut normals, mut level) = (0, 0);
        let done = watch
            .time(NORMALS, || {
                rows(frame, &NormalParams::default(), self.scratch, |_, row| {
                    for ((&x, &y), &z) in row.x.iter().zip(row.y).zip(row.z) {
                        let cosine = x * camera_up[0] + y * camera_up[1] + z * camera_up[2];
                        normals += usize::from(!x.is_nan());
                        level += usize::from(cosine > 0.966);
                    }
                })
            })
            .map_err(|e| failed(&e))?;
        work[NORMALS] = Some(done);

        let ground = watch.time(GROUND, || estimate_ground(frame, up, &GroundParams::DEFAULT));
        if let Ok(found) = &ground {
            work[GROUND] = Some(found.work);
            self.ground = Some(found.fit.plane);
        }

        let centre = Vec2::new(width as f32 - 1.0, height as f32 - 1.0) / 2.0;
        let (hit, reticle) = watch.time(RETICLE, || {
            let found = hit_test(frame, centre, &HitParams::default());
            let at = found.hit().map(|hit| ReticleHit { point: hit.point, normal: hit.normal });
            (found, self.reticle.update(at, &frame.pose_or_identity(), frame.time()))
        });

        let mut rays = Vec::with_capacity(FAN * FAN);
        rays.extend(fan(frame).map(|ray| (ray, RayOutcome::OutsideView)));
        let done = watch.time(RAYS, || {
            let mut done = Work::default();
            for (ray, outcome) in &mut rays {
                let found = cast(frame, Some(&pyramid), ray, &RayParams::default());
                *outcome = found.outcome;
                done += found.work;
            }
            done
        });
        work[RAYS] = Some(done);

        let mut taps: [Tap; TAPS.0 * TAPS.1] = std::array::from_fn(|i| Tap {
            pixel: tap_pixel(i, (width, height)),
            chair: None,
            stool: Err(NoPlace::NoSurface),
        });
        let done = watch.time(VOTES, || {
            let mut done = Work::default();
            for tap in &mut taps {
                tap.chair = chair_at(frame, tap.pixel, up);
                let voters = tap.chair.map_or(0, |(_, c)| c.tally.visible + c.tally.hidden);
                done += Work { done: voters, skipped: 13 - voters };
            }
            done
        });
        work[VOTES] = Some(done);
        let params = PlaceParams { max_hidden: 0.02, ..PlaceParams::new(STOOL, up) };
        let done = watch.time(PLACES, || {
            let mut done = Work::default();
            for tap in &mut taps {
                let answer = place(frame, Some(&pyramid), Spot::Pixel(tap.pixel.0, tap.pixel.1), &params);
                tap.stool = answer.outcome;
                done += answer.work;
            }
            done
        });
        work[PLACES] = Some(done);

        let map = watch.time(HEIGHT_MAP, || self.map.integrate(frame));
        let used = map.used + map.overhead + map.outside;
        work[HEIGHT_MAP] = Some(Work { done: used, skipped: (width * height) as u32 - used });
        let map_known = self.map.cells().iter().filter(|c| c.is_known()).count();

        let ends = self.ends(frame.pose_or_identity().translation())?;
        let mut planner = Planner::new(self.nodes);
        let plan = watch
            .time(PATH, || planner.plan(&self.map, &WALKER, ends.0, ends.1, self.corners))
            .map_err(|e| failed(&e))?;
        let (mut path, mut expanded) = (Vec::new(), 0);
        if let Plan::Found(found) = plan {
            path.extend_from_slice(self.corners.get(..found.points).unwrap_or(&[]));
            expanded = found.expanded;
        } else if let Plan::NoPath { expanded: n } = plan {
            expanded = n;
        }
        let cells = (MAP_CELLS * MAP_CELLS) as u32;
        work[PATH] = Some(Work { done: expanded, skipped: cells - expanded.min(cells) });

        let light = self.light(frame, &taps, hit.hit(), &mut watch)?;
        if let Ok(lit) = &light {
            let map = lit.drawn.map;
            work[LIGHT] = Some(Work { done: map.written as u32, skipped: map.skipped as u32 });
        }

        let readings = frame.depth().rows().flatten().filter(|z| z.is_valid()).count();
        Ok(Findings {
            camera: frame.pose_or_identity().translation(),
            axis: frame.pose_or_identity().direction_to_world(Vec3::Z),
            up,
            pixels: width * height,
            readings,
            normals,
            level,
            ground: ground.map_err(|e| e.to_string()),
            hit,
            reticle,
            rays,
            taps: taps.to_vec(),
            map,
            map_known,
            plan,
            ends,
            path,
            light,
            work,
            times,
        })
    }

    /// The light that falls on an object: where the first frame with room for one put it, or where this frame does when each is a world
    /// of its own.
    fn light(
        &mut self,
        frame: &DepthFrame<'_, D>,
        taps: &[Tap],
        hit: Option<&Hit>,
        watch: &mut Watch<'_>,
    ) -> Outcome<Result<Lit, &'static str>> {
        if frame.colour().is_none() {
            return Ok(Err("there is no colour to take light from"));
        }
        let frame = frame.with_pose(frame.pose_or_identity());
        let up = self.world.up;
        let ambient = lighting::mean_colour(&frame);
        let place = || {
            let (at, why) = object_place(taps, hit, frame.size(), up)?;
            Some((MapFrame::with_up(at, up)?, why))
        };
        if self.world.moves {
            if self.session.is_none()
                && let Some((map, why)) = place()
                && let Some(memory) = self.light.take()
            {
                self.session = Some((memory.session(map, ambient)?, why));
            }
            if let Some((session, why)) = &mut self.session {
                let view = self.capture.offer(frame.pose().as_ref(), frame.time()).captured();
                return lit(session, why, &frame, view, self.light_map, watch).map(Ok);
            }
        } else if let (Some((map, why)), Some(memory)) = (place(), self.light.as_deref_mut()) {
            let mut session = memory.session(map, ambient)?;
            return lit(&mut session, why, &frame, Some(0), self.light_map, watch).map(Ok);
        }
        Ok(Err("there is no place for an object yet"))
    }

    /// A walk worth planning, between two far ends of connected ground. Not
    /// timed: in a real application a user says where to go.
    fn ends(&mut self, camera: Vec3) -> Outcome<(Vec3, Vec3)> {
        let grid = *self.map.grid();
        // Planning anywhere classifies the cells; the plan itself is not wanted.
        Planner::new(self.nodes)
            .plan(&self.map, &WALKER, camera, camera, &mut [])
            .map_err(|e| Failure::of(&e, "walker"))?;
        let point = |i: usize| grid.point_of(i % MAP_CELLS, i / MAP_CELLS, 0.0);
        let foot = camera - grid.up() * grid.height_of(camera);
        let walkable = |i: usize| self.nodes.get(i).is_some_and(Node::is_walkable);
        let near = |a: &usize, b: &usize| point(*a).distance_squared(foot).total_cmp(&point(*b).distance_squared(foot));
        let all = MAP_CELLS * MAP_CELLS;
        let mut best = (camera, camera, -1.0);
        // Of the patches of connected ground, the one that one can walk farthest on, from its one end to the other.
        let mut seen = vec![false; all];
        while let Some(start) = (0..all).filter(|&i| walkable(i) && !seen[i]).min_by(near) {
            self.queue.clear();
            self.queue.push(start as u32);
            seen[start] = true;
            let mut next = 0;
            while let Some(&i) = self.queue.get(next) {
                next += 1;
                let (x, y) = (i as usize % MAP_CELLS, i as usize / MAP_CELLS);
                for (u, v) in [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)] {
                    let j = v.wrapping_mul(MAP_CELLS).wrapping_add(u);
                    if u < MAP_CELLS && v < MAP_CELLS && walkable(j) && !seen[j] {
                        seen[j] = true;
                        self.queue.push(j as u32);
                    }
                }
            }
            let from = point(start);
            let far = |from: Vec3| {
                let all = self.queue.iter().map(|&i| point(i as usize));
                all.max_by(|a, b| a.distance_squared(from).total_cmp(&b.distance_squared(from))).unwrap_or(from)
            };
            let to = far(from);
            let from = far(to);
            if from.distance(to) > best.2 {
                best = (from, to, from.distance(to));
            }
        }
        Ok((best.0, best.1))
    }
}

/// Horizontally ahead of the camera; along its own up when it looks straight up or down.
pub(crate) fn flat_forward<D: DepthSample>(frame: &DepthFrame<'_, D>, up: Vec3) -> Vec3 {
    let pose = frame.pose_or_identity();
    let flat = |v: Vec3| (v - up * v.dot(up)).try_normalize().filter(|_| v.cross(up).length() > 0.1);
    flat(pose.direction_to_world(Vec3::Z))
        .or_else(|| flat(pose.direction_to_world(Vec3::NEG_Y)))
        .unwrap_or_else(|| up.any_orthonormal_vector())
}

/// Rays from a hand, to the right of and below the eye, towards all parts of the view.
fn fan<D: DepthSample>(frame: &DepthFrame<'_, D>) -> impl Iterator<Item = Ray> {
    let (pose, k) = (frame.pose_or_identity(), *frame.intrinsics());
    let hand = k.fy().signum() * 0.25;
    let from = pose.to_world(Vec3::new(0.25, hand, 0.0));
    let size = Vec2::new(frame.size().0 as f32, frame.size().1 as f32);
    (0..FAN * FAN).filter_map(move |i| {
        let uv = (Vec2::new((i % FAN) as f32, (i / FAN) as f32) + 0.5) / FAN as f32;
        // Towards a point four metres away on the pixel's ray.
        Ray::new(from, pose.to_world(k.unproject(uv * size - 0.5, 4.0)) - from)
    })
}

/// Taps in rows over the lower half of the image, where people put things.
const fn tap_pixel(i: usize, (width, height): (usize, usize)) -> (usize, usize) {
    let (x, y) = (i % TAPS.0, i / TAPS.0);
    ((2 * x + 1) * width / (2 * TAPS.0), height / 2 + (2 * y + 1) * height / (4 * TAPS.1))
}

/// A chair upright on what a pixel sees, looking at the camera, and the vote of its points; `None` where nothing level is.
fn chair_at<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    (x, y): (usize, usize),
    up: Vec3,
) -> Option<(OrientedBox, Collision)> {
    let outcome = hit_test(frame, Vec2::new(x as f32, y as f32), &HitParams::default());
    let hit = outcome.hit()?;
    let level = hit.normal?.dot(up) >= LEVEL;
    let to_camera = frame.pose_or_identity().translation() - hit.point;
    let z = (to_camera - up * to_camera.dot(up)).try_normalize().filter(|_| level)?;
    let rotation = Quat::from_mat3(&Mat3::from_cols(up.cross(z), up, z));
    let chair = OrientedBox { centre: hit.point + up * (CHAIR.y / 2.0), half: CHAIR / 2.0, rotation };
    Some((chair, vote(frame, box_points(&chair, up), &STRICT)))
}

/// A frame put into an object's session as a view, if it is one, and the map drawn.
fn lit<D: DepthSample>(
    session: &mut Session<'_>,
    why: &'static str,
    frame: &DepthFrame<'_, D>,
    view: Option<u16>,
    pixels: &mut [[f32; 3]],
    watch: &mut Watch<'_>,
) -> Outcome<Lit> {
    let (width, height) = LIGHT_PRESET.map;
    let mut out = ImageViewMut::new(pixels, width, height).map_err(|e| Failure::of(&e, "environment map"))?;
    let (observed, drawn) = watch.time(LIGHT, || {
        let observed = view.map(|id| session.observe(frame, u32::from(id))).transpose();
        (observed, session.draw(&mut out))
    });
    let observed = observed.map_err(|e| Failure::of(&e, format!("frame {}", frame.sequence())))?;
    let (seen, near_share) = (session.far().seen(), lighting::near_share(session));
    let map = LinearImage { width, height, pixels: pixels.to_vec() };
    let harmonics = lighting::harmonics(&map);
    Ok(Lit { map: *session.map(), why, observed, drawn, seen, near_share, harmonics })
}

/// Where an object would be put: where the stool fits nearest to the middle of the image, else where a chair is free, else what the
/// reticle meets. And which of these.
fn object_place(taps: &[Tap], hit: Option<&Hit>, (w, h): (usize, usize), up: Vec3) -> Option<(Vec3, &'static str)> {
    let off = |tap: &&Tap| (2 * tap.pixel.0).abs_diff(w).pow(2) + (2 * tap.pixel.1).abs_diff(h).pow(2);
    let stool = taps.iter().filter(|t| t.stool.is_ok()).min_by_key(off);
    let chair = || taps.iter().filter(|t| t.chair.is_some_and(|c| c.1.verdict == Verdict::Free)).min_by_key(off);
    if let Some(at) = stool.and_then(|t| t.stool.as_ref().ok()) {
        return Some((at.pose.centre, "a stool that fits"));
    }
    if let Some((at, _)) = chair().and_then(|t| t.chair) {
        return Some((at.centre, "a chair that is free"));
    }
    hit.map(|hit| (hit.point + up * ABOVE, "15 cm above what the reticle meets"))
}

/// Where the map lies: on the ground, reaching from the camera forwards; around the camera when it will move. And whether
/// there was any ground.
pub(crate) fn lay_grid<D: DepthSample>(frame: &DepthFrame<'_, D>, up: Vec3, moves: bool) -> Outcome<(Grid, bool)> {
    let forward = flat_forward(frame, up);
    let camera = frame.pose_or_identity().translation();
    let ground = estimate_ground(frame, up, &GroundParams::DEFAULT);
    let foot = match &ground {
        Ok(found) => camera - up * found.fit.plane.distance(camera) / found.fit.plane.normal().dot(up),
        Err(_) => camera - up * STANDING,
    };
    let ahead = MAP_CELLS as f32 * MAP_CELL * if moves { 0.2 } else { 0.45 };
    let grid = Grid::new(foot + forward * ahead, up, forward, MAP_CELL, MAP_CELLS, MAP_CELLS);
    Ok((grid.map_err(|e| Failure::of(&e, "height map"))?, ground.is_ok()))
}
