//! `isobath points`: every pixel as a 3D point.

use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath_source::with_frame;
use serde_json::json;

use crate::args::PointsArgs;
use crate::commands::info::extend;
use crate::failure::{Failure, Outcome};
use crate::files::{self, PlyPoint};
use crate::say::{Say, count};
use crate::source::Source;

/// One entry a pixel, NaN in holes.
fn points<D: DepthSample>(frame: &DepthFrame<'_, D>, world: bool) -> Vec<[f32; 3]> {
    let (w, h) = frame.size();
    let at = |(x, y)| if world { frame.world_point(x, y) } else { frame.point(x, y) };
    (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).map(|p| at(p).map_or([f32::NAN; 3], |p| p.to_array())).collect()
}

fn colours<D: DepthSample>(frame: &DepthFrame<'_, D>) -> Option<Vec<[u8; 3]>> {
    frame.colour()?;
    let (w, h) = frame.size();
    let grey = [128; 3];
    Some((0..w * h).map(|i| frame.colour_at(i % w, i / w).unwrap_or(grey)).collect())
}

pub(crate) fn run(args: &PointsArgs, say: &mut Say) -> Outcome {
    let (source, frame) = Source::frame(&args.of)?;
    if args.world && frame.pose.is_none() {
        return Err(Failure::new("the frame has no pose, so there is no world")
            .at(format!("{}, frame {}", source.name(), args.of.frame))
            .advise("leave --world out: points are then in the camera frame"));
    }
    let (w, h) = frame.size();
    let points = with_frame!(frame, |f| points(f, args.world));
    let found = points.iter().filter(|p| p[0].is_finite()).count();
    let mut coloured = false;
    let form = if args.out.extension().is_some_and(|e| e == "npy") {
        files::write_npy(&args.out, &[h, w, 3], points.as_flattened())?;
        "npy"
    } else {
        let colours = with_frame!(frame, |f| colours(f));
        coloured = colours.is_some();
        let colour = |i: usize| colours.as_ref().and_then(|c| c.get(i).copied());
        let vertices: Vec<PlyPoint> = points
            .iter()
            .enumerate()
            .filter(|(_, p)| p[0].is_finite())
            .map(|(i, &position)| PlyPoint { position, colour: colour(i) })
            .collect();
        files::write_ply(&args.out, &vertices, coloured)?;
        "ply"
    };
    let space = if args.world { "world" } else { "camera" };
    say.head(&format!("points of {}, frame {}", source.name(), args.of.frame));
    say.fact("points", &format!("{} of {} pixels, {space} frame, metres", count(found as u64), count((w * h) as u64)));
    say.fact("file", &format!("{}{}", args.out.display(), if coloured { ", with colour" } else { "" }));
    let mut out = source.json("points", args.of.frame);
    extend(
        &mut out,
        json!({ "points": found, "width": w, "height": h, "space": space, "format": form, "colour": coloured,
                "out": args.out }),
    );
    say.json(&out);
    Ok(())
}
