//! What `check` and `test` run, as a table.

use std::time::Instant;

use anyhow::{Context, Result, bail};

use crate::proof::BARE_METAL;
use crate::shell::{Cmd, Missing, ensure_component, ensure_target};
use crate::{c_library, firmware, fuzz, instructions, proof, vm};

/// One row of the table: a name to pick it by, whether the quick loop has it, what it does, and how.
struct Suite {
    name: &'static str,
    quick: bool,
    what: &'static str,
    run: fn(&Options) -> Result<()>,
}

struct Options {
    only: Vec<String>,
    allow_missing: bool,
    smoke_seconds: u32,
}

const SUITES: &[Suite] = &[
    Suite {
        name: "fmt",
        quick: true,
        what: "every file is as rustfmt writes it",
        run: |_| {
            ensure_component("rustfmt", &["fmt", "--version"], "the format check")?;
            Cmd::new("cargo").args(["fmt", "--all", "--check"]).run()?;
            for manifest in ["fuzz/Cargo.toml", proof::MANIFEST] {
                Cmd::new("cargo").args(["fmt", "--all", "--check", "--manifest-path", manifest]).run()?;
            }
            Ok(())
        },
    },
    Suite {
        name: "clippy",
        quick: true,
        what: "clippy over everything, firmware images included, warnings as errors",
        run: |_| {
            ensure_component("clippy", &["clippy", "--version"], "the lints")?;
            Cmd::new("cargo").args(["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"]).run()?;
            // The one place with libusb in it, which nothing else here builds.
            let usb = ["clippy", "-p", "isobath-usb", "--features", "live", "--all-targets", "--", "-D", "warnings"];
            Cmd::new("cargo").args(usb).run()?;
            // The firmware images are a workspace of their own; only one of them is for another target than the rest. `--release`:
            // what their build script makes is made already.
            for (target, packages) in [
                (BARE_METAL[0], ["--workspace", "--exclude", CORTEX_A]),
                (BARE_METAL[1], ["--package", CORTEX_A, "--no-deps"]),
            ] {
                ensure_target(target, "the lints of the firmware images")?;
                let args = ["clippy", "--release", "--manifest-path", proof::MANIFEST, "--target", target];
                Cmd::new("cargo").args(args).args(packages).args(["--", "-D", "warnings"]).run()?;
            }
            Ok(())
        },
    },
    Suite {
        name: "tests",
        quick: true,
        what: "unit, integration and documentation tests; seed corpora replayed",
        run: |_| repeatable(Cmd::new("cargo").args(["test", "--workspace", "--no-fail-fast"])).run(),
    },
    Suite {
        name: "numerics",
        quick: false,
        what: "the f64-oracle tests again on optimised code, where vectorised and fused arithmetic differ",
        run: |_| {
            let args = ["test", "--release", "-p", "isobath", "-p", "isobath-tests", "--lib", "--tests"];
            repeatable(Cmd::new("cargo").args(args)).run()
        },
    },
    Suite { name: "docs", quick: false, what: "documentation builds without a broken link", run: |_| docs().run() },
    Suite {
        name: "bare-metal",
        quick: false,
        what: "the core, and the sensors for microcontrollers, compile without an operating system",
        run: |_| {
            for target in BARE_METAL {
                ensure_target(target, "building the core for devices")?;
                let crates = ["-p", "isobath", "-p", "isobath-vl53", "--features", "isobath-vl53/vl53-8x8"];
                Cmd::new("cargo").args(["build", "--release"]).args(crates).args(["--target", target]).run()?;
            }
            Ok(())
        },
    },
    Suite {
        name: "proof",
        quick: false,
        what: "an image without an allocator links, holds no panic, and one with `alloc` does not link",
        run: |_| proof::run(),
    },
    Suite {
        name: "firmware",
        quick: false,
        what: "the per-frame job in QEMU: the host's answers, and instructions, stack and sizes as stored",
        run: |_| firmware::run(false),
    },
    Suite {
        name: "c-interface",
        quick: false,
        what: "the C library links for devices by itself, holds no panic; C programs under gcc's sanitizers",
        run: |_| c_library::check(),
    },
    Suite {
        name: "instructions",
        quick: false,
        what: "the hot kernels take no more instructions than the repository's table says",
        run: |_| instructions::run(),
    },
    Suite {
        name: "vm",
        quick: false,
        what: "the drivers on a real Linux kernel in QEMU: simulated cameras, faults, unplugging",
        run: |_| vm::run(),
    },
    Suite {
        name: "fuzz",
        quick: false,
        what: "every fuzz target runs for a while from its seeds",
        run: |options| fuzz::run(&[], options.smoke_seconds),
    },
];

