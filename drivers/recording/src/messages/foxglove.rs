//! Foxglove's schemas, in protobuf and in JSON: the same names, so one description a schema does for both. Fields that are not
//! known are passed over, as protobuf wants it.

use std::borrow::Cow;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use isobath::ground::units::Timestamp;
use serde::Deserialize;

use super::{CameraInfo, Image, Kind, Message, Transform, cut_off, stamp};
use crate::parse::ParseError;

fn other(kind: Kind, encoding: &str) -> ParseError {
    ParseError::new(format!("{kind:?} messages in {encoding} are not known here"), "ROS messages (cdr, ros1) are")
}

// ---------------------------------------------------------------------------------------------------------------- protobuf

/// One field's value: numbers are their bits.
enum Value<'a> {
    Number(u64),
    Bytes(&'a [u8]),
}

impl<'a> Value<'a> {
    fn bytes(&self) -> &'a [u8] {
        match self {
            Self::Bytes(bytes) => bytes,
            Self::Number(_) => &[],
        }
    }

    fn u32(&self) -> u32 {
        match self {
            Self::Number(n) => u32::try_from(*n).unwrap_or(u32::MAX),
            Self::Bytes(_) => 0,
        }
    }

    fn i64(&self) -> i64 {
        match self {
            Self::Number(n) => n.cast_signed(),
            Self::Bytes(_) => 0,
        }
    }

    fn f64(&self) -> f64 {
        match self {
            Self::Number(n) => f64::from_bits(*n),
            Self::Bytes(_) => 0.0,
        }
    }

    fn text(&self) -> Result<&'a str, ParseError> {
        std::str::from_utf8(self.bytes())
            .map_err(|_| ParseError::new("a name in a message is not text", "the file is damaged: copy it again"))
    }
}

fn varint(bytes: &mut &[u8]) -> Result<u64, ParseError> {
    let mut value = 0_u64;
    for shift in (0..70).step_by(7) {
        let (&byte, rest) = bytes.split_first().ok_or_else(cut_off)?;
        *bytes = rest;
        value |= u64::from(byte & 0x7f).checked_shl(shift).unwrap_or(0);
        if byte < 0x80 {
            return Ok(value);
        }
    }
    Err(ParseError::new("a number in a message does not end", "the file is damaged: copy it again"))
}

/// Calls `each` with the number and the value of every field.
fn fields<'a>(
    mut bytes: &'a [u8],
    mut each: impl FnMut(u64, Value<'a>) -> Result<(), ParseError>,
) -> Result<(), ParseError> {
    while !bytes.is_empty() {
        let tag = varint(&mut bytes)?;
        let value = match tag & 7 {
            0 => Value::Number(varint(&mut bytes)?),
            1 => {
                let (number, rest) = bytes.split_first_chunk().ok_or_else(cut_off)?;
                bytes = rest;
                Value::Number(u64::from_le_bytes(*number))
            }
            2 => {
                let len = usize::try_from(varint(&mut bytes)?).map_err(|_| cut_off())?;
                let (value, rest) = bytes.split_at_checked(len).ok_or_else(cut_off)?;
                bytes = rest;
                Value::Bytes(value)
            }
            5 => {
                let (number, rest) = bytes.split_first_chunk().ok_or_else(cut_off)?;
                bytes = rest;
                Value::Number(u64::from(u32::from_le_bytes(*number)))
            }
            _ => return Err(ParseError::new("a message is not protobuf", "the file is damaged: copy it again")),
        };
        each(tag >> 3, value)?;
    }
    Ok(())
}

fn time(bytes: &[u8]) -> Result<Timestamp, ParseError> {
    let (mut seconds, mut nanos) = (0, 0);
    fields(bytes, |field, value| {
        match field {
            1 => seconds = value.i64(),
            2 => nanos = value.i64(),
            _ => {}
        }
        Ok(())
    })?;
    Ok(stamp(seconds, nanos))
}

