//! `isobath devices`: what is plugged in, what can be done with it, and what is missing, in words.
//!
//! What the kernel says in `/sys` is read without opening anything: video nodes (which camera each belongs to), depth cameras on USB that no
//! kernel driver serves, and inertial sensors. No camera can be mistaken for another: they are known by their USB numbers.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::args::DevicesArgs;
use crate::failure::Outcome;
use crate::live;
use crate::say::Say;

/// What a device is to this program.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Device {
    /// "camera", "usb", "imu".
    sort: &'static str,
    name: String,
    /// Where it is: `/dev/video0`, `usb 2-1.3`.
    place: String,
    usb: Option<(u16, u16)>,
    /// SRC, when it can be one.
    src: Option<String>,
    can: Vec<String>,
    missing: Vec<String>,
}

/// USB cameras by their numbers: name, what `usb:` calls them, and why not when it doesn't.
fn known(vendor: u16, product: u16) -> Option<(&'static str, Result<&'static str, &'static str>)> {
    const CLOSED: &str =
        "its depth is computed by a closed library on the host: record with the maker's viewer and convert";
    Some(match (vendor, product) {
        (0x045e, 0x02ae) => ("Kinect v1 (camera)", Ok("kinect")),
        (0x045e, 0x02c4 | 0x02d8 | 0x02d9) => {
            ("Kinect v2", Err("its depth needs decoding that is not there: use a recording"))
        }
        (0x045e, 0x097c) => ("Azure Kinect (depth)", Err(CLOSED)),
        (0x03e7, _) => {
            ("Luxonis OAK", Err("it computes depth with firmware that its maker's library uploads: use a recording"))
        }
        (0x2bc5, 0x066b) => ("Orbbec Femto Bolt", Err(CLOSED)),
        _ => return None,
    })
}

/// Cameras that speak V4L2, by their USB numbers.
fn video_family(usb: Option<(u16, u16)>) -> Option<&'static str> {
    match usb? {
        (0x8086, 0x0ad0..=0x0b5f | 0x1155 | 0xabcd) => Some("Intel RealSense D4xx"),
        (0x2bc5, _) => Some("Orbbec"),
        (0x045e, 0x02ae) => Some("Kinect v1"),
        _ => None,
    }
}

fn line(path: &Path) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    let line = text.lines().next()?.trim();
    (!line.is_empty()).then(|| line.chars().take(60).collect())
}

fn hex(path: &Path) -> Option<u16> {
    u16::from_str_radix(&line(path)?, 16).ok()
}

/// The entries of a folder, by number where their names have one.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    all.sort_by_key(|p| {
        let name = p.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let digits: String = name.chars().filter(char::is_ascii_digit).collect();
        (digits.parse::<u64>().unwrap_or(0), name)
    });
    all
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The USB numbers of a device or of what it hangs on.
fn usb_of(device: &Path) -> Option<(u16, u16)> {
    let real = fs::canonicalize(device).ok()?;
    real.ancestors().take(4).find_map(|at| Some((hex(&at.join("idVendor"))?, hex(&at.join("idProduct"))?)))
}

