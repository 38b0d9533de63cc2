//! Links the proof image (`tests/firmware/proof`) for each bare-metal target: it has no allocator, so that it links proves
//! that nothing in the core's tree wants one. Nor does it hold a panic: where the core indexes, divides or clamps, the
//! compiler has seen that it can't fail, or it would have linked `core::panicking`.
//!
//! A proof that can't fail proves nothing, so the same image with an `extern crate alloc` must not link, and the one with an
//! index that can be out of bounds must be caught.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};

use crate::elf::Elf;
use crate::shell::{Cmd, ensure_target, root};

/// The targets without an operating system that the core is held to.
pub(crate) const BARE_METAL: &[&str] = &["thumbv7em-none-eabihf", "aarch64-unknown-none"];

/// The workspace of the images.
pub(crate) const MANIFEST: &str = "tests/firmware/Cargo.toml";

/// What the names of panic functions have in common, in both of Rust's manglings.
pub(crate) const PANICS: &str = "core9panicking";

/// `cargo xtask proof`.
pub(crate) fn run() -> Result<()> {
    let mut lines = Vec::new();
    let mut bad = Vec::new();
    for target in BARE_METAL {
        ensure_target(target, "linking the proof image")?;
        cargo("build", target).run()?;
        let bytes = image(target)?;
        let elf =
            Elf::parse(&bytes).with_context(|| format!("the image for {target} is no ELF file that we can read"))?;
        let (text, data, bss) = elf.sizes();
        let panics = elf.symbols_with(PANICS);
        lines.push(format!(
            "{target:<24} text {text:>8}  data {data:>6}  bss {bss:>8}  panic symbols {:>3}",
            panics.len()
        ));
        if !panics.is_empty() {
            bad.push(format!("{target}: {} panic symbols: {}", panics.len(), panics.join(" ")));
            let callers = callers(target)?;
            bad.extend(callers.iter().map(|line| format!("    {line}")));
        }
        if let Some(alloc) = elf.symbols_with("__rust_alloc").first() {
            bail!("{target}: the image holds the allocator symbol {alloc}");
        }
    }
    let target = BARE_METAL[0];
    println!("negative control: the image with `extern crate alloc` must not link");
    let (linked, _, errors) = cargo("build", target).args(["--features", "with-alloc"]).read()?;
    if linked || !errors.contains("no global memory allocator found") {
        bail!("the negative control did not fail as it must:\n{errors}");
    }
    println!("it does not: no global memory allocator found");
    println!("negative control: the image with an unchecked index must show a panic symbol");
    cargo("build", target).args(["--features", "with-panic"]).run()?;
    let found = Elf::parse(&image(target)?).map(|elf| elf.symbols_with(PANICS)).unwrap_or_default();
    let [first, ..] = found.as_slice() else {
        bail!("the negative control shows none: the search for panic symbols finds nothing");
    };
    println!("it does: {first}\n\n{}", lines.join("\n"));
    if !bad.is_empty() {
        bail!("the core must not panic, yet the image can:\n{}", bad.join("\n"));
    }
    Ok(())
}

fn cargo(verb: &str, target: &str) -> Cmd {
    Cmd::new("cargo").args([
        verb,
        "--release",
        "--manifest-path",
        MANIFEST,
        "--package",
        "isobath-proof",
        "--target",
        target,
    ])
}

fn folder(target: &str) -> PathBuf {
    root().join("tests/firmware/target").join(target).join("release")
}

fn image(target: &str) -> Result<Vec<u8>> {
    let path = folder(target).join("isobath-proof");
    fs::read(&path).with_context(|| format!("reading {}", path.display()))
}

/// Which functions of the image call a panic: `caller -> panic`, from the assembly.
fn callers(target: &str) -> Result<BTreeSet<String>> {
    cargo("rustc", target).args(["--", "--emit=asm"]).run()?;
    let mut found = BTreeSet::new();
    for entry in fs::read_dir(folder(target).join("deps"))? {
        let path = entry?.path();
        if path.extension().is_none_or(|e| e != "s") {
            continue;
        }
        let text = fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))?;
        fs::remove_file(&path)?;
        let mut caller = "";
        for line in text.lines() {
            // Labels of functions begin the line; local ones begin with a dot.
            if let Some((label, "")) = line.split_once(':')
                && !label.starts_with(['.', '\t', ' '])
            {
                caller = label;
            } else if let Some(word) = line.split_whitespace().skip(1).find(|w| w.contains(PANICS))
                && line.trim_start().starts_with('b')
                && !caller.contains(PANICS)
            {
                found.insert(format!("{caller} -> {word}"));
            }
        }
    }
    Ok(found)
}
