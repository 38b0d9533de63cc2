//! `isobath record` and `isobath convert`: a source's frames, and its inertial readings between them, into a recording.

use std::path::Path;

use isobath::ground::units::Timestamp;
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::imu::ImuSample;
use isobath_recording::{ImuRecording, McapOptions, McapWriter, TumOptions, TumWriter};
use isobath_source::{Clock as _, Deadline, HostNanos, ImuOutcome, ImuSource, OwnedFrame, SourceError, SystemClock};
use serde_json::json;

use crate::args::{ConvertArgs, HowMuchArgs, RecordArgs};
use crate::commands::run::progress;
use crate::failure::{Failure, Outcome};
use crate::live;
use crate::say::{Say, bytes, count};
use crate::source::{Source, failure};
use crate::stop::Stop;

/// Frames that can't be read, one after the other, before it is given up.
const MOST_FAILURES: usize = 100;

pub(crate) fn record(args: &RecordArgs, say: &mut Say) -> Outcome {
    let source = Source::open_every(&args.source)?;
    let sensor = match args.imu.as_deref() {
        Some(_) if source.len().is_some() => {
            return Err(Failure::new("a recording's inertial readings are its own")
                .at("--imu")
                .advise("leave it out: they are recorded when there are some"));
        }
        Some(device) => Some(live::imu(device)?),
        None => None,
    };
    copy("record", source, sensor, &args.out, &args.much, None, say)
}

pub(crate) fn convert(args: &ConvertArgs, say: &mut Say) -> Outcome {
    let mcap = args.out.extension().is_some_and(|e| e == "mcap");
    if mcap && args.step.is_some() {
        return Err(Failure::new("MCAP keeps the source's own steps")
            .at("--step")
            .advise("leave it out, or give a folder with --out"));
    }
    let source = Source::open(&args.source)?;
    copy("convert", source, None, &args.out, &args.much, args.step, say)
}

/// Where frames go.
enum Sink {
    Mcap(Box<McapWriter>),
    Tum(Box<TumWriter>),
}

/// What was written.
#[derive(Default)]
struct Written {
    frames: u64,
    imu_samples: u64,
    lossless: bool,
    notes: Vec<String>,
}

impl Sink {
    fn create(path: &Path, source: &Source, step: Option<f32>) -> Result<Self, SourceError> {
        let up = source.info().up;
        if path.extension().is_some_and(|e| e == "mcap") {
            let source = format!("{}: {}", source.name(), source.info().kind);
            return Ok(Self::Mcap(Box::new(McapWriter::create(path, McapOptions { source, up })?)));
        }
        let mut options = TumOptions { up, ..TumOptions::default() };
        if let Some(step) = step.and_then(|step| DepthUnit::new(step).ok()) {
            options.step = step;
        }
        Ok(Self::Tum(Box::new(TumWriter::create(path, options)?)))
    }

    fn frame(&mut self, frame: &OwnedFrame, log_time: u64) -> Result<(), SourceError> {
        match self {
            Self::Mcap(w) => w.frame(frame, log_time),
            Self::Tum(w) => w.frame(frame),
        }
    }

    fn imu(&mut self, sample: &ImuSample, log_time: u64) -> Result<(), SourceError> {
        match self {
            Self::Mcap(w) => w.imu(sample, log_time),
            Self::Tum(w) => w.imu(sample),
        }
    }

    fn finish(self) -> Result<Written, SourceError> {
        match self {
            Self::Mcap(w) => w.finish().map(|done| Written {
                frames: done.frames,
                imu_samples: done.imu_samples,
                lossless: true,
                notes: Vec::new(),
            }),
            Self::Tum(w) => w.finish().map(|r| Written {
                frames: r.frames,
                imu_samples: r.imu_samples,
                lossless: r.is_lossless(),
                notes: r.notes,
            }),
        }
    }
}

/// The inertial readings of a recording, handed over in the order of their times.
struct Readings {
    imu: ImuRecording,
    next: Option<ImuSample>,
}

