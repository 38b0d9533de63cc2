//! The lists of the TUM RGB-D data set: `time file` and `time tx ty tz qx qy qz qw`, one a line, `#` for comments, seconds
//! since the Unix epoch. <https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats>

use isobath::ground::units::Timestamp;

use super::{ParseError, RawPose, content_lines, numbers, quoted};

/// One line of a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TumLine<'a> {
    /// Line in the text, from 1.
    pub line: usize,
    /// Time of the image.
    pub time: Timestamp,
    /// What follows the time: a file's path, relative to the list.
    pub rest: &'a str,
}

/// Reads a list of times and file names (`depth.txt`, `rgb.txt`).
///
/// # Errors
/// [`ParseError`] with the line that has no time or no file name.
pub fn parse_tum_list(text: &str) -> Result<Vec<TumLine<'_>>, ParseError> {
    const HINT: &str = "a line is like: 1305031102.160407 depth/1305031102.160407.png";
    content_lines(text)
        .map(|(line, content)| {
            let (time, rest) = content
                .split_once([' ', '\t'])
                .ok_or_else(|| ParseError::at(line, format!("{} has no file name", quoted(content)), HINT))?;
            Ok(TumLine { line, time: timestamp(line, time, HINT)?, rest: rest.trim() })
        })
        .collect()
}

/// Reads a trajectory (`groundtruth.txt`).
///
/// # Errors
/// [`ParseError`] with the line that is not eight numbers beginning with a time.
pub fn parse_tum_poses(text: &str) -> Result<Vec<(Timestamp, RawPose)>, ParseError> {
    const HINT: &str = "a line is: time tx ty tz qx qy qz qw";
    content_lines(text)
        .map(|(line, content)| {
            let (time, rest) = content.split_once([' ', '\t', ',']).unwrap_or((content, ""));
            let v = numbers(line, rest)?;
            let pose = if v.len() == 7 { RawPose::from_numbers(&v) } else { None };
            let pose =
                pose.ok_or_else(|| ParseError::at(line, format!("{} numbers follow the time, not 7", v.len()), HINT))?;
            Ok((timestamp(line, time, HINT)?, pose))
        })
        .collect()
}

/// Plain digits exactly: `f64` seconds since 1970 know 0.2 microseconds only.
fn exact(word: &str) -> Option<Timestamp> {
    let (sign, digits) = word.strip_prefix('-').map_or((1, word), |digits| (-1, digits));
    let (whole, part) = digits.split_once('.').unwrap_or((digits, ""));
    if whole.is_empty() || part.len() > 9 || !whole.bytes().chain(part.bytes()).all(|b| b.is_ascii_digit()) {
        return None;
    }
    let nanos: i64 = format!("{whole}{part:0<9}").parse().ok()?;
    Some(Timestamp::from_nanos(sign * nanos))
}

fn timestamp(line: usize, word: &str, hint: &str) -> Result<Timestamp, ParseError> {
    let seconds = exact(word).or_else(|| word.parse::<f64>().ok().and_then(Timestamp::from_seconds));
    seconds.ok_or_else(|| ParseError::at(line, format!("{} is not a time in seconds", quoted(word)), hint))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lists_with_comments_and_windows_line_ends() {
        let list =
            parse_tum_list("# depth maps\r\n# file: 'x.bag'\r\n1.5 depth/a b.png\r\n\r\n2 \tdepth/2.png").unwrap();
        assert_eq!(list.len(), 2);
        assert_eq!((list[0].line, list[0].rest), (3, "depth/a b.png"));
        assert_eq!(list[1].time, Timestamp::from_nanos(2_000_000_000));
        let poses =
            parse_tum_poses("# t\n1305031098.6659 1.3563 0.6305 1.6380 0.6132 0.5962 -0.3311 -0.3986\n").unwrap();
        assert_eq!(poses.len(), 1);
    }

    #[test]
    fn broken_lines_are_named() {
        assert_eq!(parse_tum_list("1 a\n2\n").unwrap_err().line, Some(2));
        assert_eq!(parse_tum_list("nan a\n").unwrap_err().line, Some(1));
        assert_eq!(parse_tum_list("1e300 a\n").unwrap_err().line, Some(1));
        assert_eq!(parse_tum_poses("1 2 3\n").unwrap_err().line, Some(1));
        assert_eq!(parse_tum_poses("x 0 0 0 0 0 0 1\n").unwrap_err().line, Some(1));
    }

    proptest! {
        #[test]
        fn any_text_gives_an_answer(text in "\\PC{0,80}", lines in "([-0-9.e# ]{0,30}\n){0,5}") {
            let _ = (parse_tum_list(&text), parse_tum_poses(&text), parse_tum_list(&lines), parse_tum_poses(&lines));
        }
    }
}
