//! Reading a depth source to see what it gives: frames by their numbers, with every pixel checked, and everything else that comes between.

use std::time::{Duration, Instant};

use isobath_source::{Deadline, DepthPixels, DepthSource, Gap, Outcome, OwnedFrame, SourceError, SystemClock};

use crate::pattern;

/// What a source gave.
#[derive(Debug)]
pub enum Seen {
    /// A frame: its number, when every pixel is right.
    Frame(Option<u64>),
    /// The stream broke and goes on.
    Gap(Gap),
    /// Nothing, for this long.
    TimedOut(Duration),
    /// The end.
    End,
    /// An error after which the next frame can be asked for.
    Error(SourceError),
    /// The device is gone; the time from asking to knowing.
    Gone(Duration),
}

impl Seen {
    /// The number of a frame that is right.
    #[must_use]
    pub const fn number(&self) -> Option<u64> {
        if let Self::Frame(number) = self { *number } else { None }
    }
}

/// How long a frame is waited for here, in the guest's time.
pub const WAIT: Duration = Duration::from_secs(2);

/// Asks once.
///
/// # Panics
/// An outcome that was added since: this file has to learn it.
pub fn next(source: &mut dyn DepthSource, frame: &mut OwnedFrame, wait: Duration) -> Seen {
    let start = Instant::now();
    match source.next_into(frame, Deadline::after(&SystemClock, wait)) {
        Ok(Outcome::Frame) => Seen::Frame(number(frame)),
        Ok(Outcome::EndOfStream) => Seen::End,
        Ok(Outcome::TimedOut) => Seen::TimedOut(start.elapsed()),
        Ok(Outcome::Recovered(gap)) => Seen::Gap(gap),
        Ok(other) => panic!("an outcome that this test does not know: {other:?}"),
        Err(error) if error.is_terminal() => Seen::Gone(start.elapsed()),
        Err(error) => Seen::Error(error),
    }
}

/// The number of a frame, when its depth is what a simulated camera saw, to the last pixel.
#[must_use]
pub fn number(frame: &OwnedFrame) -> Option<u64> {
    let DepthPixels::U16(pixels) = frame.depth() else { return None };
    pattern::recognise(pixels, frame.size().0)
}

/// Asks until there were so many frames, or the end; at most four times as often, so that a source that gives nothing is
/// noticed.
pub fn until_frames(source: &mut dyn DepthSource, count: usize) -> Vec<Seen> {
    let (mut frame, mut seen, mut frames) = (OwnedFrame::new(), Vec::new(), 0);
    while frames < count && seen.len() < 4 * count + 8 {
        let one = next(source, &mut frame, WAIT);
        frames += usize::from(matches!(one, Seen::Frame(_)));
        let is_end = matches!(one, Seen::End | Seen::Gone(_));
        seen.push(one);
        if is_end {
            break;
        }
    }
    seen
}

/// The numbers of the frames among them.
///
/// # Panics
/// A frame has a wrong pixel, a number comes twice or earlier than it should: the test has failed.
#[must_use]
pub fn numbers(seen: &[Seen]) -> Vec<u64> {
    let frames = seen.iter().filter(|s| matches!(s, Seen::Frame(_)));
    let numbers: Vec<u64> = frames.map(|s| s.number().expect("every pixel of a frame is right")).collect();
    assert!(numbers.windows(2).all(|w| w[0] < w[1]), "frames come once, and in order: {numbers:?}");
    numbers
}
