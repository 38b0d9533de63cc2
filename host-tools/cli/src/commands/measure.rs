//! `isobath measure`: the distance between two pixels' points, and its error bar.

use isobath::glam::Vec2;
use isobath::localized::measure::{MeasuredPoint, between, height_above, measure_point};
use isobath::localized::plane::ground::{GroundParams, estimate_ground};
use isobath::sensing::camera::intrinsics::pixel_index;
use isobath::sensing::depth::DepthSample;
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::frame::DepthFrame;
use isobath_source::with_frame;
use serde_json::{Value, json};

use crate::args::MeasureArgs;
use crate::commands::info::extend;
use crate::failure::Outcome;
use crate::say::{Say, metres, point};
use crate::source::Source;

/// What is at one end.
enum End {
    Point(MeasuredPoint),
    NoDepth,
    OutsideView,
}

impl End {
    fn at<D: DepthSample>(frame: &DepthFrame<'_, D>, at: Vec2) -> Self {
        match pixel_index(at, frame.size()) {
            None => Self::OutsideView,
            Some((x, y)) => measure_point(frame, x, y, &DepthNoise::KINECT).map_or(Self::NoDepth, Self::Point),
        }
    }

    fn json(&self) -> Value {
        match self {
            Self::Point(p) => json!({ "answer": "point", "point_m": p.point.to_array(), "sigma_m": p.sigma }),
            Self::NoDepth => json!({ "answer": "no_depth" }),
            Self::OutsideView => json!({ "answer": "outside_view" }),
        }
    }

    fn sentence(&self) -> String {
        match self {
            Self::Point(p) => format!("{} m, ± {} along its ray", point(p.point), metres(p.sigma)),
            Self::NoDepth => "no depth: the sensor has no reading there".into(),
            Self::OutsideView => "outside the view".into(),
        }
    }
}

pub(crate) fn run(args: &MeasureArgs, say: &mut Say) -> Outcome {
    let (source, frame) = Source::frame(&args.of)?;
    let up = source.up(&frame);
    // clap saw to it that there are two.
    let [a, b] = [0, 1].map(|i| args.pixels.get(i).copied().unwrap_or(Vec2::NAN));
    let ends = with_frame!(frame, |f| [End::at(f, a), End::at(f, b)]);
    let ground = with_frame!(frame, |f| estimate_ground(f, up.direction, &GroundParams::DEFAULT)).ok();
    say.head(&format!("from pixel {}, {} to {}, {} of {}", a.x, a.y, b.x, b.y, source.name()));
    say.fact("from", &ends[0].sentence());
    say.fact("to", &ends[1].sentence());
    let mut out = source.json("measure", args.of.frame);
    extend(&mut out, json!({ "pixels": [a.to_array(), b.to_array()], "from": ends[0].json(), "to": ends[1].json() }));
    if let [End::Point(p), End::Point(q)] = &ends {
        let d = between(p, q);
        let rise = (q.point - p.point).dot(up.direction);
        let run = (d.value * d.value - rise * rise).max(0.0).sqrt();
        say.fact(
            "distance",
            &format!("{:.3} m ± {} (one standard deviation, Kinect noise model)", d.value, metres(d.sigma)),
        );
        say.fact("of which", &format!("{} along the ground, {} up", metres(run), metres(rise)));
        extend(
            &mut out,
            json!({ "answer": "distance", "distance_m": d.value, "sigma_m": d.sigma, "horizontal_m": run, "rise_m": rise }),
        );
        if let Some(ground) = ground {
            let [hp, hq] = [p, q].map(|p| height_above(p, &ground.fit));
            say.fact(
                "heights",
                &format!(
                    "{:.3} m ± {} and {:.3} m ± {} above the ground",
                    hp.value,
                    metres(hp.sigma),
                    hq.value,
                    metres(hq.sigma)
                ),
            );
            let heights = [hp, hq].map(|h| json!({ "height_m": h.value, "sigma_m": h.sigma }));
            extend(&mut out, json!({ "heights_above_ground": heights }));
        }
    } else {
        say.fact("distance", "unknown: both ends need a reading");
        extend(&mut out, json!({ "answer": "unknown" }));
    }
    extend(&mut out, json!({ "up": up.json() }));
    say.fact("up", &up.sentence());
    say.json(&out);
    Ok(())
}
