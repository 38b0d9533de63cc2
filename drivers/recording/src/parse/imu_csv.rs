//! Inertial readings as text, as the simulator and the TUM writer write them: `time_ns,force_x,force_y,force_z,rate_x,rate_y,rate_z`, one a
//! line after a line of names; m/s^2 and rad/s.

use isobath::glam::Vec3;
use isobath::ground::units::Timestamp;
use isobath::sensing::imu::ImuSample;

use super::{ParseError, content_lines, numbers, quoted};

/// Reads inertial readings.
///
/// ```
/// let text = "time_ns,force_x,force_y,force_z,rate_x,rate_y,rate_z\n5,0,9.8,0,0.1,0,0\n";
/// let samples = isobath_recording::parse::parse_imu_csv(text).unwrap();
/// assert_eq!((samples[0].time.as_nanos(), samples[0].rate.x), (5, 0.1));
/// ```
///
/// # Errors
/// [`ParseError`] with the line that is not a time and six numbers.
pub fn parse_imu_csv(text: &str) -> Result<Vec<ImuSample>, ParseError> {
    const HINT: &str = "a line is: time_ns,force_x,force_y,force_z,rate_x,rate_y,rate_z";
    content_lines(text)
        .skip(1)
        .map(|(line, content)| {
            let (time, rest) = content.split_once(',').unwrap_or((content, ""));
            let nanos = time
                .trim()
                .parse()
                .map_err(|_| ParseError::at(line, format!("{} is not a time in nanoseconds", quoted(time)), HINT))?;
            let v: Vec<f32> = numbers(line, rest)?.into_iter().map(|v| v as f32).collect();
            let &[fx, fy, fz, rx, ry, rz] = v.as_slice() else {
                return Err(ParseError::at(line, format!("{} numbers follow the time, not 6", v.len()), HINT));
            };
            let (force, rate) = (Vec3::new(fx, fy, fz), Vec3::new(rx, ry, rz));
            Ok(ImuSample { time: Timestamp::from_nanos(nanos), rate, force, field: None })
        })
        .collect()
}
