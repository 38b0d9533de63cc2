//! A D435-like camera on the scripted kernel: extension unit, metadata, colour, clocks.

mod kernel;

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::time::Duration;

use isobath::wire::device::d4xx::monitor::{Opcode, parse_question, write_answer};
use isobath::wire::device::d4xx::tables::seal;
use isobath_source::{BackPressure, Clock, Deadline, DepthSource, Outcome, OwnedFrame};
use isobath_v4l2::sys::{Errno, FourCc, Kind, Query, SysResult};
use isobath_v4l2::sysfs::Roots;
use isobath_v4l2::{OpenOptions, V4l2Source, devices_with, open_with};
use kernel::{Act, FakeSys, Kernel, NodeScript, draw_z16};

const SIZE: (u32, u32) = (64, 48);

/// A file tree with one USB camera: depth and its metadata on interface 0, colour on interface 3.
fn tree(root: &Path, product: &str, vendor: &str) -> Roots {
    let device = root.join("sys/devices/usb2/2-1");
    for (interface, nodes) in [("0", &[0, 1][..]), ("3", &[2])] {
        let directory = device.join(format!("2-1:1.{interface}"));
        fs::create_dir_all(&directory).unwrap();
        fs::write(directory.join("bInterfaceNumber"), format!("0{interface}\n")).unwrap();
        for n in nodes {
            let node = directory.join(format!("video4linux/video{n}"));
            fs::create_dir_all(&node).unwrap();
            fs::write(node.join("name"), "Scripted: depth\n").unwrap();
            fs::write(node.join("index"), format!("{}\n", n % 2)).unwrap();
            symlink(&directory, node.join("device")).unwrap();
            fs::create_dir_all(root.join("sys/class/video4linux")).unwrap();
            symlink(&node, root.join(format!("sys/class/video4linux/video{n}"))).unwrap();
        }
    }
    for (name, value) in [
        ("idVendor", vendor),
        ("idProduct", product),
        ("serial", "839112061234"),
        ("product", "Depth Camera"),
        ("speed", "480"),
    ] {
        fs::write(device.join(name), format!("{value}\n")).unwrap();
    }
    Roots { sys: root.join("sys"), dev: "/dev".into() }
}

fn put(table: &mut [u8], at: usize, values: &[f32]) {
    for (i, v) in values.iter().enumerate() {
        table[at + 4 * i..at + 4 * i + 4].copy_from_slice(&v.to_le_bytes());
    }
}

fn depth_table() -> Vec<u8> {
    let mut table = vec![0; 576];
    put(&mut table, 160, &[-50.0]);
    put(&mut table, 256, &[1380.0, 1381.0, 961.0, 538.0]); // 1920x1080
    put(&mut table, 288, &[613.5, 613.25, 321.5, 239.25]); // 640x480
    seal(25, &mut table).unwrap();
    table
}

