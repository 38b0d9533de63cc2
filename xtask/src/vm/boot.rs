//! One boot: a program with the libraries it needs goes into the guest, runs there as root, and its verdict comes back.
//!
//! QEMU translates instructions (no `/dev/kvm` is needed, or asked for: where it is there and of no use, QEMU hangs). With `-icount` the guest's clock
//! counts its instructions, and jumps over idle time (`sleep=off`): what the guest sees of time does not depend on how busy this
//! machine is, so a timeout in a test means the same everywhere, and ten minutes of a waiting camera take seconds. The verdict goes through the
//! port of `isa-debug-exit`; see `tests/vm/guest/init`.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::archive::Archive;
use super::kernel::Kernel;
use crate::shell::{Cmd, ensure_debian, missing, root};

/// A guest that hangs is stopped after this many seconds of the host's time.
const PATIENCE: &str = "600";

/// The guest's memory, megabytes: kernel, file system and tests take about 300.
const MEMORY: &str = "640";

/// Makes sure of what a boot needs.
pub(super) fn ensure() -> Result<()> {
    let why = "running the drivers on a kernel with simulated cameras";
    if !cfg!(all(target_arch = "x86_64", target_os = "linux")) {
        return Err(missing("x86-64 Linux", why, "another machine: the guest runs this one's programs"));
    }
    ensure_debian("qemu-system-x86_64", "qemu-system-x86", why)?;
    ensure_debian("busybox", "busybox-static", why)
}

/// The folder for what is fetched and made.
pub(super) fn folder() -> PathBuf {
    root().join("target/vm")
}

/// What goes into the guest with one boot.
#[derive(Debug, Default)]
pub(super) struct Job {
    archive: Archive,
    interactive: bool,
}

impl Job {
    /// A program for `/bin`, with its libraries.
    pub(super) fn program(&mut self, path: &Path) -> Result<()> {
        let name = path.file_name().and_then(|n| n.to_str()).context("a program has a name")?;
        // Debug information is most of a test's size, and every byte of it is copied at boot.
        let stripped = folder().join("stripped");
        let source = match Cmd::new("strip").args(["--strip-debug", "-o"]).arg(&stripped).arg(path).read() {
            Ok((true, ..)) => stripped.as_path(),
            _ => path,
        };
        self.archive.copy(source, &format!("bin/{name}"))?;
        let (_, libraries, _) = Cmd::new("ldd").arg(path).read()?;
        for word in libraries.split_whitespace().filter(|word| word.starts_with('/')) {
            self.archive.copy(Path::new(word), word.trim_start_matches('/'))?;
        }
        Ok(())
    }

    /// The guest's console is this terminal.
    pub(super) fn interactive(&mut self) {
        self.interactive = true;
    }

    /// Boots and runs `script`; `Ok` with its exit status, as far as that is below 127.
    pub(super) fn boot(mut self, script: &str) -> Result<u8> {
        ensure()?;
        let folder = folder();
        let kernel = Kernel::get(&folder)?;
        self.archive.file("job", script.as_bytes());
        let mut guest = Archive::default();
        guest.copy(&root().join("tests/vm/guest/init"), "init")?;
        let (_, busybox, _) = Cmd::new("sh").args(["-c", "command -v busybox"]).read()?;
        guest.copy(Path::new(busybox.trim()), "bin/busybox")?;
        kernel.pack(&mut guest)?;
        let files = folder.join("guest.cpio");
        let mut bytes = guest.finish();
        bytes.extend(self.archive.finish());
        fs::write(&files, bytes)?;

        let console =
            "console=ttyS0 quiet loglevel=4 panic=-1 mitigations=off nokaslr tsc=reliable random.trust_cpu=on";
        let mut qemu = Cmd::new("timeout");
        if self.interactive {
            qemu = qemu.arg("--foreground").terminal();
        }
        let (code, last) = qemu
            .args(["-k", "5", if self.interactive { "0" } else { PATIENCE }, "qemu-system-x86_64"])
            .args(["-accel", "tcg,thread=single", "-icount", "shift=0,sleep=off"])
            .args(["-M", "q35,hpet=off", "-cpu", "qemu64", "-smp", "1", "-m", MEMORY])
            .args(["-nodefaults", "-no-user-config", "-no-reboot", "-display", "none", "-serial", "stdio"])
            .args(["-device", "isa-debug-exit,iobase=0xf4,iosize=0x04"])
            .arg("-kernel")
            .arg(kernel.image())
            .arg("-initrd")
            .arg(&files)
            .args(["-append", console])
            .stream()?;
        match code {
            Some(85) => Ok(0),
            Some(124 | 137) => bail!("the guest gave no verdict within {PATIENCE} s; its last line: {last}"),
            Some(code @ 3..) if code % 2 == 1 => Ok((code / 2) as u8),
            code => bail!("the guest gave no verdict (QEMU's exit: {code:?}); its last line: {last}"),
        }
    }
}
