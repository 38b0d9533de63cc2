//! `isobath bench`: run time against error of everything above, measured here and now.

use std::io::{IsTerminal as _, Write as _};

use isobath_bench::report::LOST;
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
        peers: args.peers.clone(),
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
    for line in report.text().trim_end().lines() {
        if line.starts_with(LOST) {
            say.alarm(line);
        } else {
            say.line(line);
        }
    }
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
        BenchError::Peers(_) => failure.advise("run `cargo xtask peers`, then this again; or leave --peers out"),
        BenchError::Write { .. } => failure.advise("choose a folder that can be written, with --out"),
        _ => failure,
    }
}
