//! What `cargo xtask peers` left: a file `workers` with one worker or one gap a line, words with tabs between.
//!
//! ```text
//! worker<TAB>opencv<TAB>/path/to/python<TAB>/path/to/worker.py<TAB>opencv
//! missing<TAB>pcl<TAB>apt-get is not there
//! ```

use std::path::{Path, PathBuf};

use super::PeersError;

/// The file's name.
pub(super) const FILE: &str = "workers";

/// What can be started, and what can't.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Manifest {
    /// Name and command of each.
    pub(super) workers: Vec<(String, Vec<String>)>,
    /// In words.
    pub(super) missing: Vec<String>,
}

impl Manifest {
    pub(super) fn read(folder: &Path) -> Result<Self, PeersError> {
        let path = folder.join(FILE);
        let text = std::fs::read_to_string(&path).map_err(|_| PeersError::NotMade { path: path.clone() })?;
        Self::parse(&text, &path)
    }

    fn parse(text: &str, path: &Path) -> Result<Self, PeersError> {
        let mut manifest = Self::default();
        for (i, line) in text.lines().enumerate() {
            let words: Vec<&str> = line.split('\t').collect();
            match words.as_slice() {
                ["worker", name, command @ ..] if !command.is_empty() => {
                    let command = command.iter().map(|&w| w.to_owned()).collect();
                    manifest.workers.push(((*name).to_owned(), command));
                }
                ["missing", name, why] => manifest.missing.push(format!("{name}: {why}")),
                _ => return Err(PeersError::Manifest { path: PathBuf::from(path), line: i + 1 }),
            }
        }
        Ok(manifest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workers_and_gaps_are_read() {
        let text = "worker\topencv\t/a b/python\tworker.py\topencv\nmissing\tpcl\tno apt-get\n";
        let manifest = Manifest::parse(text, Path::new("workers")).unwrap();
        assert_eq!(
            manifest.workers,
            [("opencv".into(), vec!["/a b/python".into(), "worker.py".into(), "opencv".into()])]
        );
        assert_eq!(manifest.missing, ["pcl: no apt-get"]);
    }

    #[test]
    fn errors_say_where_and_what_to_do() {
        for bad in ["worker\topencv\n", "rubbish\n"] {
            let error = Manifest::parse(bad, Path::new("x/workers")).unwrap_err().to_string();
            assert!(error.contains("x/workers:1") && error.contains("cargo xtask peers"), "{error}");
        }
        let error = Manifest::read(Path::new("/nowhere")).unwrap_err().to_string();
        assert!(error.contains("cargo xtask peers"), "{error}");
    }
}
