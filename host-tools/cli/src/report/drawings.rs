//! The pictures of the page: what was found drawn over the colour image, depth, normals, rays, the height map from above.

use isobath::glam::Vec3;
use isobath::lighting::equirect::uv_of_direction;
use isobath::localized::collision::Verdict;
use isobath::localized::normals::NormalParams;
use isobath::localized::normals::dense::{rows, scratch_len};
use isobath::localized::planner::Plan;
use isobath::localized::raycast::RayOutcome;
use isobath::localized::reticle::ReticleState;
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath_sim::LinearImage;

use super::run::{chairs_of, ray_counts, thinned};
use super::{Figure, charts};
use crate::failure::{Failure, Outcome};
use crate::lighting::{balls, raster, view_from};
use crate::picture::map::{MapDrawing, TALL, height_colour};
use crate::picture::perspective::Pen;
use crate::picture::svg::Svg;
use crate::picture::{colours, frames};
use crate::pipeline::{Findings, Lit, MAP_CELL, Pipeline, STANDING, WALKER};
use crate::say::metres;

/// The pictures of the frame that is shown, drawn while its memory holds it.
#[derive(Debug)]
pub(crate) struct Drawings {
    pub(super) figures: Vec<Figure>,
}

impl Drawings {
    /// Draws everything there is to see of a frame.
    pub(crate) fn new<D: DepthSample>(
        frame: &DepthFrame<'_, D>,
        found: &Findings,
        pipeline: &Pipeline<'_, D>,
    ) -> Outcome<Self> {
        let (w, h) = frame.size();
        let mut normals = Vec::with_capacity(w * h);
        let mut scratch = vec![0.0; scratch_len(w)];
        rows(frame, &NormalParams::default(), &mut scratch, |_, row| {
            normals.extend(row.x.iter().zip(row.y).zip(row.z).map(|((&x, &y), &z)| [x, y, z]));
        })
        .map_err(|e| Failure::of(&e, "normals"))?;
        let mut figures = vec![scene_figure(frame, found, &normals), depth_figure(frame)];
        if let Some(confidence) = frames::confidence(frame) {
            figures.push(Figure {
                title: "Confidence".into(),
                drawing: Svg::over(&confidence, "confidence").finish(),
                legend: charts::colour_bar(0.0, 100.0, " %", "confidence in percent", |v| {
                    frames::confidence_colour(v / 100.0)
                }),
                caption: "How sure the sensor is of each pixel, as it says itself.".into(),
                wide: false,
            });
        }
        figures.push(normals_figure((w, h), &normals));
        figures.push(rays_figure(frame, found, &normals));
        figures.push(map_figure(frame, found, pipeline));
        if let Ok(lit) = &found.light {
            figures.extend(light_figures(lit, found, &pipeline.light_map()));
        }
        Ok(Self { figures })
    }
}

/// Sizes of strokes and letters, for drawings of any size.
fn unit_of((w, _): (usize, usize)) -> f32 {
    w as f32 / 640.0
}

