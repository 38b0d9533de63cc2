//! The boards: building an image for each, running it in QEMU, reading what it prints.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};

use super::figures::Figures;
use crate::elf::Elf;
use crate::proof::{MANIFEST, PANICS};
use crate::shell::{Cmd, ensure_debian, ensure_target, root};

/// An image, and the machine it runs on.
struct Board {
    name: &'static str,
    package: &'static str,
    target: &'static str,
    qemu: &'static str,
    machine: &'static [&'static str],
}

const M4: Board = Board {
    name: "cortex-m4",
    package: "isobath-firmware-cortex-m",
    target: "thumbv7em-none-eabihf",
    qemu: "qemu-system-arm",
    machine: &["-M", "mps2-an386"],
};

const BOARDS: [Board; 3] = [
    M4,
    Board { name: "cortex-m55", target: "thumbv8m.main-none-eabihf", machine: &["-M", "mps3-an547"], ..M4 },
    Board {
        name: "cortex-a53",
        package: "isobath-firmware-cortex-a",
        target: "aarch64-unknown-none",
        qemu: "qemu-system-aarch64",
        // Without a network card: its ROM is in a package of its own.
        machine: &["-M", "virt", "-cpu", "cortex-a53", "-nic", "none"],
    },
];

/// Seconds after which an image hangs; it takes one.
const PATIENCE: &str = "120";

/// Builds and runs everything.
pub(super) fn measure() -> Result<Figures> {
    let mut figures = Figures::default();
    for board in &BOARDS {
        ensure_target(board.target, "the firmware images")?;
        ensure_debian(board.qemu, "qemu-system-arm", "running the firmware images")?;
        board.build(&[])?;
        let (passed, said) = board.run()?;
        if !passed {
            bail!("{}: the image says:\n{said}", board.name);
        }
        read(board.name, &said, &mut figures)?;
        let bytes = board.image()?;
        let elf = Elf::parse(&bytes).context("the image is no ELF file that we can read")?;
        no_panic(board.package, &elf)?;
        if board.name == M4.name {
            functions(&elf, &mut figures);
        }
        println!("{:<11} answers equal to the host's", board.name);
    }
    println!("negative control: an image that expects another frame's answers must fail");
    M4.build(&["--features", "with-fault"])?;
    let (passed, said) = M4.run()?;
    if passed || !said.contains("answers DIFFER") {
        bail!("the negative control did not fail as it must:\n{said}");
    }
    println!("it does: answers differ");
    example()?;
    footprint(&mut figures)?;
    Ok(figures)
}

/// The image to start from runs to its end: six answers. Its only panics may be those of [`QUEUES`].
fn example() -> Result<()> {
    let example = Board { package: "isobath-firmware-example", ..M4 };
    example.build(&[])?;
    let (passed, said) = example.run()?;
    if !passed || said.lines().filter(|line| line.starts_with("seen ")).count() != 6 {
        bail!("the example says:\n{said}");
    }
    let bytes = example.image()?;
    let elf = Elf::parse(&bytes).context("the image is no ELF file that we can read")?;
    let panics = elf.symbols_with(PANICS);
    if let Some(other) = panics.iter().find(|name| !QUEUES.iter().any(|known| name.contains(known))) {
        bail!("the example can panic: {other}");
    }
    println!("the example answers six frames");
    Ok(())
}

/// What heapless's queues link: a remainder by their length, which is never 0, but which they know at run time only.
const QUEUES: [&str; 2] = ["panic_const_rem_by_zero", "panic_fmt"];

fn folder(target: &str) -> PathBuf {
    root().join("tests/firmware/target").join(target).join("release")
}

fn no_panic(image: &str, elf: &Elf<'_>) -> Result<()> {
    let panics = elf.symbols_with(PANICS);
    if !panics.is_empty() {
        bail!("{image} can panic: {}\n`cargo xtask proof` says who calls them in the core", panics.join(" "));
    }
    Ok(())
}

impl Board {
    fn build(&self, features: &[&str]) -> Result<()> {
        let mut args = vec!["rustc", "--release", "--manifest-path", MANIFEST, "--package", self.package];
        args.extend(["--target", self.target]);
        args.extend(features);
        // Stack sizes are a nightly option; the variable lets these crates have it, and with link-time optimisation its
        // compilation is that of the whole image. Set for every image, or the dependencies would be built twice.
        args.extend(["--", "-Zemit-stack-sizes"]);
        let allowed = "isobath_firmware_cortex_m,isobath_firmware_cortex_a,isobath_firmware_example";
        Cmd::new("cargo").args(args).env("RUSTC_BOOTSTRAP", allowed).run()
    }

