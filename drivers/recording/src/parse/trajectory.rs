//! Open3D's trajectory log: for each pose a line of three whole numbers, the first of which is the frame's number, then a
//! 4 x 4 camera-to-world matrix. <http://redwood-data.org/indoor/fileformat.html>

use super::{ParseError, RawPose, content_lines, numbers};

/// Reads frame numbers and their poses.
///
/// ```
/// use isobath_recording::parse::parse_trajectory_log;
/// let log = parse_trajectory_log("5 5 6\n1 0 0 0.5\n0 1 0 0\n0 0 1 0\n0 0 0 1\n").unwrap();
/// assert_eq!(log[0].0, 5);
/// ```
///
/// # Errors
/// [`ParseError`] with the line where a header or a row is not one, or where the text ends within a pose.
pub fn parse_trajectory_log(text: &str) -> Result<Vec<(u64, RawPose)>, ParseError> {
    const HINT: &str = "a pose is a line of three whole numbers, then four lines of four numbers";
    let mut poses = Vec::new();
    let mut lines = content_lines(text);
    while let Some((line, header)) = lines.next() {
        let head = numbers(line, header)?;
        let &[id, ..] = head.as_slice() else {
            return Err(ParseError::at(line, "no frame number", HINT));
        };
        if head.len() != 3 || id < 0.0 || id.fract() != 0.0 || id > 1e15 {
            return Err(ParseError::at(line, "not a line of three whole numbers", HINT));
        }
        let mut matrix = Vec::with_capacity(16);
        for _ in 0..4 {
            let Some((line, row)) = lines.next() else {
                return Err(ParseError::at(line, "the text ends within this pose", HINT));
            };
            let row = numbers(line, row)?;
            if row.len() != 4 {
                return Err(ParseError::at(line, format!("a row of {} numbers", row.len()), HINT));
            }
            matrix.extend(row);
        }
        let pose = RawPose::from_numbers(&matrix).ok_or_else(|| ParseError::at(line, "not a matrix", HINT))?;
        poses.push((id as u64, pose));
    }
    Ok(poses)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn broken_logs_are_refused_with_their_line() {
        let good = "0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
        assert_eq!(parse_trajectory_log(&good.repeat(3)).unwrap().len(), 3);
        assert!(parse_trajectory_log("").unwrap().is_empty());
        for (bad, line) in [
            ("0 0 1\n1 0 0 0\n", 1),
            ("0 0 1\n1 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", 2),
            ("1 0 0 0\n", 1),
            ("-1 0 1\n", 1),
            ("0.5 0 1\n", 1),
            ("0 0 1\n1 0 0 x\n", 2),
        ] {
            assert_eq!(parse_trajectory_log(bad).unwrap_err().line, Some(line), "{bad:?}");
        }
    }

    proptest! {
        #[test]
        fn any_text_gives_an_answer(text in "([-0-9.enaif ]{0,20}\n){0,12}") {
            let _ = parse_trajectory_log(&text);
        }
    }
}
