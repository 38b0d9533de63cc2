//! The parsers of recordings: files and lists of any content. An error must say something; what is accepted must hold together.

use isobath_recording::parse::{
    self, NpyData, ParseError, RawImage, RawPixels, decode_depth_png, parse_imu_csv, parse_npy, parse_pgm,
    parse_pose_list, parse_pose_matrix, parse_trajectory_log, parse_tum_list, parse_tum_poses,
};
use isobath_recording::{CameraFile, OpenOptions, open_bytes};
use isobath_source::{Deadline, Outcome, OwnedFrame};

fn speaks<T>(result: Result<T, ParseError>) -> Option<T> {
    match result {
        Ok(value) => Some(value),
        Err(error) => {
            assert!(!error.what.is_empty() && !error.hint.is_empty(), "{error:?}");
            assert!(error.to_string().len() < 2000, "an error message as long as its file");
            None
        }
    }
}

fn holds(image: &RawImage) {
    let count = match &image.pixels {
        RawPixels::U16(v) => v.len(),
        RawPixels::F32(v) => v.len(),
    };
    assert_eq!(count, image.width * image.height);
    assert!(count > 0 && count <= parse::MAX_PIXELS);
}

/// Messages of every kind and encoding: the first byte chooses.
pub fn message(data: &[u8]) {
    use isobath_recording::messages::{Encoding, Kind, Message, decode};
    const KINDS: [Kind; 10] = [
        Kind::Image,
        Kind::CompressedImage,
        Kind::CameraInfo,
        Kind::Transforms,
        Kind::Transform,
        Kind::BareTransform,
        Kind::Pose,
        Kind::Imu,
        Kind::MagneticField,
        Kind::Number,
    ];
    const ENCODINGS: [Encoding; 4] = [Encoding::Cdr, Encoding::Ros1, Encoding::Protobuf, Encoding::Json];
    let Some((&which, bytes)) = data.split_first() else { return };
    let which = usize::from(which);
    let (kind, encoding) = (KINDS[which % KINDS.len()], ENCODINGS[which / KINDS.len() % ENCODINGS.len()]);
    match speaks(decode(kind, encoding, bytes)) {
        Some(Message::Image(image)) => assert!(image.data.len() <= bytes.len()),
        // A transform takes bytes: none is made of nothing (an empty protobuf message takes two).
        Some(Message::Transforms(list)) => assert!(list.len() <= bytes.len() + 1),
        _ => {}
    }
}

/// Whole files of messages, MCAP and bags: what opens has frames whose parts agree.
pub fn open_messages(data: &[u8]) {
    let Ok(mut recording) = open_bytes(data.to_vec(), "fuzz", &OpenOptions::default()) else { return };
    let mut frame = OwnedFrame::new();
    for _ in 0..recording.len().min(4) {
        if matches!(recording.next_into(&mut frame, Deadline::NEVER), Ok(Outcome::Frame)) {
            let (w, h) = frame.size();
            assert!(w * h > 0 && w * h <= parse::MAX_PIXELS);
            assert!(frame.intrinsics.fx().is_finite() && frame.unit.metres() > 0.0);
        }
    }
}

/// NPY arrays.
pub fn npy(data: &[u8]) {
    if let Some(array) = speaks(parse_npy(data)) {
        let count = match &array.data {
            NpyData::U16(v) => v.len(),
            NpyData::F32(v) => v.len(),
        };
        assert_eq!(count, array.width * array.height);
    }
}

/// 16-bit PGM.
pub fn pgm(data: &[u8]) {
    if let Some(image) = speaks(parse_pgm(data)) {
        holds(&image);
    }
}

/// 16-bit PNG.
pub fn depth_png(data: &[u8]) {
    if let Some(image) = speaks(decode_depth_png(data)) {
        holds(&image);
    }
}

/// `camera.toml`.
pub fn camera_file(data: &[u8]) {
    if let Ok(text) = core::str::from_utf8(data) {
        let _ = speaks(CameraFile::parse(text));
    }
}

/// Lists of files and of poses, trajectories and pose matrices.
pub fn lists(data: &[u8]) {
    if let Ok(text) = core::str::from_utf8(data) {
        let lines = text.lines().count();
        assert!(speaks(parse_tum_list(text)).is_none_or(|l| l.len() <= lines));
        assert!(speaks(parse_tum_poses(text)).is_none_or(|l| l.len() <= lines));
        assert!(speaks(parse_trajectory_log(text)).is_none_or(|l| l.len() <= lines));
        assert!(speaks(parse_pose_list(text)).is_none_or(|l| l.len() <= lines));
        assert!(speaks(parse_imu_csv(text)).is_none_or(|l| l.len() <= lines));
        let _ = speaks(parse_pose_matrix(text));
    }
}
