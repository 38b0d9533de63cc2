//! `cargo xtask VERB`: the one entry point for isobath's checks, data and documents, the same on a desk and in CI.
//!
//! [`suites`] lists what `check` and `test` run; [`shell`] runs programs and installs what is missing; [`proof`], [`firmware`],
//! [`fuzz`], [`vm`], [`c_library`], [`instructions`], [`motorcycle`] and [`peers`] are the verbs with more than one command behind them.

use std::process::ExitCode;

use anyhow::{Result, bail};

mod c_library;
mod elf;
mod firmware;
mod fuzz;
mod instructions;
mod motorcycle;
mod peers;
mod proof;
mod shell;
mod suites;
mod vm;

use shell::Cmd;

/// A verb: its name, its arguments, one line of help, more help, what it does.
struct Verb {
    name: &'static str,
    arguments: &'static str,
    summary: &'static str,
    details: &'static str,
    run: fn(Vec<String>) -> Result<()>,
}

const VERBS: &[Verb] = &[
    Verb {
        name: "check",
        arguments: "",
        summary: "the quick loop before every commit: format, clippy, tests",
        details: "Runs the suites marked `check` in `cargo xtask test --list`. Under three minutes once built.",
        run: suites::check,
    },
    Verb {
        name: "test",
        arguments: "[--only SUITE]... [--list] [--allow-missing] [--smoke SECONDS]",
        summary: "everything CI runs; installs what it needs where it can",
        details: "--only SUITE     only this suite (may be given several times)\n\
                  --list           the suites, and what each does\n\
                  --allow-missing  a suite that could not run (a tool is missing and can't be installed) is no failure\n\
                  --smoke SECONDS  how long each fuzz target runs (default 20)\n\n\
                  Ends with a table of suites and the line `N passed, N failed, N skipped`.",
        run: suites::test,
    },
    Verb {
        name: "fuzz",
        arguments: "[TARGET]... [--seconds N] [--list]",
        summary: "run fuzz targets (all, or those named) on a copy of their seed corpora",
        details: "--seconds N  how long each target runs (default 60)\n\
                  --list       the targets\n\n\
                  Needs a nightly toolchain, cargo-fuzz and a C++ compiler, and installs them where it can. What a target finds\n\
                  is written to fuzz/artifacts/TARGET/: minimise it (`cargo +nightly fuzz tmin TARGET FILE`) and put it into\n\
                  fuzz/corpus/TARGET/, where the ordinary tests replay it.",
        run: fuzz::verb,
    },
    Verb {
        name: "proof",
        arguments: "",
        summary: "link the bare-metal proof image: no std, no allocator, no panic; print its sizes",
        details: "Links tests/firmware/proof for each bare-metal target, then checks the check: with an `extern crate alloc` in\n\
                  the tree the link must fail, with an unchecked index a panic must be found. Prints text, data and bss. A panic\n\
                  symbol in the image is an error, which names the functions that call it.",
        run: |args| no_arguments(&args).and_then(|()| proof::run()),
    },
    Verb {
        name: "firmware",
        arguments: "[--store]",
        summary: "run the bare-metal images in QEMU: answers, instructions, stack, memory against what is stored",
        details: "--store  take what was measured for the stored figures (tests/firmware/results.toml) and write docs/footprint.md\n\n\
                  Builds tests/firmware for Cortex-M4F, Cortex-M55 and AArch64 and runs it in QEMU, which it installs where it can\n\
                  (Debian's qemu-system-arm, for which apt removes a newer qemu-utils that conflicts with it). Fails when an answer is not the host's, when a figure is off by more than 3 % in either\n\
                  direction, when the localized job's stack exceeds 8 KiB on the M4, or when an image can panic.",
        run: firmware::verb,
    },
    Verb {
        name: "c-library",
        arguments: "[TARGET]",
        summary: "make the static library for C programs (default: for this machine)",
        details: "Prints where it is, and its sizes. Without std and without an allocator on every target, this machine too. The header is\n\
                  core-nostd/capi/include/isobath.h, an example beside it.",
        run: c_library::verb,
    },
    Verb {
        name: "header",
        arguments: "",
        summary: "write core-nostd/capi/include/isobath.h anew from the Rust sources",
        details: "By cbindgen, as core-nostd/capi/cbindgen.toml says. A test holds that it is up to date.",
        run: |args| no_arguments(&args).and_then(|()| c_library::header()),
    },
    Verb {
        name: "bench",
        arguments: "[-- CRITERION ARGUMENTS]",
        summary: "cargo bench over the workspace",
        details: "Times are for people: no check depends on them. Arguments are passed on to criterion, such as a filter.",
        run: |args| {
            let rest = args.iter().skip(usize::from(args.first().is_some_and(|a| a == "--")));
            Cmd::new("cargo").args(["bench", "--workspace", "--benches", "--"]).args(rest).run()
        },
    },
    Verb {
        name: "peers",
        arguments: "",
        summary: "get other libraries (OpenCV, Open3D, PCL, ...) for `isobath bench --peers`",
        details: "Makes target/peers: a Python of its own with the versions of host-tools/bench/peers/requirements.txt (about 1.5 GB), and\n\
                  a worker for PCL, for which Debian's packages are installed where they can be (0.25 GB). A library that can't be had\n\
                  is told and left out. No check needs any of it.",
        run: peers::verb,
    },
    Verb {
        name: "instructions",
        arguments: "[--store]",
        summary: "count the instructions of the hot kernels against the repository's table",
        details: "--store  write tests/instructions/baseline.toml anew\n\n\
                  Runs each kernel of tests/instructions under valgrind, which it installs where it can. Prints count, count per answer\n\
                  and change. More than the table's tolerance (3 %) above the stored count fails; so does a kernel that only one of the\n\
                  two lists has. With another compiler than the stored one, or on another target, it warns or does not compare.",
        run: instructions::verb,
    },
    Verb {
        name: "vm",
        arguments: "[--test FILE] [FILTER]... | --shell",
        summary: "the drivers on a real Linux kernel in QEMU, with simulated cameras",
        details: "--test FILE  only this file of tests/vm/tests (one boot of about ten seconds each)\n\
                  FILTER       only tests whose name holds it\n\
                  --shell      a shell in the guest instead\n\n\
                  Fetches Debian's kernel (70 MB, once, into target/vm), and installs qemu-system-x86, busybox-static, v4l-utils and\n\
                  libclang1 where it can. tests/vm/README.md says how the devices are made.",
        run: vm::verb,
    },
    Verb {
        name: "docs",
        arguments: "[--open] [--numerics]",
        summary: "the API documentation, warnings as errors; the generated documents",
        details: "--open      show it in a browser\n\
                  --numerics  write docs/numerics.md anew (the worst error of every function) instead",
        run: |args| {
            if args.iter().any(|a| a == "--numerics") {
                let test = ["test", "-p", "isobath-tests", "--test", "numerics", "the_document"];
                return Cmd::new("cargo").args(test).env("ISOBATH_WRITE_NUMERICS", "1").run();
            }
            let open = args.iter().any(|a| a == "--open");
            suites::docs().args(open.then_some("--open")).run()
        },
    },
    Verb {
        name: "motorcycle",
        arguments: "[--from DIR] [--out DIR]",
        summary: "convert the Middlebury 2014 Motorcycle frame into data/motorcycle",
        details: "--from DIR  read motorcycle_left.png and motorcycle_disp.npz there instead of downloading the PyPI package\n\
                  --out DIR   where to write (default data/motorcycle)\n\n\
                  Downloads scikit-image 0.18.3 with pip, checks its hash, and writes depth, colour, camera and their source.",
        run: motorcycle::verb,
    },
];

