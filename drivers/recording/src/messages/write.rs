//! ROS 2 messages written as CDR, little endian, and their definitions as `ros2msg` schemas have them: the message itself,
//! then every message that it names, between lines of `=`.

use isobath::ground::units::Timestamp;

/// A message being written.
#[derive(Debug, Default)]
pub(crate) struct Cdr(Vec<u8>);

impl Cdr {
    /// Begins anew, in the memory that is there.
    pub(crate) fn begin(&mut self) -> &mut Self {
        self.0.clear();
        self.0.extend_from_slice(&[0, 1, 0, 0]);
        self
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.0
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) -> &mut Self {
        // Aligned from the end of the four bytes at the front, which are four themselves.
        while !(self.0.len() - 4).is_multiple_of(N) {
            self.0.push(0);
        }
        self.0.extend_from_slice(&bytes);
        self
    }

    pub(crate) fn u8(&mut self, v: u8) -> &mut Self {
        self.number([v])
    }

    pub(crate) fn u32(&mut self, v: u32) -> &mut Self {
        self.number(v.to_le_bytes())
    }

    pub(crate) fn f64s(&mut self, values: impl IntoIterator<Item = f64>) -> &mut Self {
        for v in values {
            self.number(v.to_le_bytes());
        }
        self
    }

    pub(crate) fn text(&mut self, text: &str) -> &mut Self {
        self.u32(text.len() as u32 + 1);
        self.0.extend_from_slice(text.as_bytes());
        self.u8(0)
    }

    /// A sequence of bytes: how many, and who appends them.
    pub(crate) fn data(&mut self, len: usize, fill: impl FnOnce(&mut Vec<u8>)) -> &mut Self {
        self.u32(len as u32);
        let end = self.0.len() + len;
        fill(&mut self.0);
        // Who fills in less or more would break all that follows.
        self.0.resize(end, 0);
        self
    }

    pub(crate) fn header(&mut self, (seconds, nanos): (i32, u32), frame: &str) -> &mut Self {
        self.u32(seconds.cast_unsigned()).u32(nanos).text(frame)
    }

    /// All of `sensor_msgs/msg/Image` but the pixels.
    pub(crate) fn image_head(
        &mut self,
        stamp: (i32, u32),
        frame: &str,
        (width, height): (usize, usize),
        encoding: &str,
        bytes: usize,
    ) -> &mut Self {
        self.begin().header(stamp, frame).u32(height as u32).u32(width as u32).text(encoding);
        self.u8(0).u32((width * bytes) as u32)
    }

    /// `sensor_msgs/msg/CameraInfo` of a pinhole.
    pub(crate) fn camera_info(
        &mut self,
        stamp: (i32, u32),
        frame: &str,
        (width, height): (usize, usize),
        k: &isobath::sensing::camera::Intrinsics,
    ) -> &mut Self {
        let [fx, fy, cx, cy] = [k.fx(), k.fy(), k.cx(), k.cy()].map(f64::from);
        self.begin().header(stamp, frame).u32(height as u32).u32(width as u32).text("plumb_bob");
        self.u32(5).f64s([0.0; 5]);
        self.f64s([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
        self.f64s([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        self.f64s([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
        // No binning, the whole image, not to be rectified.
        self.u32(0).u32(0).u32(0).u32(0).u32(0).u32(0).u8(0)
    }
}

/// ROS 2's stamp; `None` beyond ±68 years.
pub(crate) fn stamp(time: Timestamp) -> Option<(i32, u32)> {
    let nanos = time.as_nanos();
    let seconds = i32::try_from(nanos.div_euclid(1_000_000_000)).ok()?;
    Some((seconds, nanos.rem_euclid(1_000_000_000) as u32))
}

macro_rules! named {
    ($name:literal, $body:expr) => {
        concat!(
            "================================================================================\nMSG: ",
            $name,
            "\n",
            $body
        )
    };
}

macro_rules! header {
    () => {
        concat!(
            named!("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
            named!("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n")
        )
    };
}

macro_rules! vector3 {
    () => {
        named!("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n")
    };
}

macro_rules! quaternion {
    () => {
        named!("geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n")
    };
}

pub(crate) const IMAGE: &str = concat!(
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n",
    header!()
);

pub(crate) const CAMERA_INFO: &str = concat!(
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\n\
    float64[12] p\nuint32 binning_x\nuint32 binning_y\nRegionOfInterest roi\n",
    header!(),
    named!(
        "sensor_msgs/RegionOfInterest",
        "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"
    )
);

pub(crate) const IMU: &str = concat!(
    "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n\
    geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n\
    geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
    header!(),
    quaternion!(),
    vector3!()
);

pub(crate) const MAGNETIC_FIELD: &str = concat!(
    "std_msgs/Header header\ngeometry_msgs/Vector3 magnetic_field\nfloat64[9] magnetic_field_covariance\n",
    header!(),
    vector3!()
);

pub(crate) const TF_MESSAGE: &str = concat!(
    "geometry_msgs/TransformStamped[] transforms\n",
    named!("geometry_msgs/TransformStamped", "std_msgs/Header header\nstring child_frame_id\nTransform transform\n"),
    header!(),
    named!("geometry_msgs/Transform", "Vector3 translation\nQuaternion rotation\n"),
    vector3!(),
    quaternion!()
);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Encoding, Kind, Message, decode};
    use isobath::sensing::camera::Intrinsics;

    #[test]
    fn what_is_written_is_read() {
        let mut cdr = Cdr::default();
        let data = cdr.image_head((-2, 5), "camera", (3, 1), "16UC1", 2).data(6, |out| out.extend(1..=6)).bytes();
        let Message::Image(image) = decode(Kind::Image, Encoding::Cdr, data).unwrap() else { panic!("an image") };
        assert_eq!((image.width, image.height, image.step, image.frame.as_ref()), (3, 1, 6, "camera"));
        assert_eq!((image.stamp.as_nanos(), image.data.as_ref()), (-1_999_999_995, &[1, 2, 3, 4, 5, 6][..]));
        // Cut off anywhere, it is refused.
        for cut in 0..data.len() {
            assert!(decode(Kind::Image, Encoding::Cdr, &data[..cut]).is_err(), "{cut}");
        }
        let k = Intrinsics::new(500.1, -500.2, 3.3, 4.4).unwrap();
        let data = cdr.camera_info((0, 0), "c", (640, 480), &k).bytes();
        let Message::CameraInfo(info) = decode(Kind::CameraInfo, Encoding::Cdr, data).unwrap() else {
            panic!("a camera")
        };
        assert_eq!(info.k.map(|v| v as f32), [500.1, 0.0, 3.3, 0.0, -500.2, 4.4, 0.0, 0.0, 1.0]);
        assert_eq!((info.width, info.height, info.d.len()), (640, 480, 5));
    }

    #[test]
    fn stamps_are_exact_or_refused() {
        for nanos in [0, 1, -1, 1_341_841_278_842_700_000, -5_000_000_000] {
            let (s, ns) = stamp(Timestamp::from_nanos(nanos)).unwrap();
            assert_eq!(i64::from(s) * 1_000_000_000 + i64::from(ns), nanos);
        }
        assert_eq!(stamp(Timestamp::from_nanos(i64::MAX)), None);
    }
}