fn scene_figure<D: DepthSample>(frame: &DepthFrame<'_, D>, found: &Findings, normals: &[[f32; 3]]) -> Figure {
    let raster = frames::scene(frame, normals);
    let unit = unit_of(frame.size());
    let mut svg = Svg::over(&raster, "the scene with reticle, chairs and path");
    let pen = Pen::new(frame);
    // Footprints first, so that boxes stand over them.
    let blocked = chairs_of(found, Verdict::Blocked);
    for chair in &blocked {
        pen.footprint(&mut svg, chair, colours::BLOCKED, 1.3 * unit);
    }
    for stool in thinned(found.stools()) {
        pen.cuboid(&mut svg, &stool, colours::ROOM, 1.5 * unit);
    }
    // Far ones first, near ones over them.
    for chair in chairs_of(found, Verdict::Free).iter().rev() {
        pen.cuboid(&mut svg, chair, colours::FREE, 1.7 * unit);
    }
    for tap in &found.taps {
        let at = [tap.pixel.0 as f32, tap.pixel.1 as f32];
        svg.circle(at, 1.8 * unit, "#ffffff", "stroke=\"#10161c\" stroke-width=\"0.8\" opacity=\"0.8\"");
    }
    if let Plan::Found(_) = found.plan {
        let lifted: Vec<Vec3> = found.path.iter().map(|&p| p + found.up * 0.02).collect();
        pen.polyline(&mut svg, &lifted, "#1a1400", 5.0 * unit);
        pen.polyline(&mut svg, &lifted, colours::PATH, 3.0 * unit);
        for (p, name) in [(lifted.first(), "start"), (lifted.last(), "goal")] {
            if let Some(at) = p.and_then(|&p| pen.pixel(p)).filter(|&at| inside(at, frame.size())) {
                svg.circle(at, 4.5 * unit, colours::PATH, "stroke=\"#1a1400\" stroke-width=\"1.2\"");
                svg.label([at[0], at[1] - 9.0 * unit], 13.0 * unit, name, colours::PATH, "middle");
            }
        }
    }
    if let ReticleState::Tracking(pose) | ReticleState::Holding { pose, .. } = found.reticle {
        let normal = pose.orientation * Vec3::Z;
        let size = 0.02 * frame.pose_or_identity().to_camera(pose.position).z;
        let lifted = pose.position + normal * size * 0.1;
        pen.circle(&mut svg, lifted, normal, size * 2.2, colours::CURSOR, 2.2 * unit);
        pen.circle(&mut svg, lifted, normal, size * 0.5, colours::CURSOR, 2.2 * unit);
        pen.line(&mut svg, lifted, lifted + normal * size * 4.0, colours::CURSOR, 2.2 * unit);
        if let (Some(at), Some(hit)) = (pen.pixel(lifted), found.hit()) {
            let at = [at[0] + 22.0 * unit, at[1] - 14.0 * unit];
            svg.label(at, 13.0 * unit, &metres(hit.z), colours::CURSOR, "start");
        }
    }
    Figure {
        title: "What was found".into(),
        drawing: svg.finish(),
        legend: charts::key(&[
            (colours::FREE, "a chair is free"),
            (colours::BLOCKED, "a chair is blocked (footprint)"),
            (colours::ROOM, "a stool fits"),
            ("#ffffff", "taps"),
            (colours::PATH, "path"),
            (colours::CURSOR, "reticle and its normal"),
        ]),
        caption: "Drawn through the frame's own camera; what the real scene hides is dashed. Where a tap meets level \
                  ground, a chair (0.5 x 0.9 x 0.5 m) is judged by the vote of 13 of its points (a fifth hidden blocks); a stool (0.3 x 0.4 x 0.3 m) must \
                  stand level and be wholly in sight. Of overlapping ones the nearest is drawn."
            .into(),
        wide: true,
    }
}

/// Whether a place is on the picture, give or take a few pixels.
fn inside([x, y]: [f32; 2], (w, h): (usize, usize)) -> bool {
    (-4.0..w as f32 + 4.0).contains(&x) && (-4.0..h as f32 + 4.0).contains(&y)
}

fn depth_figure<D: DepthSample>(frame: &DepthFrame<'_, D>) -> Figure {
    let (near, far) = frames::depth_span(frame);
    let step = frames::round_step(far - near, 14.0);
    let raster = frames::depth(frame, (near, far), step);
    Figure {
        title: "Depth".into(),
        drawing: Svg::over(&raster, "false-colour depth").finish(),
        legend: charts::colour_bar(near, far, " m", "depth in metres", |z| colours::depth(z, near, far)),
        caption: format!(
            "z along the camera's axis. Dark lines join points of equal depth, every {} m; dark grey has no reading.",
            short(step)
        ),
        wide: false,
    }
}