impl Readings {
    fn new(imu: ImuRecording) -> Self {
        let mut readings = Self { imu, next: None };
        readings.advance();
        readings
    }

    fn advance(&mut self) {
        let empty =
            ImuSample { time: Timestamp::ZERO, rate: Default::default(), force: Default::default(), field: None };
        let mut one = [empty];
        self.next = loop {
            match self.imu.read(&mut one, Deadline::NEVER) {
                Ok(ImuOutcome::Samples(n)) => break one.first().copied().filter(|_| n > 0),
                // A broken one is passed over; each is a step on, so this ends.
                Err(_) => {}
                Ok(_) => break None,
            }
        };
    }

    /// Writes those up to `time`.
    fn until(&mut self, time: Timestamp, sink: &mut Sink) -> Result<(), SourceError> {
        while let Some(sample) = self.next.filter(|s| s.time <= time) {
            sink.imu(&sample, log_time(sample.time))?;
            self.advance();
        }
        Ok(())
    }
}

/// Writes the readings that came since the last frame; waits for none.
fn drain(imu: &mut dyn ImuSource, sink: &mut Sink, arrival: u64) -> Result<(), SourceError> {
    let empty = ImuSample { time: Timestamp::ZERO, rate: Default::default(), force: Default::default(), field: None };
    let mut some = [empty; 64];
    // A sensor of 10 kHz has 400 of these between two frames; one that never stops talking must not keep the frames waiting.
    for _ in 0..64 {
        match imu.read(&mut some, Deadline::at(HostNanos(0))) {
            Ok(ImuOutcome::Samples(n)) => {
                for sample in some.iter().take(n) {
                    sink.imu(sample, arrival)?;
                }
            }
            Ok(ImuOutcome::Recovered(_)) => {}
            // What ails the sensor, if it is the camera, the camera tells too.
            _ => break,
        }
    }
    Ok(())
}

/// Recordings arrive when they were taken.
fn log_time(time: Timestamp) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(0)
}

