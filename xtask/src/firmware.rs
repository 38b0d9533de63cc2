//! Runs the images of `tests/firmware` in QEMU and holds their figures to what is stored.
//!
//! [`boards`] builds and runs; [`figures`] are the numbers, stored in `tests/firmware/results.toml`; [`document`] makes
//! `docs/footprint.md` of the stored ones. Instructions are counted by QEMU's `-icount`, so they repeat to the digit on any machine;
//! another compiler moves them, which is what the tolerance and `--store` are for.

mod boards;
mod document;
mod figures;

use std::fs;

use anyhow::{Context, Result, bail};

use crate::shell::root;
use figures::Figures;

/// Largest stack of any stage of the localized job, of the light and of key frames on the M4, bytes.
const MOST_STACK: u64 = 8 * 1024;
/// Largest memory, bytes: what is counted, and its bound.
const MOST_MEMORY: [(&str, u64); 2] = [("localized-job", 160 * 1024), ("lighting-tiny", 256 * 1024)];
/// What is stored.
const STORED: &str = "tests/firmware/results.toml";
/// The document made of it.
const DOCUMENT: &str = "docs/footprint.md";

/// `cargo xtask firmware`.
pub(crate) fn verb(args: Vec<String>) -> Result<()> {
    match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [] => run(false),
        ["--store"] => run(true),
        _ => bail!("unexpected arguments; see `cargo xtask firmware --help`"),
    }
}

/// Builds, runs, compares; or stores.
pub(crate) fn run(store: bool) -> Result<()> {
    let measured = boards::measure()?;
    let mut wrong = limits(&measured);
    let stored_at = root().join(STORED);
    let document_at = root().join(DOCUMENT);
    if store {
        fs::write(&stored_at, measured.to_toml())?;
        fs::write(&document_at, document::render(&measured))?;
        println!("stored: {STORED}, {DOCUMENT}");
    } else {
        let text = fs::read_to_string(&stored_at).with_context(|| format!("reading {STORED}"))?;
        let stored = Figures::from_toml(&text)?;
        wrong.extend(measured.differences(&stored));
        if fs::read_to_string(&document_at).unwrap_or_default() != document::render(&stored) {
            wrong.push(format!("{DOCUMENT} is not what {STORED} says"));
        }
    }
    if !wrong.is_empty() {
        bail!(
            "{}\nIf that is meant: `cargo xtask firmware --store`, and say in the commit what it costs",
            wrong.join("\n")
        );
    }
    println!("{} figures as stored", measured.len());
    Ok(())
}

/// What no stored figure may excuse.
fn limits(measured: &Figures) -> Vec<String> {
    let held =
        |stage: &str| document::JOB.contains(&stage) || ["light-", "key-frame-"].iter().any(|p| stage.starts_with(p));
    let stages = measured.section("cortex-m4.stack").filter(|(stage, bytes)| *bytes > MOST_STACK && held(stage));
    let stacks = stages
        .map(|(stage, bytes)| format!("stage {stage} takes {bytes} bytes of stack; the M4 has {MOST_STACK} for it"));
    let memory = MOST_MEMORY.into_iter().filter_map(|(what, most)| {
        let bytes = measured.get("memory", what).unwrap_or(u64::MAX);
        (bytes > most).then(|| format!("{what} takes {bytes} bytes of memory; it must fit {most}"))
    });
    stacks.chain(memory).collect()
}
