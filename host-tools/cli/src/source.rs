//! From the command line to frames: opening a recording or a camera, reading one frame of it, and knowing which way is up.

use std::path::{Path, PathBuf};
use std::time::Duration;

use isobath::glam::Vec3;
use isobath::localized::plane::ground::{GroundParams, dominant_plane, estimate_ground};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath_recording::{ImuRecording, OpenOptions, open_imu};
use isobath_sim::{SimOptions, SimSource};
use isobath_source::{
    Clock as _, Deadline, DepthSource, ImuSource, Outcome as Read, OwnedFrame, Recording, SourceError, SourceInfo,
    StreamStats, SystemClock, with_frame,
};

use crate::args::{FrameArgs, SourceArgs};
use crate::failure::{Failure, Outcome};
use crate::live::{self, Camera};

/// How the up direction became known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum UpFrom {
    /// `--up`.
    Option,
    /// The recording itself.
    Recording,
    /// The normal of the ground seen in the frame, which lies near the top of the image.
    Ground,
    /// The top of the image.
    ImageTop,
}

/// Which way is up in the world, and how that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Up {
    pub(crate) direction: Vec3,
    pub(crate) from: UpFrom,
}

impl Up {
    /// For people.
    pub(crate) fn sentence(&self) -> String {
        let [x, y, z] = self.direction.to_array().map(|v| (v * 1e3).round() / 1e3 + 0.0);
        let from = match self.from {
            UpFrom::Option => "given by --up",
            UpFrom::Recording => "from the recording",
            UpFrom::Ground => "estimated: the normal of the ground seen (give --up to say otherwise)",
            UpFrom::ImageTop => "assumed: the top of the image (give --up to say otherwise)",
        };
        format!("({x:.3}, {y:.3}, {z:.3}), {from}")
    }

    pub(crate) fn json(&self) -> serde_json::Value {
        serde_json::json!({ "direction": self.direction.to_array(), "from": self.from })
    }
}

/// Where frames come from.
enum From {
    /// In any order, and it ends.
    Recording(Box<dyn Recording>),
    /// One after the other, for as long as it is plugged in. How many were read.
    Live(Camera, usize),
}

/// An opened source.
pub(crate) struct Source {
    name: String,
    from: From,
    up: Option<Vec3>,
    /// The file or folder, where it is one.
    path: Option<PathBuf>,
}

impl std::fmt::Debug for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Source").field("name", &self.name).finish_non_exhaustive()
    }
}

/// How long a live source may take for a frame. A camera that starts needs a second or two.
const PATIENCE: Duration = Duration::from_secs(5);

/// What a live source said instead of giving a frame, that many times in a row, before it is given up.
const MOST_FAILURES: usize = 100;

impl Source {
    pub(crate) fn open(args: &SourceArgs) -> Outcome<Self> {
        Self::open_as(args, false)
    }

    /// Opens a source to be recorded: a camera that is faster than the disk queues its frames instead of passing over them.
    pub(crate) fn open_every(args: &SourceArgs) -> Outcome<Self> {
        Self::open_as(args, true)
    }

    fn open_as(args: &SourceArgs, every: bool) -> Outcome<Self> {
        let mut options = OpenOptions { camera: args.camera.clone(), ..OpenOptions::default() };
        let set = &mut options.set;
        if let Some([fx, fy, cx, cy]) = args.intrinsics {
            (set.fx, set.fy, set.cx, set.cy) = (Some(fx), Some(fy), Some(cx), Some(cy));
        }
        if let Some((width, height)) = args.size {
            (set.width, set.height) = (Some(width), Some(height));
        }
        // Options that were not given leave what the camera file says.
        set.depth.unit = args.unit;
        set.depth.min_z = args.min_z;
        set.depth.max_z = args.max_z;
        set.depth.min_confidence = args.min_confidence;
        let name = args.src.display().to_string();
        let file = |path: &Path| -> Outcome<(From, Option<PathBuf>)> {
            let recording = isobath_recording::open(path, &options).map_err(|e| failure(&e, &path.display()))?;
            Ok((From::Recording(recording), Some(path.to_owned())))
        };
        let (from, path) = match args.src.to_str().and_then(|src| src.split_once(':')) {
            Some(("sim", scene)) => (From::Recording(simulate(scene, args)?), None),
            Some(("mcap" | "bag", path)) => {
                let path = Path::new(path);
                if path.is_file() && !isobath_recording::is_messages(path) {
                    return Err(Failure::new("is neither an MCAP file nor a ROS 1 bag")
                        .at(path.display())
                        .advise("leave the prefix out: other recordings are recognised by what they hold"));
                }
                file(path)?
            }
            Some((kind @ ("v4l2" | "usb"), device)) => {
                (From::Live(live::open(kind, device, &options, every)?, 0), None)
            }
            _ => file(&args.src)?,
        };
        let up = match args.up {
            Some(up) => Some(up.try_normalize().ok_or_else(|| {
                Failure::new("the up direction has no length").at("--up").advise("give a direction, such as 0,-1,0")
            })?),
            None => None,
        };
        Ok(Self { name, from, up, path })
    }

