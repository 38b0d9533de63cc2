//! The guest's kernel: Debian's own, as its package has it, with the modules that the tests load.
//!
//! `linux-image-amd64` always names the newest version, which is asked for: pinned ones leave the mirrors. The package stays in
//! `target/vm`; of it, the kernel itself and the closure of [`MODULES`] are kept. A module names those it needs in its own
//! `.modinfo` section (`depends=a,b`), so the closure needs no `depmod`, and the list that busybox's `modprobe` reads is written here.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::archive::Archive;
use crate::shell::{Cmd, ensure_apt, ensure_debian, missing};

/// What the tests load by name: the simulated host controller, cameras, the sensors of a HID motion module, virtual cameras, devices
/// written by function file system.
const MODULES: [&str; 12] = [
    "vhci-hcd",
    "uvcvideo",
    "usbhid",
    "hid-generic",
    "hid-sensor-hub",
    "hid-sensor-accel-3d",
    "hid-sensor-gyro-3d",
    "gspca_kinect",
    "vivid",
    "dummy_hcd",
    "usb_f_fs",
    "libcomposite",
];

const WHY: &str = "the kernel that the drivers are tested on";

/// A kernel that is ready to boot.
#[derive(Debug)]
pub(super) struct Kernel {
    /// The package: `linux-image-6.1.0-56-amd64`.
    package: String,
    /// `target/vm`.
    folder: PathBuf,
}

impl Kernel {
    /// The newest one that Debian has; one that was fetched before when that can't be had.
    pub(super) fn get(folder: &Path) -> Result<Self> {
        fs::create_dir_all(folder)?;
        let of = |package| Self { package, folder: folder.to_owned() };
        let fetched = of(fs::read_to_string(folder.join("package")).unwrap_or_default());
        if fetched.is_there() && newest().is_none_or(|newest| newest == fetched.package) {
            return Ok(fetched);
        }
        let fetch = || -> Result<Self> {
            ensure_debian("dpkg-deb", "dpkg", WHY)?;
            let first = newest().map(of).map(|kernel| kernel.fetch().map(|()| kernel));
            if let Some(Ok(kernel)) = first {
                return Ok(kernel);
            }
            // What apt knows may be out of date.
            ensure_apt(WHY)?;
            let package = newest().ok_or_else(|| missing("linux-image-amd64", WHY, "apt-get update (as root)"))?;
            let kernel = of(package);
            kernel.fetch().map(|()| kernel)
        };
        match fetch() {
            Ok(kernel) => {
                fs::write(folder.join("package"), &kernel.package)?;
                Ok(kernel)
            }
            Err(why) if fetched.is_there() => {
                println!("using {}, fetched earlier: {why:#}", fetched.package);
                Ok(fetched)
            }
            Err(why) => Err(why),
        }
    }

    fn is_there(&self) -> bool {
        !self.package.is_empty() && self.image().is_file() && self.modules().is_dir()
    }

    /// The bootable file.
    pub(super) fn image(&self) -> PathBuf {
        self.folder.join(format!("vmlinuz-{}", self.release()))
    }

    /// What `uname -r` says in the guest.
    fn release(&self) -> &str {
        self.package.trim_start_matches("linux-image-")
    }

    /// The kept modules: one folder for each list of modules, so that a changed list is a new folder.
    fn modules(&self) -> PathBuf {
        let sum = MODULES.join(" ").bytes().fold(0u32, |sum, b| sum.rotate_left(5) ^ u32::from(b));
        self.folder.join(format!("modules-{}-{sum:08x}", self.release()))
    }

    fn fetch(&self) -> Result<()> {
        println!("fetching {} (70 MB, once)", self.package);
        let user = "APT::Sandbox::User=root"; // the folder is ours, not apt's user's
        let download = Cmd::new("apt-get").args(["download", "-qq", "-o", user, &self.package]).dir(&self.folder);
        if download.run().is_err() {
            let how = format!("apt-get download {} (it needs Debian's mirror)", self.package);
            return Err(missing(&self.package, WHY, &how));
        }
        let prefix = format!("{}_", self.package);
        let deb = files(&self.folder)?.into_iter().find(|f| f.file_name().is_some_and(|n| starts(n, &prefix)));
        let deb = deb.context("apt-get download left no package")?;
        let unpacked = self.folder.join("unpacked");
        let _ = fs::remove_dir_all(&unpacked);
        Cmd::new("dpkg-deb").arg("-x").arg(&deb).arg(&unpacked).run()?;
        let release = self.release();
        self.keep(&unpacked.join("lib/modules").join(release).join("kernel"))?;
        fs::copy(unpacked.join("boot").join(format!("vmlinuz-{release}")), self.image())?;
        fs::remove_dir_all(&unpacked)?;
        fs::remove_file(deb)?;
        Ok(())
    }

