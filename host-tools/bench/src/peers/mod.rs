//! Other libraries beside isobath: the same frames, one thread each, taking turns with isobath's methods in one run.
//!
//! Each library lives in a worker process, in whatever language it has; `cargo xtask peers` makes them and leaves a list of their
//! commands. Here they are started, given each frame as a file, and their methods become [`Method`]s of the row they name, which
//! tell their own processor time. One that dies, hangs or talks rubbish is named in the report, and the others go on.
//!
//! | module | idea |
//! |---|---|
//! | `manifest` | which workers there are |
//! | `protocol` | what is said |
//! | `worker` | a process with a deadline |
//!
//! What the libraries get wrong, and how to add one: `host-tools/bench/peers/README.md`.

mod manifest;
mod protocol;
mod worker;

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use crate::input::{Depth, Input};
use crate::row::{Method, Row, Score};
use manifest::Manifest;
use protocol::{Answer, Kind, Offer, Request, one_thread};
use worker::{Worker, WorkerError};

/// Why there are no peers at all.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PeersError {
    /// The verb has not been run.
    #[error("no other libraries to compare with: {} is not there; make them with `cargo xtask peers`", .path.display())]
    NotMade {
        /// The list of workers.
        path: PathBuf,
    },
    /// The list can't be read.
    #[error("{}:{line} is not understood; make it anew with `cargo xtask peers`", .path.display())]
    Manifest {
        /// The list of workers.
        path: PathBuf,
        /// Which line.
        line: usize,
    },
    /// No folder for the frames.
    #[error("can't make {}: {error}; point TMPDIR to a folder that can be written", .path.display())]
    Scratch {
        /// The folder.
        path: PathBuf,
        /// Why not.
        error: std::io::Error,
    },
}

/// Who was asked, and what went wrong: for the report.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Beside {
    /// Libraries with their versions.
    pub libraries: Vec<String>,
    /// Libraries that could not be had, and why.
    pub missing: Vec<String>,
    /// What went wrong in the run; each once.
    pub troubles: Vec<String>,
}

/// An answer that takes longer than this never comes. Open3D's import from a cold disk takes half a minute.
const PATIENCE: Duration = Duration::from_secs(120);

/// The workers, started.
#[derive(Debug)]
pub(crate) struct Peers {
    workers: Vec<Peer>,
    beside: RefCell<Beside>,
    folder: Scratch,
}

#[derive(Debug)]
struct Peer {
    /// Name and version, as the report gives it.
    who: String,
    worker: RefCell<Worker>,
    offers: RefCell<Vec<Offer>>,
}

/// A folder for frames and answers, gone with its owner.
#[derive(Debug)]
struct Scratch(PathBuf);

impl Scratch {
    fn new() -> Result<Self, PeersError> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let n = NEXT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("isobath-peers-{}-{n}", std::process::id()));
        match std::fs::create_dir_all(&path) {
            Ok(()) => Ok(Self(path)),
            Err(error) => Err(PeersError::Scratch { path, error }),
        }
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // Left behind at worst: the system empties its folder for temporary files.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

impl Peers {
    /// Starts every worker that `cargo xtask peers` left in `folder`.
    pub(crate) fn start(folder: &Path) -> Result<Self, PeersError> {
        Self::of(Manifest::read(folder)?, PATIENCE)
    }

    fn of(manifest: Manifest, patience: Duration) -> Result<Self, PeersError> {
        let folder = Scratch::new()?;
        let mut beside = Beside { missing: manifest.missing, ..Beside::default() };
        let mut workers = Vec::new();
        for (name, command) in manifest.workers {
            let started = Worker::start(&name, &command, &folder.0, patience).and_then(|mut worker| {
                let who = worker.ask_for(&Request::Hello, |answer| match answer {
                    Answer::Peer { peer, version } => Some(format!("{peer} {version}")),
                    _ => None,
                })?;
                worker.name.clone_from(&who);
                Ok(Peer { who, worker: RefCell::new(worker), offers: RefCell::default() })
            });
            match started {
                Ok(peer) => {
                    beside.libraries.push(peer.who.clone());
                    workers.push(peer);
                }
                Err(error) => beside.troubles.push(error.to_string()),
            }
        }
        Ok(Self { workers, beside: RefCell::new(beside), folder })
    }