/// `Vector3`, `Quaternion`, `Point`.
fn doubles<const N: usize>(bytes: &[u8]) -> Result<[f64; N], ParseError> {
    let mut out = [0.0; N];
    fields(bytes, |field, value| {
        if let Some(slot) = usize::try_from(field).ok().and_then(|f| out.get_mut(f.wrapping_sub(1))) {
            *slot = value.f64();
        }
        Ok(())
    })?;
    Ok(out)
}

/// A repeated double, packed or one by one.
fn push(list: &mut Vec<f64>, value: &Value<'_>) {
    match value {
        Value::Number(n) => list.push(f64::from_bits(*n)),
        Value::Bytes(bytes) => list.extend(bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b))),
    }
}

fn transform(bytes: &[u8]) -> Result<Transform, ParseError> {
    let mut t = Transform::default();
    fields(bytes, |field, value| {
        match field {
            1 => t.stamp = time(value.bytes())?,
            2 => t.parent = value.text()?.into(),
            3 => t.child = value.text()?.into(),
            4 => t.translation = doubles(value.bytes())?,
            5 => t.rotation = doubles(value.bytes())?,
            _ => {}
        }
        Ok(())
    })?;
    Ok(t)
}

fn matrix(values: &[f64]) -> [f64; 9] {
    values.try_into().unwrap_or_default()
}

pub(super) fn decode_protobuf(kind: Kind, bytes: &[u8]) -> Result<Message<'_>, ParseError> {
    match kind {
        Kind::Image | Kind::CompressedImage => {
            let mut image = Image::default();
            let raw = kind == Kind::Image;
            fields(bytes, |field, value| {
                match (field, raw) {
                    (1, _) => image.stamp = time(value.bytes())?,
                    (2, true) => image.width = value.u32(),
                    (3, true) => image.height = value.u32(),
                    (4, true) | (3, false) => image.encoding = Cow::Borrowed(value.text()?),
                    (5, true) => image.step = value.u32(),
                    (6, true) | (2, false) => image.data = Cow::Borrowed(value.bytes()),
                    (7, true) | (4, false) => image.frame = Cow::Borrowed(value.text()?),
                    _ => {}
                }
                Ok(())
            })?;
            Ok(Message::Image(image))
        }
        Kind::CameraInfo => {
            let (mut info, mut k) = (CameraInfo::default(), Vec::new());
            fields(bytes, |field, value| {
                match field {
                    1 => info.stamp = time(value.bytes())?,
                    2 => info.width = value.u32(),
                    3 => info.height = value.u32(),
                    4 => info.model = value.text()?.into(),
                    5 => push(&mut info.d, &value),
                    6 => push(&mut k, &value),
                    9 => info.frame = value.text()?.into(),
                    _ => {}
                }
                Ok(())
            })?;
            info.k = matrix(&k);
            Ok(Message::CameraInfo(info))
        }
        Kind::Transform => Ok(Message::Transforms(vec![transform(bytes)?])),
        Kind::Transforms => {
            let mut transforms = Vec::new();
            fields(bytes, |field, value| {
                if field == 1 {
                    transforms.push(transform(value.bytes())?);
                }
                Ok(())
            })?;
            Ok(Message::Transforms(transforms))
        }
        Kind::Pose => {
            let mut t = Transform::default();
            fields(bytes, |field, value| {
                match field {
                    1 => t.stamp = time(value.bytes())?,
                    2 => t.parent = value.text()?.into(),
                    3 => fields(value.bytes(), |field, value| {
                        match field {
                            1 => t.translation = doubles(value.bytes())?,
                            2 => t.rotation = doubles(value.bytes())?,
                            _ => {}
                        }
                        Ok(())
                    })?,
                    _ => {}
                }
                Ok(())
            })?;
            Ok(Message::Transforms(vec![t]))
        }
        _ => Err(other(kind, "protobuf")),
    }
}

