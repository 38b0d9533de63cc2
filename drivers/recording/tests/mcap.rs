//! MCAP: what is recorded comes back, also from a file whose recorder was killed, and also from files of others.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::process::{Command, Stdio};

use isobath::glam::{Quat, Vec3};
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::imu::ImuSample;
use isobath_recording::{McapOptions, McapWriter, OpenOptions, open, open_bytes, open_imu};
use isobath_source::{Deadline, DepthPixels, ImuOutcome, ImuSource as _, Outcome, OwnedFrame, Recording, SourceError};
use proptest::prelude::*;

fn next(r: &mut dyn Recording) -> OwnedFrame {
    let mut frame = OwnedFrame::new();
    assert_eq!(r.next_into(&mut frame, Deadline::NEVER).unwrap(), Outcome::Frame);
    frame
}

fn opened(bytes: Vec<u8>) -> Box<dyn Recording> {
    open_bytes(bytes, "test.mcap", &OpenOptions::default()).unwrap()
}

fn written(frames: &[OwnedFrame]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut w = McapWriter::new(&mut file, "memory", McapOptions::default()).unwrap();
    for (i, frame) in frames.iter().enumerate() {
        w.frame(frame, i as u64 * 33_000_000).unwrap();
    }
    assert_eq!(w.finish().unwrap().frames, frames.len() as u64);
    file
}

/// A frame with everything, its content made from `seed`.
fn frame(seed: u32, (w, h): (usize, usize), unit: f32) -> OwnedFrame {
    let mut frame = OwnedFrame::new();
    let mut state = seed;
    let mut random = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 16
    };
    frame.depth_u16_mut(w, h).fill_with(|| random() as u16);
    frame.confidence_mut().fill_with(|| random() as u8);
    frame.colour_mut(2 * w, 2 * h).fill_with(|| [random() as u8, random() as u8, random() as u8]);
    frame.unit = DepthUnit::new(unit).unwrap();
    frame.intrinsics = Intrinsics::new(0.1 + w as f32, -0.3 - h as f32, w as f32 * 0.499, h as f32 * 0.501).unwrap();
    let turn = Quat::from_rotation_y(seed as f32 * 1e-3);
    frame.pose = Some(Pose::new(turn, Vec3::new(0.1, -2.5, seed as f32)).unwrap());
    frame.time = Timestamp::from_nanos(1_341_841_278_842_700_001 + i64::from(seed) * 33_333_333);
    frame.sequence = u64::from(seed) + 7;
    frame
}