/// Looks at the file trees `sys` (`/sys`) and `dev` (`/dev`).
fn look(sys: &Path, dev: &Path) -> Vec<Device> {
    let mut found = Vec::new();
    for node in entries(&sys.join("class/video4linux")) {
        if !name_of(&node).starts_with("video") {
            continue;
        }
        let usb = usb_of(&node.join("device"));
        let family = video_family(usb);
        let path = dev.join(name_of(&node));
        let says = line(&node.join("name")).unwrap_or_else(|| "a video node".into());
        let mut can = Vec::new();
        match family {
            Some("Intel RealSense D4xx") => can.push(
                "depth with its own unit and calibration, if this node is the depth one (each camera has several)"
                    .into(),
            ),
            Some("Orbbec") => can.push("depth, if this node is the depth one; calibration as far as it tells".into()),
            _ => {
                can.push(
                    "depth, if it has a depth format (Z16, Y16, Y12, Y10B); calibration from a camera file".into(),
                );
            }
        }
        let mut missing = Vec::new();
        if !path.exists() {
            missing.push(format!("{} is not there: pass it into this container, or check udev", path.display()));
        }
        found.push(Device {
            sort: "camera",
            name: says,
            src: Some(format!("v4l2:{}", path.display())),
            place: path.display().to_string(),
            usb,
            can,
            missing,
        });
    }
    for device in entries(&sys.join("bus/usb/devices")) {
        let (Some(vendor), Some(product)) = (hex(&device.join("idVendor")), hex(&device.join("idProduct"))) else {
            continue;
        };
        let headset = entries(&device).iter().any(|i| {
            // The bulk protocol of headset firmware: its class is how it is known.
            let byte = |name: &str| line(&i.join(name)).and_then(|t| u8::from_str_radix(&t, 16).ok());
            (byte("bInterfaceClass"), byte("bInterfaceSubClass"), byte("bInterfaceProtocol"))
                == (Some(0xff), Some(b'i'), Some(b'B'))
        });
        let (name, kind) = match known(vendor, product) {
            Some(known) => known,
            None if headset => ("headset firmware", Ok("bulk")),
            None => continue,
        };
        let says = line(&device.join("product")).map_or_else(|| name.to_owned(), |p| format!("{name} ({p})"));
        let (src, can, missing) = match kind {
            Ok(kind) => (Some(format!("usb:{kind}")), vec!["depth, over USB".to_owned()], Vec::new()),
            Err(why) => (None, Vec::new(), vec![why.to_owned()]),
        };
        let place = format!("usb {}", name_of(&device));
        found.push(Device { sort: "usb", name: says, place, usb: Some((vendor, product)), src, can, missing });
    }
    for device in entries(&sys.join("bus/iio/devices")) {
        if !name_of(&device).starts_with("iio:device") {
            continue;
        }
        let has = |axis: &str| {
            device.join(format!("in_{axis}_x_raw")).exists() || device.join(format!("in_{axis}_scale")).exists()
        };
        let parts: Vec<&str> = [("accel", "acceleration"), ("anglvel", "angular rate"), ("magn", "magnetic field")]
            .iter()
            .filter(|(axis, _)| has(axis))
            .map(|(_, word)| *word)
            .collect();
        if parts.is_empty() {
            continue;
        }
        found.push(Device {
            sort: "imu",
            name: line(&device.join("name")).unwrap_or_else(|| "an inertial sensor".into()),
            place: dev.join(name_of(&device)).display().to_string(),
            usb: usb_of(&device),
            src: None,
            can: vec![format!("{}: record --imu {}", parts.join(", "), name_of(&device))],
            missing: Vec::new(),
        });
    }
    found
}

pub(crate) fn run(_: &DevicesArgs, say: &mut Say) -> Outcome {
    #[allow(unused_mut, reason = "what it can be asked itself is known with the feature `live` only")]
    let mut found = look(Path::new("/sys"), Path::new("/dev"));
    #[cfg(feature = "live")]
    ask(&mut found);
    tell(&found, say);
    Ok(())
}

/// Video nodes, asked themselves instead of guessed by their numbers.
#[cfg(feature = "live")]
fn ask(found: &mut Vec<Device>) {
    found.retain(|d| d.sort != "camera");
    found.extend(isobath_v4l2::devices().into_iter().map(|d| Device {
        sort: "camera",
        place: d.path.display().to_string(),
        src: d.has_depth.then(|| format!("v4l2:{}", d.path.display())),
        name: d.name,
        usb: d.usb,
        can: d.can,
        missing: d.missing,
    }));
}

