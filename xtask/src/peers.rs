//! Other libraries for `isobath bench --peers`: a Python of their own with pinned versions, and a worker for PCL.
//!
//! Nothing here is part of the test command. What can't be had is told, and the rest is made: `target/peers/workers` lists what
//! there is and what there is not. PCL's headers are unpacked from Debian's packages and only the libraries that normals need are
//! installed: `libpcl-dev` as a whole brings VTK and Qt, 1.4 GB; this is 0.25.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use crate::shell::{Cmd, ensure_debian, ensure_debian_package, root};

/// Sources of the workers.
const SOURCES: &str = "host-tools/bench/peers";

/// Name, the distributions of `requirements.txt` it needs beside numpy, and shared libraries that wheels leave to the system.
const PYTHON: &[(&str, &str, &[&str])] = &[
    ("opencv", "opencv-contrib-python-headless", &[]),
    ("open3d", "open3d", &["libgomp1", "libgl1", "libusb-1.0-0"]),
    ("realsense", "pyrealsense2", &["libusb-1.0-0", "libudev1"]),
    ("kornia", "kornia-rs", &[]),
];

/// What the list of workers says.
#[derive(Default)]
struct List {
    text: String,
}

impl List {
    fn worker(&mut self, name: &str, command: &[&Path]) {
        let _ = write!(self.text, "worker\t{name}");
        for word in command {
            let _ = write!(self.text, "\t{}", word.display());
        }
        self.text.push('\n');
    }

    fn missing(&mut self, name: &str, why: &anyhow::Error) {
        // One line, without tabs: they part the words.
        let why = format!("{why:#}").split_whitespace().collect::<Vec<_>>().join(" ");
        println!("{name} is left out: {why}");
        let _ = writeln!(self.text, "missing\t{name}\t{why}");
    }
}

/// `cargo xtask peers`.
pub(crate) fn verb(args: Vec<String>) -> Result<()> {
    crate::no_arguments(&args)?;
    let out = root().join("target/peers");
    fs::create_dir_all(&out)?;
    let mut list = List::default();
    match python(&out) {
        Ok(python) => {
            for &(name, distribution, system) in PYTHON {
                match wheel(&python, name, distribution, system) {
                    Ok(()) => {
                        let source = root().join(SOURCES).join("worker.py");
                        list.worker(name, &[&python, &source, Path::new(name)]);
                    }
                    Err(why) => list.missing(name, &why),
                }
            }
        }
        Err(why) => PYTHON.iter().for_each(|(name, ..)| list.missing(name, &why)),
    }
    match pcl(&out) {
        Ok(worker) => list.worker("pcl", &[&worker]),
        Err(why) => list.missing("pcl", &why),
    }
    let path = out.join("workers");
    fs::write(&path, &list.text).with_context(|| format!("writing {}", path.display()))?;
    println!("\nwrote {}; now: cargo run --release -- bench --filter normals --peers", path.display());
    Ok(())
}

/// The Python of a virtual environment, made when it is not there, with numpy.
fn python(out: &Path) -> Result<PathBuf> {
    let venv = out.join("venv");
    let python = venv.join("bin/python");
    if !python.exists() {
        ensure_debian("python3", "python3", "other libraries")?;
        let make = || Cmd::new("python3").args(["-m", "venv"]).args([&venv]).run();
        // Debian keeps what `venv` needs in a package of its own.
        if make().is_err() {
            ensure_debian_package("python3-venv", "other libraries")?;
            make()?;
        }
    }
    pip(&python, "numpy")?;
    Ok(python)
}

/// Installs one distribution in its pinned version.
fn pip(python: &Path, distribution: &str) -> Result<()> {
    let pins = fs::read_to_string(root().join(SOURCES).join("requirements.txt"))?;
    let pin = pins.lines().find(|l| l.split_once("==").is_some_and(|(name, _)| name == distribution));
    let pin = pin.with_context(|| format!("{distribution} is not in requirements.txt"))?;
    let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary=:all:", pin];
    Cmd::new(&python.to_string_lossy()).args(install).run()
}

/// Installs a library and sees whether its worker starts.
fn wheel(python: &Path, name: &str, distribution: &str, system: &[&str]) -> Result<()> {
    pip(python, distribution)?;
    let program = python.to_string_lossy();
    let starts = || {
        let import = format!("import {name}_peer");
        Cmd::new(&program).dir(root().join(SOURCES)).args(["-c", &import]).read()
    };
    if starts()?.0 {
        return Ok(());
    }
    for package in system {
        ensure_debian_package(package, distribution)?;
    }
    let (fine, _, error) = starts()?;
    ensure!(fine, "{}", error.lines().last().unwrap_or("it does not start"));
    Ok(())
}

/// Builds PCL's worker.
fn pcl(out: &Path) -> Result<PathBuf> {
    ensure_debian("g++", "g++", "PCL's worker")?;
    let (fine, depends, _) = Cmd::new("apt-cache").args(["depends", "libpcl-dev"]).read()?;
    ensure!(fine, "this system's packages know no libpcl-dev; `apt-get update` may help");
    // Debian's names carry the version: libpcl-features1.13.
    let library = depends.split_whitespace().find(|word| word.starts_with("libpcl-features"));
    let library = library.context("libpcl-dev names no libpcl-features")?;
    for package in [library, "libeigen3-dev", "libboost-dev"] {
        ensure_debian_package(package, "PCL's worker")?;
    }
    let unpacked = out.join("pcl");
    fs::create_dir_all(&unpacked)?;
    for package in ["libpcl-dev", "libflann-dev"] {
        Cmd::new("apt-get").dir(&unpacked).args(["download", "-qq", package]).run()?;
    }
    for file in fs::read_dir(&unpacked)?.filter_map(|e| e.ok().map(|e| e.path())) {
        if file.extension().is_some_and(|e| e == "deb") {
            Cmd::new("dpkg-deb").arg("-x").arg(&file).arg(&unpacked).run()?;
        }
    }
    let include = unpacked.join("usr/include");
    let pcl = folder(&include, "pcl-")?;
    let (worker, source) = (out.join("pcl-worker"), root().join(SOURCES).join("pcl_worker.cpp"));
    let mut build = Cmd::new("g++").args(["-std=c++17", "-O3", "-DNDEBUG", "-isystem", "/usr/include/eigen3"]);
    for path in [&include, &pcl] {
        build = build.arg("-isystem").arg(path);
    }
    // By file: the plain names belong to the development packages.
    let version = library.trim_start_matches("libpcl-features");
    let libraries = ["features", "search", "common"].map(|l| format!("-l:libpcl_{l}.so.{version}"));
    build.arg(&source).args(libraries).arg("-o").arg(&worker).run()?;
    Ok(worker)
}

/// The folder whose name begins so.
fn folder(parent: &Path, begins: &str) -> Result<PathBuf> {
    for entry in fs::read_dir(parent)? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().starts_with(begins) {
            return Ok(entry.path());
        }
    }
    bail!("no {begins}* in {}", parent.display())
}
