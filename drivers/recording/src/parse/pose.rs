//! Poses as text: seven numbers (tx ty tz qx qy qz qw), or a matrix, row by row.
//!
//! Numbers that can't be read are an error of the file. Numbers that are no rigid transform (7-Scenes and `ScanNet` write NaN
//! or -inf where tracking was lost) are an error of one frame: they are kept as a [`RawPose`] and refused by
//! [`RawPose::pose`].

use isobath::glam::{Mat4, Quat, Vec3, Vec4};
use isobath::sensing::camera::Pose;
use isobath::sensing::camera::convention::Convention;
use isobath::sensing::camera::pose::PoseError;

use super::{ParseError, content_lines, numbers};
use crate::camera_file::Direction;

/// The numbers of a pose, not yet judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RawPose {
    /// Position (metres) and rotation quaternion, x y z w.
    Quaternion([f32; 3], [f32; 4]),
    /// A 4 x 4 matrix for column vectors.
    Matrix(Mat4),
}

impl RawPose {
    /// The pose, camera-to-world in the core's axes, of numbers in this convention and direction.
    ///
    /// # Errors
    /// [`PoseError`] when the numbers are no rigid transform.
    pub fn pose(self, convention: Convention, direction: Direction) -> Result<Pose, PoseError> {
        let matrix = match self {
            Self::Quaternion(t, q) => Pose::new(Quat::from_array(q), Vec3::from(t))?.matrix(),
            Self::Matrix(m) => m,
        };
        let matrix = match direction {
            Direction::CameraToWorld => matrix,
            // Judged before it is inverted, so that the inverse exists.
            Direction::WorldToCamera => Pose::from_matrix(matrix)?.inverse().matrix(),
        };
        convention.pose_from_matrix(matrix)
    }

    /// From seven numbers, or twelve or sixteen of a matrix by rows.
    pub(crate) fn from_numbers(v: &[f64]) -> Option<Self> {
        let v: Vec<f32> = v.iter().map(|&x| x as f32).collect();
        let row = |r: usize| v.get(4 * r..4 * r + 4).and_then(|r| <[f32; 4]>::try_from(r).ok()).map(Vec4::from);
        match *v.as_slice() {
            [tx, ty, tz, qx, qy, qz, qw] => Some(Self::Quaternion([tx, ty, tz], [qx, qy, qz, qw])),
            _ if v.len() == 12 || v.len() == 16 => {
                let last = if v.len() == 16 { row(3)? } else { Vec4::W };
                Some(Self::Matrix(Mat4::from_cols(row(0)?, row(1)?, row(2)?, last).transpose()))
            }
            _ => None,
        }
    }
}

/// Reads one matrix of 4 x 4 (or 3 x 4) numbers, one row a line: the `pose.txt` of 7-Scenes.
///
/// # Errors
/// [`ParseError`] unless there are 16 or 12 numbers. NaN and infinite are numbers here.
pub fn parse_pose_matrix(text: &str) -> Result<RawPose, ParseError> {
    let mut all = Vec::new();
    let mut last = None;
    for (line, content) in content_lines(text).take(17) {
        all.extend(numbers(line, content)?);
        last = Some(line);
    }
    let pose = if all.len() == 7 { None } else { RawPose::from_numbers(&all) };
    pose.ok_or_else(|| ParseError {
        line: last,
        what: format!("holds {} numbers, a pose matrix 16", all.len()),
        hint: "four rows of four numbers, camera-to-world unless camera.toml says otherwise".into(),
    })
}

/// Reads one pose a line: tx ty tz qx qy qz qw, or the 12 or 16 numbers of a matrix by rows (KITTI).
///
/// # Errors
/// [`ParseError`] with the line that holds another count of numbers, or something else.
pub fn parse_pose_list(text: &str) -> Result<Vec<RawPose>, ParseError> {
    content_lines(text)
        .map(|(line, content)| {
            let v = numbers(line, content)?;
            RawPose::from_numbers(&v).ok_or_else(|| {
                ParseError::at(
                    line,
                    format!("holds {} numbers", v.len()),
                    "a pose is tx ty tz qx qy qz qw, or a matrix of 12 or 16 numbers by rows",
                )
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn seven_numbers_and_matrices_agree() {
        let list = parse_pose_list("# c\n1 2 3 0 0 0.70710678 0.70710678\n\n0 -1 0 1 1 0 0 2 0 0 1 3\n").unwrap();
        let [a, b] = [0, 1].map(|i| list[i].pose(Convention::OpenCv, Direction::CameraToWorld).unwrap());
        assert!((a.to_world(Vec3::X) - b.to_world(Vec3::X)).length() < 1e-6);
        let inverse = list[0].pose(Convention::OpenCv, Direction::WorldToCamera).unwrap();
        assert!((inverse.to_world(a.to_world(Vec3::ONE)) - Vec3::ONE).length() < 1e-5);
    }

    #[test]
    fn lost_tracking_is_a_pose_that_is_none() {
        let lost = parse_pose_matrix("-inf -inf -inf -inf\nnan 0 0 0\n0 0 1 0\n0 0 0 1\n").unwrap();
        assert_eq!(lost.pose(Convention::OpenCv, Direction::CameraToWorld), Err(PoseError::NotFinite));
        let zero = parse_pose_list("0 0 0 0 0 0 0").unwrap();
        assert!(zero[0].pose(Convention::OpenCv, Direction::WorldToCamera).is_err());
    }

    #[test]
    fn other_texts_are_refused_with_their_line() {
        assert_eq!(parse_pose_list("0 0 0 0 0 0 1\n1 2 3\n").unwrap_err().line, Some(2));
        assert_eq!(parse_pose_list("\n\n0 0 0 x 0 0 1").unwrap_err().line, Some(3));
        assert!(parse_pose_matrix("1 2 3 4").is_err());
        assert!(parse_pose_matrix("").is_err());
        assert!(parse_pose_matrix(&"1 0 0 0\n".repeat(1000)).is_err());
    }

    proptest! {
        #[test]
        fn any_text_gives_an_answer(text in "([-0-9.eE#naif ]{0,40}\n){0,8}") {
            let _ = parse_pose_matrix(&text);
            for pose in parse_pose_list(&text).unwrap_or_default() {
                for convention in [Convention::OpenCv, Convention::OpenGl, Convention::Unity] {
                    let _ = pose.pose(convention, Direction::WorldToCamera);
                }
            }
        }
    }
}