fn copy(
    command: &str,
    mut source: Source,
    mut sensor: Option<Box<dyn ImuSource>>,
    out: &Path,
    much: &HowMuchArgs,
    step: Option<f32>,
    say: &mut Say,
) -> Outcome {
    let live = source.len().is_none();
    let there = source.len().map_or(u64::MAX, |n| n as u64);
    let wanted = much.frames.unwrap_or(u64::MAX).min(there);
    if wanted == 0 {
        return Err(Failure::new("there are no frames to take").at(source.name()).advise("give --frames 1 or more"));
    }
    let mut readings = source.imu()?.map(Readings::new);
    let writing = |e: &SourceError| failure(e, &out.display());
    // The first frame shows that there is one, before a file is made.
    let mut frame = OwnedFrame::new();
    let mut sink: Option<Sink> = None;
    let (mut left_out, mut in_a_row, mut frame_notes) = (Vec::new(), 0, Vec::new());
    let (mut first, mut last) = (None, Timestamp::ZERO);
    let mut ended: Option<Failure> = None;
    let bar = progress((wanted < u64::MAX).then_some(wanted as usize));
    let stop = Stop::on_ctrl_c();
    let mut index = 0_u64;
    while index < wanted && !stop.asked() {
        let read = source.read(index as usize, &mut frame);
        let arrival = SystemClock.now().0;
        bar.inc(1);
        index += 1;
        if let Err(failure) = read {
            in_a_row += 1;
            // Of a camera, what is passed over was passed over already; what comes here is the end.
            if live || there == 1 || in_a_row > MOST_FAILURES {
                ended = Some(failure);
                break;
            }
            left_out.push(format!("frame {} left out: {}", index - 1, failure.to_string().replace('\n', ";")));
            continue;
        }
        in_a_row = 0;
        let began = *first.get_or_insert(frame.time);
        if much.seconds.is_some_and(|most| frame.time.seconds_since(began) >= most) {
            break;
        }
        last = frame.time;
        let to = match &mut sink {
            Some(sink) => sink,
            None => sink.insert(Sink::create(out, &source, step).map_err(|e| writing(&e))?),
        };
        if let Some(readings) = &mut readings {
            readings.until(frame.time, to).map_err(|e| writing(&e))?;
        }
        for imu in [source.live_imu(), sensor.as_mut().map(|s| s.as_mut() as &mut dyn ImuSource)].into_iter().flatten()
        {
            drain(imu, to, arrival).map_err(|e| writing(&e))?;
        }
        for note in &frame.notes {
            let room = frame_notes.len() < 20;
            match frame_notes.iter_mut().find(|(n, _)| n == note) {
                Some((_, count)) => *count += 1,
                None if room => frame_notes.push((note.clone(), 1_u64)),
                None => {}
            }
        }
        match to.frame(&frame, if live { arrival } else { log_time(frame.time) }) {
            Ok(()) => {}
            Err(e @ SourceError::Config { .. }) => left_out.push(format!("frame {} left out: {e}", index - 1)),
            Err(e) => return Err(writing(&e)),
        }
    }
    bar.finish_and_clear();
    let Some(mut sink) = sink else {
        return Err(ended.unwrap_or_else(|| Failure::new("no frame could be read").at(source.name())));
    };
    if let Some(readings) = &mut readings {
        // A whole recording's readings end after its last frame.
        let until = if index >= there { Timestamp::from_nanos(i64::MAX) } else { last };
        readings.until(until, &mut sink).map_err(|e| writing(&e))?;
    }
    let written = sink.finish().map_err(|e| writing(&e))?;
    let seconds = first.map_or(0.0, |first| last.seconds_since(first));
    let size = size_of(out);
    let stats = source.stats();

    say.head(&format!("{}: {}", source.name(), source.info().kind));
    let lost = if live && stats.lost() > 0 {
        format!(", {} of {} lost before they came here", count(stats.lost()), count(stats.span()))
    } else {
        String::new()
    };
    say.fact("frames", &format!("{}, {seconds:.2} s{lost}", count(written.frames)));
    say.fact(
        "imu",
        &if written.imu_samples > 0 { format!("{} readings", count(written.imu_samples)) } else { "none".into() },
    );
    say.fact("depth", if written.lossless { "to the bit" } else { "not all as it was: see below" });
    say.fact("written", &format!("{}, {}", out.display(), bytes(size as usize)));
    let mut notes: Vec<String> = source.info().notes.iter().chain(&written.notes).cloned().collect();
    let several =
        |(note, n): &(String, u64)| if *n == 1 { note.clone() } else { format!("{note} ({} frames)", count(*n)) };
    notes.extend(frame_notes.iter().take(5).map(several));
    notes.extend(left_out.iter().take(5).cloned());
    if left_out.len() > 5 {
        notes.push(format!("{} more frames were left out", left_out.len() - 5));
    }
    for note in &notes {
        say.fact("note", note);
    }
    say.json(&json!({
        "command": command, "source": source.name(), "kind": source.info().kind, "out": out,
        "frames": written.frames, "frames_left_out": left_out.len(), "frames_lost": stats.lost(),
        "imu_samples": written.imu_samples, "duration_s": seconds, "bytes": size,
        "lossless": written.lossless, "notes": notes,
    }));
    match ended {
        // What came before is whole and written; the end is a failure all the same.
        Some(failure) => {
            say.print();
            Err(failure)
        }
        None => Ok(()),
    }
}

/// Bytes of a file, or of a folder's files.
fn size_of(path: &Path) -> u64 {
    let Ok(meta) = path.metadata() else { return 0 };
    if !meta.is_dir() {
        return meta.len();
    }
    let entries = path.read_dir().into_iter().flatten().flatten();
    entries.map(|e| size_of(&e.path())).sum()
}