fn colour_table() -> Vec<u8> {
    let mut table = vec![0; 256];
    put(&mut table, 16, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    table[144..146].copy_from_slice(&64_u16.to_le_bytes());
    table[146..148].copy_from_slice(&48_u16.to_le_bytes());
    put(&mut table, 184, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    put(&mut table, 220, &[0.0, 0.0, 0.0]);
    seal(32, &mut table).unwrap();
    table
}

/// What the extension unit answers, and how often it is busy first.
fn monitor(
    unit_um: u32,
    records: Vec<u8>,
    spoil: Option<u16>,
    mut busy: u32,
) -> impl FnMut(u8, u8, Query, &mut [u8]) -> SysResult<()> {
    let mut answer = [0; 1024];
    move |unit, selector, query, data| {
        if (unit, selector) != (3, 1) {
            return Err(Errno::ENOENT);
        }
        if data.len() != 1024 {
            return Err(Errno::ENOBUFS);
        }
        if busy > 0 {
            busy -= 1;
            return Err(Errno::EIO);
        }
        if query == Query::GetCurrent {
            data.copy_from_slice(&answer);
            return Ok(());
        }
        let (opcode, [first, ..]) = parse_question(data).unwrap();
        let mut table = match (opcode, first) {
            (o, _) if o == Opcode::Gvd as u32 => vec![7; 256],
            (o, 9) if o == Opcode::Advanced as u32 => {
                if unit_um == 0 {
                    answer = write_answer((-7_i32).cast_unsigned(), &[]).unwrap();
                    return Ok(());
                }
                let mut control = vec![0; 20];
                control[..4].copy_from_slice(&unit_um.to_le_bytes());
                control
            }
            (o, 25) if o == Opcode::Calibration as u32 => depth_table(),
            (o, 32) if o == Opcode::Calibration as u32 => colour_table(),
            (o, _) if o == Opcode::RectifiedParams as u32 => records.clone(),
            _ => panic!("an opcode that must never be asked: {opcode:#x}"),
        };
        if spoil == Some(first as u16) && opcode == Opcode::Calibration as u32 {
            let middle = table.len() / 2;
            table[middle] ^= 0x10;
        }
        answer = write_answer(opcode, &table).unwrap();
        Ok(())
    }
}

fn draw(fourcc: FourCc, width: u32, height: u32, stride: u32, frame: u32) -> Vec<u8> {
    if fourcc == FourCc(*b"YUYV") {
        // Left half dark, right half bright; grey.
        let row = (0..width).flat_map(|x| [if x < width / 2 { 16 } else { 235 }, 128]);
        return (0..height).flat_map(|_| row.clone()).collect();
    }
    draw_z16(fourcc, width, height, stride, frame)
}

fn record(size: (u32, u32), k: [f32; 4]) -> Vec<u8> {
    let mut bytes = Vec::new();
    bytes.extend((size.0 as u16).to_le_bytes());
    bytes.extend((size.1 as u16).to_le_bytes());
    k.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes
}

struct Setup {
    kernel: Kernel,
    options: OpenOptions,
    _root: tempfile::TempDir,
}

fn setup(unit_um: u32, records: Vec<u8>, spoil: Option<u16>, busy: u32) -> Setup {
    let root = tempfile::tempdir().unwrap();
    let kernel = Kernel::new("/dev/video0", NodeScript::video(b"Z16 ", SIZE)).with(|w| {
        w.nodes.insert("/dev/video1".into(), NodeScript::meta(b"D4XX"));
        w.nodes.insert("/dev/video2".into(), NodeScript::video(b"YUYV", SIZE));
        w.extension = Some(Box::new(monitor(unit_um, records, spoil, busy)));
        w.draw = draw;
    });
    let options = OpenOptions {
        size: Some(SIZE),
        policy: BackPressure::Queue(4),
        roots: tree(root.path(), "0b07", "8086"),
        ..OpenOptions::default()
    };
    Setup { kernel, options, _root: root }
}

fn open(s: &Setup) -> V4l2Source<FakeSys> {
    open_with(&s.kernel, Box::new(s.kernel.clone()), "/dev/video0".as_ref(), &s.options).unwrap()
}

fn next(s: &Setup, camera: &mut V4l2Source<FakeSys>, frame: &mut OwnedFrame) {
    let deadline = Deadline::after(&s.kernel, Duration::from_millis(300));
    assert_eq!(camera.next_into(frame, deadline).unwrap(), Outcome::Frame);
}

#[test]
fn everything_comes_from_the_camera_itself() {
    let s = setup(250, record(SIZE, [60.5, 61.5, 31.5, 23.25]), None, 3);
    let mut camera = open(&s);
    let info = camera.info().clone();
    let k = info.intrinsics;
    assert_eq!([k.fx(), k.fy(), k.cx(), k.cy()], [60.5, 61.5, 31.5, 23.25]);
    assert!(
        info.kind.starts_with("Intel RealSense D435, serial number 070707070707, firmware 7.7.7.7"),
        "{}",
        info.kind
    );
    assert!(info.has_colour);
    let mut frame = OwnedFrame::new();
    let mut last = 0;
    for n in 0..60_u64 {
        next(&s, &mut camera, &mut frame);
        assert_eq!((frame.sequence, frame.unit.metres()), (n, 0.000_25));
        // The device stamps the frame when the host sees it, and exposes for 8 ms before.
        let stamp = camera.last_info().unwrap();
        assert_eq!((stamp.frame_counter, stamp.exposure), (Some(n as u32), Some(8000)));
        let age = s.kernel.now().timestamp().as_nanos() - frame.time.as_nanos();
        assert!((3_900_000..40_000_000).contains(&age), "frame {n}: the middle of the exposure was {age} ns ago");
        assert!(frame.time.as_nanos() > last);
        last = frame.time.as_nanos();
        // From the first colour image on: left dark, right bright, where there is depth.
        let colour = frame.colour().expect("colour of the same time");
        assert_eq!(colour.size(), (64, 48));
        assert_eq!((colour.get(5, 20), colour.get(60, 20)), (Some([0; 3]), Some([255; 3])), "frame {n}");
    }
    let estimate = camera.clock_estimate().unwrap();
    assert!(estimate.skew.abs() < 1e-6 && estimate.pairs == 60, "{estimate:?}");
    assert_eq!(camera.metadata_format(), Some(FourCc(*b"D4XX")));
    assert_eq!((camera.stats().span(), camera.stats().delivered), (60, 60));
    camera.stop().unwrap();
    s.kernel.check();
}

#[test]
fn what_the_camera_does_not_say_falls_back_and_is_told() {
    let notes = |s: &Setup| open(s).info().notes.join("\n");
    // Without a list: the table's entry scaled, since it has none for this size.
    let s = setup(0, Vec::new(), None, 0);
    let camera = open(&s);
    let text = camera.info().notes.join("\n");
    assert!(text.contains("default, 1000 um") && text.contains("scaled"), "{text}");
    assert!((camera.info().intrinsics.fx() - 1380.0 * 64.0 / 1920.0).abs() < 1e-3);
    drop(camera);
    // A damaged colour table: depth all the same.
    let s = setup(1000, Vec::new(), Some(32), 0);
    assert!(notes(&s).contains("no calibration of a colour camera"), "{}", notes(&s));
    // A damaged depth table and no list: nothing is guessed, and what the caller says is taken.
    let mut s = setup(1000, Vec::new(), Some(25), 0);
    let error = open_with(&s.kernel, Box::new(s.kernel.clone()), "/dev/video0".as_ref(), &s.options).unwrap_err();
    assert!(error.to_string().contains("not known: fx, fy, cx, cy"), "{error}");
    let set = &mut s.options.set;
    (set.fx, set.fy, set.cx, set.cy) = (Some(1.0), Some(2.0), Some(3.0), Some(4.0));
    assert!(notes(&s).contains("can't be used"));
    // No extension unit at all.
    s.kernel.world().extension = None;
    assert!(notes(&s).contains("default, 1000 um"));
    s.kernel.check();
}

/// A kernel that does not know the camera's metadata (6.1 and most of them) gives the time stamp all the same.
#[test]
fn bare_headers_give_times_without_counter_and_exposure() {
    let s = setup(1000, record(SIZE, [60.0, 60.0, 32.0, 24.0]), None, 0);
    s.kernel.world().nodes.insert("/dev/video1".into(), NodeScript::meta(b"UVCH"));
    let mut camera = open(&s);
    assert!(camera.info().notes.iter().any(|n| n.contains("camera's clock (UVCH)")), "{:?}", camera.info().notes);
    let mut frame = OwnedFrame::new();
    for _ in 0..40 {
        next(&s, &mut camera, &mut frame);
        assert_eq!(camera.last_info().map(|i| (i.frame_counter, i.exposure)), Some((None, None)));
    }
    assert_eq!(camera.clock_estimate().map(|e| e.pairs), Some(40));
    camera.stop().unwrap();
    s.kernel.check();
}

#[test]
fn metadata_that_is_late_early_or_missing_delays_no_frame() {
    let s = setup(1000, record(SIZE, [60.0, 60.0, 32.0, 24.0]), None, 0);
    s.kernel.world().script = [
        Act::Whole,
        Act::NoMeta,
        Act::Whole,
        Act::Whole,
        Act::LateMeta,
        Act::Whole,
        Act::Whole,
        Act::EarlyMeta,
        Act::Whole,
        Act::NoMeta,
        Act::Whole,
        Act::Whole,
    ]
    .into();
    let mut camera = open(&s);
    let mut frame = OwnedFrame::new();
    let mut with = Vec::new();
    let mut last = 0;
    for n in 0..8 {
        next(&s, &mut camera, &mut frame);
        with.push(camera.last_info().map(|i| i.frame_counter.unwrap() - n));
        let time = frame.time.as_nanos();
        assert!(time > last, "frame {n}");
        last = time;
    }
    // Each metadata is its own frame's: the counter is the frame's number. The early one waited.
    assert_eq!(with, [Some(0), None, Some(0), None, Some(0), Some(0), Some(0), Some(0)]);
    camera.stop().unwrap();
    s.kernel.check();
}

#[test]
fn clock_wraps_and_steps_do_not_turn_time_back() {
    let s = setup(1000, record(SIZE, [60.0, 60.0, 32.0, 24.0]), None, 0);
    let mut acts: Vec<Act> = vec![Act::Clock(u32::MAX - 1_000_000)];
    acts.extend((0..60).map(|_| Act::Whole));
    acts.push(Act::Clock(5));
    acts.extend((0..60).map(|_| Act::Whole));
    s.kernel.world().script = acts.into();
    let mut camera = open(&s);
    let mut frame = OwnedFrame::new();
    let (mut last, mut jumps) = (0, 0);
    for n in 0..120 {
        next(&s, &mut camera, &mut frame);
        let time = frame.time.as_nanos();
        assert!(time > last, "frame {n}: {time} after {last}");
        let age = s.kernel.now().timestamp().as_nanos() - time;
        assert!((0..60_000_000).contains(&age), "frame {n}: {age} ns old");
        last = time;
        jumps += frame.notes.iter().filter(|note| note.contains("jumped")).count();
    }
    assert_eq!(jumps, 1, "a wrap is none, a step is one");
    camera.stop().unwrap();
    s.kernel.check();
}

#[test]
fn frames_lost_inside_the_device_are_counted_apart() {
    let s = setup(1000, record(SIZE, [60.0, 60.0, 32.0, 24.0]), None, 0);
    s.kernel.world().script =
        [Act::Whole, Act::Lose(2), Act::Whole, Act::Skip(3), Act::Whole, Act::Lose(1), Act::Skip(1), Act::Whole].into();
    let mut camera = open(&s);
    let mut frame = OwnedFrame::new();
    for _ in 0..4 {
        next(&s, &mut camera, &mut frame);
    }
    let stats = camera.stats();
    assert_eq!((stats.delivered, stats.dropped_by_device, stats.dropped_by_system), (4, 3, 4));
    assert_eq!(stats.span(), 11, "the device counted 11 frames");
    camera.stop().unwrap();
    s.kernel.check();
}

#[test]
fn every_node_leads_to_depth_and_the_report_says_what_is_what() {
    let s = setup(1000, record(SIZE, [60.0, 60.0, 32.0, 24.0]), None, 0);
    for path in ["/dev/video1", "/dev/video2"] {
        let camera = open_with(&s.kernel, Box::new(s.kernel.clone()), path.as_ref(), &s.options).unwrap();
        assert_eq!(camera.info().path, Path::new("/dev/video0"));
        assert!(camera.info().notes[0].contains("/dev/video0 of the same camera"), "{:?}", camera.info().notes);
    }
    let reports = devices_with(&s.kernel, &s.options.roots);
    assert_eq!(reports.iter().map(|r| r.has_depth).collect::<Vec<_>>(), [true, false, false]);
    let text = reports.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
    assert!(text.contains("/dev/video0: Intel RealSense D435 (8086:0b07)"), "{text}");
    assert!(text.contains("480 Mbit/s") && text.contains("D4XX") && text.contains("colour;"), "{text}");
    s.kernel.fail(kernel::Call::Open, 0, Errno(13));
    let text = devices_with(&s.kernel, &s.options.roots)[0].to_string();
    assert!(text.contains("missing: the right to open it") && text.contains("0b07"), "{text}");
}

#[test]
fn a_device_without_numbers_is_generic_and_junk_in_sysfs_is_passed_over() {
    let root = tempfile::tempdir().unwrap();
    let roots = tree(root.path(), "zzzz", "8086");
    fs::create_dir_all(root.path().join("sys/class/video4linux/videoX")).unwrap();
    fs::create_dir_all(root.path().join("sys/class/video4linux/v4l-subdev0")).unwrap();
    let nodes = roots.nodes();
    assert_eq!(nodes.len(), 3);
    assert!(nodes.iter().all(|n| n.usb.is_none()));
    assert_eq!(Roots { sys: "/nowhere".into(), dev: "/dev".into() }.nodes(), []);
    let kernel = Kernel::new("/dev/video0", NodeScript::video(b"Y16 ", SIZE));
    let text = devices_with(&kernel, &roots)[0].to_string();
    assert!(text.contains("depth as Y16") && text.contains("camera.toml"), "{text}");
    assert_eq!(kernel.world().nodes["/dev/video0".as_ref() as &Path].kind, Kind::Video);
}