/// The firmware image for 64-bit Arm.
const CORTEX_A: &str = "isobath-firmware-cortex-a";

/// Property tests draw the same cases every time here; `cargo test` by hand draws anew.
fn repeatable(cmd: Cmd) -> Cmd {
    cmd.env("PROPTEST_RNG_SEED", "1")
}

/// The documentation build.
pub(crate) fn docs() -> Cmd {
    Cmd::new("cargo").args(["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-D warnings")
}

/// `cargo xtask check`.
pub(crate) fn check(args: Vec<String>) -> Result<()> {
    crate::no_arguments(&args)?;
    run(SUITES.iter().filter(|s| s.quick), &Options { only: Vec::new(), allow_missing: false, smoke_seconds: 0 })
}

/// `cargo xtask test`.
pub(crate) fn test(args: Vec<String>) -> Result<()> {
    let mut options = Options { only: Vec::new(), allow_missing: false, smoke_seconds: 20 };
    let mut args = args.into_iter();
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--list" => {
                for s in SUITES {
                    println!("{:<12} {:<6} {}", s.name, if s.quick { "check" } else { "" }, s.what);
                }
                return Ok(());
            }
            "--only" => {
                let name = args.next().context("--only needs a suite")?;
                if !SUITES.iter().any(|s| s.name == name) {
                    bail!("no suite `{name}`; `cargo xtask test --list` names them");
                }
                options.only.push(name);
            }
            "--allow-missing" => options.allow_missing = true,
            "--smoke" => {
                options.smoke_seconds =
                    args.next().and_then(|n| n.parse().ok()).context("--smoke needs a number of seconds")?;
            }
            other => bail!("unexpected argument `{other}`; see `cargo xtask test --help`"),
        }
    }
    run(SUITES.iter().filter(|s| options.only.is_empty() || options.only.iter().any(|o| o == s.name)), &options)
}

enum Outcome {
    Passed,
    Failed(String),
    Missing(String),
}

fn run<'a>(suites: impl Iterator<Item = &'a Suite>, options: &Options) -> Result<()> {
    let mut rows = Vec::new();
    for suite in suites {
        println!("\n== {}: {}", suite.name, suite.what);
        let start = Instant::now();
        let outcome = match (suite.run)(options) {
            Ok(()) => Outcome::Passed,
            Err(error) if error.is::<Missing>() => Outcome::Missing(format!("{error:#}")),
            Err(error) => Outcome::Failed(format!("{error:#}")),
        };
        if let Outcome::Failed(why) | Outcome::Missing(why) = &outcome {
            println!("{}: {why}", suite.name);
        }
        rows.push((suite.name, outcome, start.elapsed().as_secs_f64()));
    }
    let (mut passed, mut failed, mut skipped) = (0, 0, 0);
    println!("\n{:<12} {:<8} {:>8}", "suite", "result", "seconds");
    for (name, outcome, seconds) in &rows {
        let (word, why) = match outcome {
            Outcome::Passed => {
                passed += 1;
                ("passed", "")
            }
            Outcome::Failed(why) => {
                failed += 1;
                ("FAILED", why.as_str())
            }
            Outcome::Missing(why) if options.allow_missing => {
                skipped += 1;
                ("skipped", why.as_str())
            }
            Outcome::Missing(why) => {
                failed += 1;
                ("MISSING", why.as_str())
            }
        };
        println!("{name:<12} {word:<8} {seconds:>8.1}  {why}");
    }
    println!("{passed} passed, {failed} failed, {skipped} skipped");
    if failed > 0 {
        let names = rows.iter().filter(|(_, o, _)| !matches!(o, Outcome::Passed)).map(|(n, ..)| *n);
        bail!("not passed: {}", names.collect::<Vec<_>>().join(", "));
    }
    Ok(())
}
