//! Running the fuzz targets for a bounded time, on copies of their corpora: git holds only the chosen seeds.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};

use crate::shell::{Cmd, ensure_cargo_tool, ensure_debian, ensure_nightly, root};

const CARGO_FUZZ: &str = "0.13.2";

/// The targets: one file each in `fuzz/fuzz_targets`.
fn targets() -> Result<Vec<String>> {
    let dir = root().join("fuzz/fuzz_targets");
    let mut names = Vec::new();
    for entry in fs::read_dir(&dir).with_context(|| format!("reading {}", dir.display()))? {
        if let Some(name) = entry?.file_name().to_str().and_then(|n| n.strip_suffix(".rs")) {
            names.push(name.to_owned());
        }
    }
    names.sort();
    Ok(names)
}

/// `cargo xtask fuzz`.
pub(crate) fn verb(args: Vec<String>) -> Result<()> {
    let (mut chosen, mut seconds) = (Vec::new(), 60);
    let mut args = args.into_iter();
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--list" => {
                println!("{}", targets()?.join("\n"));
                return Ok(());
            }
            "--seconds" => seconds = args.next().and_then(|n| n.parse().ok()).context("--seconds needs a number")?,
            flag if flag.starts_with('-') => bail!("unexpected argument `{flag}`; see `cargo xtask fuzz --help`"),
            _ => chosen.push(arg),
        }
    }
    run(&chosen, seconds)
}

/// Runs the named targets, or all, `seconds` each. A crash is an error that names the target; the others run all the same.
pub(crate) fn run(chosen: &[String], seconds: u32) -> Result<()> {
    let all = targets()?;
    if let Some(unknown) = chosen.iter().find(|c| !all.contains(c)) {
        bail!("no fuzz target `{unknown}`; there are {}", all.join(", "));
    }
    let why = "fuzzing";
    ensure_nightly(why)?;
    ensure_debian("c++", "g++", "libFuzzer is C++")?;
    ensure_cargo_tool("cargo-fuzz", CARGO_FUZZ, &["fuzz", "--version"], why)?;
    let fuzz = || Cmd::cargo_of("nightly").args(["fuzz"]);
    fuzz().args(["build"]).run()?;
    let mut crashed = Vec::new();
    for name in if chosen.is_empty() { &all } else { chosen } {
        let corpus = scratch_corpus(name)?;
        let limits = [
            format!("-max_total_time={seconds}"),
            // A hang is a finding: no small input may take ten seconds.
            "-timeout=10".into(),
            "-rss_limit_mb=2048".into(),
            "-max_len=4096".into(),
            "-print_final_stats=0".into(),
            "-verbosity=0".into(),
        ];
        let started = std::time::Instant::now();
        let corpus_arg = corpus.to_string_lossy().into_owned();
        if let Err(error) = fuzz().args(["run", name, &corpus_arg, "--"]).args(&limits).run() {
            println!("{error:#}");
            crashed.push(name.as_str());
        }
        println!(
            "{name}: {:.0} s, {} inputs of interest",
            started.elapsed().as_secs_f64(),
            fs::read_dir(&corpus)?.count()
        );
    }
    if !crashed.is_empty() {
        bail!("crashed: {}; the inputs are in fuzz/artifacts", crashed.join(", "));
    }
    Ok(())
}

/// A fresh copy of the seeds under `target/`, for libFuzzer to grow.
fn scratch_corpus(name: &str) -> Result<PathBuf> {
    let (seeds, scratch) = (root().join("fuzz/corpus").join(name), root().join("target/fuzz-corpus").join(name));
    if scratch.exists() {
        fs::remove_dir_all(&scratch)?;
    }
    fs::create_dir_all(&scratch)?;
    for entry in fs::read_dir(&seeds).with_context(|| format!("{name} has no seeds in {}", seeds.display()))? {
        let entry = entry?;
        fs::copy(entry.path(), scratch.join(entry.file_name()))?;
    }
    Ok(scratch)
}
