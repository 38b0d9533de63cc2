//! `isobath probe`: what the light of a place does to three balls, and the light in nine coefficients.

use isobath::glam::Vec3;
use isobath_sim::{LinearImage, read_linear};
use serde_json::json;

use crate::args::ProbeArgs;
use crate::commands::info::extend;
use crate::failure::{Failure, Outcome};
use crate::files;
use crate::lighting::{Light, balls, gather, harmonics, light_json, light_sentence, view_from};
use crate::say::{Say, point};

/// A ball's side, pixels.
const SIDE: usize = 256;

pub(crate) fn run(args: &ProbeArgs, say: &mut Say) -> Outcome {
    if !(args.exposure > 0.0 && args.exposure.is_finite()) {
        return Err(Failure::new("the exposure must be above 0")
            .at("--exposure")
            .advise("give a factor such as 1 or 0.5"));
    }
    let light = args.light.as_ref().map(gather).transpose()?;
    let map = match (&light, &args.map) {
        (Some(light), _) => light.map.clone(),
        (None, Some(path)) => read(path)?,
        (None, None) => {
            return Err(Failure::new("there is nothing to probe").advise("give SRC and --at, or --map FILE"));
        }
    };
    let sh = harmonics(&map);
    let mut out = match &light {
        Some(light) => {
            light.tell(say);
            light.json("probe")
        }
        None => {
            let name = args.map.as_deref().map(|m| m.display().to_string()).unwrap_or_default();
            say.head(&format!("light of {name}: {} x {}", map.width, map.height));
            let mut out = serde_json::Map::new();
            extend(&mut out, json!({ "command": "probe", "source": name, "width": map.width, "height": map.height }));
            out
        }
    };
    let to_world = |d: Vec3| light.as_ref().map_or(d, |light: &Light| light.to_world(d));
    let main = sh.main_light();
    say.fact("main light", &light_sentence(main.as_ref()));
    if let Some(main) = main {
        say.fact("", &format!("direction {}", point(to_world(main.direction))));
        say.fact("", &format!("colour {}, ambient {}", colour(main.colour), colour(main.ambient)));
    }
    say.line("");
    let rows: Vec<Vec<String>> = ["1", "y", "z", "x", "xy", "yz", "3z²-1", "xz", "x²-y²"]
        .iter()
        .zip(sh.coefficients)
        .map(|(name, c)| std::iter::once((*name).to_owned()).chain(c.map(|v| format!("{v:.4}"))).collect())
        .collect();
    say.table(&["harmonic", "red", "green", "blue"], &rows, &[]);
    if let Some(path) = &args.out {
        let view = view_from(light.as_ref().map_or(Vec3::Z, |light| light.camera));
        files::write_png(path, &balls(&map, &view, SIDE, args.exposure))?;
        say.fact("balls", &path.display().to_string());
    }
    extend(&mut out, json!({ "harmonics": light_json(&sh, to_world), "exposure": args.exposure, "out": args.out }));
    say.json(&out);
    Ok(())
}

fn colour([r, g, b]: [f32; 3]) -> String {
    format!("({r:.2},\u{a0}{g:.2},\u{a0}{b:.2})")
}

fn read(path: &std::path::Path) -> Outcome<LinearImage> {
    let map = read_linear(path)
        .map_err(|e| Failure::of(&e, path.display()).advise("give an .exr, .hdr, .png or .jpg file"))?;
    if map.height == 0 || map.width != 2 * map.height {
        return Err(Failure::new(format!("{} x {} pixels are no environment map", map.width, map.height))
            .at(path.display())
            .advise("give an equirectangular map, twice as wide as high"));
    }
    Ok(map)
}