fn assert_same(read: &OwnedFrame, wrote: &OwnedFrame) {
    assert_eq!(read.depth(), wrote.depth());
    assert_eq!((read.unit, read.intrinsics), (wrote.unit, wrote.intrinsics));
    assert_eq!((read.time, read.sequence), (wrote.time, wrote.sequence));
    let rows = |f: &OwnedFrame| f.colour().map(|c| c.rows().map(<[[u8; 3]]>::to_vec).collect::<Vec<_>>());
    assert_eq!(rows(read), rows(wrote));
    let rows = |f: &OwnedFrame| f.confidence().map(|c| c.rows().map(<[u8]>::to_vec).collect::<Vec<_>>());
    assert_eq!(rows(read), rows(wrote));
    assert_eq!(read.pose.is_some(), wrote.pose.is_some());
    if let (Some(a), Some(b)) = (read.pose, wrote.pose) {
        assert!((a.translation() - b.translation()).length() < 1e-6 * (1.0 + b.translation().length()));
        assert!(a.rotation().dot(b.rotation()).abs() > 1.0 - 1e-6);
    }
    assert!(read.notes.is_empty(), "{:?}", read.notes);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    // Any unit, any steps, any part missing: the same frame, to the bit.
    #[test]
    fn a_frame_comes_back_as_it_was(
        seed in any::<u16>(),
        size in (1_usize..9, 1_usize..7),
        unit in prop_oneof![Just(0.001_f32), Just(0.0002), Just(0.0001), 1e-5_f32..2.0],
        parts in 0_u8..8,
    ) {
        let mut frames: Vec<_> = (0..3).map(|i| frame(u32::from(seed) + i, size, unit)).collect();
        for f in &mut frames {
            if parts & 1 != 0 { f.clear_colour(); }
            if parts & 2 != 0 { f.clear_confidence(); }
            if parts & 4 != 0 { f.pose = None; }
        }
        let mut recording = opened(written(&frames));
        prop_assert_eq!(recording.len(), 3);
        for f in &frames {
            assert_same(&next(recording.as_mut()), f);
        }
        let mut end = OwnedFrame::new();
        prop_assert_eq!(recording.next_into(&mut end, Deadline::NEVER).unwrap(), Outcome::EndOfStream);
        recording.seek(1).unwrap();
        assert_same(&next(recording.as_mut()), &frames[1]);
    }

    #[test]
    fn metres_in_floating_point_come_back_to_the_bit(values in prop::collection::vec(any::<f32>(), 6)) {
        let mut f = OwnedFrame::new();
        f.depth_f32_mut(3, 2).copy_from_slice(&values);
        f.unit = DepthUnit::METRE;
        let read = next(opened(written(&[f])).as_mut());
        let DepthPixels::F32(read) = read.depth() else { panic!("f32 was written") };
        prop_assert_eq!(read.iter().map(|v| v.to_bits()).collect::<Vec<_>>(), values.iter().map(|v| v.to_bits()).collect::<Vec<_>>());
    }

    // Whatever happens to the bytes of a file, there is an answer, soon, and no panic.
    #[test]
    fn damaged_files_give_an_answer(cut in 0.0_f64..1.0, at in 0.0_f64..1.0, flip in any::<u8>(), cuts in any::<bool>()) {
        let mut bytes = written(&[frame(1, (4, 3), 0.001), frame(2, (4, 3), 0.001)]);
        let at = (at * bytes.len() as f64) as usize;
        bytes[at] ^= flip;
        if cuts {
            bytes.truncate((cut * bytes.len() as f64) as usize);
        }
        if let Ok(mut r) = open_bytes(bytes, "damaged", &OpenOptions::default()) {
            let mut f = OwnedFrame::new();
            for _ in 0..r.len() {
                let _ = r.next_into(&mut f, Deadline::NEVER);
            }
        }
    }
}

#[test]
fn millimetres_are_written_as_such_and_other_units_as_metres() {
    for (unit, encoding) in [(0.001, "16UC1"), (0.0002, "32FC1")] {
        let bytes = written(&[frame(1, (4, 3), unit)]);
        let found = |text: &str| bytes.windows(text.len()).any(|w| w == text.as_bytes());
        // With the zero that ends a CDR string: as an image's encoding, not in a definition.
        assert!(found(&format!("{encoding}\0")), "{unit}");
    }
}

#[test]
fn inertial_readings_come_back_to_the_bit_and_pauses_are_kept_out() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("imu.mcap");
    let mut w = McapWriter::create(&path, McapOptions::default()).unwrap();
    let sample = |i: i32| ImuSample {
        time: Timestamp::from_nanos(i64::from(i) * 5_000_000),
        rate: Vec3::new(0.1 * i as f32, -0.2, 0.3),
        force: Vec3::new(0.0, -9.806_65, i as f32 * 1e-3),
        field: (i % 2 == 0).then(|| Vec3::new(21.3, -4.7 * i as f32, 43.1)),
    };
    for i in 0..200 {
        w.imu(&sample(i), i as u64 * 5_000_000).unwrap();
        if i == 100 {
            w.pause().unwrap();
            assert!(w.is_paused());
            w.frame(&frame(1, (4, 3), 0.001), 0).unwrap();
            w.imu(&sample(-1), 0).unwrap();
            w.resume();
        }
        if i % 50 == 0 {
            w.frame(&frame(1, (4, 3), 0.001), i as u64 * 5_000_000).unwrap();
        }
    }
    let done = w.finish().unwrap();
    assert_eq!((done.frames, done.imu_samples, done.paused_frames), (4, 200, 1));
    let error = McapWriter::create(&path, McapOptions::default()).unwrap_err();
    assert!(error.to_string().contains("never overwritten"), "{error}");

    let mut imu = open_imu(&path).unwrap().expect("readings");
    assert_eq!(imu.len(), 200);
    assert!((imu.info().rate_hz - 200.0).abs() < 0.1, "{}", imu.info().rate_hz);
    let empty = ImuSample { time: Timestamp::ZERO, rate: Vec3::ZERO, force: Vec3::ZERO, field: None };
    let mut out = [empty; 64];
    let mut all = Vec::new();
    while let ImuOutcome::Samples(n) = imu.read(&mut out, Deadline::NEVER).unwrap() {
        all.extend_from_slice(&out[..n]);
    }
    assert_eq!(all.len(), 200);
    for (i, read) in all.iter().enumerate() {
        let wrote = sample(i as i32);
        assert_eq!((read.time, read.rate, read.force), (wrote.time, wrote.rate, wrote.force));
        if let Some(field) = wrote.field {
            assert!(read.field.unwrap().abs_diff_eq(field, 1e-5), "{i}");
        }
    }
    assert_eq!(open(&path, &OpenOptions::default()).unwrap().len(), 4);
}

