//! `isobath hit`: what is behind a pixel.

use isobath::localized::hit::{HitOutcome, HitParams, hit_test};
use isobath_source::with_frame;
use serde_json::json;

use crate::args::HitArgs;
use crate::commands::info::extend;
use crate::failure::Outcome;
use crate::say::{Say, metres, point};
use crate::source::Source;

pub(crate) fn run(args: &HitArgs, say: &mut Say) -> Outcome {
    let (source, frame) = Source::frame(&args.of)?;
    let outcome = with_frame!(frame, |f| hit_test(f, args.pixel, &HitParams::default()));
    let mut out = source.json("hit", args.of.frame);
    extend(&mut out, json!({ "pixel": args.pixel.to_array() }));
    say.head(&format!("pixel {}, {} of {}", args.pixel.x, args.pixel.y, source.name()));
    match outcome {
        HitOutcome::Hit(hit) => {
            let space = if frame.pose.is_some() { "world" } else { "camera frame: the frame has no pose" };
            say.fact("point", &format!("{} m, {space}", point(hit.point)));
            say.fact("distance", &format!("z {}, range {}", metres(hit.z), metres(hit.range)));
            say.fact(
                "error bar",
                &format!("{} (one standard deviation of z, Kinect noise model)", metres(hit.sigma_z)),
            );
            match (hit.normal, hit.estimate) {
                (Some(n), Some(e)) => say.fact(
                    "normal",
                    &format!("{}, from {} readings, {} off a plane", point(n), e.support, metres(e.residual)),
                ),
                _ => say.fact("normal", "none: too few readings around"),
            }
            say.fact("confidence", &format!("{:.0} %", f32::from(hit.confidence) / 2.55));
            extend(
                &mut out,
                json!({
                    "answer": "hit",
                    "point_m": hit.point.to_array(), "camera_point_m": hit.camera_point.to_array(),
                    "normal": hit.normal.map(|n| n.to_array()),
                    "z_m": hit.z, "range_m": hit.range, "sigma_z_m": hit.sigma_z,
                    "confidence": f32::from(hit.confidence) / 255.0,
                    "support": hit.estimate.map(|e| e.support), "residual_m": hit.estimate.map(|e| e.residual),
                }),
            );
        }
        HitOutcome::NoDepth { .. } => {
            say.fact("answer", "no depth: the sensor has no reading there");
            extend(&mut out, json!({ "answer": "no_depth" }));
        }
        HitOutcome::OutsideView => {
            let (w, h) = frame.size();
            say.fact("answer", &format!("outside the view: the image is {w} x {h}"));
            extend(&mut out, json!({ "answer": "outside_view" }));
        }
    }
    say.json(&out);
    Ok(())
}