    /// Gives everybody a frame.
    pub(crate) fn load(&self, input: &Input) {
        let path = self.folder.0.join("frame.raw");
        let (kind, bytes): (Kind, Vec<u8>) = match &input.depth {
            Depth::U16(depth) => (Kind::Millimetres, depth.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Depth::F32(depth) => (Kind::Metres, depth.iter().flat_map(|v| v.to_le_bytes()).collect()),
        };
        let written = std::fs::write(&path, bytes);
        for peer in &self.workers {
            peer.offers.borrow_mut().clear();
            if let Err(error) = &written {
                self.trouble(&format!("can't write {}: {error}", path.display()));
                continue;
            }
            let request = Request::Frame { size: input.size(), kind, camera: &input.intrinsics, path: &path };
            let offers = peer.worker.borrow_mut().ask_for(&request, |answer| match answer {
                Answer::Methods { methods } => Some(methods),
                _ => None,
            });
            match offers {
                Ok(offers) => *peer.offers.borrow_mut() = offers,
                Err(error) => self.failed(&error),
            }
        }
    }

    /// Everybody's methods for a row, on the frame loaded last.
    pub(crate) fn methods<'a>(&'a self, row: &'static Row, input: &'a Input) -> Vec<Method<'a>> {
        let Some(score) = row.answers else { return Vec::new() };
        let mut methods = Vec::new();
        // A variant of a row asks the same question.
        let question = row.name.split('.').next().unwrap_or(row.name);
        for peer in &self.workers {
            for offer in peer.offers.borrow().iter().filter(|o| o.row == question) {
                let (id, again) = (offer.id.clone(), offer.id.clone());
                let run = move |repeats| self.time(peer, &id, repeats);
                let result =
                    move || self.answer(peer, &again, input).map_or_else(|| Score::none(row), |a| score(input, &a));
                methods.push(Method::told(offer.label.clone(), input.pixels(), peer.who.clone(), run, result));
            }
        }
        methods
    }

    /// Who was asked and what went wrong so far.
    pub(crate) fn beside(&self) -> Beside {
        self.beside.borrow().clone()
    }

    fn time(&self, peer: &Peer, method: &str, repeats: usize) -> Option<Duration> {
        let told = peer.worker.borrow_mut().ask_for(&Request::Run { method, repeats }, |answer| match answer {
            Answer::Time { cpu_ns, wall_ns } => Some((cpu_ns, wall_ns)),
            _ => None,
        });
        match told {
            Ok((cpu, wall)) => one_thread(cpu, wall).or_else(|| {
                self.trouble(&format!(
                    "{}: `{method}` ran on more than one core ({cpu} ns of processor time in {wall} ns); it does not count",
                    peer.who
                ));
                None
            }),
            Err(error) => {
                self.failed(&error);
                None
            }
        }
    }

    /// Three numbers a pixel.
    fn answer(&self, peer: &Peer, method: &str, input: &Input) -> Option<Vec<f32>> {
        let path = self.folder.0.join("result.raw");
        let written =
            peer.worker.borrow_mut().ask_for(&Request::Result { method, path: &path }, |answer| match answer {
                Answer::Written { written } => Some(written),
                _ => None,
            });
        if let Err(error) = written {
            self.failed(&error);
            return None;
        }
        let bytes = std::fs::read(&path).unwrap_or_default();
        // The next method's answer must not be this one's.
        let _ = std::fs::remove_file(&path);
        if bytes.len() != 12 * input.pixels() {
            self.trouble(&format!(
                "{}: `{method}` answered {} bytes for {} pixels of 12; worker and bench differ in age: run `cargo xtask peers` again",
                peer.who,
                bytes.len(),
                input.pixels()
            ));
            return None;
        }
        let (numbers, _) = bytes.as_chunks::<4>();
        Some(numbers.iter().map(|&b| f32::from_le_bytes(b)).collect())
    }

    fn failed(&self, error: &WorkerError) {
        // Its end was told when it ended.
        if !matches!(error, WorkerError::Gone { .. }) {
            self.trouble(&error.to_string());
        }
    }

    fn trouble(&self, text: &str) {
        let troubles = &mut self.beside.borrow_mut().troubles;
        if !troubles.iter().any(|t| t == text) {
            troubles.push(text.to_owned());
        }
    }
}

#[cfg(all(test, unix))]
pub(crate) mod tests {
    use super::*;
    use crate::input::Sensor;
    use crate::rows::ALL;

    pub(crate) struct Scratch(
        pub(crate) PathBuf,
        #[allow(dead_code, reason = "removes the folder in the end")] super::Scratch,
    );

    impl Scratch {
        pub(crate) fn new() -> Self {
            let scratch = super::Scratch::new().unwrap();
            Self(scratch.0.clone(), scratch)
        }
    }

