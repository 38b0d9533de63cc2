//! `isobath bench`: run time against error of everything above, measured here and now.

use std::io::{IsTerminal as _, Write as _};

use isobath_bench::{BenchError, Options, run as measure};

use crate::args::BenchArgs;
use crate::failure::{Failure, Outcome};
use crate::say::Say;

pub(crate) fn run(args: &BenchArgs, say: &mut Say) -> Outcome {
    let options = Options {
        filter: args.filter.clone(),
        quick: args.quick,
        sizes: args.size.into_iter().collect(),
        seed: args.seed,
    };
    let watched = std::io::stderr().is_terminal();
    // One line that is written over: what is being measured.
    let mut tell = |what: &str| {
        if watched {
            let _ = write!(std::io::stderr(), "\r\x1b[2K{what}");
        }
    };
    let report = measure(&options, &mut tell).map_err(|e| failed(&e));
    tell("");
    let report = report?;
    say.line(report.text().trim_end());
    for file in report.write(&args.out).map_err(|e| failed(&e))? {
        say.line(&format!("wrote {}", file.display()));
    }
    say.json(&report.json());
    Ok(())
}

fn failed(error: &BenchError) -> Failure {
    let failure = Failure::of(error, "bench");
    match error {
        BenchError::NothingSelected { .. } => failure.advise("give one of these names, or a part of it, with --filter"),
        BenchError::Write { .. } => failure.advise("choose a folder that can be written, with --out"),
        _ => failure,
    }
}
