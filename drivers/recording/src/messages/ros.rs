//! ROS messages read. CDR (ROS 2) aligns every number to its own size, ends strings with a zero and opens with four bytes that
//! name the byte order; ROS 1 packs tightly, little endian, and its headers carry a counter. Field for field they are the same.

use std::borrow::Cow;

use isobath::ground::units::Timestamp;

use super::{CameraInfo, Encoding, Image, Imu, Kind, Message, Transform, cut_off, stamp};
use crate::parse::ParseError;

/// The fields of a message, one after the other.
struct Fields<'a> {
    bytes: &'a [u8],
    at: usize,
    ros1: bool,
    big: bool,
}

type Field<T> = Result<T, ParseError>;

impl<'a> Fields<'a> {
    fn new(encoding: Encoding, bytes: &'a [u8]) -> Field<Self> {
        if encoding == Encoding::Ros1 {
            return Ok(Self { bytes, at: 0, ros1: true, big: false });
        }
        let (&[kind, order, _, _], bytes) = bytes.split_first_chunk().ok_or_else(cut_off)?;
        if kind != 0 || order > 1 {
            return Err(ParseError::new(
                format!("a message is packed as CDR {kind:#04x} {order:#04x}; plain CDR (0, 0 or 1) is read"),
                "record with a middleware that sends plain CDR, as ROS 2's do by default",
            ));
        }
        Ok(Self { bytes, at: 0, ros1: false, big: order == 0 })
    }

    fn take(&mut self, len: usize) -> Field<&'a [u8]> {
        let end = self.at.checked_add(len).ok_or_else(cut_off)?;
        let taken = self.bytes.get(self.at..end).ok_or_else(cut_off)?;
        self.at = end;
        Ok(taken)
    }

    fn number<const N: usize>(&mut self) -> Field<[u8; N]> {
        if !self.ros1 {
            self.at = self.at.next_multiple_of(N);
        }
        let mut bytes: [u8; N] = self.take(N)?.try_into().map_err(|_| cut_off())?;
        if self.big {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn u8(&mut self) -> Field<u8> {
        self.number().map(u8::from_le_bytes)
    }

    fn u32(&mut self) -> Field<u32> {
        self.number().map(u32::from_le_bytes)
    }

    fn f64(&mut self) -> Field<f64> {
        self.number().map(f64::from_le_bytes)
    }

    fn f64s<const N: usize>(&mut self) -> Field<[f64; N]> {
        let mut out = [0.0; N];
        for v in &mut out {
            *v = self.f64()?;
        }
        Ok(out)
    }

    /// A sequence of bytes.
    fn data(&mut self) -> Field<&'a [u8]> {
        let len = self.u32()? as usize;
        self.take(len)
    }

    fn text(&mut self) -> Field<&'a str> {
        let bytes = self.data()?;
        let bytes = if self.ros1 { bytes } else { bytes.strip_suffix(&[0]).unwrap_or(bytes) };
        std::str::from_utf8(bytes)
            .map_err(|_| ParseError::new("a name in a message is not text", "the file is damaged: copy it again"))
    }

    fn header(&mut self) -> Field<(Timestamp, &'a str)> {
        if self.ros1 {
            self.u32()?; // the sender's counter
        }
        let seconds = self.u32()?;
        // ROS 1's seconds have no sign, ROS 2's have.
        let seconds = if self.ros1 { i64::from(seconds) } else { i64::from(seconds.cast_signed()) };
        let time = stamp(seconds, i64::from(self.u32()?));
        Ok((time, self.text()?))
    }

    fn transform(&mut self) -> Field<Transform> {
        let (stamp, parent) = self.header()?;
        let child = self.text()?;
        let (translation, rotation) = (self.f64s()?, self.f64s()?);
        Ok(Transform { stamp, parent: parent.into(), child: child.into(), translation, rotation })
    }
}

pub(super) fn decode(kind: Kind, encoding: Encoding, bytes: &[u8]) -> Result<Message<'_>, ParseError> {
    let mut f = Fields::new(encoding, bytes)?;
    Ok(match kind {
        Kind::Image => {
            let (stamp, frame) = f.header()?;
            let (height, width) = (f.u32()?, f.u32()?);
            let encoding = f.text()?;
            let big_endian = f.u8()? != 0;
            let step = f.u32()?;
            let data = f.data()?;
            Message::Image(Image {
                stamp,
                frame: Cow::Borrowed(frame),
                width,
                height,
                encoding: Cow::Borrowed(encoding),
                big_endian,
                step,
                data: Cow::Borrowed(data),
            })
        }
        Kind::CompressedImage => {
            let (stamp, frame) = f.header()?;
            let (format, data) = (f.text()?, f.data()?);
            Message::Image(Image {
                stamp,
                frame: Cow::Borrowed(frame),
                encoding: Cow::Borrowed(format),
                data: Cow::Borrowed(data),
                ..Image::default()
            })
        }
        Kind::CameraInfo => {
            let (stamp, frame) = f.header()?;
            let (height, width) = (f.u32()?, f.u32()?);
            let model = f.text()?.to_owned();
            let count = f.u32()? as usize;
            if count > 64 {
                return Err(ParseError::new(
                    format!("a calibration says it has {count} lens coefficients"),
                    "the file is damaged: copy it again",
                ));
            }
            let d = (0..count).map(|_| f.f64()).collect::<Result<_, _>>()?;
            let k = f.f64s()?;
            Message::CameraInfo(CameraInfo { stamp, frame: frame.into(), width, height, model, d, k })
        }
        Kind::Transforms => {
            let count = f.u32()?;
            // Each takes bytes: what is cut off ends the loop, whatever the count says.
            let transforms = (0..count).map(|_| f.transform()).collect::<Result<_, _>>()?;
            Message::Transforms(transforms)
        }
        Kind::Transform => Message::Transforms(vec![f.transform()?]),
        Kind::BareTransform => {
            let (translation, rotation) = (f.f64s()?, f.f64s()?);
            Message::Transforms(vec![Transform { translation, rotation, ..Transform::default() }])
        }
        Kind::Pose => {
            let (stamp, parent) = f.header()?;
            let (translation, rotation) = (f.f64s()?, f.f64s()?);
            let parent = parent.to_owned();
            Message::Transforms(vec![Transform { stamp, parent, child: String::new(), translation, rotation }])
        }
        Kind::Imu => {
            let (stamp, _) = f.header()?;
            f.f64s::<13>()?; // orientation and its covariance
            let rate = f.f64s()?;
            f.f64s::<9>()?;
            let force = f.f64s()?;
            Message::Imu(Imu { stamp, rate, force })
        }
        Kind::MagneticField => {
            let (stamp, _) = f.header()?;
            Message::MagneticField(stamp, f.f64s()?)
        }
        Kind::Number => Message::Number(f.number().map(f32::from_le_bytes)?),
    })
}