    /// A worker in the shell.
    pub(crate) fn script(body: &str) -> Vec<String> {
        ["sh", "-c", body].map(str::to_owned).to_vec()
    }

    /// Answers every request rightly, but for what `run` and `result` say.
    fn fake(run: &str, result: &str) -> Vec<String> {
        script(&format!(
            r#"while read -r verb a b c; do case $verb in
                hello) echo '{{"peer": "Fake", "version": "1"}}';;
                frame) echo '{{"methods": [{{"row": "normals", "id": "m", "label": "Fake m"}}]}}';;
                run) {run};;
                result) {result};;
            esac; done"#
        ))
    }

    const GOOD_RUN: &str = r#"echo '{"cpu_ns": 76800, "wall_ns": 77000}'"#;
    /// 16 x 12 pixels of three zeros, which are no normals.
    const GOOD_RESULT: &str = r#"head -c 2304 /dev/zero > "$b"; echo '{"written": 576}'"#;

    fn peers(commands: Vec<Vec<String>>) -> Peers {
        let workers = commands.into_iter().enumerate().map(|(i, c)| (format!("fake{i}"), c)).collect();
        Peers::of(Manifest { workers, missing: vec!["none: none".into()] }, Duration::from_millis(1500)).unwrap()
    }

    fn input() -> Input {
        Input::new("wall", Sensor::Exact, (16, 12), 1).unwrap()
    }

    #[test]
    fn a_workers_method_is_timed_and_scored_with_ours() {
        let peers = peers(vec![fake(GOOD_RUN, GOOD_RESULT)]);
        let input = input();
        peers.load(&input);
        let mut methods = peers.methods(&ALL[0], &input);
        assert_eq!((methods.len(), methods[0].name(), methods[0].peer()), (1, "Fake m", Some("Fake 1")));
        assert_eq!(methods[0].spend(4, |_| Duration::ZERO), Some(Duration::from_nanos(76_800)));
        assert_eq!(methods[0].score().errors[2], 100.0, "zeros are no normals");
        assert_eq!(peers.methods(&ALL[1], &input).len(), 1, "a variant asks the same question");
        assert!(peers.methods(&ALL[2], &input).is_empty(), "nobody asks peers about single pixels");
        assert_eq!(peers.beside().troubles, [""; 0]);
    }

    #[test]
    fn the_others_go_on_when_one_fails() {
        for (run, result, word) in [
            ("exit 1", GOOD_RESULT, "ended while asked `run m`"),
            ("sleep 30", GOOD_RESULT, "no answer to `run m`"),
            ("echo what", GOOD_RESULT, "`what` is no answer"),
            (r#"echo '{"error": "too small"}'"#, GOOD_RESULT, "too small"),
            (r#"echo '{"cpu_ns": 9000000, "wall_ns": 1000}'"#, GOOD_RESULT, "more than one core"),
            (GOOD_RUN, r#"echo '{"written": 576}'"#, "answered 0 bytes"),
            (GOOD_RUN, "exit 1", "ended while asked `result m`"),
        ] {
            let peers = peers(vec![fake(run, result), fake(GOOD_RUN, GOOD_RESULT)]);
            let input = input();
            peers.load(&input);
            let mut methods = peers.methods(&ALL[0], &input);
            assert_eq!(methods.len(), 2);
            let times: Vec<_> = methods.iter_mut().map(|m| m.spend(1, |_| Duration::ZERO).is_some()).collect();
            let scores: Vec<_> = methods.iter_mut().map(|m| m.score().errors[2]).collect();
            assert!(times[1] && scores[1] == 100.0, "{word}");
            assert!(!times[0] || scores[0].is_nan(), "{word}");
            let troubles = peers.beside().troubles;
            assert!(troubles.len() == 1 && troubles[0].contains(word), "{word}: {troubles:?}");
            // A new frame: who has ended offers nothing, and is not complained about again.
            peers.load(&input);
            assert!(!peers.methods(&ALL[0], &input).is_empty());
            assert_eq!(peers.beside().troubles.len(), 1, "{word}");
        }
    }

    #[test]
    fn who_does_not_even_start_is_named() {
        let peers = peers(vec![vec!["/no/such/program".into()], script("exit 7"), fake(GOOD_RUN, GOOD_RESULT)]);
        let beside = peers.beside();
        assert_eq!(
            (beside.libraries.as_slice(), beside.missing.as_slice()),
            (&["Fake 1".to_owned()][..], &["none: none".to_owned()][..])
        );
        assert!(
            beside.troubles.len() == 2 && beside.troubles.iter().all(|t| t.contains("cargo xtask peers")),
            "{beside:?}"
        );
    }
}
