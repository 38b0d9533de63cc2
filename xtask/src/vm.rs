//! Runs the tests of `tests/vm` on a real Linux kernel, in QEMU, with cameras that they simulate themselves.
//!
//! [`kernel`] fetches Debian's kernel and picks modules; [`archive`] writes the guest's file system; [`boot`] runs one program in the guest.
//! Cargo is told that this program runs its test binaries (`cargo xtask vm --run BINARY ARGUMENTS`): one boot a file in
//! `tests/vm/tests`, and cargo's own report of what passed. `tests/vm/README.md` says how to use it.

mod archive;
mod boot;
mod kernel;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use crate::shell::{Cmd, ensure_debian, ensure_debian_package, root};
use boot::Job;

/// The tests' package, and the feature without which it is only the devices.
const PACKAGE: [&str; 4] = ["-p", "isobath-vm", "--features", "guest"];

/// `cargo xtask vm`.
pub(crate) fn verb(args: Vec<String>) -> Result<()> {
    let words: Vec<&str> = args.iter().map(String::as_str).collect();
    match words[..] {
        ["--run", binary, ref arguments @ ..] => guest(binary, arguments),
        ["--shell"] => shell(),
        ["--test", file, ref filter @ ..] => test(&["--test", file], filter),
        ref filter => test(&["--test", "*"], filter),
    }
}

/// The suite.
pub(crate) fn run() -> Result<()> {
    prepare()?;
    Cmd::new("cargo").arg("clippy").args(PACKAGE).args(["--all-targets", "--", "-D", "warnings"]).run()?;
    control()?;
    test(&["--test", "*"], &[])
}

/// A guest whose program fails must fail, with its status; one whose kernel dies must not pass.
fn control() -> Result<()> {
    println!("negative controls: a program that ends with status 5, a kernel that panics");
    match Job::default().boot("exit 5\n") {
        Ok(5) => {}
        other => bail!("the first control gave {other:?}"),
    }
    match Job::default().boot("echo c > /proc/sysrq-trigger\n") {
        Err(why) => println!("both fail as they must ({why})"),
        Ok(code) => bail!("a guest whose kernel died ended with {code}"),
    }
    Ok(())
}

/// What builds and boots need, asked for before minutes go into building.
fn prepare() -> Result<()> {
    boot::ensure()?;
    ensure_debian("v4l2-ctl", "v4l-utils", "reading simulated cameras with a program that is not ours")?;
    ensure_debian_package("libclang1", "building the V4L2 driver: its bindings are generated")
}

/// Builds the tests in `which` files and lets cargo run them in the guest.
fn test(which: &[&str], filter: &[&str]) -> Result<()> {
    prepare()?;
    Cmd::new("cargo").args(["build", "-p", "isobath-cli", "--features", "live"]).run()?;
    let runner = std::env::current_exe()?;
    let runner = runner.to_str().context("the path of this program is no text")?;
    let runner = format!("target.x86_64-unknown-linux-gnu.runner = ['{runner}', 'vm', '--run']");
    Cmd::new("cargo")
        .args(["test", "--no-fail-fast", "--config", &runner])
        .args(PACKAGE)
        .args(which)
        // One camera at a time: the tests share one host controller, and one processor.
        .args(["--", "--test-threads=1"])
        .args(filter)
        .run()
}

/// A job with the programs that tests start.
fn job() -> Result<Job> {
    let mut job = Job::default();
    for program in [debian_program("v4l2-ctl")?, root().join("target/debug/isobath")] {
        if program.is_file() {
            job.program(&program)?;
        }
    }
    Ok(job)
}

fn debian_program(name: &str) -> Result<PathBuf> {
    let (_, path, _) = Cmd::new("sh").args(["-c", &format!("command -v {name}")]).read()?;
    Ok(PathBuf::from(path.trim()))
}

/// Cargo's runner: one test binary, one boot.
fn guest(binary: &str, arguments: &[&str]) -> Result<()> {
    // Cargo starts a runner in the tests' own folder, and names the binary from there or from the root.
    let binary = Path::new(binary).canonicalize().with_context(|| format!("no test at {binary}"))?;
    let mut job = job()?;
    job.program(&binary)?;
    let name = binary.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    let words = arguments.iter().map(|word| format!(" '{word}'")).collect::<String>();
    match job.boot(&format!("exec /bin/{name}{words}\n"))? {
        0 => Ok(()),
        3 => bail!("the guest's kernel reported a fault of its own"),
        code => bail!("the test ended with status {code}"),
    }
}

/// A shell in the guest, with every program in it.
fn shell() -> Result<()> {
    boot::ensure()?;
    let mut job = job()?;
    job.interactive();
    println!("Ctrl-D ends the guest; `modprobe uvcvideo` and the like load what xtask/src/vm/kernel.rs lists");
    job.boot("exec setsid cttyhack sh -i\n").map(|_| ())
}
