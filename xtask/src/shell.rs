//! Running programs, and getting the ones that are missing.
//!
//! The `ensure_*` functions return [`Missing`] when something is neither there nor to be had, with what it is for and the
//! command that would get it; the suite runner tells that apart from a failure.

use std::ffi::OsStr;
use std::fmt;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Once;

use anyhow::{Context, Result, anyhow, bail};

/// The repository.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().map_or_else(|| PathBuf::from("."), Path::to_path_buf)
}

/// A tool that is not there and could not be installed.
#[derive(Debug)]
pub(crate) struct Missing {
    what: String,
    why: String,
    how: String,
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is missing ({}); get it with: {}", self.what, self.why, self.how)
    }
}

impl std::error::Error for Missing {}

/// The error of a tool that is missing: what, what for, and the command that would get it.
pub(crate) fn missing(what: &str, why: &str, how: &str) -> anyhow::Error {
    anyhow!(Missing { what: what.into(), why: why.into(), how: how.into() })
}

/// A program to run, by default in the repository's root.
#[derive(Debug)]
pub(crate) struct Cmd {
    command: Command,
}

impl Cmd {
    /// A program found in PATH.
    pub(crate) fn new(program: &str) -> Self {
        let mut command = Command::new(program);
        command.current_dir(root()).stdin(Stdio::null());
        // What the `cargo run` that started xtask set would pin the toolchain of, and rebuild things in, the cargo that it starts.
        for (name, _) in std::env::vars_os() {
            let text = name.to_string_lossy();
            let set_by_cargo = text.starts_with("CARGO_PKG_") || text.starts_with("CARGO_MANIFEST_");
            if set_by_cargo
                || ["CARGO", "RUSTUP_TOOLCHAIN", "RUST_RECURSION_COUNT", "LD_LIBRARY_PATH"].contains(&&*text)
            {
                command.env_remove(&name);
            }
        }
        Self { command }
    }

    /// `cargo` of a named toolchain.
    pub(crate) fn cargo_of(toolchain: &str) -> Self {
        Self::new("rustup").args(["run", toolchain, "cargo"])
    }

    /// One more argument.
    pub(crate) fn arg(self, arg: impl AsRef<OsStr>) -> Self {
        self.args([arg])
    }

    /// More arguments.
    pub(crate) fn args<S: AsRef<OsStr>>(mut self, args: impl IntoIterator<Item = S>) -> Self {
        self.command.args(args);
        self
    }

    /// An environment variable.
    pub(crate) fn env(mut self, name: &str, value: &str) -> Self {
        self.command.env(name, value);
        self
    }

    /// Another directory.
    pub(crate) fn dir(mut self, dir: impl AsRef<Path>) -> Self {
        self.command.current_dir(dir);
        self
    }

    fn line(&self) -> String {
        let words = std::iter::once(self.command.get_program()).chain(self.command.get_args());
        words.map(|w| w.to_string_lossy()).collect::<Vec<_>>().join(" ")
    }

    /// Runs it with its output shown; anything but success is an error.
    pub(crate) fn run(mut self) -> Result<()> {
        let line = self.line();
        println!("$ {line}");
        let status = self.command.status().with_context(|| format!("could not start `{line}`"))?;
        if !status.success() {
            bail!("`{line}` failed: {status}");
        }
        Ok(())
    }

    /// Runs it quietly; its success, standard output and standard error.
    pub(crate) fn read(mut self) -> Result<(bool, String, String)> {
        let line = self.line();
        let out = self.command.output().with_context(|| format!("could not start `{line}`"))?;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Ok((out.status.success(), text(&out.stdout), text(&out.stderr)))
    }

    /// Gives it this terminal's input, too.
    pub(crate) fn terminal(mut self) -> Self {
        self.command.stdin(Stdio::inherit());
        self
    }

    /// Runs it with its output shown as it comes, without carriage returns; its exit status, unless a signal ended it, and the last
    /// line with something in it.
    pub(crate) fn stream(mut self) -> Result<(Option<i32>, String)> {
        let line = self.line();
        let mut child =
            self.command.stdout(Stdio::piped()).spawn().with_context(|| format!("could not start `{line}`"))?;
        let mut from = child.stdout.take().context("its output is a pipe")?;
        let (mut bytes, mut last, mut current) = ([0; 4096], String::new(), Vec::new());
        let mut to = std::io::stdout().lock();
        loop {
            let n = from.read(&mut bytes)?;
            if n == 0 {
                break;
            }
            let shown: Vec<u8> = bytes[..n].iter().copied().filter(|b| !matches!(b, b'\r' | 0)).collect();
            to.write_all(&shown)?;
            to.flush()?;
            for byte in shown {
                if byte != b'\n' {
                    current.push(byte);
                } else if !current.trim_ascii().is_empty() {
                    last = String::from_utf8_lossy(&std::mem::take(&mut current)).into_owned();
                }
            }
        }
        if !current.trim_ascii().is_empty() {
            last = String::from_utf8_lossy(&current).into_owned();
        }
        Ok((child.wait()?.code(), last))
    }

