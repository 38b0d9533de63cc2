//! How many instructions the hot kernels take, held against the table in the repository (`tests/instructions/baseline.toml`).
//!
//! Times waver by ten per cent on a shared machine, so no check depends on them. Instructions do not waver: the same program
//! on the same input executes the same ones, however busy the machine, and a kernel that no longer vectorises shows at once. They
//! are no times either: a cache miss costs nothing here. `cargo bench` has the last word on speed, this on what changed.
//!
//! `tests/instructions` runs one kernel a process, under callgrind, which counts inside one function only. (gungraun would do the
//! same; its runner takes ten minutes to build.) What could still differ between machines is glibc's choice of `memcpy` by
//! processor, which is nothing beside a kernel; the core uses none of its mathematics.

mod table;

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use std::sync::Mutex;

use anyhow::{Context, Result, bail};

use crate::shell::{Cmd, ensure_debian, root};
use table::{Baseline, Count, Verdict, judge, percent};

/// The program, and the folder it lives in.
const PROGRAM: &str = "isobath-instructions";
/// The function inside which callgrind counts; the star is for paths and hashes of the name.
const COUNTED: &str = "--toggle-collect=*counted_part*";

/// `cargo xtask instructions`.
pub(crate) fn verb(args: Vec<String>) -> Result<()> {
    match args.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        [] => run(),
        ["--store"] => store(),
        [other, ..] => bail!("unexpected argument `{other}`; see `cargo xtask instructions --help`"),
    }
}

/// Counts and compares; what is slower by more than the tolerance, or in one list only, is an error.
pub(crate) fn run() -> Result<()> {
    let baseline = read_baseline()?;
    let counts = count_all()?;
    let compiler = Compiler::read()?;
    let names: BTreeSet<&str> =
        counts.iter().map(|c| c.name.as_str()).chain(baseline.kernels.keys().map(String::as_str)).collect();
    println!("\n{:<24} {:>12} {:>9} {:<9} {:>9}", "kernel", "instructions", "each", "", "change");
    let (mut bad, mut notes, mut slower) = (Vec::new(), Vec::new(), 0);
    for c in &counts {
        let stored = baseline.kernels.get(&c.name).copied();
        let change = stored.map_or_else(|| "new".into(), |stored| format!("{:+.2} %", percent(stored, c.instructions)));
        println!("{:<24} {:>12} {:>9.1} {:<9} {:>9}", c.name, c.instructions, c.each(), format!("/{}", c.unit), change);
    }
    println!();
    if baseline.target != compiler.target {
        println!("The stored counts are of {}, this is {}: not compared.", baseline.target, compiler.target);
        return Ok(());
    }
    let same_compiler = baseline.rustc == compiler.rustc;
    if !same_compiler {
        println!(
            "The stored counts are of rustc {}, this is {}. Another compiler makes other code of the same source, so what is slower \
             is a warning, no failure. Once the new compiler is the project's: cargo xtask instructions --store",
            baseline.rustc, compiler.rustc
        );
    }
    for name in names {
        let stored = baseline.kernels.get(name).copied();
        let now = counts.iter().find(|c| c.name == name).map(|c| c.instructions);
        let (verdict, text) = judge(name, stored, now, baseline.tolerance);
        match verdict {
            Verdict::Within => {}
            Verdict::Faster => notes.push(text),
            Verdict::Slower if !same_compiler => {
                slower += 1;
                notes.push(format!("warning: {text}"));
            }
            Verdict::Slower | Verdict::Unlisted | Verdict::Gone => bad.push(text),
        }
    }
    notes.iter().for_each(|note| println!("{note}"));
    if bad.is_empty() {
        println!("{} kernels, {slower} of them more than {} % above what is stored", counts.len(), baseline.tolerance);
        return Ok(());
    }
    bail!("{}", bad.join("\n"))
}

/// Counts, and writes the table anew; only the tolerance stays.
fn store() -> Result<()> {
    let tolerance = read_baseline().map_or(table::TOLERANCE, |b| b.tolerance);
    let counts = count_all()?;
    let Compiler { rustc, target } = Compiler::read()?;
    fs::write(baseline_path(), table::write(&counts, tolerance, &rustc, &target))?;
    println!("wrote {}: {} kernels; `git diff` shows what moved", baseline_path().display(), counts.len());
    Ok(())
}

fn baseline_path() -> PathBuf {
    root().join("tests/instructions/baseline.toml")
}

fn read_baseline() -> Result<Baseline> {
    let path = baseline_path();
    let text = fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))?;
    Baseline::parse(&text).with_context(|| format!("{}: mend it, or write it anew with --store", path.display()))
}

/// What the counts depend on besides the source.
struct Compiler {
    rustc: String,
    target: String,
}

impl Compiler {
    fn read() -> Result<Self> {
        let (_, text, _) = Cmd::new("rustc").args(["-vV"]).read()?;
        let value = |key: &str| text.lines().find_map(|l| l.strip_prefix(key)).map(str::trim).map(String::from);
        // The first line has version, commit and date: nightlies differ in the last two only.
        let rustc = value("rustc ").context("`rustc -vV` does not tell its version")?;
        Ok(Self { rustc, target: value("host: ").context("`rustc -vV` does not tell its host")? })
    }
}

/// Builds the program and counts every kernel it has, as many at a time as there are cores.
fn count_all() -> Result<Vec<Count>> {
    ensure_debian("valgrind", "valgrind", "counting instructions")?;
    let build = ["build", "--profile", "counted", "-p", PROGRAM, "--target-dir", "target"];
    // Flags of one's own (`-C target-cpu=native`) would count another program.
    Cmd::new("cargo").args(build).env("RUSTFLAGS", "").run()?;
    let (ok, list, errors) = Cmd::new(&program()).read()?;
    if !ok {
        bail!("the list of kernels: {errors}");
    }
    let waiting: Vec<Count> = list
        .lines()
        .map(|l| Count::parse(l).with_context(|| format!("a kernel's line: `{l}`")))
        .collect::<Result<_>>()?;
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    let (waiting, done) = (Mutex::new(waiting.into_iter().enumerate()), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                while let Some((place, kernel)) = next(&waiting) {
                    let counted = count(&kernel.name).map(|instructions| Count { instructions, ..kernel });
                    lock(&done).push((place, counted));
                }
            });
        }
    });
    let mut done = std::mem::take(&mut *lock(&done));
    done.sort_by_key(|(place, _)| *place);
    done.into_iter().map(|(_, counted)| counted).collect()
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn next<T>(waiting: &Mutex<impl Iterator<Item = T>>) -> Option<T> {
    lock(waiting).next()
}

fn program() -> String {
    root().join("target/counted").join(PROGRAM).to_string_lossy().into_owned()
}

/// Instructions of one kernel.
fn count(kernel: &str) -> Result<u64> {
    let folder = root().join("target/instructions");
    fs::create_dir_all(&folder)?;
    let file = folder.join(format!("{kernel}.callgrind"));
    let out = format!("--callgrind-out-file={}", file.display());
    let valgrind = Cmd::new("valgrind").args(["--tool=callgrind", "--collect-atstart=no", COUNTED, &out]);
    let (ok, _, errors) = valgrind.args([&program(), kernel]).read()?;
    if !ok {
        bail!("{kernel} under valgrind failed:\n{errors}");
    }
    let text = fs::read_to_string(&file).with_context(|| format!("reading {}", file.display()))?;
    match table::total(&text) {
        Some(0) | None => bail!("{kernel}: {} counts nothing; is `counted_part` still a function?", file.display()),
        Some(instructions) => Ok(instructions),
    }
}
