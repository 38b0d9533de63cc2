//! `isobath find-place`: where is there room for a box of this size?

use isobath::localized::placement::search::{SearchParams, SearchReport, find_place};
use isobath::localized::placement::{PlaceParams, Placement};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath_source::with_frame;
use serde_json::{Value, json};

use crate::args::FindPlaceArgs;
use crate::commands::info::extend;
use crate::failure::{Failure, Outcome};
use crate::say::{Say, count, metres, point};
use crate::source::Source;

/// Spots tried, across the larger side of the image.
const ACROSS: usize = 96;

fn search<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    params: &PlaceParams,
    best: &mut [Option<Placement>],
) -> Outcome<SearchReport> {
    let (w, h) = frame.size();
    let mut storage = vec![Cell::EMPTY; cells_needed(w, h)];
    let pyramid = Pyramid::build(frame.depth(), &mut storage).map_err(|e| Failure::of(&e, "depth pyramid"))?;
    let step = (w.max(h) / ACROSS).max(1);
    let search = SearchParams { start: None, step: Some(step), max_tries: u32::MAX };
    Ok(find_place(frame, Some(&pyramid), params, &search, best))
}

pub(crate) fn run(args: &FindPlaceArgs, say: &mut Say) -> Outcome {
    let size = args.size;
    if size.min_element() < 1e-3 || size.max_element() > 1e3 {
        return Err(Failure::new("the box must measure 1 mm to 1 km along each axis")
            .at("--size")
            .advise("give SX,SY,SZ in metres, such as 0.5,0.9,0.5 for a chair"));
    }
    let (source, frame) = Source::frame(&args.of)?;
    let up = source.up(&frame);
    let params = PlaceParams { max_hidden: 0.02, ..PlaceParams::new(size, up.direction) };
    let mut best = vec![None; args.most.clamp(1, 1000)];
    let report = with_frame!(frame, |f| search(f, &params, &mut best))?;
    say.head(&format!("places for a box of {} x {} x {} m in {}", size.x, size.y, size.z, source.name()));
    let places: Vec<&Placement> = best.iter().flatten().collect();
    if places.is_empty() {
        say.line("No place: nowhere in the view is a surface level, wide and free enough with");
        say.line("the whole box in sight. Try a smaller box.");
    } else {
        let rows: Vec<Vec<String>> = places
            .iter()
            .map(|p| {
                vec![
                    point(p.pose.centre),
                    metres(p.flatness),
                    format!("{:.1}°", p.tilt.to_degrees()),
                    format!("{:.0} %", p.coverage * 100.0),
                    format!("{:.2}", p.score(&params)),
                ]
            })
            .collect();
        say.table(&["centre, m", "roughness", "tilt", "covered", "score"], &rows, &[]);
    }
    say.fact(
        "tried",
        &format!(
            "{} spots, {} pixels read, {} saved",
            count(report.tried),
            count(report.work.done),
            count(report.work.skipped)
        ),
    );
    say.fact("up", &up.sentence());
    let list: Vec<Value> = places
        .iter()
        .map(|p| {
            json!({
                "centre_m": p.pose.centre.to_array(), "rotation_xyzw": p.pose.rotation.to_array(),
                "normal": p.plane.normal().to_array(), "flatness_m": p.flatness, "tilt_rad": p.tilt,
                "coverage": p.coverage, "score": p.score(&params),
            })
        })
        .collect();
    let mut out = source.json("find-place", args.of.frame);
    extend(
        &mut out,
        json!({
            "answer": if list.is_empty() { "none" } else { "found" }, "size_m": size.to_array(), "places": list,
            "tried": report.tried, "work_done": report.work.done, "work_skipped": report.work.skipped, "up": up.json(),
        }),
    );
    say.json(&out);
    Ok(())
}
