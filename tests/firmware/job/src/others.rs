//! Capabilities that the job does without, measured on its last frame: dense normals, rays, collision, measuring, the avatar.

use core::hint::black_box;

use isobath::glam::{Quat, Vec3};
use isobath::ground::geometry::{OrientedBox, Ray};
use isobath::localized::avatar::{Avatar, AvatarParams};
use isobath::localized::collision::{CollisionParams, vote};
use isobath::localized::hit::{HitParams, hit_test};
use isobath::localized::measure::{PatchParams, patch};
use isobath::localized::normals::adaptive::{self, AdaptiveParams};
use isobath::localized::normals::{NormalParams, dense, normal_at};
use isobath::localized::particles::{ParticleParams, ParticlePool};
use isobath::localized::plane::ground::{GroundParams, estimate_ground};
use isobath::localized::raycast::{RayParams, cast};
use isobath::localized::reflect::{Bounce, ReflectParams, reflect};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::Pyramid;
use isobath::wire::rvl;

use crate::answers::Answers;
use crate::frame::Packed;
use crate::memory::{H, Memory, W};
use crate::run::Refused;
use crate::{Probe, Stage};

/// Scratch of the capabilities that are not the job's.
#[derive(Debug)]
pub struct Scratch {
    dense: [f32; dense::scratch_len(W)],
    adaptive: [f32; adaptive::scratch_len(W)],
}

impl Scratch {
    /// Zeros.
    pub const NEW: Self = Self { dense: [0.0; dense::scratch_len(W)], adaptive: [0.0; adaptive::scratch_len(W)] };
}

/// Rays, boxes and points asked for.
const TIMES: u32 = 20;

/// Measures each on a frame; a sum of what they gave goes to `out`.
///
/// # Errors
/// [`Refused`] when the stream or the camera is none.
#[inline(never)]
pub fn measure(
    packed: &Packed<'_>,
    memory: &mut Memory,
    scratch: &mut Scratch,
    probe: &mut impl Probe,
    out: &mut impl Answers,
) -> Result<(), Refused> {
    rvl::decode(packed.depth, &mut memory.depth.view_mut()).map_err(|_| Refused)?;
    let (camera, pose) = packed.view.read().ok_or(Refused)?;
    let frame = &DepthFrame::new(memory.depth.view(), DepthUnit::MILLIMETRE, camera).with_pose(pose);
    let pyramid = &Pyramid::build(frame.depth(), &mut memory.pyramid).map_err(|_| Refused)?;
    let each = |name, unit| Stage { name, times: TIMES, unit, budgeted: false };
    let pixels = |name| Stage { name, times: (W * H) as u32, unit: "pixel", budgeted: false };
    let spots = || (0..TIMES as usize).map(|i| (i % 5 * 28 + 24, i / 5 * 14 + 40));
    let targets = || spots().filter_map(|(x, y)| frame.world_point(x, y));

    let mut sum = 0.0;
    let done = probe.stage(pixels("normals-dense"), || {
        dense::rows(frame, &NormalParams::default(), &mut scratch.dense, |_, n| {
            sum += n.z.first().copied().unwrap_or(0.0)
        })
    });
    out.count("dense normals", done.map_err(|_| Refused)?.done as usize);
    let done = probe.stage(pixels("normals-adaptive"), || {
        adaptive::rows(frame, &AdaptiveParams::default(), &mut scratch.adaptive, |_, n| {
            sum += n.z.first().copied().unwrap_or(0.0);
        })
    });
    done.map_err(|_| Refused)?;
    black_box(sum);

    let cross = probe.stage(each("normal-cross", "normal"), || {
        spots().filter_map(|(x, y)| normal_at(frame, x, y, &NormalParams::default())).map(|e| e.normal.z).sum::<f32>()
    });
    out.number("normals of points", cross);
    let fit = probe.stage(each("normal-fit", "normal"), || {
        spots().filter_map(|(x, y)| normal_at(frame, x, y, &NormalParams::POINT)).map(|e| e.normal.z).sum::<f32>()
    });
    out.number("fitted normals", fit);
    let bare = HitParams { normal: None, ..HitParams::default() };
    let hits = probe.stage(each("hit-bare", "hit"), || {
        let at = spots().map(|(x, y)| hit_test(frame, isobath::glam::Vec2::new(x as f32, y as f32), &bare));
        at.filter_map(|h| h.hit().map(|h| h.range)).sum::<f32>()
    });
    out.number("hits without normals", hits);

    // From beside the camera to what it sees.
    let from = pose.to_world(Vec3::new(-0.4, -0.3, 0.2));
    let rays = || targets().filter_map(move |to| Ray::new(from, to - from));
    let seen = probe.stage(each("ray", "ray"), || {
        rays().map(|ray| cast(frame, Some(pyramid), &ray, &RayParams::default()).work.done as f32).sum::<f32>()
    });
    out.number("ray casts", seen);
    let mut bounces = [Bounce::EMPTY; 4];
    let reflected = probe.stage(each("reflection", "ray"), || {
        let params = ReflectParams::default();
        rays().map(|ray| reflect(frame, Some(pyramid), &ray, &params, &mut bounces).bounces as f32).sum::<f32>()
    });
    out.number("reflections", reflected);

    let votes = probe.stage(each("vote", "box"), || {
        let boxes = targets().map(|centre| OrientedBox { centre, half: Vec3::splat(0.2), rotation: Quat::IDENTITY });
        boxes.map(|b| f32::from(vote(frame, b.corners(), &CollisionParams::default()).verdict as u8)).sum::<f32>()
    });
    out.number("votes", votes);
    let flat = probe.stage(each("measure-patch", "patch"), || {
        let patches =
            spots().filter_map(|(x, y)| patch(frame, x, y, &DepthNoise::KINECT, &PatchParams::default()).ok());
        patches.map(|p| p.fit.rms).sum::<f32>()
    });
    out.number("patches", flat);
    let ground = probe.stage(Stage { times: 1, ..each("ground", "plane") }, || {
        estimate_ground(frame, black_box(Vec3::Y), &GroundParams::default()).is_ok()
    });
    out.count("ground", usize::from(ground));

    let cloud = OrientedBox { centre: pose.to_world(Vec3::Z * 1.5), half: Vec3::splat(0.5), rotation: Quat::IDENTITY };
    let mut rain = ParticlePool::<64>::new(1);
    let drops = probe.stage(Stage { times: 64, ..each("particles", "particle") }, || {
        rain.step(frame, Some(pyramid), &ParticleParams::rain(cloud, Vec3::NEG_Y), 0.03).hits
    });
    out.count("drops", drops as usize);
    let avatar = targets().next().and_then(|at| Avatar::new(at, Vec3::Y, AvatarParams::default()).ok());
    if let Some(mut avatar) = avatar {
        let arrived = probe.stage(Stage { times: 1, ..each("avatar", "step") }, || {
            let goal = frame.world_point(80, 100).unwrap_or(Vec3::ZERO);
            avatar.step(frame, Some(pyramid), goal, isobath::ground::units::Timestamp::from_nanos(1)).arrived
        });
        out.count("avatar", usize::from(arrived));
    }
    Ok(())
}
