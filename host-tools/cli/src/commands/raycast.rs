//! `isobath raycast`: where a ray meets the scene.

use isobath::glam::Vec3;
use isobath::ground::geometry::Ray;
use isobath::localized::normals::{NormalParams, normal_at};
use isobath::localized::raycast::{RayCast, RayOutcome, RayParams, cast};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath_source::with_frame;
use serde_json::json;

use crate::args::RaycastArgs;
use crate::commands::info::extend;
use crate::failure::{Failure, Outcome};
use crate::say::{Say, count, metres, point};
use crate::source::Source;

/// The ray's answer, and the normal (world) where it hit.
fn answer<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    ray: &Ray,
    params: &RayParams,
) -> Outcome<(RayCast, Option<Vec3>)> {
    let (w, h) = frame.size();
    let mut storage = vec![Cell::EMPTY; cells_needed(w, h)];
    let pyramid = Pyramid::build(frame.depth(), &mut storage).map_err(|e| Failure::of(&e, "depth pyramid"))?;
    let found = cast(frame, Some(&pyramid), ray, params);
    let normal = found
        .hit()
        .and_then(|hit| normal_at(frame, hit.pixel.0, hit.pixel.1, &NormalParams::POINT))
        .map(|e| frame.pose_or_identity().direction_to_world(e.normal));
    Ok((found, normal))
}

pub(crate) fn run(args: &RaycastArgs, say: &mut Say) -> Outcome {
    let (source, frame) = Source::frame(&args.of)?;
    if args.world && frame.pose.is_none() {
        return Err(Failure::new("the frame has no pose, so there is no world")
            .at(format!("{}, frame {}", source.name(), args.of.frame))
            .advise("leave --world out: points are then in the camera frame"));
    }
    let pose = frame.pose.unwrap_or_default();
    let (from, dir) =
        if args.world { (args.from, args.dir) } else { (pose.to_world(args.from), pose.direction_to_world(args.dir)) };
    let ray = Ray::new(from, dir).ok_or_else(|| {
        Failure::new("the direction has no length").at("--dir").advise("give a direction, such as 0,0,1")
    })?;
    let mut params = RayParams { max_distance: args.reach, ..RayParams::default() };
    if let Some(thickness) = args.thickness {
        params.thickness = thickness;
    }
    let (found, normal) = with_frame!(frame, |f| answer(f, &ray, &params))?;
    // Answers are in the frame that the question was in.
    let back = |p: Vec3| if args.world { p } else { pose.to_camera(p) };
    let normal = normal.map(|n| if args.world { n } else { pose.direction_to_camera(n) });
    let space = if args.world { "world" } else { "camera frame" };

    say.head(&format!("ray from {} towards {} ({space})", point(args.from), point(args.dir)));
    let mut out = source.json("raycast", args.of.frame);
    let more = match found.outcome {
        RayOutcome::Hit(hit) => {
            let p = back(hit.point);
            say.fact("hit", &format!("{} m, after {}", point(p), metres(hit.distance)));
            say.fact("pixel", &format!("{}, {}, z {}", hit.pixel.0, hit.pixel.1, metres(hit.z)));
            if let Some(n) = normal {
                say.fact("normal", &point(n));
            }
            if hit.passed_behind {
                say.fact("note", "the ray went behind another surface first; it may have hit something there");
            }
            json!({
                "answer": "hit", "point_m": p.to_array(), "distance_m": hit.distance, "z_m": hit.z,
                "pixel": [hit.pixel.0, hit.pixel.1], "normal": normal.map(|n| n.to_array()),
                "passed_behind": hit.passed_behind,
            })
        }
        RayOutcome::HitOccluded { point: p, pixel, distance } => {
            let p = back(p);
            say.fact("occluded", &format!("goes behind a surface at {} m, after {}", point(p), metres(distance)));
            say.fact("pixel", &format!("{}, {}", pixel.0, pixel.1));
            say.fact("note", "what is behind that surface the camera can't see");
            json!({
                "answer": "hit_occluded", "point_m": p.to_array(), "distance_m": distance,
                "pixel": [pixel.0, pixel.1],
            })
        }
        RayOutcome::Miss { left_view } => {
            let why = if left_view { "it left the view" } else { "it reached its end" };
            say.fact("miss", &format!("nothing seen was in the way; {why}"));
            json!({ "answer": "miss", "left_view": left_view })
        }
        RayOutcome::NoDepth => {
            say.fact("no depth", "the ray met holes and nothing else; something may be there");
            json!({ "answer": "no_depth" })
        }
        RayOutcome::OutsideView => {
            say.fact("outside", "the ray was never in the view");
            json!({ "answer": "outside_view" })
        }
    };
    say.fact(
        "work",
        &format!(
            "{} pixels visited, {} skipped ({:.0} %) with {} pyramid tiles",
            count(found.work.done),
            count(found.work.skipped),
            found.work.skipped_share() * 100.0,
            found.tiles
        ),
    );
    extend(&mut out, more);
    extend(
        &mut out,
        json!({ "space": if args.world { "world" } else { "camera" },
                "work_done": found.work.done, "work_skipped": found.work.skipped, "tiles": found.tiles }),
    );
    say.json(&out);
    Ok(())
}
