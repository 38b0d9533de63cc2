//! As much of ELF as the checks of images need: sizes, symbols, stack sizes.

use std::collections::BTreeSet;

/// What we need of a little-endian ELF file, 32 or 64 bits: section sizes and symbol names.
pub(crate) struct Elf<'a> {
    bytes: &'a [u8],
    sections: Vec<Section>,
    wide: bool,
}

struct Section {
    name: usize,
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
    pub(crate) fn parse(bytes: &'a [u8]) -> Option<Self> {
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
                name: n(at, 4)? as usize,
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
    pub(crate) fn sizes(&self) -> (usize, usize, usize) {
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
    pub(crate) fn symbols_with(&self, part: &str) -> Vec<String> {
        let names = self.symbols().into_iter().map(|(_, name)| name).filter(|name| name.contains(part));
        names.collect::<BTreeSet<_>>().into_iter().collect()
    }

    /// Stack bytes of each function's own frame, as `-Z emit-stack-sizes` left them; the name is the linker's.
    pub(crate) fn stack_sizes(&self) -> Vec<(String, u64)> {
        let symbols = self.symbols();
        let mut found = Vec::new();
        for section in self.sections.iter().filter(|s| self.section_name(s) == ".stack_sizes") {
            let (mut at, end) = (section.offset, section.offset + section.size);
            while at < end {
                let word = if self.wide { 8 } else { 4 };
                let Some(address) = number(self.bytes, at, word) else { break };
                at += word;
                let Some(bytes) = self.uleb(&mut at) else { break };
                // Thumb functions have an odd address.
                let named = symbols.iter().find(|(place, _)| place & !1 == address & !1);
                found.push((named.map_or_else(|| format!("{address:#x}"), |(_, name)| name.clone()), bytes));
            }
        }
        found
    }

    fn uleb(&self, at: &mut usize) -> Option<u64> {
        let (mut value, mut shift) = (0, 0);
        loop {
            let byte = *self.bytes.get(*at)?;
            *at += 1;
            value |= u64::from(byte & 0x7f) << shift;
            shift += 7;
            if byte & 0x80 == 0 || shift > 56 {
                return Some(value);
            }
        }
    }

    fn text_at(&self, at: usize) -> String {
        let rest = self.bytes.get(at..).unwrap_or(&[]);
        rest.split(|b| *b == 0).next().map(String::from_utf8_lossy).unwrap_or_default().into_owned()
    }

    fn section_name(&self, section: &Section) -> String {
        // Field e_shstrndx.
        let index = number(self.bytes, if self.wide { 0x3e } else { 0x32 }, 2).unwrap_or(0) as usize;
        self.sections.get(index).map_or_else(String::new, |names| self.text_at(names.offset + section.name))
    }

    /// Address and name of every symbol.
    fn symbols(&self) -> Vec<(u64, String)> {
        let mut found = Vec::new();
        let (entry, value, word) = if self.wide { (24, 8, 8) } else { (16, 4, 4) };
        for table in self.sections.iter().filter(|s| s.kind == SYMBOL_TABLE) {
            let Some(names) = self.sections.get(table.link) else { continue };
            for at in (0..table.size / entry).map(|i| table.offset + i * entry) {
                if let (Some(name), Some(address)) = (number(self.bytes, at, 4), number(self.bytes, at + value, word)) {
                    found.push((address, self.text_at(names.offset + name as usize)));
                }
            }
        }
        found
    }
}

fn number(bytes: &[u8], at: usize, len: usize) -> Option<u64> {
    Some(bytes.get(at..at + len)?.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)))
}
