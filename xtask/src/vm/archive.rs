//! The guest's file system: a cpio archive of the "newc" form, which the kernel unpacks into memory at boot.
//!
//! A file is a header of fourteen numbers in hexadecimal text, its name, its bytes, each padded to four bytes; an entry called
//! `TRAILER!!!` ends the archive. The kernel takes several archives one after the other, so that what is the same in every boot (modules,
//! busybox) is written once. Source: Documentation/driver-api/early-userspace/buffer-format.rst of Linux.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

/// An archive in the making.
#[derive(Debug, Default)]
pub(super) struct Archive {
    bytes: Vec<u8>,
    folders: BTreeSet<String>,
    files: BTreeSet<String>,
}

/// File types and permissions, as `stat` has them.
const FOLDER: u32 = 0o040_755;
const PROGRAM: u32 = 0o100_755;

impl Archive {
    /// An empty folder, and those it is in.
    pub(super) fn folder(&mut self, path: &str) {
        for (end, _) in path.match_indices('/').chain([(path.len(), "")]).filter(|(end, _)| *end > 0) {
            if self.folders.insert(path[..end].to_owned()) {
                self.entry(&path[..end], FOLDER, &[]);
            }
        }
    }

    /// A file that may be run. `path` has no leading slash. The second file of a name is left out.
    pub(super) fn file(&mut self, path: &str, content: &[u8]) {
        if self.files.insert(path.to_owned()) {
            if let Some((folder, _)) = path.rsplit_once('/') {
                self.folder(folder);
            }
            self.entry(path, PROGRAM, content);
        }
    }

    /// A file of this machine.
    pub(super) fn copy(&mut self, from: &Path, to: &str) -> Result<()> {
        let content = fs::read(from).with_context(|| format!("reading {}", from.display()))?;
        self.file(to, &content);
        Ok(())
    }

    /// The archive's bytes.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.entry("TRAILER!!!", 0, &[]);
        self.bytes
    }

    fn entry(&mut self, name: &str, mode: u32, content: &[u8]) {
        self.bytes.extend(b"070701");
        let length = u32::try_from(content.len()).expect("no file of the guest has 4 GiB");
        let inode = u32::try_from(self.folders.len() + self.files.len()).unwrap_or(0);
        let links = if mode == FOLDER { 2 } else { 1 };
        let name_length = name.len() as u32 + 1;
        // Inode, mode, user, group, links, time, size, device of the file system (two), device (two), name, checksum.
        for field in [inode, mode, 0, 0, links, 0, length, 0, 0, 0, 0, name_length, 0] {
            self.bytes.extend(format!("{field:08x}").bytes());
        }
        self.bytes.extend(name.bytes().chain([0]));
        self.pad();
        self.bytes.extend(content);
        self.pad();
    }

    fn pad(&mut self) {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_aligned_and_folders_come_first_and_once() {
        let mut archive = Archive::default();
        archive.file("a/b/c", b"hello");
        archive.file("a/b/d", b"");
        archive.file("a/b/d", b"again");
        let bytes = archive.finish();
        assert_eq!(bytes.len() % 4, 0);
        let text = String::from_utf8_lossy(&bytes);
        let at: Vec<usize> = text.match_indices("070701").map(|(at, _)| at).collect();
        let name = |at: usize| text[at + 110..].split('\0').next().unwrap_or("");
        assert_eq!(at.iter().map(|&at| name(at)).collect::<Vec<_>>(), ["a", "a/b", "a/b/c", "a/b/d", "TRAILER!!!"]);
        assert!(at.iter().all(|at| at % 4 == 0));
        assert_eq!(&text[at[2] + 54..at[2] + 62], "00000005", "the size is the seventh field");
    }
}
