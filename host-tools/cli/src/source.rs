//! From the command line to frames: opening a recording, reading one frame of it, and knowing which way is up.

use isobath::glam::Vec3;
use isobath::localized::plane::ground::{GroundParams, dominant_plane, estimate_ground};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath_recording::OpenOptions;
use isobath_sim::{SimOptions, SimSource};
use isobath_source::{Deadline, Outcome as Read, OwnedFrame, Recording, SourceError, with_frame};

use crate::args::{FrameArgs, SourceArgs};
use crate::failure::{Failure, Outcome};

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

/// An opened recording.
pub(crate) struct Source {
    name: String,
    recording: Box<dyn Recording>,
    up: Option<Vec3>,
}

impl std::fmt::Debug for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Source").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Source {
    pub(crate) fn open(args: &SourceArgs) -> Outcome<Self> {
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
        let recording = match args.src.to_str().and_then(|src| src.strip_prefix("sim:")) {
            Some(simulated) => simulate(simulated, args)?,
            None => isobath_recording::open(&args.src, &options).map_err(|e| failure(&e, &args.src.display()))?,
        };
        let up = match args.up {
            Some(up) => Some(up.try_normalize().ok_or_else(|| {
                Failure::new("the up direction has no length").at("--up").advise("give a direction, such as 0,-1,0")
            })?),
            None => None,
        };
        Ok(Self { name: args.src.display().to_string(), recording, up })
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

    pub(crate) fn recording(&self) -> &dyn Recording {
        self.recording.as_ref()
    }

    /// Reads frame `index`, from 0.
    pub(crate) fn read(&mut self, index: usize, frame: &mut OwnedFrame) -> Outcome {
        let place = format!("{}, frame {index}", self.name);
        self.recording.seek(index).map_err(|e| failure(&e, &self.name))?;
        match self.recording.next_into(frame, Deadline::NEVER).map_err(|e| failure(&e, &place))? {
            Read::Frame => Ok(()),
            _ => {
                let last = self.recording.len().saturating_sub(1);
                Err(Failure::new("there is no such frame").at(place).advise(format!("give a frame from 0 to {last}")))
            }
        }
    }

    /// Which way is up: as given, as recorded, as the ground in this frame says, or else the top of the image.
    pub(crate) fn up(&self, frame: &OwnedFrame) -> Up {
        if let Some(direction) = self.up {
            return Up { direction, from: UpFrom::Option };
        }
        if let Some(direction) = self.recording.info().up.and_then(Vec3::try_normalize) {
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
fn failure(error: &SourceError, place: &impl std::fmt::Display) -> Failure {
    match error {
        SourceError::Io { path, error, hint } => Failure::new(error.to_string()).at(path.display()).advise(hint),
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