/// A round number without trailing zeros.
fn short(value: f32) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn normals_figure((w, h): (usize, usize), normals: &[[f32; 3]]) -> Figure {
    let raster = frames::normals(w, h, normals);
    let unit = unit_of((w, h));
    let mut svg = Svg::over(&raster, "surface normals");
    let side = 84.0 * unit;
    let (x, y) = (w as f32 - side - 12.0 * unit, h as f32 - side - 12.0 * unit);
    svg.raw(&format!(
        "<defs><clipPath id=\"ball\"><circle cx=\"{0}\" cy=\"{1}\" r=\"{2}\"/></clipPath></defs><g clip-path=\"url(#ball)\">",
        x + side / 2.0,
        y + side / 2.0,
        side / 2.0
    ));
    svg.picture(&frames::normal_ball(96), x, y, side, side, false);
    svg.raw("</g>");
    svg.circle([x + side / 2.0, y + side / 2.0], side / 2.0, "none", "stroke=\"#ffffff\" stroke-width=\"1.5\"");
    Figure {
        title: "Normals".into(),
        drawing: svg.finish(),
        legend: String::new(),
        caption: "Which way each pixel faces, in the camera frame: x as red, up as green, towards the camera as blue. The ball \
                  shows the colours of all directions."
            .into(),
        wide: false,
    }
}

fn rays_figure<D: DepthSample>(frame: &DepthFrame<'_, D>, found: &Findings, normals: &[[f32; 3]]) -> Figure {
    let raster = frames::scene(frame, normals);
    let unit = unit_of(frame.size());
    let (w, h) = frame.size();
    let mut svg = Svg::over(&raster, "rays from a hand");
    svg.rect(-0.5, -0.5, w as f32, h as f32, "fill=\"#000000\" opacity=\"0.45\"");
    let pen = Pen::new(frame);
    for (ray, outcome) in &found.rays {
        let (end, colour) = match outcome {
            RayOutcome::Hit(hit) => (hit.point, colours::RAY),
            RayOutcome::HitOccluded { point, .. } => (*point, colours::BLOCKED),
            RayOutcome::Miss { .. } | RayOutcome::NoDepth | RayOutcome::OutsideView => (ray.at(8.0), colours::UNKNOWN),
        };
        pen.line(&mut svg, ray.origin(), end, colour, 1.1 * unit);
        if matches!(outcome, RayOutcome::Hit(_) | RayOutcome::HitOccluded { .. })
            && let Some(at) = pen.pixel(end)
        {
            svg.circle(at, 3.6 * unit, colour, "stroke=\"#10060f\" stroke-width=\"1\"");
        }
    }
    let [hits, occluded, missed, no_depth, outside] = ray_counts(found);
    Figure {
        title: "Ray casts".into(),
        drawing: svg.finish(),
        legend: charts::key(&[
            (colours::RAY, &format!("hit ({hits})")),
            (colours::BLOCKED, &format!("went behind a surface ({occluded})")),
            (colours::UNKNOWN, &format!("missed, or unknown ({})", missed + no_depth + outside)),
        ]),
        caption:
            "Rays from a hand 25 cm to the right of and below the camera, each stopped where it first meets the scene. \
                  What a ray does behind a surface the camera cannot know."
                .into(),
        wide: false,
    }
}