fn no_arguments(args: &[String]) -> Result<()> {
    if let Some(first) = args.first() {
        bail!("unexpected argument `{first}`");
    }
    Ok(())
}

fn overview() -> String {
    let mut text = String::from("cargo xtask VERB: isobath's checks, data and documents\n\n");
    for v in VERBS {
        text += &format!("  {:<12} {}\n", v.name, v.summary);
    }
    text + "\n`cargo xtask VERB --help` says more about one.\n"
}

fn main() -> ExitCode {
    let mut args = std::env::args().skip(1);
    let Some(name) = args.next() else {
        print!("{}", overview());
        return ExitCode::SUCCESS;
    };
    if ["help", "--help", "-h"].contains(&name.as_str()) {
        print!("{}", overview());
        return ExitCode::SUCCESS;
    }
    let Some(verb) = VERBS.iter().find(|v| v.name == name) else {
        eprint!("no verb `{name}`\n\n{}", overview());
        return ExitCode::from(2);
    };
    let args: Vec<String> = args.collect();
    if args.iter().take_while(|a| *a != "--").any(|a| a == "--help" || a == "-h") {
        println!("cargo xtask {} {}\n\n{}\n\n{}", verb.name, verb.arguments, verb.summary, verb.details);
        return ExitCode::SUCCESS;
    }
    match (verb.run)(args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("xtask {name}: {error:#}");
            ExitCode::FAILURE
        }
    }
}
