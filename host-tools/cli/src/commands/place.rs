//! `isobath place`: does a box at this place collide with the scene? By majority vote of its points.

use isobath::glam::{Mat3, Quat, Vec3};
use isobath::ground::geometry::OrientedBox;
use isobath::localized::collision::{CollisionParams, Verdict, box_points, vote};
use isobath_source::with_frame;
use serde_json::json;

use crate::args::PlaceArgs;
use crate::commands::info::extend;
use crate::failure::{Failure, Outcome};
use crate::pipeline::flat_forward;
use crate::say::{Say, point};
use crate::source::Source;

pub(crate) fn run(args: &PlaceArgs, say: &mut Say) -> Outcome {
    let [cx, cy, cz, sx, sy, sz] = args.cuboid;
    let (centre, size) = (Vec3::new(cx, cy, cz), Vec3::new(sx, sy, sz));
    if size.min_element() <= 0.0 {
        return Err(Failure::new("a box needs a positive size along each axis")
            .at("--box")
            .advise("give CX,CY,CZ,SX,SY,SZ: first where its middle is, then how large it is"));
    }
    let (source, frame) = Source::frame(&args.of)?;
    let up = source.up(&frame);
    let forward = with_frame!(frame, |f| flat_forward(f, up.direction));
    let right = forward.cross(up.direction);
    let upright = Quat::from_mat3(&Mat3::from_cols(right, up.direction, -forward));
    let yaw = Quat::from_axis_angle(up.direction, args.yaw.to_radians());
    let object = OrientedBox { centre, half: size / 2.0, rotation: yaw * upright };
    let points = box_points(&object, up.direction);
    let found = with_frame!(frame, |f| vote(f, points, &CollisionParams::default()));
    let t = found.tally;
    let (word, sentence) = match found.verdict {
        Verdict::Free => ("free", "free: most of the points that can be judged are in front of the scene"),
        Verdict::Blocked => {
            ("blocked", "blocked: half or more of the points that can be judged are in or behind the scene")
        }
        Verdict::Unknown => ("unknown", "unknown: too few of its points can be judged"),
    };
    say.head(&format!("a box of {sx} x {sy} x {sz} m at {} m in {}", point(centre), source.name()));
    say.fact("answer", sentence);
    say.fact(
        "votes",
        &format!(
            "{} visible, {} hidden; without a vote: {} in holes, {} outside the view, {} behind the camera",
            t.visible, t.hidden, t.holes, t.outside, t.behind_camera
        ),
    );
    say.fact("up", &up.sentence());
    let mut out = source.json("place", args.of.frame);
    extend(
        &mut out,
        json!({
            "answer": word, "voters": t.visible + t.hidden, "visible": t.visible, "hidden": t.hidden, "holes": t.holes,
            "outside_view": t.outside, "behind_camera": t.behind_camera,
            "centre_m": centre.to_array(), "size_m": size.to_array(), "rotation_xyzw": object.rotation.to_array(),
            "up": up.json(),
        }),
    );
    say.json(&out);
    Ok(())
}
