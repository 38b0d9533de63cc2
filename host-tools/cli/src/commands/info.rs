//! `isobath info`: what is in a recording. Reads the first frame.

use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath_source::{ImuSource as _, OwnedFrame, with_frame};
use serde_json::json;

use crate::args::InfoArgs;
use crate::failure::Outcome;
use crate::say::{Say, count, metres, point};
use crate::source::Source;

/// What the depth values of a frame look like.
struct Readings {
    pixels: usize,
    valid: usize,
    nearest: f32,
    farthest: f32,
    median: f32,
}

fn readings<D: DepthSample>(frame: &DepthFrame<'_, D>) -> Readings {
    let mut z: Vec<f32> = frame.depth().rows().flatten().map(|v| v.metres(frame.unit())).filter(|&z| z > 0.0).collect();
    z.sort_by(f32::total_cmp);
    let (w, h) = frame.size();
    Readings {
        pixels: w * h,
        valid: z.len(),
        nearest: z.first().copied().unwrap_or(f32::NAN),
        farthest: z.last().copied().unwrap_or(f32::NAN),
        median: z.get(z.len() / 2).copied().unwrap_or(f32::NAN),
    }
}

pub(crate) fn run(args: &InfoArgs, say: &mut Say) -> Outcome {
    let mut source = Source::open(&args.source)?;
    let mut frame = OwnedFrame::new();
    source.read(0, &mut frame)?;
    let imu = source.imu()?;
    let own = source.live_imu().map(|imu| imu.info().kind.clone());
    let info = source.info();
    let frames = source.len();
    let k = frame.intrinsics;
    let (w, h) = frame.size();
    let r = with_frame!(frame, |f| readings(f));
    let up = source.up(&frame);
    let share = r.valid as f32 / r.pixels.max(1) as f32;
    let colour = frame.colour().map(|c| c.size());

    say.head(&format!("{}: {}", source.name(), info.kind));
    say.fact("frames", &frames.map_or("live".into(), |n| count(n as u64)));
    say.fact("depth", &format!("{w} x {h}, {} m a step", frame.unit.metres()));
    say.fact("camera", &format!("fx {:.2}  fy {:.2}  cx {:.2}  cy {:.2} (pixels)", k.fx(), k.fy(), k.cx(), k.cy()));
    say.fact(
        "readings",
        &format!(
            "{:.1} % of the first frame's pixels; {} to {}, median {}",
            share * 100.0,
            metres(r.nearest),
            metres(r.farthest),
            metres(r.median)
        ),
    );
    say.fact("colour", &colour.map_or("none".into(), |(w, h)| format!("{w} x {h}")));
    say.fact("confidence", if frame.confidence().is_some() { "yes" } else { "none" });
    let pose = frame.pose.map_or("none: the world is the camera frame".to_owned(), |p| {
        format!("yes; the first camera stands at {} m", point(p.translation()))
    });
    say.fact("poses", &pose);
    let inertial = imu.as_ref().map_or_else(
        || own.unwrap_or_else(|| "none".to_owned()),
        |imu| {
            let field = if imu.has_field() { ", with magnetic field" } else { "" };
            let rate = imu.info().rate_hz;
            format!("{} readings at {rate:.0} Hz{field}", count(imu.len() as u64))
        },
    );
    say.fact("imu", &inertial);
    say.fact("up", &up.sentence());
    let imu_notes = imu.iter().flat_map(|imu| &imu.info().notes);
    let notes: Vec<&String> = info.notes.iter().chain(&frame.notes).chain(imu_notes).collect();
    for note in &notes {
        say.fact("note", note);
    }

    let mut out = source.json("info", 0);
    let rest = json!({
        "kind": info.kind,
        "frames": frames,
        "width": w, "height": h,
        "unit_m": frame.unit.metres(),
        "intrinsics_px": { "fx": k.fx(), "fy": k.fy(), "cx": k.cx(), "cy": k.cy() },
        "readings": r.valid, "readings_share": share,
        "z_min_m": r.nearest, "z_max_m": r.farthest, "z_median_m": r.median,
        "colour_size": colour, "has_confidence": frame.confidence().is_some(),
        "has_pose": frame.pose.is_some(),
        "imu": imu.as_ref().map(|imu| json!({
            "readings": imu.len(), "rate_hz": imu.info().rate_hz, "has_field": imu.has_field(),
        })),
        "up": up.json(),
        "notes": notes,
    });
    extend(&mut out, rest);
    say.json(&out);
    Ok(())
}

/// Adds the fields of an object to another.
pub(crate) fn extend(map: &mut serde_json::Map<String, serde_json::Value>, more: serde_json::Value) {
    if let serde_json::Value::Object(more) = more {
        map.extend(more);
    }
}