fn map_figure<D: DepthSample>(frame: &DepthFrame<'_, D>, found: &Findings, pipeline: &Pipeline<'_, D>) -> Figure {
    let camera = frame.pose_or_identity().translation();
    let map = pipeline.map();
    let mut drawing = MapDrawing::new(map, &[camera], |x, y| pipeline.walkable(x, y));
    // The view's two sides, as far as the map goes.
    let pose = frame.pose_or_identity();
    let k = frame.intrinsics();
    let (w, h) = frame.size();
    let side = |x: f32| {
        let ray = k.ray(isobath::glam::Vec2::new(x, h as f32 / 2.0));
        let along = pose.direction_to_world(ray);
        camera + along * 6.0
    };
    let wedge = [side(-0.5), camera, side(w as f32 - 0.5)];
    drawing.line(&wedge, "#ffffff", 1.2, "stroke-dasharray=\"5 5\" stroke-opacity=\"0.7\"");
    let shapes = thinned(found.stools()).into_iter().map(|b| (b, colours::ROOM));
    let shapes = shapes.chain(chairs_of(found, Verdict::Blocked).into_iter().map(|b| (b, colours::BLOCKED)));
    let shapes = shapes.chain(chairs_of(found, Verdict::Free).into_iter().map(|b| (b, colours::FREE)));
    for (shape, colour) in shapes {
        let c = shape.corners();
        let extra = format!("fill-opacity=\"0.15\" stroke=\"{colour}\" stroke-width=\"2\"");
        drawing.polygon(&[c[0], c[1], c[5], c[4]], colour, &extra);
    }
    if !found.path.is_empty() {
        drawing.line(&found.path, "#1a1400", 7.0, "");
        drawing.line(&found.path, colours::PATH, 4.0, "");
        for (p, name) in [(found.path.first(), "start"), (found.path.last(), "goal")] {
            if let Some(&p) = p {
                drawing.place(p, name, colours::PATH);
            }
        }
    }
    drawing.place(camera, "camera", "#ffffff");
    let from = if pipeline.grounded() {
        "the ground".to_owned()
    } else {
        format!("a level {STANDING} m below the camera, as no ground was seen")
    };
    let bar = charts::colour_bar(0.0, TALL, " m", "height above the ground in metres", height_colour);
    let key = charts::key(&[
        ("#d6ded6", "can be walked on"),
        (&colours::hex(colours::HOLE), "never seen"),
        (colours::FREE, "chair free"),
        (colours::BLOCKED, "chair blocked"),
        (colours::ROOM, "stool"),
        (colours::PATH, "path"),
    ]);
    Figure {
        title: "Height map and path".into(),
        drawing: drawing.svg.finish(),
        legend: format!("{bar}{key}"),
        caption: format!(
            "From above, the camera looking up the page; cells of {:.0} cm, coloured by the highest reading over {from}. The \
             walker keeps {:.0} cm from obstacles and climbs {:.0} cm at most; what was never seen it does not enter.",
            MAP_CELL * 100.0,
            WALKER.radius * 100.0,
            WALKER.max_step * 100.0
        ),
        wide: false,
    }
}

/// The light of an object's place: its map, and balls in it.
fn light_figures(lit: &Lit, found: &Findings, map: &LinearImage) -> [Figure; 2] {
    let camera = lit.map.direction(found.camera - lit.map.at);
    let mut svg = Svg::over(&raster(map, 1.0), "environment map");
    if let Some(main) = lit.harmonics.main_light() {
        let at = uv_of_direction(main.direction) * isobath::glam::Vec2::new(map.width as f32, map.height as f32) - 0.5;
        svg.circle([at.x, at.y], 7.0, "none", "stroke=\"#ffe08a\" stroke-width=\"2\"");
        svg.label([at.x + 11.0, at.y + 4.0], 12.0, "main light", "#ffe08a", "start");
    }
    let kept = if lit.near_share > 0.0 { "near points over" } else { "no near points, only" };
    let environment = Figure {
        title: "Environment map".into(),
        drawing: svg.finish(),
        legend: String::new(),
        caption: format!(
            "What is seen from {}, in every direction: {kept} light from afar, where no frame looked the ambient. Up in the first \
             row; the ring is the main light of the order-2 harmonics.",
            lit.why
        ),
        wide: false,
    };
    let picture = balls(map, &view_from(camera), 160, 1.0);
    let balls = Figure {
        title: "Balls in that light".into(),
        drawing: Svg::over(&picture, "a mirror, a glossy and a matt ball").finish(),
        legend: String::new(),
        caption: "A mirror, a glossy and a matt white ball at that place, as the camera sees them.".into(),
        wide: false,
    };
    [environment, balls]
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn short_numbers_keep_what_they_have() {
        assert_eq!(short(0.25), "0.25");
        assert_eq!(short(0.2), "0.2");
    }
}
