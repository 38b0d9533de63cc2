//! Links the proof image (`tests/firmware/proof`) for each bare-metal target: it has no allocator, so that it links proves
//! that nothing in the core's tree wants one. A proof that can't fail proves nothing, so the same image with an
//! `extern crate alloc` must not link.

use std::collections::BTreeMap;
use std::fs;

use anyhow::{Context, Result, bail};

use crate::shell::{Cmd, ensure_target, root};

/// The targets without an operating system that the core is held to.
pub(crate) const BARE_METAL: &[&str] = &["thumbv7em-none-eabihf", "aarch64-unknown-none"];

/// The proof's own workspace.
pub(crate) const MANIFEST: &str = "tests/firmware/proof/Cargo.toml";

/// `cargo xtask proof`.
pub(crate) fn run() -> Result<()> {
    let build =
        |target: &str| Cmd::new("cargo").args(["build", "--release", "--manifest-path", MANIFEST, "--target", target]);
    let mut lines = Vec::new();
    for target in BARE_METAL {
        ensure_target(target, "linking the proof image")?;
        build(target).run()?;
        let path = root().join("tests/firmware/proof/target").join(target).join("release/isobath-proof");
        let bytes = fs::read(&path).with_context(|| format!("reading {}", path.display()))?;
        let image =
            Elf::parse(&bytes).with_context(|| format!("{} is not an ELF file that we can read", path.display()))?;
        let (text, data, bss) = image.sizes();
        lines.push(format!("{target:<24} text {text:>8}  data {data:>6}  bss {bss:>8}"));
        let panics = image.symbols_with("core9panicking");
        lines.push(match panics.as_slice() {
            [] => "    no panic symbols".to_owned(),
            some => format!("    {} panic symbols: {}", some.len(), some.join(" ")),
        });
        if let Some(alloc) = image.symbols_with("__rust_alloc").first() {
            bail!("{target}: the image holds the allocator symbol {alloc}");
        }
    }
    println!("negative control: the image with `extern crate alloc` must not link");
    let (linked, _, errors) = build(BARE_METAL[0]).args(["--features", "with-alloc"]).read()?;
    if linked || !errors.contains("no global memory allocator found") {
        bail!("the negative control did not fail as it must:\n{errors}");
    }
    println!("it does not: no global memory allocator found\n\n{}", lines.join("\n"));
    Ok(())
}

/// What we need of a little-endian ELF file, 32 or 64 bits: section sizes and symbol names.
struct Elf<'a> {
    bytes: &'a [u8],
    sections: Vec<Section>,
    wide: bool,
}

struct Section {
    kind: u64,
    flags: u64,
    offset: usize,
    size: usize,
    link: usize,
}

/// Section types and flags of the ELF specification.
const SYMBOL_TABLE: u64 = 2;
const NO_BITS: u64 = 8;
const WRITE: u64 = 1;
const ALLOC: u64 = 2;

impl<'a> Elf<'a> {
    fn parse(bytes: &'a [u8]) -> Option<Self> {
        if bytes.get(..4)? != b"\x7fELF" || *bytes.get(5)? != 1 {
            return None;
        }
        let wide = *bytes.get(4)? == 2;
        let n = |at: usize, len: usize| number(bytes, at, len);
        let (table, entry, count) =
            if wide { (n(0x28, 8)?, n(0x3a, 2)?, n(0x3c, 2)?) } else { (n(0x20, 4)?, n(0x2e, 2)?, n(0x30, 2)?) };
        let sections = (0..count).map(|i| {
            let at = (table + i * entry) as usize;
            // Field offsets in Elf64_Shdr and Elf32_Shdr.
            let [flags, offset, size, link] = if wide { [0x08, 0x18, 0x20, 0x28] } else { [0x08, 0x10, 0x14, 0x18] };
            let word = if wide { 8 } else { 4 };
            Some(Section {
                kind: n(at + 4, 4)?,
                flags: n(at + flags, word)?,
                offset: n(at + offset, word)? as usize,
                size: n(at + size, word)? as usize,
                link: n(at + link, 4)? as usize,
            })
        });
        Some(Self { bytes, sections: sections.collect::<Option<_>>()?, wide })
    }

    /// Bytes of code and constants, of initialised data, and of zeroed data.
    fn sizes(&self) -> (usize, usize, usize) {
        let mut sizes = (0, 0, 0);
        for s in self.sections.iter().filter(|s| s.flags & ALLOC != 0) {
            match (s.kind == NO_BITS, s.flags & WRITE != 0) {
                (true, _) => sizes.2 += s.size,
                (false, true) => sizes.1 += s.size,
                (false, false) => sizes.0 += s.size,
            }
        }
        sizes
    }

    /// Names of symbols that contain `part`, each once.
    fn symbols_with(&self, part: &str) -> Vec<String> {
        let mut found = BTreeMap::new();
        let entry = if self.wide { 24 } else { 16 };
        for table in self.sections.iter().filter(|s| s.kind == SYMBOL_TABLE) {
            let Some(names) = self.sections.get(table.link) else { continue };
            for i in 0..table.size / entry {
                let Some(name) = number(self.bytes, table.offset + i * entry, 4) else { continue };
                let rest = self.bytes.get(names.offset + name as usize..).unwrap_or(&[]);
                let name = rest.split(|b| *b == 0).next().map(String::from_utf8_lossy).unwrap_or_default();
                if name.contains(part) {
                    found.insert(name.into_owned(), ());
                }
            }
        }
        found.into_keys().collect()
    }
}

fn number(bytes: &[u8], at: usize, len: usize) -> Option<u64> {
    Some(bytes.get(at..at + len)?.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)))
}