    /// Copies the closure of [`MODULES`] out of the package's tree.
    fn keep(&self, tree: &Path) -> Result<()> {
        let mut there = BTreeMap::new();
        walk(tree, &mut |path| {
            if let Some(name) = path.file_name().and_then(|n| n.to_str()).and_then(|n| n.strip_suffix(".ko")) {
                there.insert(canonical(name), path.to_owned());
            }
        })?;
        // Written under another name first: a folder of the right name is a whole one.
        let folder = self.folder.join("modules-in-the-making");
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder)?;
        let mut wanted: Vec<String> = MODULES.iter().map(|m| canonical(m)).collect();
        let mut kept = BTreeSet::new();
        while let Some(name) = wanted.pop() {
            if !kept.insert(name.clone()) {
                continue;
            }
            let Some(path) = there.get(&name) else {
                bail!("{} has no module {name}: the list in xtask/src/vm/kernel.rs wants it", self.package);
            };
            let content = fs::read(path)?;
            wanted.extend(needs(&content));
            fs::write(folder.join(format!("{name}.ko")), content)?;
        }
        fs::rename(&folder, self.modules())?;
        Ok(())
    }

    /// Writes the modules, and who needs whom, into the guest's file system.
    pub(super) fn pack(&self, archive: &mut Archive) -> Result<()> {
        let home = format!("lib/modules/{}", self.release());
        let mut direct = BTreeMap::new();
        for path in files(&self.modules())? {
            let content = fs::read(&path)?;
            let name = path.file_stem().and_then(|n| n.to_str()).unwrap_or_default().to_owned();
            archive.file(&format!("{home}/{name}.ko"), &content);
            direct.insert(name, needs(&content));
        }
        // `a.ko: b.ko c.ko`: what a needs, directly or not; the last is loaded first.
        let mut list = String::new();
        for name in direct.keys() {
            let mut order = Vec::new();
            visit(name, &direct, &mut order);
            order.reverse();
            let mut words = order.iter().map(|m| format!("{m}.ko"));
            list += &format!("{}: {}\n", words.next().unwrap_or_default(), words.collect::<Vec<_>>().join(" "));
        }
        archive.file(&format!("{home}/modules.dep"), list.as_bytes());
        Ok(())
    }
}

/// The package that `linux-image-amd64` stands for now, where apt knows.
fn newest() -> Option<String> {
    let (_, text, _) = Cmd::new("apt-cache").args(["show", "--no-all-versions", "linux-image-amd64"]).read().ok()?;
    let depends = text.lines().find_map(|line| line.strip_prefix("Depends: "))?;
    depends.split([' ', ',']).find(|word| word.starts_with("linux-image-")).map(str::to_owned)
}

/// A module's name as the kernel spells it: `-` and `_` are one to it.
fn canonical(name: &str) -> String {
    name.replace('-', "_")
}

/// The modules that a module names in its `.modinfo`.
fn needs(module: &[u8]) -> Vec<String> {
    const KEY: &[u8] = b"\0depends=";
    let Some(at) = module.windows(KEY.len()).position(|w| w == KEY) else { return Vec::new() };
    let value = module[at + KEY.len()..].split(|&b| b == 0).next().unwrap_or_default();
    String::from_utf8_lossy(value).split(',').filter(|name| !name.is_empty()).map(canonical).collect()
}

/// Depth first: what `name` needs, then `name`.
fn visit(name: &str, direct: &BTreeMap<String, Vec<String>>, order: &mut Vec<String>) {
    if order.iter().any(|done| done == name) {
        return;
    }
    for needed in direct.get(name).into_iter().flatten() {
        visit(needed, direct, order);
    }
    order.push(name.to_owned());
}

fn starts(name: &std::ffi::OsStr, prefix: &str) -> bool {
    name.to_str().is_some_and(|name| name.starts_with(prefix))
}

fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| format!("reading {}", folder.display()))?;
    let mut files = entries.map(|e| e.map(|e| e.path())).collect::<Result<Vec<_>, _>>()?;
    files.sort();
    Ok(files)
}

fn walk(folder: &Path, each: &mut dyn FnMut(&Path)) -> Result<()> {
    for path in files(folder)? {
        if path.is_dir() {
            walk(&path, each)?;
        } else {
            each(&path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_module_names_what_it_needs() {
        assert_eq!(needs(b"ELF\0license=GPL\0depends=usb-core,mc\0name=x\0"), ["usb_core", "mc"]);
        assert!(needs(b"\0depends=\0").is_empty() && needs(b"nothing").is_empty());
    }

    #[test]
    fn what_is_needed_comes_before() {
        let list = [("a", vec!["b", "c"]), ("b", vec!["c"]), ("c", vec![])];
        let direct = list.map(|(n, d)| (n.to_owned(), d.into_iter().map(str::to_owned).collect())).into();
        let mut order = Vec::new();
        visit("a", &direct, &mut order);
        assert_eq!(order, ["c", "b", "a"]);
    }
}