    fn image(&self) -> Result<Vec<u8>> {
        let path = folder(self.target).join(self.package);
        fs::read(&path).with_context(|| format!("reading {}", path.display()))
    }

    /// Whether it ended well, and what it said.
    fn run(&self) -> Result<(bool, String)> {
        let image = folder(self.target).join(self.package);
        let flags = ["-nographic", "-monitor", "none", "-serial", "none", "-icount", "shift=0"];
        let console = ["-semihosting-config", "enable=on,target=native", "-kernel"];
        let cmd =
            Cmd::new("timeout").args([PATIENCE, self.qemu]).args(self.machine).args(flags).args(console).arg(image);
        let (passed, out, err) = cmd.read()?;
        Ok((passed, out + &err))
    }
}

/// Figures from an image's lines: words in pairs, name and value.
fn read(board: &str, said: &str, figures: &mut Figures) -> Result<()> {
    let (mut frame, mut job) = (0, 0);
    for line in said.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let value =
            |name: &str| words.chunks(2).find_map(|w| (w.first() == Some(&name)).then(|| w.get(1)).flatten().copied());
        let number = |name: &str| -> Result<u64> {
            value(name).and_then(|v| v.parse().ok()).with_context(|| format!("no number `{name}` in: {line}"))
        };
        match words.first().copied() {
            Some("frame" | "others" | "lighting") => (frame, job) = (0, 0),
            Some("size") if board == M4.name => {
                let name = value("size").unwrap_or_default();
                figures.most("memory", name, number("bytes")?);
            }
            Some("calibration") => {
                let (seen, spent) = (number("calibration")?, number("of")?);
                // A tick and the call around the loop.
                if seen.abs_diff(spent) > spent / 1000 {
                    bail!("{board}: the clock sees {seen} instructions where {spent} were spent");
                }
            }
            Some("stage") => {
                let name = value("stage").unwrap_or_default();
                let instructions = number("instructions")?;
                figures.most(&format!("{board}.instructions"), name, instructions);
                figures.most(&format!("{board}.stack"), name, number("stack")?);
                figures.most("times", name, number("times")?);
                frame += instructions;
                job += instructions * number("budgeted")?;
            }
            Some("answers") if job > 0 => {
                figures.most(&format!("{board}.instructions"), "sum-frame", frame);
                figures.most(&format!("{board}.instructions"), "sum-job", job);
            }
            _ => {}
        }
    }
    Ok(())
}

/// Bytes of the largest stack frames of the image's functions.
fn functions(elf: &Elf<'_>, figures: &mut Figures) {
    let mut sizes = elf.stack_sizes();
    sizes.sort_by_key(|(_, bytes)| std::cmp::Reverse(*bytes));
    println!("largest stack frames of single functions on {}:", M4.name);
    for (name, bytes) in sizes.iter().take(8) {
        println!("{bytes:>8}  {name}");
    }
    if let Some((_, bytes)) = sizes.first() {
        figures.most("cortex-m4.functions", "largest-stack-frame", *bytes);
        figures.most("cortex-m4.functions", "counted", sizes.len() as u64);
    }
}

/// Flash of each capability linked alone, beyond what the frame itself takes.
fn footprint(figures: &mut Figures) -> Result<()> {
    let build = ["build", "--release", "--bins", "--manifest-path", MANIFEST, "--package", "isobath-footprint"];
    Cmd::new("cargo").args(build).args(["--target", M4.target]).run()?;
    let flash = |name: &str| -> Result<u64> {
        let path = folder(M4.target).join(name);
        let bytes = fs::read(&path).with_context(|| format!("reading {}", path.display()))?;
        let elf = Elf::parse(&bytes).context("the image is no ELF file that we can read")?;
        no_panic(name, &elf)?;
        let (text, data, _) = elf.sizes();
        Ok((text + data) as u64)
    };
    let frame = flash("frame")?;
    for entry in fs::read_dir(root().join("tests/firmware/footprint/src/bin"))? {
        let path = entry?.path();
        let name = path.file_stem().and_then(|n| n.to_str()).unwrap_or_default();
        if name != "frame" {
            figures.most("cortex-m4.flash", name, flash(name)?.saturating_sub(frame));
        }
    }
    Ok(())
}