fn tell(found: &[Device], say: &mut Say) {
    let titles = BTreeMap::from([
        ("camera", "Video nodes"),
        ("imu", "Inertial sensors"),
        ("usb", "Depth cameras on USB without a kernel driver"),
    ]);
    for sort in ["camera", "usb", "imu"] {
        let of_sort: Vec<&Device> = found.iter().filter(|d| d.sort == sort).collect();
        if of_sort.is_empty() {
            continue;
        }
        say.head(titles.get(sort).copied().unwrap_or(sort));
        for d in of_sort {
            let usb = d.usb.map_or(String::new(), |(v, p)| format!(", USB {v:04x}:{p:04x}"));
            say.line(&format!("  {}: {}{usb}", d.place, d.name));
            if let Some(src) = &d.src {
                say.fact("    SRC", src);
            }
            for can in &d.can {
                say.fact("    can", can);
            }
            for missing in &d.missing {
                say.fact("    missing", missing);
            }
        }
    }
    if found.is_empty() {
        say.line("No camera, and no inertial sensor, is plugged in that the kernel knows.");
    }
    if !live::BUILT {
        say.remark("This isobath opens recordings only. For cameras, build it so:");
        say.line(&format!("  {}", live::COMMAND));
        say.remark(&format!("The build needs libclang: {}.", live::NEEDS));
    }
    let list: Vec<Value> = found
        .iter()
        .map(|d| {
            json!({
                "sort": d.sort, "name": d.name, "place": d.place, "source": d.src,
                "usb": d.usb.map(|(v, p)| format!("{v:04x}:{p:04x}")), "can": d.can, "missing": d.missing,
            })
        })
        .collect();
    say.json(&json!({ "command": "devices", "live": live::BUILT, "devices": list }));
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    /// A folder that goes away by itself.
    struct Folder(PathBuf);

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    fn put(root: &Path, files: &[(&str, &str)]) {
        for (name, text) in files {
            let path = root.join(name);
            fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
            fs::write(path, text).expect("written");
        }
    }

    #[test]
    fn what_the_kernel_lists_is_said_in_words() {
        let folder = Folder(std::env::temp_dir().join(format!("isobath-devices-{}", std::process::id())));
        let root = &folder.0;
        put(
            root,
            &[
                ("sys/devices/usb2/2-1/idVendor", "8086\n"),
                ("sys/devices/usb2/2-1/idProduct", "0b07\n"),
                ("sys/devices/usb2/2-1/2-1:1.0/video4linux/video10/name", "Intel(R) RealSense(TM) Depth Ca\n"),
                ("sys/devices/usb2/2-2/idVendor", "045e\n"),
                ("sys/devices/usb2/2-2/idProduct", "02ae\n"),
                ("sys/devices/usb2/2-3/idVendor", "1d6b\n"),
                ("sys/devices/usb2/2-3/idProduct", "0002\n"),
                ("sys/devices/usb2/2-4/idVendor", "1209\n"),
                ("sys/devices/usb2/2-4/idProduct", "0001\n"),
                ("sys/devices/usb2/2-4/2-4:1.0/bInterfaceClass", "ff\n"),
                ("sys/devices/usb2/2-4/2-4:1.0/bInterfaceSubClass", "69\n"),
                ("sys/devices/usb2/2-4/2-4:1.0/bInterfaceProtocol", "42\n"),
                ("sys/devices/usb2/2-5/idVendor", "045e\n"),
                ("sys/devices/usb2/2-5/idProduct", "097c\n"),
                ("sys/bus/iio/devices/iio:device0/name", "gyro_3d\n"),
                ("sys/bus/iio/devices/iio:device0/in_anglvel_scale", "0.1\n"),
                ("sys/bus/iio/devices/iio:device1/name", "adc\n"),
                ("sys/class/video4linux/v4l-subdev0/name", "x\n"),
                ("dev/video3", ""),
            ],
        );
        let usb = root.join("sys/devices/usb2");
        let node = usb.join("2-1/2-1:1.0/video4linux/video10");
        symlink(usb.join("2-1/2-1:1.0"), node.join("device")).expect("linked");
        symlink(&node, root.join("sys/class/video4linux/video10")).expect("linked");
        fs::create_dir_all(root.join("sys/bus/usb/devices")).expect("a folder");
        for name in ["2-1", "2-2", "2-3", "2-4", "2-5"] {
            symlink(usb.join(name), root.join("sys/bus/usb/devices").join(name)).expect("linked");
        }
        let found = look(&root.join("sys"), &root.join("dev"));
        let of = |sort: &str| found.iter().filter(|d| d.sort == sort).collect::<Vec<_>>();
        let cameras = of("camera");
        assert_eq!(cameras.len(), 1);
        assert_eq!(cameras[0].usb, Some((0x8086, 0x0b07)));
        assert!(cameras[0].can[0].contains("its own unit"), "{cameras:?}");
        assert!(cameras[0].missing[0].contains("is not there"), "{cameras:?}");
        let sources: Vec<_> = of("usb").iter().map(|d| d.src.clone()).collect();
        assert_eq!(sources, [Some("usb:kinect".to_owned()), Some("usb:bulk".to_owned()), None]);
        assert!(of("usb")[2].missing[0].contains("closed"));
        let imu = of("imu");
        assert_eq!((imu.len(), imu[0].can[0].as_str()), (1, "angular rate: record --imu iio:device0"));
        assert_eq!(look(&root.join("nothing"), root), []);
    }
}
