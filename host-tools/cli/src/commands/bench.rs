//! `isobath bench`: run time against error of everything above, measured here and now.

use std::io::{IsTerminal as _, Write as _};

use isobath_bench::report::LOST;
use isobath_bench::{BenchError, Options, lighting, run as measure};

use crate::args::{BenchArgs, BenchLightingArgs, BenchOnly};
use crate::failure::{Failure, Outcome};
use crate::say::Say;

pub(crate) fn run(args: &BenchArgs, say: &mut Say) -> Outcome {
    if let Some(BenchOnly::Lighting(args)) = &args.only {
        return light(args, say);
    }
    let options = Options {
        filter: args.filter.clone(),
        quick: args.quick,
        sizes: args.size.into_iter().collect(),
        seed: args.seed,
        peers: args.peers.clone(),
    };
    let report = watched(|tell| measure(&options, tell))?;
    lines(&report.text(), say);
    for file in report.write(&args.out).map_err(|e| failed(&e))? {
        say.line(&format!("wrote {}", file.display()));
    }
    say.json(&report.json());
    Ok(())
}

/// The light of places against the truth.
fn light(args: &BenchLightingArgs, say: &mut Say) -> Outcome {
    let options = lighting::Options { quick: args.quick, seed: args.seed };
    let report = watched(|tell| lighting::run(&options, tell))?;
    lines(&report.text(), say);
    for file in report.write(&args.out).map_err(|e| failed(&e))? {
        say.line(&format!("wrote {}", file.display()));
    }
    say.json(&report.json());
    Ok(())
}

/// Runs, and on a terminal says in one line, written over and over, what is being measured.
fn watched<T>(measure: impl FnOnce(&mut dyn FnMut(&str)) -> Result<T, BenchError>) -> Outcome<T> {
    let watched = std::io::stderr().is_terminal();
    let mut tell = |what: &str| {
        if watched {
            let _ = write!(std::io::stderr(), "\r\x1b[2K{what}");
        }
    };
    let report = measure(&mut tell).map_err(|e| failed(&e));
    tell("");
    report
}

/// Tables, what is lost in red.
fn lines(text: &str, say: &mut Say) {
    for line in text.trim_end().lines() {
        if line.starts_with(LOST) {
            say.alarm(line);
        } else {
            say.line(line);
        }
    }
}

fn failed(error: &BenchError) -> Failure {
    let failure = Failure::of(error, "bench");
    match error {
        BenchError::NothingSelected { .. } => failure.advise("give one of these names, or a part of it, with --filter"),
        BenchError::Peers(_) => failure.advise("run `cargo xtask peers`, then this again; or leave --peers out"),
        BenchError::Write { .. } => failure.advise("choose a folder that can be written, with --out"),
        _ => failure,
    }
}