    /// Opens the source and reads the one frame asked for.
    pub(crate) fn frame(args: &FrameArgs) -> Outcome<(Self, OwnedFrame)> {
        let mut source = Self::open(&args.source)?;
        let mut frame = OwnedFrame::new();
        source.read(args.frame, &mut frame)?;
        Ok((source, frame))
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    pub(crate) fn info(&self) -> &SourceInfo {
        match &self.from {
            From::Recording(r) => r.info(),
            From::Live(c, _) => c.depth().info(),
        }
    }

    /// Frames there are; `None` of a live source.
    pub(crate) fn len(&self) -> Option<usize> {
        match &self.from {
            From::Recording(r) => Some(r.len()),
            From::Live(..) => None,
        }
    }

    /// What became of a live source's frames.
    pub(crate) fn stats(&self) -> StreamStats {
        match &self.from {
            From::Recording(r) => r.stats(),
            From::Live(c, _) => c.depth().stats(),
        }
    }

    /// The recording's inertial readings, when it has some.
    pub(crate) fn imu(&self) -> Outcome<Option<ImuRecording>> {
        let Some(path) = &self.path else { return Ok(None) };
        open_imu(path).map_err(|e| failure(&e, &path.display()))
    }

    /// The camera's own inertial sensor.
    pub(crate) fn live_imu(&mut self) -> Option<&mut dyn ImuSource> {
        match &mut self.from {
            From::Recording(_) => None,
            From::Live(camera, _) => camera.imu(),
        }
    }

    /// Reads frame `index`, from 0. A live source can't go back: it passes over frames up to that number, or gives the next one.
    pub(crate) fn read(&mut self, index: usize, frame: &mut OwnedFrame) -> Outcome {
        let place = format!("{}, frame {index}", self.name);
        match &mut self.from {
            From::Recording(recording) => {
                recording.seek(index).map_err(|e| failure(&e, &self.name))?;
                match recording.next_into(frame, Deadline::NEVER).map_err(|e| failure(&e, &place))? {
                    Read::Frame => Ok(()),
                    _ => {
                        let last = recording.len().saturating_sub(1);
                        Err(Failure::new("there is no such frame")
                            .at(place)
                            .advise(format!("give a frame from 0 to {last}")))
                    }
                }
            }
            From::Live(camera, read) => loop {
                wait(camera.depth_mut(), frame).map_err(|f| f.at(&place))?;
                *read += 1;
                if *read > index {
                    return Ok(());
                }
            },
        }
    }

    /// Which way is up: as given, as recorded, as the ground in this frame says, or else the top of the image.
    pub(crate) fn up(&self, frame: &OwnedFrame) -> Up {
        if let Some(direction) = self.up {
            return Up { direction, from: UpFrom::Option };
        }
        if let Some(direction) = self.info().up.and_then(Vec3::try_normalize) {
            return Up { direction, from: UpFrom::Recording };
        }
        with_frame!(frame, |f| estimate_up(f))
    }

    /// What every answer for machines begins with.
    pub(crate) fn json(&self, command: &str, frame: usize) -> serde_json::Map<String, serde_json::Value> {
        let mut map = serde_json::Map::new();
        map.insert("command".into(), command.into());
        map.insert("source".into(), self.name.clone().into());
        map.insert("frame".into(), frame.into());
        map
    }
}

/// Waits for a live source's next frame. What goes wrong with single frames is passed over.
fn wait(source: &mut dyn DepthSource, frame: &mut OwnedFrame) -> Outcome {
    let deadline = Deadline::after(&SystemClock, PATIENCE);
    let mut failures = 0;
    loop {
        match source.next_into(frame, deadline) {
            Ok(Read::Frame) => return Ok(()),
            Ok(Read::EndOfStream) => return Err(Failure::new("the stream ended")),
            Ok(Read::TimedOut) => {
                return Err(Failure::new(format!("no frame came within {} s", PATIENCE.as_secs()))
                    .advise("see `isobath devices`; unplug the camera and plug it in again"));
            }
            // A gap; or what a later version says.
            Ok(_) => {}
            Err(e) if e.is_retryable() && failures < MOST_FAILURES && !deadline.has_passed(SystemClock.now()) => {
                failures += 1;
            }
            Err(e) => return Err(failure(&e, &source.info().path.display())),
        }
    }
}

/// A scene without files: `SCENE`, or `SCENE@SENSOR`.
fn simulate(what: &str, args: &SourceArgs) -> Outcome<Box<dyn Recording>> {
    let (scene, sensor) = what.split_once('@').unwrap_or((what, "none"));
    let failed = |e: &isobath_sim::SimError| Failure::of(e, format!("sim:{what}"));
    let mut options = SimOptions { sensor: sensor.parse().map_err(|e| failed(&e))?, ..SimOptions::default() };
    if let Some(size) = args.size {
        options.size = size;
    }
    Ok(Box::new(SimSource::open(scene, options).map_err(|e| failed(&e))?))
}

/// The top of the image, in the world.
fn image_top<D: DepthSample>(frame: &DepthFrame<'_, D>) -> Vec3 {
    let top = if frame.intrinsics().fy() < 0.0 { Vec3::Y } else { Vec3::NEG_Y };
    frame.pose_or_identity().direction_to_world(top)
}

fn estimate_up<D: DepthSample>(frame: &DepthFrame<'_, D>) -> Up {
    let top = image_top(frame);
    let ground = estimate_ground(frame, top, &GroundParams::DEFAULT)
        .or_else(|_| dominant_plane(frame, top, &GroundParams::DEFAULT));
    match ground {
        Ok(found) => Up { direction: found.fit.plane.normal(), from: UpFrom::Ground },
        Err(_) => Up { direction: top, from: UpFrom::ImageTop },
    }
}

/// A driver's error in this program's form: its advice goes where advice goes.
pub(crate) fn failure(error: &SourceError, place: &impl std::fmt::Display) -> Failure {
    match error {
        SourceError::Io { path, error, hint }
        | SourceError::Permission { path, error, hint }
        | SourceError::Busy { path, error, hint } => Failure::new(error.to_string()).at(path.display()).advise(hint),
        SourceError::Format { path, line, what, hint } => {
            let line = line.map(|n| format!(", line {n}")).unwrap_or_default();
            Failure::new(what).at(format!("{}{line}", path.display())).advise(hint)
        }
        SourceError::Config { path, what, hint } | SourceError::Unsupported { path, what, hint } => {
            Failure::new(what).at(path.display()).advise(hint)
        }
        SourceError::MissingCalibration { path, needed, hint } => {
            Failure::new(format!("not known: {}", needed.join(", "))).at(path.display()).advise(hint)
        }
        SourceError::OutOfRange { asked, len } => Failure::new(format!("there is no frame {asked}"))
            .at(place)
            .advise(format!("give a frame from 0 to {}", len.saturating_sub(1))),
        other => Failure::of(other, place),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobath_source::{Gap, GapCause, LinkKind};

    /// A camera that says what it is told to, then numbers its frames.
    struct Scripted {
        info: SourceInfo,
        script: Vec<Result<Read, SourceError>>,
        frames: u64,
    }

    impl DepthSource for Scripted {
        fn info(&self) -> &SourceInfo {
            &self.info
        }

        fn next_into(&mut self, frame: &mut OwnedFrame, _: Deadline) -> Result<Read, SourceError> {
            let said = if self.script.is_empty() { Ok(Read::Frame) } else { self.script.remove(0) };
            if matches!(said, Ok(Read::Frame)) {
                frame.sequence = self.frames;
                self.frames += 1;
            }
            said
        }
    }

    fn camera(script: Vec<Result<Read, SourceError>>) -> Source {
        let info = SourceInfo {
            kind: "scripted".into(),
            path: "test".into(),
            size: None,
            intrinsics: OwnedFrame::new().intrinsics,
            up: None,
            has_colour: false,
            has_poses: false,
            notes: Vec::new(),
        };
        let camera = Camera::Depth(Box::new(Scripted { info, script, frames: 0 }));
        Source { name: "v4l2:test".into(), from: From::Live(camera, 0), up: None, path: None }
    }

    #[test]
    fn a_camera_passes_over_frames_and_never_goes_back() {
        let link = SourceError::Link { path: "test".into(), kind: LinkKind::Stall, doing: "reading", error: None };
        let gap = Gap { cause: GapCause::Link, lost: Some(3) };
        let mut source = camera(vec![Err(link), Ok(Read::Recovered(gap)), Ok(Read::Frame)]);
        assert_eq!(source.len(), None);
        let mut frame = OwnedFrame::new();
        for (asked, got) in [(2, 2), (0, 3), (4, 4), (4, 5)] {
            source.read(asked, &mut frame).expect("a frame");
            assert_eq!(frame.sequence, got, "asked for {asked}");
        }
    }

    #[test]
    fn a_camera_that_is_silent_or_gone_is_a_failure_with_advice() {
        let mut frame = OwnedFrame::new();
        let silent = camera(vec![Ok(Read::TimedOut)]).read(0, &mut frame).expect_err("nothing came").to_string();
        assert!(silent.contains("no frame came within 5 s") && silent.contains("isobath devices"), "{silent}");
        let gone = SourceError::Disconnected { device: "scripted".into() };
        let gone = camera(vec![Err(gone)]).read(0, &mut frame).expect_err("unplugged").to_string();
        assert!(gone.contains("disconnected"), "{gone}");
    }
}
