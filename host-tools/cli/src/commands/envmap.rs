//! `isobath envmap`: the light that falls on a place, as an environment map.

use serde_json::json;

use crate::args::EnvmapArgs;
use crate::commands::info::extend;
use crate::failure::{Failure, Outcome};
use crate::files;
use crate::lighting::{gather, harmonics, light_json, light_sentence, raster};
use crate::say::Say;

pub(crate) fn run(args: &EnvmapArgs, say: &mut Say) -> Outcome {
    let light = gather(&args.light)?;
    if args.out.extension().is_some_and(|e| e == "png") {
        files::write_png(&args.out, &raster(&light.map, 1.0))?;
    } else {
        isobath_sim::write_linear(&light.map, &args.out).map_err(|e| Failure::writing(&args.out, e))?;
    }
    let sh = harmonics(&light.map);
    light.tell(say);
    say.fact("main light", &light_sentence(sh.main_light().as_ref()));
    say.fact("map", &args.out.display().to_string());
    let mut out = light.json("envmap");
    extend(&mut out, json!({ "harmonics": light_json(&sh, |d| light.to_world(d)), "out": args.out }));
    say.json(&out);
    Ok(())
}