    /// Whether it can be started and succeeds.
    fn succeeds(self) -> bool {
        self.read().is_ok_and(|(ok, ..)| ok)
    }
}

/// A compilation target of the default toolchain.
pub(crate) fn ensure_target(target: &str, why: &str) -> Result<()> {
    let (_, installed, _) = Cmd::new("rustup").args(["target", "list", "--installed"]).read().unwrap_or_default();
    if installed.lines().any(|l| l == target) || Cmd::new("rustup").args(["target", "add", target]).run().is_ok() {
        return Ok(());
    }
    // A toolchain without rustup may hold the target all the same.
    if let Ok((true, dir, _)) = Cmd::new("rustc").args(["--print", "target-libdir", "--target", target]).read()
        && Path::new(dir.trim()).is_dir()
    {
        return Ok(());
    }
    Err(missing(&format!("target {target}"), why, &format!("rustup target add {target}")))
}

/// A component of the default toolchain.
pub(crate) fn ensure_component(component: &str, probe: &[&str], why: &str) -> Result<()> {
    if Cmd::new("cargo").args(probe).succeeds()
        || Cmd::new("rustup").args(["component", "add", component]).run().is_ok()
    {
        return Ok(());
    }
    Err(missing(component, why, &format!("rustup component add {component}")))
}

/// A nightly toolchain.
pub(crate) fn ensure_nightly(why: &str) -> Result<()> {
    let there = || Cmd::new("rustup").args(["run", "nightly", "rustc", "--version"]).succeeds();
    let install = ["toolchain", "install", "nightly", "--profile", "minimal"];
    if there() || (Cmd::new("rustup").args(install).run().is_ok() && there()) {
        return Ok(());
    }
    Err(missing("a nightly toolchain", why, &format!("rustup {}", install.join(" "))))
}

/// A cargo subcommand from crates.io, at a known version.
pub(crate) fn ensure_cargo_tool(name: &str, version: &str, probe: &[&str], why: &str) -> Result<()> {
    let there = || Cmd::new("cargo").args(probe).succeeds();
    let install = ["install", name, "--version", version, "--locked"];
    if there() || (Cmd::new("cargo").args(install).run().is_ok() && there()) {
        return Ok(());
    }
    Err(missing(name, why, &format!("cargo {}", install.join(" "))))
}

/// A program, or the Debian package that holds it (installed when we are root and there is apt).
pub(crate) fn ensure_debian(program: &str, package: &str, why: &str) -> Result<()> {
    let there = || Cmd::new("sh").args(["-c", &format!("command -v {program}")]).succeeds();
    if !there() {
        apt_install(package);
    }
    if there() {
        return Ok(());
    }
    Err(missing(
        program,
        why,
        &format!("apt-get install {package} (as root; elsewhere, the package that holds `{program}`)"),
    ))
}

/// Debian's package lists, refreshed when we are root.
pub(crate) fn ensure_apt(why: &str) -> Result<()> {
    if apt_is_there() {
        apt_update();
        return Ok(());
    }
    Err(missing("apt-get", why, "a Debian (or a container of one): its packages are fetched by apt"))
}

/// A Debian package that holds no program: a library, or headers.
pub(crate) fn ensure_debian_package(package: &str, why: &str) -> Result<()> {
    let there = || {
        let status = Cmd::new("dpkg-query").args(["-W", "-f", "${Status}", package]).read();
        status.is_ok_and(|(_, text, _)| text.ends_with("ok installed"))
    };
    if !there() {
        apt_install(package);
    }
    if there() {
        return Ok(());
    }
    Err(missing(package, why, &format!("apt-get install --no-install-recommends {package} (as root, on Debian)")))
}

/// Installs a package when we are root and there is apt; the caller sees whether it went well.
fn apt_install(package: &str) {
    if is_root() && apt_is_there() {
        apt_update();
        let apt = Cmd::new("apt-get").env("DEBIAN_FRONTEND", "noninteractive");
        let _ = apt.args(["install", "-y", "-qq", "--no-install-recommends", package]).run();
    }
}

fn is_root() -> bool {
    Cmd::new("id").args(["-u"]).read().is_ok_and(|(_, id, _)| id.trim() == "0")
}

fn apt_is_there() -> bool {
    Cmd::new("apt-get").args(["--version"]).succeeds()
}

/// Once in a run, and only by root.
fn apt_update() {
    static UPDATE: Once = Once::new();
    if is_root() {
        UPDATE.call_once(|| {
            // A list that could not be refreshed may still hold the package.
            let _ = Cmd::new("apt-get").args(["update", "-qq"]).run();
        });
    }
}
