//! `isobath completions`: what a shell needs to complete our commands and options.

use clap::CommandFactory as _;

pub(crate) fn run(shell: clap_complete::Shell) {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut crate::args::Cli::command(), "isobath", &mut text);
    // A closed pipe is no error.
    let _ = std::io::Write::write_all(&mut std::io::stdout(), &text);
}
