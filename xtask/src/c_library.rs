//! The static library for C programs (`core-nostd/capi`): how it is made, and what is held of it.
//!
//! The crate is an ordinary Rust library in the workspace. The static one needs a panic handler, which only it may bring, and
//! `panic = "abort"`, since nothing may unwind into C: hence a profile, a feature and a crate type on the command line.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};

use crate::elf::Elf;
use crate::proof::{BARE_METAL, PANICS};
use crate::shell::{Cmd, ensure_debian, ensure_target, root};

/// `cargo xtask c-library`.
pub(crate) fn verb(args: Vec<String>) -> Result<()> {
    let target = match args.as_slice() {
        [] => None,
        [target] => Some(target.as_str()),
        [_, extra, ..] => bail!("unexpected argument `{extra}`"),
    };
    let path = build(target, "c-library")?;
    let bytes = fs::read(&path).with_context(|| format!("reading {}", path.display()))?;
    let code = members(&bytes)?
        .iter()
        .filter(|(name, _)| name.contains("isobath"))
        .fold(0, |sum, (_, member)| sum + Elf::parse(member).map_or(0, |elf| elf.sizes().0));
    println!("{}: {} bytes, of which isobath's code and constants {code}", path.display(), bytes.len());
    Ok(())
}

/// `cargo xtask header`.
pub(crate) fn header() -> Result<()> {
    Cmd::new("cargo").args(["test", "-p", "isobath-capi", "--test", "header"]).env("ISOBATH_WRITE_HEADER", "1").run()
}

/// The suite `c-interface`.
pub(crate) fn check() -> Result<()> {
    let mut lines = Vec::new();
    for target in BARE_METAL {
        ensure_target(target, "building the C library for devices")?;
        let panics = panics(&build(Some(target), "c-library")?)?;
        if !panics.is_empty() {
            bail!("{target}: the C library can panic: {}", panics.join(" "));
        }
        lines.push(format!("{target:<24} {}", link(target)?));
    }
    let host = panics(&build(None, "c-library")?)?;
    if !host.is_empty() {
        bail!("this machine's C library can panic: {}", host.join(" "));
    }
    println!("negative control: the library with overflow checks must show a panic symbol");
    let shown = panics(&build(Some(BARE_METAL[0]), "dev")?)?;
    let [first, ..] = shown.as_slice() else {
        bail!("the negative control shows none: the search for panic symbols finds nothing");
    };
    println!("it does: {first}");
    ensure_debian("gcc", "gcc", "C programs against the static library")?;
    let test = ["test", "-p", "isobath-capi", "--test", "c_program", "--test", "header"];
    Cmd::new("cargo").args(test).env("ISOBATH_SANITIZE", "1").env("CC", "gcc").run()?;
    println!("{}", lines.join("\n"));
    Ok(())
}

/// Makes the library; where it is.
fn build(target: Option<&str>, profile: &str) -> Result<PathBuf> {
    let args = ["rustc", "-p", "isobath-capi", "--features", "panic-handler", "--crate-type", "staticlib", "--profile"];
    let cargo = Cmd::new("cargo").args(args).arg(profile);
    cargo.args(target.iter().flat_map(|t| ["--target", t])).run()?;
    let folder = root().join("target").join(target.unwrap_or_default());
    Ok(folder.join(if profile == "dev" { "debug" } else { profile }).join("libisobath_capi.a"))
}

/// Panic symbols anywhere in the library, referred to or defined.
fn panics(library: &std::path::Path) -> Result<Vec<String>> {
    let bytes = fs::read(library).with_context(|| format!("reading {}", library.display()))?;
    let members = members(&bytes)?;
    let elves: Vec<_> = members.iter().filter_map(|(_, member)| Elf::parse(member)).collect();
    if elves.is_empty() {
        bail!("{} holds no object file that we can read", library.display());
    }
    Ok(elves.iter().flat_map(|elf| elf.symbols_with(PANICS)).collect())
}

/// Links everything the library exports, and nothing but the library, with the linker that rustc brings: that it links shows that
/// a C program need bring nothing. Its sizes.
fn link(target: &str) -> Result<String> {
    let folder = root().join("target").join(target).join("c-library");
    let (library, image) = (folder.join("libisobath_capi.a"), folder.join("everything.elf"));
    let bytes = fs::read(&library)?;
    let mut names = Vec::new();
    for (_, member) in members(&bytes)? {
        let found = Elf::parse(member).map(|elf| elf.symbols_with("isobath_")).unwrap_or_default();
        names.extend(found.into_iter().filter(|name| name.starts_with("isobath_") && !name.contains('.')));
    }
    let (_, about, _) = Cmd::new("rustc").args(["-vV"]).read()?;
    let host = about.lines().find_map(|l| l.strip_prefix("host: ")).context("rustc names its host")?;
    let (_, sysroot, _) = Cmd::new("rustc").args(["--print", "sysroot"]).read()?;
    let lld = PathBuf::from(sysroot.trim()).join("lib/rustlib").join(host).join("bin/rust-lld");
    let entry = names.first().context("the library exports nothing")?;
    Cmd::new(lld.to_str().context("the toolchain's path is text")?)
        .args(["-flavor", "gnu", "--gc-sections", "--no-undefined", "-e", entry])
        .args(names.iter().flat_map(|name| ["-u", name]))
        .arg(&library)
        .arg("-o")
        .arg(&image)
        .run()?;
    let bytes = fs::read(&image)?;
    let (text, data, bss) = Elf::parse(&bytes).context("the linked image is no ELF file that we can read")?.sizes();
    Ok(format!("{:>2} functions, text {text:>6}  data {data:>4}  bss {bss:>4}", names.len()))
}

/// Names and contents of an archive's members (the format of System V and GNU).
fn members(archive: &[u8]) -> Result<Vec<(String, &[u8])>> {
    const HEADER: usize = 60;
    let mut rest = archive.strip_prefix(b"!<arch>\n").context("not an archive")?;
    let mut found = Vec::new();
    let mut long_names: &[u8] = &[];
    while rest.len() >= HEADER {
        let (header, after) = rest.split_at(HEADER);
        let text = |range: std::ops::Range<usize>| String::from_utf8_lossy(&header[range]).trim().to_owned();
        let size: usize = text(48..58).parse().context("the size of an archive's member")?;
        let member = after.get(..size).context("an archive that ends within a member")?;
        let name = text(0..16);
        match name.as_str() {
            "//" => long_names = member,
            "/" | "/SYM64/" => {}
            short => {
                let long = short.strip_prefix('/').and_then(|at| long_names.get(at.parse::<usize>().ok()?..));
                let long = long.and_then(|n| n.split(|b| *b == b'/').next());
                let name = long.map_or(short.into(), |n| String::from_utf8_lossy(n));
                found.push((name.into_owned(), member));
            }
        }
        // Members begin at even offsets.
        rest = after.get(size + size % 2..).unwrap_or(&[]);
    }
    Ok(found)
}
