//! From what a sensor says to what is: scale, misalignment, bias, mounting, and the delay of its clock.
//!
//! Each triad (gyroscope, accelerometer, magnetometer) has the usual affine model (Tedaldi, Pretto, Menegatti 2014, "A robust and easy to implement method for IMU
//! calibration without external equipments"): v = M (raw - b), with b the offset in the sensor's units and M the 3x3 matrix that takes scale
//! and misalignment away (hard and soft iron, for a magnetometer). Then the mounting turns all three into the frame wanted, often the camera's.
//! The matrices are multiplied once, when the calibration is made.
//!
//! Memory: 160 bytes. Cost: 3 x 12 operations. Error: `f32` rounding.

use glam::{Quat, Vec3};

use super::{ImuError, ImuSample, in_range};
use crate::ground::rotation;

/// The affine model of one triad: M (raw - b).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triad {
    /// M by rows, without unit. Near the identity for a sensor in SI units.
    pub matrix: [[f32; 3]; 3],
    /// b, in the sensor's unit: what it says when there is nothing.
    pub bias: Vec3,
}

impl Triad {
    /// Changes nothing.
    pub const IDENTITY: Self = Self { matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], bias: Vec3::ZERO };

    /// The corrected value.
    #[must_use]
    pub fn apply(&self, raw: Vec3) -> Vec3 {
        let v = raw - self.bias;
        let [x, y, z] = self.matrix.map(|row| Vec3::from_array(row).dot(v));
        Vec3::new(x, y, z)
    }

    fn turned(&self, mounting: Quat) -> Self {
        // A matrix turned is its columns turned.
        let [a, b, c] = self.matrix;
        let [[ax, ay, az], [bx, by, bz], [cx, cy, cz]] = [a, b, c];
        let x = rotation::rotate(mounting, Vec3::new(ax, bx, cx));
        let y = rotation::rotate(mounting, Vec3::new(ay, by, cy));
        let z = rotation::rotate(mounting, Vec3::new(az, bz, cz));
        Self { matrix: [[x.x, y.x, z.x], [x.y, y.y, z.y], [x.z, y.z, z.z]], bias: self.bias }
    }

    fn check(&self) -> Result<(), ImuError> {
        for value in self.matrix.iter().flatten() {
            in_range("matrix", *value, -1e3, 1e3)?;
        }
        for value in self.bias.to_array() {
            in_range("bias", value, -1e5, 1e5)?;
        }
        Ok(())
    }
}

/// What stands between a sensor's readings and the frame they are wanted in.
///
/// ```
/// use isobath::glam::{Quat, Vec3, vec3};
/// use isobath::ground::units::Timestamp;
/// use isobath::sensing::imu::calibration::{ImuCalibration, Triad};
/// use isobath::sensing::imu::ImuSample;
/// let rate = Triad { bias: vec3(0.01, 0.0, 0.0), ..Triad::IDENTITY };
/// // x right, y up, z back becomes x right, y down, z forward; its stamps are 4 ms late.
/// let mounting = Quat::from_rotation_x(core::f32::consts::PI);
/// let calibration = ImuCalibration::new(rate, Triad::IDENTITY, Triad::IDENTITY, mounting, -4_000_000)?;
/// let raw = ImuSample { time: Timestamp::from_nanos(9_000_000), rate: vec3(0.01, 1.0, 0.0), force: vec3(0.0, 9.8, 0.0), field: None };
/// let real = calibration.apply(&raw);
/// assert!((real.rate - Vec3::NEG_Y).length() < 1e-6);
/// assert!((real.force - vec3(0.0, -9.8, 0.0)).length() < 1e-5);
/// assert_eq!(real.time.as_nanos(), 5_000_000);
/// # Ok::<(), isobath::sensing::imu::ImuError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuCalibration {
    rate: Triad,
    force: Triad,
    field: Triad,
    offset: i64,
}

impl ImuCalibration {
    /// Changes nothing.
    pub const IDENTITY: Self =
        Self { rate: Triad::IDENTITY, force: Triad::IDENTITY, field: Triad::IDENTITY, offset: 0 };

    /// From the three triads, the mounting (unit quaternion that turns the sensor's axes into the frame wanted), and the nanoseconds to add to
    /// the sensor's stamps so that they are the camera's ([`TimeOffset`](super::offset::TimeOffset) finds them).
    ///
    /// # Errors
    /// [`ImuError`]: a coefficient is not finite or beyond 1000 (a bias: 100,000), or the mounting's length is off by more than a hundredth.
    pub fn new(rate: Triad, force: Triad, field: Triad, mounting: Quat, offset_nanos: i64) -> Result<Self, ImuError> {
        for triad in [&rate, &force, &field] {
            triad.check()?;
        }
        in_range("mounting", rotation::length(mounting), 0.99, 1.01)?;
        let mounting = rotation::unit(mounting);
        let [rate, force, field] = [rate, force, field].map(|t| t.turned(mounting));
        Ok(Self { rate, force, field, offset: offset_nanos })
    }