#[test]
fn a_writer_is_a_sink_of_frames_on_their_way() {
    let wrote = [frame(1, (4, 3), 0.001), frame(2, (4, 3), 0.001)];
    let source = opened(written(&wrote));
    let mut file = Vec::new();
    let sink = McapWriter::new(&mut file, "memory", McapOptions::default()).unwrap();
    let mut through = isobath_source::Recorded::new(source, sink);
    let mut f = OwnedFrame::new();
    while isobath_source::DepthSource::next_into(&mut through, &mut f, Deadline::NEVER).unwrap() == Outcome::Frame {}
    assert_eq!(through.sink().recorded().frames, 2);
    drop(through);
    let mut again = opened(file);
    for f in &wrote {
        assert_same(&next(again.as_mut()), f);
    }
}

#[test]
fn a_file_cut_off_anywhere_opens_up_to_there() {
    let frames: Vec<_> = (0..6).map(|i| frame(i, (320, 240), 0.0002)).collect();
    let mut file = Vec::new();
    let mut w = McapWriter::new(&mut file, "memory", McapOptions::default()).unwrap();
    let mut ends = Vec::new();
    for (i, f) in frames.iter().enumerate() {
        // Two seconds apart: each is a chunk of its own.
        w.frame(f, i as u64 * 2_000_000_000).unwrap();
        w.flush().unwrap();
        ends.push(());
    }
    drop(w);
    let whole = opened(file.clone()).len();
    assert_eq!((whole, ends.len()), (6, 6));
    let mut seen = 0;
    for cut in (0..file.len()).rev().step_by(file.len() / 40) {
        let Ok(mut r) = open_bytes(file[..cut].to_vec(), "cut", &OpenOptions::default()) else { continue };
        seen = seen.max(r.len());
        assert!(r.info().notes.iter().any(|n| n.contains("cut off") || n.contains("no index")), "{:?}", r.info().notes);
        for wrote in frames.iter().take(r.len()) {
            assert_same(&next(r.as_mut()), wrote);
        }
        // All frames whose bytes are there are there: a frame is a seventh of a chunk's share at least.
        assert!(r.len() >= (cut * 6 / file.len()).saturating_sub(1), "{cut}: {}", r.len());
    }
    assert!(seen >= 5);
}

/// The recorder that [`a_killed_recorder_leaves_a_readable_file`] kills.
#[test]
#[ignore = "run as a process by another test"]
fn recorder() {
    let path = std::env::var_os("ISOBATH_RECORDER").expect("a path");
    let mut w = McapWriter::create(path.as_ref(), McapOptions::default()).unwrap();
    for i in 0.. {
        // A second apart: each frame but the first writes out the chunk before.
        w.frame(&frame(i, (64, 48), 0.001), u64::from(i) * 1_000_000_000).unwrap();
        println!("frame {i}");
        io::stdout().flush().unwrap();
        if i == 20 {
            // Never finished, never dropped.
            std::thread::sleep(std::time::Duration::from_secs(600));
        }
    }
}

#[test]
fn a_killed_recorder_leaves_a_readable_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("killed.mcap");
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["recorder", "--exact", "--ignored", "--nocapture"])
        .env("ISOBATH_RECORDER", &path)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    // By what it says, not by time: it is killed when it has taken frame 20.
    let out = io::BufReader::new(child.stdout.take().unwrap());
    assert!(io::BufRead::lines(out).any(|line| line.is_ok_and(|l| l.contains("frame 20"))));
    child.kill().unwrap(); // SIGKILL
    child.wait().unwrap();

    let mut r = open(&path, &OpenOptions::default()).unwrap();
    assert_eq!(r.len(), 20, "all but the open chunk");
    assert!(r.info().notes.iter().any(|n| n.contains("cut off")), "{:?}", r.info().notes);
    for i in 0..20 {
        assert_same(&next(r.as_mut()), &frame(i, (64, 48), 0.001));
    }
}

