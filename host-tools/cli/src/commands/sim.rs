//! `isobath sim`: a simulated recording with its ground truth.

use std::path::PathBuf;

use isobath_sim::{ImuModel, PoseNoise, Scene, SimOptions, V3, write_recording};
use serde_json::json;

use crate::args::{Quality, SimArgs};
use crate::commands::run::progress;
use crate::failure::{Failure, Outcome};
use crate::say::{Say, count};

pub(crate) fn run(args: &SimArgs, say: &mut Say) -> Outcome {
    let failed = |e: &isobath_sim::SimError| Failure::of(e, &args.scene);
    let mut scene = Scene::open(&args.scene).map_err(|e| failed(&e))?;
    for (i, at) in args.probe.iter().enumerate() {
        let at = V3::from(at.map(f64::from));
        scene = scene.with_place(&format!("probe {}", i + 1), at).map_err(|e| failed(&e))?;
    }
    let options = SimOptions {
        size: args.size,
        frames: args.frames,
        sensor: args.sensor.parse().map_err(|e| failed(&e))?,
        seed: args.seed,
        environment: args.environment,
        path: args.path.parse().map_err(|e| failed(&e))?,
        place: args.place.clone(),
        pose_noise: if args.tracking == Quality::Phone { PoseNoise::PHONE } else { PoseNoise::NONE },
        imu: if args.imu == Quality::Phone { ImuModel::PHONE } else { ImuModel::EXACT },
        colour_size: args.colour_size,
        lens: args.lens.map_or([0.0; 8], |k| k.map(f64::from)),
        field_of_view: args.fov.map(f64::to_radians),
        unit: args.unit,
        ..SimOptions::default()
    };
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from("out").join(scene.name()));
    let bar = progress(Some(args.frames.max(2)));
    let summary = write_recording(&scene, &options, &folder, |done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let summary = summary.map_err(|e| failed(&e))?;

    say.head(&format!("{}: {}", scene.name(), scene.about()));
    say.fact(
        "frames",
        &format!("{}, {} x {}, sensor {}", count(summary.frames as u64), args.size.0, args.size.1, options.sensor),
    );
    say.fact(
        "truth",
        &format!("exact depth, normals, linear colour, segments; {} environment maps", summary.environment_maps),
    );
    say.fact("imu", &format!("{} readings", count(summary.imu_samples as u64)));
    say.fact("written", &summary.folder.display().to_string());
    say.json(&json!({
        "command": "sim",
        "scene": scene.name(),
        "sensor": options.sensor.to_string(),
        "seed": args.seed,
        "frames": summary.frames,
        "environment_maps": summary.environment_maps,
        "imu_samples": summary.imu_samples,
        "folder": summary.folder,
    }));
    Ok(())
}