// -------------------------------------------------------------------------------------------------------------------- JSON

#[derive(Deserialize, Default)]
#[serde(default)]
struct JsonTime {
    sec: i64,
    #[serde(alias = "nanosec")]
    nsec: i64,
}

impl JsonTime {
    fn stamp(&self) -> Timestamp {
        stamp(self.sec, self.nsec)
    }
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct JsonImage<'a> {
    timestamp: JsonTime,
    #[serde(borrow)]
    frame_id: Cow<'a, str>,
    width: u32,
    height: u32,
    encoding: Cow<'a, str>,
    format: Cow<'a, str>,
    step: u32,
    #[serde(borrow)]
    data: Cow<'a, str>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct JsonCamera {
    timestamp: JsonTime,
    frame_id: String,
    width: u32,
    height: u32,
    distortion_model: String,
    #[serde(rename = "D")]
    d: Vec<f64>,
    #[serde(rename = "K")]
    k: Vec<f64>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Xyzw {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct JsonPose {
    position: Xyzw,
    orientation: Xyzw,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct JsonPoseInFrame {
    timestamp: JsonTime,
    frame_id: String,
    pose: JsonPose,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct JsonTransform {
    timestamp: JsonTime,
    parent_frame_id: String,
    child_frame_id: String,
    translation: Xyzw,
    rotation: Xyzw,
}

impl From<JsonTransform> for Transform {
    fn from(t: JsonTransform) -> Self {
        let (p, q) = (t.translation, t.rotation);
        Self {
            stamp: t.timestamp.stamp(),
            parent: t.parent_frame_id,
            child: t.child_frame_id,
            translation: [p.x, p.y, p.z],
            rotation: [q.x, q.y, q.z, q.w],
        }
    }
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct JsonTransforms {
    transforms: Vec<JsonTransform>,
}

fn json<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<T, ParseError> {
    serde_json::from_slice(bytes).map_err(|e| {
        ParseError::new(format!("a message is not the JSON it should be: {e}"), "check who wrote the file")
    })
}

pub(super) fn decode_json(kind: Kind, bytes: &[u8]) -> Result<Message<'_>, ParseError> {
    Ok(match kind {
        Kind::Image | Kind::CompressedImage => {
            let j: JsonImage<'_> = json(bytes)?;
            let data = STANDARD.decode(j.data.as_bytes()).map_err(|e| {
                ParseError::new(format!("an image's data is not base64: {e}"), "the file is damaged: copy it again")
            })?;
            Message::Image(Image {
                stamp: j.timestamp.stamp(),
                frame: j.frame_id,
                width: j.width,
                height: j.height,
                encoding: if kind == Kind::Image { j.encoding } else { j.format },
                big_endian: false,
                step: j.step,
                data: Cow::Owned(data),
            })
        }
        Kind::CameraInfo => {
            let j: JsonCamera = json(bytes)?;
            Message::CameraInfo(CameraInfo {
                stamp: j.timestamp.stamp(),
                frame: j.frame_id,
                width: j.width,
                height: j.height,
                model: j.distortion_model,
                k: matrix(&j.k),
                d: j.d,
            })
        }
        Kind::Transform => Message::Transforms(vec![json::<JsonTransform>(bytes)?.into()]),
        Kind::Transforms => {
            Message::Transforms(json::<JsonTransforms>(bytes)?.transforms.into_iter().map(Transform::from).collect())
        }
        Kind::Pose => {
            let j: JsonPoseInFrame = json(bytes)?;
            let (p, q) = (j.pose.position, j.pose.orientation);
            Message::Transforms(vec![Transform {
                stamp: j.timestamp.stamp(),
                parent: j.frame_id,
                child: String::new(),
                translation: [p.x, p.y, p.z],
                rotation: [q.x, q.y, q.z, q.w],
            }])
        }
        _ => return Err(other(kind, "JSON")),
    })
}