/// A disk with room for so many bytes.
struct Disk<'a> {
    content: &'a mut Vec<u8>,
    room: usize,
}

impl Write for Disk<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let fits = bytes.len().min(self.room - self.content.len());
        if fits == 0 && !bytes.is_empty() {
            return Err(io::Error::from(io::ErrorKind::StorageFull));
        }
        self.content.extend_from_slice(&bytes[..fits]);
        Ok(fits)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_said_and_what_was_written_opens() {
    let mut content = Vec::new();
    let mut w = McapWriter::new(Disk { content: &mut content, room: 100_000 }, "full", McapOptions::default()).unwrap();
    let mut failure = None;
    for i in 0..100 {
        if let Err(e) = w.frame(&frame(i, (64, 48), 0.001), u64::from(i) * 1_000_000_000) {
            failure.get_or_insert(e);
        }
    }
    let failure = failure.expect("the disk is full");
    assert!(matches!(failure, SourceError::Io { .. }) && failure.to_string().contains("no room left"), "{failure}");
    assert!(w.finish().is_err(), "a file that is not whole is never called finished");
    let mut r = opened(content);
    assert!(r.len() >= 2, "{}", r.len());
    for i in 0..r.len() {
        assert_same(&next(r.as_mut()), &frame(i as u32, (64, 48), 0.001));
    }
}

#[test]
fn what_a_file_cannot_hold_is_refused_and_the_file_goes_on() {
    let mut file = Vec::new();
    let mut w = McapWriter::new(&mut file, "memory", McapOptions::default()).unwrap();
    w.frame(&frame(1, (4, 3), 0.001), 0).unwrap();
    let other = w.frame(&frame(2, (4, 3), 0.002), 1).unwrap_err();
    assert!(other.to_string().contains("one unit"), "{other}");
    assert!(w.frame(&OwnedFrame::new(), 2).is_err());
    let mut late = frame(3, (4, 3), 0.001);
    late.time = Timestamp::from_nanos(i64::MAX);
    assert!(w.frame(&late, 3).unwrap_err().to_string().contains("68 years"));
    w.frame(&frame(4, (4, 3), 0.001), 4).unwrap();
    w.finish().unwrap();
    assert_eq!(opened(file).len(), 2);
}

// ------------------------------------------------------------------------------------------------- files that others wrote

/// What a foreign file is made of: topic, schema, message encoding, log time, content.
type Foreign<'a> = (&'a str, &'a str, &'a str, u64, Vec<u8>);

fn foreign(messages: &[Foreign<'_>], chunks: bool) -> Vec<u8> {
    let mut file = io::Cursor::new(Vec::new());
    let mut w = mcap::WriteOptions::new().use_chunks(chunks).create(&mut file).unwrap();
    for (topic, schema, encoding, log_time, data) in messages {
        let schema = w.add_schema(schema, "", b"").unwrap();
        let channel_id = w.add_channel(schema, topic, encoding, &BTreeMap::new()).unwrap();
        let (log_time, publish_time) = (*log_time, *log_time);
        w.write_to_known_channel(
            &mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time },
            data,
        )
        .unwrap();
    }
    w.finish().unwrap();
    drop(w);
    file.into_inner()
}

const CAMERA_JSON: &str = r#"{"timestamp":{"sec":5,"nsec":6},"frame_id":"c","width":2,"height":1,"distortion_model":"","D":[],
    "K":[100,0,0.5,0,101,0.25,0,0,1],"R":[],"P":[]}"#;

fn json_image(encoding: &str, step: u32, base64: &str) -> Vec<u8> {
    format!(
        r#"{{"timestamp":{{"sec":5,"nsec":6}},"frame_id":"c","width":2,"height":1,"encoding":"{encoding}","step":{step},"data":"{base64}"}}"#
    )
    .into_bytes()
}

