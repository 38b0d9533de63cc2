//! The bench: run time **and** error of everything isobath answers, side by side.
//!
//! A claim of speed that does not say what it costs in error is no claim. Here each capability is one [`Row`](row::Row): methods x
//! knobs, measured on the same simulated frames with known truth, over scenes, sensors and resolutions, alternating in one
//! process. Of each comparison the Pareto front is marked: the methods that no other beats in both time and error.
//!
//! ```text
//! rows (what is compared) x input (scene, sensor, size) -> measure (alternating) -> Report -> terminal | CSV | JSON | HTML
//! ```
//!
//! | module | idea |
//! |---|---|
//! | [`row`] | the vocabulary: what a row, a method, a score is |
//! | [`input`] | a simulated frame, what a sensor makes of it, and the truth |
//! | [`inertial`] | readings of inertial sensors with the true orientation |
//! | `rows` | one file a capability; `rows/mod.rs` lists them |
//! | `skips` | features that skip: how much, how much faster, and that the answer is the same |
//! | [`sequence`] | frames in a row, still, slowly and fully changing; `recordings`: real ones |
//! | `measure` | timing, alternating; [`pareto`] who is beaten by nobody |
//! | [`peers`] | other libraries, in processes of their own; [`compare`] who beats whom |
//! | [`report`] | what came out, and its four forms |
//! | [`lighting`] | environment maps against the truth: an evaluation of its own, with its own tables |
//!
//! # A new row
//! A function that lists methods for an input, and a [`Row`](row::Row) that names the units; the row goes into `rows::ALL`:
//!
//! ```
//! use isobath_bench::input::{Input, Sensor};
//! use isobath_bench::row::{Measure, Method, Row, Score};
//!
//! pub const MEAN_DEPTH: Row = Row {
//!     name: "mean-depth",
//!     title: "Mean depth of a frame",
//!     unit: "pixel",
//!     errors: &[Measure { unit: "mm", name: "off", what: "distance from the mean of the exact depth", shown: true }],
//!     sensors: &[Sensor::Exact, Sensor::Kinect],
//!     scenes: &[],
//!     methods: |input| {
//!         let mean = move || input.metres().sum::<f64>() / input.pixels() as f64;
//!         let truth = input.truth.z.iter().sum::<f64>() / input.pixels() as f64;
//!         vec![Method::new("sum", input.pixels(), move || { mean(); }, move || Score::of([(mean() - truth).abs() * 1e3]))]
//!     },
//!     answers: None,
//! };
//! let input = Input::new("wall", Sensor::Exact, (16, 12), 0)?;
//! assert_eq!((MEAN_DEPTH.methods)(&input)[0].score().errors[0], 0.0);
//! # Ok::<(), isobath_bench::BenchError>(())
//! ```

pub mod compare;
pub mod inertial;
pub mod input;
pub mod lighting;
mod measure;
pub mod pareto;
pub mod peers;
mod recordings;
pub mod report;
pub mod row;
mod rows;
pub mod sequence;
mod skips;

use std::path::PathBuf;
use std::time::Duration;

use input::Input;
use measure::Effort;
use report::{Report, Result as Found};
pub use rows::ALL;

