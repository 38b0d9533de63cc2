//! `isobath path`: how to walk from one point to another, around what can't be climbed.

use isobath::glam::Vec3;
use isobath::localized::height_map::{HeightCell, HeightMap, HeightMapParams};
use isobath::localized::planner::{Node, Plan, Planner};
use isobath_source::{OwnedFrame, with_frame};
use serde_json::json;

use crate::args::PathArgs;
use crate::commands::info::extend;
use crate::failure::{Failure, Outcome};
use crate::pipeline::{MAP_CELL, MAP_CELLS, STANDING, WALKER, lay_grid};
use crate::report::run::{plan_name, plan_sentence};
use crate::say::{Say, count, metres, point};
use crate::source::Source;

pub(crate) fn run(args: &PathArgs, say: &mut Say) -> Outcome {
    let (mut source, frame) = Source::frame(&args.of)?;
    if args.all && frame.pose.is_none() {
        return Err(Failure::new("the frames have no poses, so they do not join into one map")
            .at(source.name())
            .advise("leave --all out: the map is then that of --frame alone"));
    }
    let up = source.up(&frame);
    let (grid, grounded) = with_frame!(frame, |f| lay_grid(f, up.direction, args.all))?;
    let mut cells = vec![HeightCell::UNKNOWN; MAP_CELLS * MAP_CELLS];
    let mut nodes = vec![Node::EMPTY; MAP_CELLS * MAP_CELLS];
    let mut corners = [Vec3::ZERO; 128];
    let failed = |e: &dyn std::error::Error| Failure::of(e, "path");
    let mut map = HeightMap::new(grid, &mut cells, HeightMapParams::DEFAULT).map_err(|e| failed(&e))?;
    let mut left_out = 0;
    let first = if args.all { 0 } else { args.of.frame };
    let mut other = OwnedFrame::new();
    for index in first..args.of.frame {
        // A broken file, or a frame without a pose, takes nothing from the others.
        if source.read(index, &mut other).is_ok() && other.pose.is_some() {
            with_frame!(other, |f| map.integrate(f));
        } else {
            left_out += 1;
        }
    }
    with_frame!(frame, |f| map.integrate(f));
    let plan =
        Planner::new(&mut nodes).plan(&map, &WALKER, args.from, args.to, &mut corners).map_err(|e| failed(&e))?;
    let known = map.cells().iter().filter(|c| c.is_known()).count();

    let mut out = source.json("path", args.of.frame);
    say.head(&format!("walk from {} to {} m in {}", point(args.from), point(args.to), source.name()));
    say.fact("answer", &plan_sentence(&plan));
    extend(&mut out, json!({ "answer": plan_name(&plan), "from_m": args.from.to_array(), "to_m": args.to.to_array() }));
    if let Plan::Found(path) = plan {
        let points = corners.get(..path.points).unwrap_or(&[]);
        for (i, &p) in points.iter().enumerate() {
            let name = match i {
                0 => "start",
                i if i + 1 == points.len() => "goal",
                _ => "corner",
            };
            say.fact(name, &format!("{} m", point(p)));
        }
        if let (Some(a), Some(b)) = (points.first(), points.last()) {
            say.fact("straight", &format!("{} as the crow flies", metres(a.distance(*b))));
        }
        say.fact(
            "work",
            &format!("{} of {} cells expanded", count(path.expanded), count((MAP_CELLS * MAP_CELLS) as u64)),
        );
        let points: Vec<[f32; 3]> = points.iter().map(|p| p.to_array()).collect();
        extend(
            &mut out,
            json!({ "length_m": path.length, "cost_m": path.cost, "points_m": points, "work_done": path.expanded }),
        );
    }
    say.fact(
        "map",
        &format!("{:.1} m² known, cells of {:.0} cm", known as f32 * MAP_CELL * MAP_CELL, MAP_CELL * 100.0),
    );
    if left_out > 0 {
        say.fact("note", &format!("{left_out} frames could not be read or have no pose, and are not in the map"));
    }
    if !grounded {
        say.fact("note", &format!("no ground is seen; heights count from {STANDING} m below the camera"));
    }
    say.fact("up", &up.sentence());
    extend(&mut out, json!({ "known_cells": known, "cell_m": MAP_CELL, "frames_left_out": left_out, "up": up.json() }));
    say.json(&out);
    Ok(())
}