#[test]
fn foxglove_json_is_read_and_says_what_was_assumed() {
    let pose = r#"{"timestamp":{"sec":5,"nsec":6},"frame_id":"map","pose":{"position":{"x":1,"y":2,"z":3},"orientation":{"x":0,"y":0,"z":0,"w":1}}}"#;
    for chunks in [true, false] {
        let bytes = foreign(
            &[
                ("/depth", "foxglove.RawImage", "json", 10, json_image("16UC1", 4, "6AMAAA==")),
                ("/rgb", "foxglove.RawImage", "json", 12, json_image("rgb8", 6, "AQIDBAUG")),
                ("/info", "foxglove.CameraCalibration", "json", 3, CAMERA_JSON.into()),
                ("/pose", "foxglove.PoseInFrame", "json", 11, pose.into()),
                ("/chatter", "std_msgs/String", "json", 11, b"{}".to_vec()),
            ],
            chunks,
        );
        let mut r = opened(bytes);
        let notes = r.info().notes.join("\n");
        assert!(
            notes.contains("taken to be millimetres") && notes.contains("taken to be the depth camera's"),
            "{notes}"
        );
        let f = next(r.as_mut());
        assert_eq!((f.depth(), f.unit), (&DepthPixels::U16(vec![1000, 0]), DepthUnit::MILLIMETRE));
        assert_eq!(f.time, Timestamp::from_nanos(5_000_000_006));
        assert_eq!((f.intrinsics.fy(), f.intrinsics.cy()), (101.0, 0.25));
        assert_eq!(f.colour().unwrap().rows().next().unwrap(), [[1, 2, 3], [4, 5, 6]]);
        assert_eq!(f.pose.unwrap().translation(), Vec3::new(1.0, 2.0, 3.0));
    }
}