/// What can go wrong.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// A scene can't be simulated.
    #[error(transparent)]
    Sim(#[from] isobath_sim::SimError),
    /// The simulator's camera is none to the core.
    #[error("the simulated camera is not usable: {0}")]
    Camera(#[from] isobath::sensing::camera::intrinsics::IntrinsicsError),
    /// No row's name contains the filter.
    #[error("nothing is called {filter:?}; there are {}", names().join(", "))]
    NothingSelected {
        /// What was asked for.
        filter: String,
    },
    /// There are no other libraries to compare with.
    #[error(transparent)]
    Peers(#[from] peers::PeersError),
    /// The core refused what it was given.
    #[error("the core refused: {0}")]
    Core(String),
    /// A report can't be written.
    #[error("can't write {path}: {error}")]
    Write {
        /// Where.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
}

impl BenchError {
    fn core(error: impl std::fmt::Display) -> Self {
        Self::Core(error.to_string())
    }
}

/// What to measure.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Only rows whose name contains one of these; all when empty. `skipping` names the skipping table.
    pub filter: Vec<String>,
    /// Three scenes, one small size, few repetitions: under a minute.
    pub quick: bool,
    /// Sizes in place of the usual ones.
    pub sizes: Vec<(usize, usize)>,
    /// Of noise and of the questions asked.
    pub seed: u64,
    /// The folder that `cargo xtask peers` made: other libraries are measured beside isobath.
    pub peers: Option<PathBuf>,
}

impl Default for Options {
    fn default() -> Self {
        Self { filter: Vec::new(), quick: false, sizes: Vec::new(), seed: 1, peers: None }
    }
}

const SCENES: &[&str] = &["wall", "tilted", "sphere", "corner", "stairs", "desk", "living-room", "corridor"];
/// Scenes of the 3F2N benchmark's kind, for rows that name them.
const FACETS: &[&str] = &["facets-easy", "facets-medium", "facets-hard"];
const QUICK_SCENES: &[&str] = &["sphere", "corner", "living-room"];
/// Frames of a sequence: half a second; a fifth.
const FRAMES: usize = 15;
const QUICK_FRAMES: usize = 6;
const SKIPPING: &str = "skipping";

/// What can be filtered for.
#[must_use]
pub fn names() -> Vec<&'static str> {
    ALL.iter().map(|r| r.name).chain([SKIPPING]).collect()
}

/// Measures; `tell` hears what is being done.
///
/// # Errors
/// [`BenchError`]: nothing selected, or a scene that can't be simulated.
pub fn run(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Report, BenchError> {
    let wanted = |name: &str| options.filter.is_empty() || options.filter.iter().any(|f| name.contains(f.as_str()));
    if let Some(filter) = options.filter.iter().find(|f| !names().iter().any(|n| n.contains(f.as_str()))) {
        return Err(BenchError::NothingSelected { filter: filter.clone() });
    }
    let effort = if options.quick {
        Effort { rounds: 3, batch: Duration::from_micros(500), longest: Duration::from_millis(150) }
    } else {
        Effort { rounds: 9, batch: Duration::from_millis(2), longest: Duration::from_secs(1) }
    };
    let sizes: &[(usize, usize)] = match options.sizes.as_slice() {
        [] if options.quick => &[(320, 240)],
        [] => &[(160, 120), (640, 480)],
        sizes => sizes,
    };
    let scenes = if options.quick { QUICK_SCENES } else { SCENES };
    let peers = options.peers.as_deref().map(|folder| {
        tell("starting the other libraries");
        peers::Peers::start(folder)
    });
    let peers = peers.transpose()?;
    let mut report = Report {
        seed: options.seed,
        quick: options.quick,
        results: Vec::new(),
        skips: Vec::new(),
        notes: Vec::new(),
        peers: None,
    };
    for &size in sizes {
        for &scene in scenes.iter().chain(if options.quick { &[] } else { FACETS }) {
            let skipping = wanted(SKIPPING) && scenes.contains(&scene);
            if !(skipping || ALL.iter().any(|r| wanted(r.name) && r.takes(scene))) {
                continue;
            }
            let mut base = Input::new(scene, input::Sensor::Exact, size, options.seed)?;
            base.keep = peers.is_some();
            for &sensor in input::Sensor::ALL {
                let input = base.sensed_by(sensor);
                if let Some(peers) = &peers {
                    peers.load(&input);
                }
                for row in ALL.iter().filter(|r| wanted(r.name) && r.sensors.contains(&sensor) && r.takes(scene)) {
                    tell(&format!("{}: {scene}, {}, {}x{}", row.name, sensor.label(), size.0, size.1));
                    let mut methods = (row.methods)(&input);
                    methods.extend(peers.iter().flat_map(|p| p.methods(row, &input)));
                    let times = measure::alternating(&mut methods, &effort);
                    // Who could not run has no time, and is in the report's list of troubles.
                    for (method, time) in methods.iter_mut().zip(times).filter(|(_, t)| !t.best.is_nan()) {
                        let score = method.score();
                        let (name, peer) = (method.name().to_owned(), method.peer().map(str::to_owned));
                        report.results.push(Found { row, scene, sensor, size, method: name, peer, time, score });
                    }
                }
            }
            if skipping {
                tell(&format!("skipping: {scene}, {}x{}", size.0, size.1));
                report.skips.extend(skips::pyramid::simulated(&base.sensed_by(input::Sensor::Millimetres), &effort));
            }
        }
    }
    if wanted(SKIPPING) {
        let frames = if options.quick { QUICK_FRAMES } else { FRAMES };
        sequences(options, sizes, frames, &effort, &mut report, tell)?;
    }
    report.peers = peers.map(|p| p.beside());
    Ok(report)
}

/// What skips from one frame to the next, and recordings.
fn sequences(
    options: &Options,
    sizes: &[(usize, usize)],
    frames: usize,
    effort: &Effort,
    report: &mut Report,
    tell: &mut dyn FnMut(&str),
) -> Result<(), BenchError> {
    let (recorded, missed) = recordings::sequences(frames);
    report.notes.extend(missed);
    for sequence in &recorded {
        tell(&format!("skipping: {}", sequence.name));
        report.skips.extend(skips::pyramid::recorded(sequence, options.seed, effort));
        report.skips.push(skips::tiles::normals(sequence, effort));
    }
    for &size in sizes {
        tell(&format!("skipping: simulating sequences, {}x{}", size.0, size.1));
        for sequence in sequence::simulated(size, frames, options.seed)? {
            tell(&format!("skipping: {}, {}, {}", sequence.name, sequence.kind.label(), sequence.sensor));
            report.skips.push(skips::tiles::normals(&sequence, effort));
        }
    }
    Ok(())
}