    /// The corrected reading. What is not finite stays so, and is refused further on.
    #[must_use]
    pub fn apply(&self, raw: &ImuSample) -> ImuSample {
        ImuSample {
            time: raw.time.saturating_add_nanos(self.offset),
            rate: self.rate.apply(raw.rate),
            force: self.force.apply(raw.force),
            field: raw.field.map(|f| self.field.apply(f)),
        }
    }
}

impl Default for ImuCalibration {
    fn default() -> Self {
        Self::IDENTITY
    }
}

/// The rotation of a mount matrix (as in Linux' `in_mount_matrix`: rows, sensor axes to the device's).
///
/// # Errors
/// [`ImuError`] when a row is not of length 1, two are not square to each other, or left is taken for right: each to a hundredth. Axes that
/// are mirrored belong into a [`Triad`].
pub fn mounting_of(rows: [[f32; 3]; 3]) -> Result<Quat, ImuError> {
    let [x, y, z] = rows.map(Vec3::from_array);
    for row in [x, y, z] {
        in_range("mount matrix: length of a row", row.length(), 0.99, 1.01)?;
    }
    in_range("mount matrix: determinant", x.cross(y).dot(z), 0.98, 1.02)?;
    for (a, b) in [(x, y), (y, z), (z, x)] {
        in_range("mount matrix: cosine between rows", a.dot(b), -0.01, 0.01)?;
    }
    // glam wants columns.
    let columns = glam::Mat3::from_cols(x, y, z).transpose();
    Ok(rotation::unit(Quat::from_mat3(&columns)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::units::Timestamp;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn undoes_what_a_sensor_does(
            off in proptest::array::uniform9(-0.1_f32..0.1), bias in proptest::array::uniform3(-0.5_f32..0.5),
            q in proptest::array::uniform4(-1.0_f32..1.0), truth in proptest::array::uniform3(-9.0_f32..9.0),
        ) {
            let mounting = rotation::unit(Quat::from_array(q));
            let [a, b, c, d, e, f, g, h, i] = off;
            let matrix = [[1.0 + a, b, c], [d, 1.0 + e, f], [g, h, 1.0 + i]];
            let triad = Triad { matrix, bias: Vec3::from(bias) };
            // In f64: the sensor's axes from the wanted ones, then the inverse of M, then the bias.
            let m = glam::Mat3::from_cols_array_2d(&matrix).transpose();
            let truth = Vec3::from(truth);
            let raw = m.inverse() * (mounting.inverse() * truth) + Vec3::from(bias);
            let calibration = ImuCalibration::new(triad, triad, triad, mounting, 5).unwrap();
            let got = calibration.apply(&ImuSample { time: Timestamp::ZERO, rate: raw, force: raw, field: Some(raw) });
            for v in [got.rate, got.force, got.field.unwrap()] {
                prop_assert!((v - truth).length() < 3e-5, "{} {}", v, truth);
            }
            prop_assert_eq!(got.time.as_nanos(), 5);
            // The mount matrix of a rotation is that rotation.
            let rows = glam::Mat3::from_quat(mounting).transpose().to_cols_array_2d();
            prop_assert!(mounting_of(rows).unwrap().dot(mounting).abs() > 1.0 - 1e-5);
        }
    }

    #[test]
    fn what_is_no_calibration_is_refused() {
        let t = Triad::IDENTITY;
        let nan = Triad { bias: Vec3::new(0.0, f32::NAN, 0.0), ..t };
        let wild = Triad { matrix: [[1e9; 3]; 3], ..t };
        assert_eq!(ImuCalibration::new(nan, t, t, Quat::IDENTITY, 0).unwrap_err().name, "bias");
        assert_eq!(ImuCalibration::new(t, wild, t, Quat::IDENTITY, 0).unwrap_err().name, "matrix");
        let zero = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        assert_eq!(ImuCalibration::new(t, t, t, zero, 0).unwrap_err().name, "mounting");
        assert!(mounting_of([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]).is_err(), "mirrored");
        assert!(mounting_of([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).is_err(), "flat");
        assert!(mounting_of([[f32::NAN; 3]; 3]).is_err());
    }
}
