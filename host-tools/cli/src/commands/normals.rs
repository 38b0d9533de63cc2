//! `isobath normals`: every pixel's surface normal, as an array and as a picture.

use isobath::localized::normals::dense::{rows, scratch_len};
use isobath::localized::normals::{NormalMethod, NormalParams};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::Work;
use isobath_source::with_frame;
use serde_json::json;

use crate::args::{Method, NormalsArgs};
use crate::commands::info::extend;
use crate::failure::{Failure, Outcome};
use crate::files;
use crate::picture::{colours, raster::Raster};
use crate::say::{Say, count};
use crate::source::Source;

/// H x W x 3, NaN where there is no normal.
fn dense<D: DepthSample>(frame: &DepthFrame<'_, D>, params: &NormalParams) -> Outcome<(Vec<[f32; 3]>, Work)> {
    let (w, h) = frame.size();
    let mut scratch = vec![0.0; scratch_len(w)];
    let mut out = Vec::with_capacity(w * h);
    let work = rows(frame, params, &mut scratch, |_, row| {
        out.extend(row.x.iter().zip(row.y).zip(row.z).map(|((&x, &y), &z)| [x, y, z]));
    })
    .map_err(|e| Failure::of(&e, "normals"))?;
    Ok((out, work))
}

pub(crate) fn run(args: &NormalsArgs, say: &mut Say) -> Outcome {
    let (source, frame) = Source::frame(&args.of)?;
    let method = match args.method {
        Method::Exact => NormalMethod::Exact,
        Method::Paper => NormalMethod::Paper,
    };
    let params = NormalParams { method, radius: args.radius, ..NormalParams::default() };
    let (normals, work) = with_frame!(frame, |f| dense(f, &params))?;
    let (w, h) = frame.size();
    let found = normals.iter().filter(|n| n[0].is_finite()).count();
    say.head(&format!("normals of {}, frame {}", source.name(), args.of.frame));
    say.fact("found", &format!("{} of {} pixels with a reading", count(found as u64), count(work.done)));
    if let Some(path) = &args.out {
        files::write_npy(path, &[h, w, 3], normals.as_flattened())?;
        say.fact("array", &format!("{} ({h} x {w} x 3, f32, camera frame)", path.display()));
    }
    if let Some(path) = &args.png {
        let raster =
            Raster::from_fn(w, h, |x, y| normals.get(y * w + x).map_or(colours::HOLE, |&n| colours::normal(n)));
        files::write_png(path, &raster)?;
        say.fact("picture", &format!("{} (x red, up green, towards the camera blue)", path.display()));
    }
    let mut out = source.json("normals", args.of.frame);
    extend(
        &mut out,
        json!({
            "method": if method == NormalMethod::Exact { "exact" } else { "paper" }, "radius": args.radius,
            "width": w, "height": h, "normals": found, "readings": work.done,
            "out": args.out, "png": args.png,
        }),
    );
    say.json(&out);
    Ok(())
}