/// Protobuf, field by field.
fn pb(fields: &[(u32, Pb<'_>)]) -> Vec<u8> {
    fn varint(out: &mut Vec<u8>, mut v: u64) {
        while v >= 0x80 {
            out.push(v as u8 | 0x80);
            v >>= 7;
        }
        out.push(v as u8);
    }
    let mut out = Vec::new();
    for (field, value) in fields {
        let (wire, bytes): (u64, Vec<u8>) = match value {
            Pb::Var(v) => {
                let mut bytes = Vec::new();
                varint(&mut bytes, *v);
                (0, bytes)
            }
            Pb::Double(v) => (1, v.to_le_bytes().into()),
            Pb::Fixed(v) => (5, v.to_le_bytes().into()),
            Pb::Bytes(b) => {
                let mut bytes = Vec::new();
                varint(&mut bytes, b.len() as u64);
                bytes.extend_from_slice(b);
                (2, bytes)
            }
        };
        varint(&mut out, u64::from(*field) << 3 | wire);
        out.extend(bytes);
    }
    out
}

enum Pb<'a> {
    Var(u64),
    Double(f64),
    Fixed(u32),
    Bytes(&'a [u8]),
}

#[test]
fn foxglove_protobuf_and_transforms_are_read() {
    let time = pb(&[(1, Pb::Var(7)), (2, Pb::Var(8))]);
    let image = pb(&[
        (1, Pb::Bytes(&time)),
        (2, Pb::Fixed(2)),
        (3, Pb::Fixed(1)),
        (4, Pb::Bytes(b"32FC1")),
        (5, Pb::Fixed(8)),
        (6, Pb::Bytes(&[0, 0, 0xc0, 0x3f, 0, 0, 0xc0, 0x7f])),
        (7, Pb::Bytes(b"optical")),
    ]);
    let k: Vec<u8> =
        [100.0, 0.0, 0.5, 0.0, 101.0, 0.25, 0.0, 0.0, 1.0_f64].iter().flat_map(|v| v.to_le_bytes()).collect();
    let info = pb(&[
        (1, Pb::Bytes(&time)),
        (2, Pb::Fixed(2)),
        (3, Pb::Fixed(1)),
        (6, Pb::Bytes(&k)),
        (9, Pb::Bytes(b"optical")),
    ]);
    let transform = |parent: &[u8], child: &[u8], x: f64| {
        let shift = pb(&[(1, Pb::Double(x))]);
        let turn = pb(&[(4, Pb::Double(1.0))]);
        pb(&[
            (1, Pb::Bytes(&time)),
            (2, Pb::Bytes(parent)),
            (3, Pb::Bytes(child)),
            (4, Pb::Bytes(&shift)),
            (5, Pb::Bytes(&turn)),
        ])
    };
    let fixed = transform(b"body", b"optical", 0.25);
    let moving = pb(&[(1, Pb::Bytes(&transform(b"map", b"body", 1.0)))]);
    let later = pb(&[(1, Pb::Bytes(&transform(b"map", b"body", 9.0)))]);
    let bytes = foreign(
        &[
            ("/d", "foxglove.RawImage", "protobuf", 1_000, image),
            ("/i", "foxglove.CameraCalibration", "protobuf", 1_000, info),
            ("/tf_static", "foxglove.FrameTransform", "protobuf", 0, fixed),
            ("/tf", "foxglove.FrameTransforms", "protobuf", 990, moving),
            ("/tf", "foxglove.FrameTransforms", "protobuf", 1_200, later),
        ],
        true,
    );
    let mut r = opened(bytes);
    let f = next(r.as_mut());
    let DepthPixels::F32(z) = f.depth() else { panic!("metres") };
    assert!(z[0] == 1.5 && z[1].is_nan() && f.unit == DepthUnit::METRE);
    assert_eq!(f.intrinsics.fx(), 100.0);
    // The nearer of the two, through the bracket.
    assert_eq!(f.pose.unwrap().translation(), Vec3::new(1.25, 0.0, 0.0));
    assert_eq!(r.info().up, Some(Vec3::Z));
}

#[test]
fn files_that_are_not_depth_say_what_they_hold() {
    let bytes = foreign(&[("/rgb", "foxglove.RawImage", "json", 12, json_image("rgb8", 6, "AQIDBAUG"))], true);
    let error = open_bytes(bytes, "x", &OpenOptions::default()).err().unwrap().to_string();
    assert!(error.contains("no depth images") && error.contains("/rgb"), "{error}");
    let bytes = foreign(&[("/depth", "foxglove.RawImage", "json", 10, json_image("16UC1", 4, "6AMAAA=="))], true);
    let error = open_bytes(bytes.clone(), "x", &OpenOptions::default()).err().unwrap();
    assert!(matches!(error, SourceError::MissingCalibration { .. }), "{error}");
    let mut options = OpenOptions::default();
    let set = &mut options.set;
    (set.fx, set.fy, set.cx, set.cy) = (Some(1.0), Some(1.0), Some(0.0), Some(0.0));
    set.depth.unit = Some(0.0001);
    let f = next(open_bytes(bytes, "x", &options).unwrap().as_mut());
    assert!((f.z(0, 0) - 0.1).abs() < 1e-6);
}

/// Packs the one chunk of a file anew, and lets the walk find it (the index would tell of the old one).
fn repacked(file: &[u8], compression: &str, pack: impl Fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
    let mut out = mcap::MAGIC.to_vec();
    let mut at = mcap::MAGIC.len();
    while at < file.len() {
        let (op, len) = (file[at], u64::from_le_bytes(file[at + 1..at + 9].try_into().unwrap()) as usize);
        let body = &file[at + 9..at + 9 + len];
        at += 9 + len;
        let mut body = body.to_vec();
        if op == mcap::records::op::CHUNK {
            // start, end, size, crc; compression of no letters; length.
            let packed = pack(&body[40..]);
            body.truncate(28);
            body.extend((compression.len() as u32).to_le_bytes());
            body.extend(compression.as_bytes());
            body.extend((packed.len() as u64).to_le_bytes());
            body.extend(packed);
        }
        if op == mcap::records::op::DATA_END {
            break;
        }
        out.push(op);
        out.extend((body.len() as u64).to_le_bytes());
        out.extend(body);
    }
    out
}

#[test]
fn packed_chunks_are_unpacked() {
    let frames = [frame(1, (16, 12), 0.001), frame(2, (16, 12), 0.001)];
    let file = written(&frames);
    let lz4 = |bytes: &[u8]| {
        let mut e = lz4_flex::frame::FrameEncoder::new(Vec::new());
        e.write_all(bytes).unwrap();
        e.finish().unwrap()
    };
    let zstd = |bytes: &[u8]| ruzstd::encoding::compress_to_vec(bytes, ruzstd::encoding::CompressionLevel::Fastest);
    for packed in [repacked(&file, "lz4", lz4), repacked(&file, "zstd", zstd)] {
        let mut r = opened(packed);
        assert_eq!(r.len(), 2);
        for f in &frames {
            assert_same(&next(r.as_mut()), f);
        }
    }
    // A chunk that can't be unpacked is left out, and a file without the rest is told apart.
    let broken = repacked(&file, "lz4", |_| vec![1, 2, 3]);
    assert!(open_bytes(broken, "x", &OpenOptions::default()).is_err());
}
