//! The program `isobath`: asks depth recordings questions, for people and for machines.
//!
//! ```text
//! args (clap) -> source (a recording's frame) -> commands (the core's answers) -> say (text or JSON), picture, report
//! ```
//!
//! | module | idea |
//! |---|---|
//! | `args` | what can be asked, with examples |
//! | `source` | opening recordings and cameras; which way is up |
//! | `live` | cameras, when this program was built for them; what the kernel says is plugged in |
//! | `stop` | Ctrl-C: finish what was begun |
//! | `commands` | one file a command |
//! | `say` | stdout: text for people or one JSON object, never both |
//! | `failure` | stderr: what, where, what to do |
//! | `picture` | false colours, perspective drawings, SVG |
//! | `lighting` | what falls on a place: a recording's frames into one session |
//! | `pipeline` | the main job's stages, timed, in memory taken once |
//! | `report` | `report.html`: one page that needs nothing else |
//! | `files` | NPY, PLY and the like |
//!
//! Nothing here computes an answer: that is the core's. Exit codes: 0 fine, 1 failed, 2 the command line was wrong.

mod args;
mod commands;
mod failure;
mod files;
mod lighting;
mod live;
mod picture;
mod pipeline;
mod report;
mod say;
mod source;
mod stop;

use std::process::ExitCode;

use clap::Parser as _;

use args::{Cli, Command};
use say::Say;

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return refuse(&error),
    };
    let mut say = Say::new(cli.json);
    let outcome = match &cli.command {
        Command::Run(args) => commands::run::run(args, &mut say),
        Command::Info(args) => commands::info::run(args, &mut say),
        Command::Record(args) => commands::record::record(args, &mut say),
        Command::Convert(args) => commands::record::convert(args, &mut say),
        Command::Devices(args) => commands::devices::run(args, &mut say),
        Command::Sim(args) => commands::sim::run(args, &mut say),
        Command::Normals(args) => commands::normals::run(args, &mut say),
        Command::Points(args) => commands::points::run(args, &mut say),
        Command::Hit(args) => commands::hit::run(args, &mut say),
        Command::Raycast(args) => commands::raycast::run(args, &mut say),
        Command::Measure(args) => commands::measure::run(args, &mut say),
        Command::Place(args) => commands::place::run(args, &mut say),
        Command::FindPlace(args) => commands::find_place::run(args, &mut say),
        Command::Path(args) => commands::path::run(args, &mut say),
        Command::Envmap(args) => commands::envmap::run(args, &mut say),
        Command::Probe(args) => commands::probe::run(args, &mut say),
        Command::Bench(args) => commands::bench::run(args, &mut say),
        Command::Completions { shell } => {
            commands::completions::run(*shell);
            Ok(())
        }
    };
    match outcome {
        Ok(()) => {
            say.print();
            ExitCode::SUCCESS
        }
        Err(failure) if cli.json => {
            eprintln!("{}", failure.to_json());
            ExitCode::FAILURE
        }
        Err(failure) => {
            eprintln!("{failure}");
            ExitCode::FAILURE
        }
    }
}

/// What clap has to say: help and version are fine (0), the rest is bad usage (2).
fn refuse(error: &clap::Error) -> ExitCode {
    let json = std::env::args_os().any(|arg| arg == "--json");
    if json && error.use_stderr() {
        let text = error.render().to_string();
        let what = text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned();
        let failure =
            failure::Failure::new(what).at("command line").advise("see `isobath help` and `isobath help COMMAND`");
        eprintln!("{}", failure.to_json());
    } else {
        let _ = error.print();
    }
    ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2))
}
