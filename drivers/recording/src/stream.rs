//! Messages as a recording: which streams are depth, its camera, colour, confidence and poses, and what belongs to one frame.
//!
//! Depth leads. To each depth image belong the calibration and, within [`OpenOptions::association`] of its time of arrival, the colour and
//! confidence images nearest in time, and the pose. A pose is the way from the depth camera's coordinate frame to the root of the
//! transforms, one of which at least must move (or the root be called world, map or odom): a camera on its bracket has
//! no pose. What is assumed is in the notes.

use std::collections::HashMap;

use isobath::glam::{Quat, Vec3};
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::{Camera, Distortion, Intrinsics, Pose};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::depth::confidence::Limits;
use isobath_source::{Deadline, DepthSource, Outcome, OwnedFrame, Recording, SourceError, SourceInfo};

use crate::camera_file::CameraFile;
use crate::messages::pixels::{Numbers, colour_into, confidence_into, depth_into, is_colour, is_depth};
use crate::messages::{CameraInfo, Kind, Message, Transform};
use crate::reader::OpenOptions;
use crate::store::{Container, Input, Located, Store, nearest};

/// MCAP's metadata record that says what depth is.
pub(crate) const DEPTH_METADATA: &str = "isobath.depth";
/// The root of our own transforms.
pub(crate) const WORLD: &str = "world";
/// Images tried at opening, when the first ones are broken.
const PROBES: usize = 8;
/// How long a chain of transforms may be.
const MOST_LINKS: usize = 32;

/// What a file of ours says of its depth.
#[derive(Debug, Clone, PartialEq)]
struct Said {
    topic: String,
    unit: DepthUnit,
    /// Metres that were `u16` steps of the unit.
    restore: Option<DepthUnit>,
    up: Option<Vec3>,
}

impl Said {
    fn of(store: &Store) -> Option<Self> {
        let m = store.contents.metadata.get(DEPTH_METADATA)?;
        let unit = DepthUnit::new(m.get("unit_m")?.parse().ok()?).ok()?;
        let u16s = m.get("number").is_some_and(|n| n == "u16");
        let metres = m.get("stored").is_some_and(|s| s.starts_with("32FC1"));
        let up = m.get("up").and_then(|up| {
            let mut numbers = up.split(',').map(|n| n.parse().ok());
            Vec3::new(numbers.next()??, numbers.next()??, numbers.next()??).try_normalize()
        });
        Some(Self { topic: m.get("topic")?.clone(), unit, restore: (u16s && metres).then_some(unit), up })
    }
}

/// The calibration that was looked up last.
#[derive(Debug, Default)]
struct Known {
    place: Option<Located>,
    info: Option<CameraInfo>,
}

/// A recording made of messages.
#[derive(Debug)]
pub(crate) struct MessageRecording {
    info: SourceInfo,
    store: Store,
    depth: usize,
    camera: Option<usize>,
    colour: Option<usize>,
    confidence: Option<usize>,
    moving: Vec<usize>,
    /// Child to parent.
    fixed: HashMap<String, (String, Pose)>,
    pose: Option<usize>,
    said: Option<Said>,
    /// The unit of 16-bit depth, when the recording or the caller says it.
    unit: Option<DepthUnit>,
    set: CameraFile,
    limits: Option<Limits>,
    association: u64,
    known: Known,
    next: usize,
    bytes: Vec<u8>,
}

/// Opens a file of messages.
pub(crate) fn open(input: Input, options: &OpenOptions) -> Result<MessageRecording, SourceError> {
    let mut store = Store::open(input)?;
    let path = store.path().to_owned();
    let set = options.set.clone();
    let mut notes = std::mem::take(&mut store.contents.notes);
    let said = Said::of(&store);
    let mut bytes = Vec::new();
    let encodings = encodings(&mut store, &mut bytes);

    let wanted = set.depth.path.as_ref().map(|p| p.to_string_lossy().into_owned());
    let depth = choose_depth(&store, &encodings, wanted.as_deref(), said.as_ref(), &mut notes)?;
    let topic = store.channel(depth).map_or_else(String::new, |c| c.topic.clone());
    let camera = beside(&store, &topic, |i| store.channel(i).is_some_and(|c| c.kind == Kind::CameraInfo));
    let colour = options
        .colour
        .then(|| {
            let wanted = set.colour.path.as_ref().map(|p| p.to_string_lossy().into_owned());
            let of_colour = |i: usize| {
                let Some((c, Some(encoding))) = store.channel(i).zip(encodings.get(i)) else { return false };
                let name = c.topic.to_ascii_lowercase();
                let other = ["infra", "confidence", "depth", "/ir"].iter().any(|word| name.contains(word));
                wanted.as_ref().map_or(is_colour(encoding) && !other, |wanted| c.topic == *wanted)
            };
            beside(&store, &topic, of_colour)
        })
        .flatten();
    let confidence = beside(&store, &topic, |i| {
        let Some((c, Some(encoding))) = store.channel(i).zip(encodings.get(i)) else { return false };
        c.topic.to_ascii_lowercase().contains("confidence") && matches!(encoding.as_str(), "mono8" | "8UC1")
    });
    let unit = match set.depth.unit {
        Some(unit) => Some(DepthUnit::new(unit).map_err(|e| SourceError::Config {
            path: path.clone(),
            what: e.to_string(),
            hint: "give metres per step".into(),
        })?),
        None => said.as_ref().map(|s| s.unit).or_else(|| realsense_unit(&mut store, &topic, &mut bytes)),
    };
    let (moving, fixed, pose) = transforms(&mut store, &mut bytes);
    let default = Limits::default();
    let limits = Limits {
        min_z: set.depth.min_z.unwrap_or(default.min_z),
        max_z: set.depth.max_z.unwrap_or(default.max_z),
        min_confidence: set.depth.min_confidence.unwrap_or(default.min_confidence),
    };
    let kind = match store.container() {
        Container::Bag if topic.starts_with("/device_") => "RealSense recording (ROS 1 bag)".to_owned(),
        _ => store.contents.kind.clone(),
    };
    let association = Timestamp::from_seconds(options.association.abs()).map_or(i64::MAX, Timestamp::as_nanos);
    let up = set.up.map(Vec3::from).or_else(|| said.as_ref().and_then(|s| s.up)).and_then(Vec3::try_normalize);
    let mut recording = MessageRecording {
        info: SourceInfo {
            kind,
            path,
            size: None,
            intrinsics: OwnedFrame::new().intrinsics,
            up,
            has_colour: colour.is_some(),
            has_poses: false,
            notes: Vec::new(),
        },
        store,
        depth,
        camera,
        colour,
        confidence,
        moving,
        fixed,
        pose,
        said,
        unit,
        set,
        limits: (limits != default).then_some(limits),
        association: association.unsigned_abs(),
        known: Known::default(),
        next: 0,
        bytes,
    };
    recording.probe(&topic, notes)?;
    Ok(recording)
}

/// How each channel's images are encoded, by its first message.
fn encodings(store: &mut Store, bytes: &mut Vec<u8>) -> Vec<Option<String>> {
    (0..store.contents.channels.len())
        .map(|i| {
            let c = store.channel(i)?;
            let first = *c.messages.first().filter(|_| matches!(c.kind, Kind::Image | Kind::CompressedImage))?;
            match store.message(i, first, bytes) {
                Ok((_, Message::Image(image))) => Some(image.encoding.into_owned()),
                _ => None,
            }
        })
        .collect()
}

fn choose_depth(
    store: &Store,
    encodings: &[Option<String>],
    wanted: Option<&str>,
    said: Option<&Said>,
    notes: &mut Vec<String>,
) -> Result<usize, SourceError> {
    let topics = || {
        let list: Vec<_> = store.contents.channels.iter().map(|c| c.topic.as_str()).collect();
        if list.is_empty() { "nothing that is known here".to_owned() } else { list.join(", ") }
    };
    let unsupported = |what: String| SourceError::Unsupported {
        path: store.path().into(),
        what,
        hint: format!(
            "it holds {}; depth is 16UC1, mono16, 32FC1 or compressedDepth; depth.path in a camera file names its topic",
            topics()
        ),
    };
    if let Some(topic) = wanted.or(said.map(|s| s.topic.as_str()))
        && let Some(found) = store.contents.channels.iter().position(|c| c.topic == topic && c.kind != Kind::CameraInfo)
    {
        return Ok(found);
    }
    if let Some(topic) = wanted {
        return Err(unsupported(format!("has no messages of topic {topic}")));
    }
    let score = |i: usize| {
        let (c, encoding) = (store.channel(i)?, encodings.get(i)?.as_ref()?);
        let name = c.topic.to_ascii_lowercase();
        let other = ["infra", "confidence", "/ir", "amplitude"].iter().any(|word| name.contains(word));
        let raw = c.kind == Kind::Image;
        // Named depth before unnamed, as sent before compressed, depth's own view before colour's.
        let score = (name.contains("depth"), raw, !name.contains("aligned"), std::cmp::Reverse(name.len()));
        (is_depth(encoding) && !other).then_some(score)
    };
    let found: Vec<usize> = (0..encodings.len()).filter(|&i| score(i).is_some()).collect();
    let Some(&best) = found.iter().max_by_key(|&&i| score(i)) else {
        return Err(unsupported("has no depth images".into()));
    };
    let name = |i: usize| store.channel(i).map_or("", |c| c.topic.as_str());
    if found.len() > 1 {
        let others: Vec<_> = found.iter().filter(|&&i| i != best).map(|&i| name(i)).collect();
        notes.push(format!(
            "depth is {}; there is also {} (depth.path in a camera file chooses)",
            name(best),
            others.join(", ")
        ));
    }
    Ok(best)
}

/// The channel of a sort whose topic has most in common with `topic`, from the front.
fn beside(store: &Store, topic: &str, is: impl Fn(usize) -> bool) -> Option<usize> {
    let common = |i: usize| {
        let name = store.channel(i).map_or("", |c| c.topic.as_str());
        name.split('/').zip(topic.split('/')).take_while(|(a, b)| a == b).count()
    };
    // The first of several alike, hence reversed.
    (0..store.contents.channels.len()).rev().filter(|&i| is(i)).max_by_key(|&i| common(i))
}

/// A RealSense's depth unit is one of its options, on a topic beside the depth stream's.
fn realsense_unit(store: &mut Store, topic: &str, bytes: &mut Vec<u8>) -> Option<DepthUnit> {
    let is_unit = |name: &str| name.ends_with("/Depth Units/value") || name.ends_with("/Depth_Units/value");
    let option =
        beside(store, topic, |i| store.channel(i).is_some_and(|c| c.kind == Kind::Number && is_unit(&c.topic)))?;
    let place = *store.channel(option)?.messages.first()?;
    match store.message(option, place, bytes) {
        Ok((_, Message::Number(unit))) => DepthUnit::new(unit).ok(),
        _ => None,
    }
}

fn pose_of(t: &Transform) -> Option<Pose> {
    Pose::new(Quat::from_array(t.rotation.map(|v| v as f32)), Vec3::from(t.translation.map(|v| v as f32))).ok()
}

type Transforms = (Vec<usize>, HashMap<String, (String, Pose)>, Option<usize>);

/// The channels that move, the transforms that don't, and a channel of poses.
fn transforms(store: &mut Store, bytes: &mut Vec<u8>) -> Transforms {
    let (mut moving, mut fixed, mut poses) = (Vec::new(), HashMap::new(), Vec::new());
    for i in 0..store.contents.channels.len() {
        let Some(c) = store.channel(i) else { continue };
        match c.kind {
            Kind::Transforms | Kind::Transform if c.topic.ends_with("static") => {
                for place in c.messages.clone() {
                    if let Ok((_, Message::Transforms(list))) = store.message(i, place, bytes) {
                        for t in list {
                            if let Some(pose) = pose_of(&t) {
                                fixed.insert(t.child, (t.parent, pose));
                            }
                        }
                    }
                }
            }
            Kind::Transforms | Kind::Transform => moving.push(i),
            Kind::Pose => poses.push(i),
            _ => {}
        }
    }
    // Whose pose it is, a message does not say; of several none is taken.
    let pose = if let [one] = poses[..] { Some(one) } else { None };
    (moving, fixed, pose)
}

impl MessageRecording {
    /// Reads the first frame for what can't be known without, and collects the notes.
    fn probe(&mut self, topic: &str, mut notes: Vec<String>) -> Result<(), SourceError> {
        let mut frame = OwnedFrame::new();
        let mut first_error = None;
        for index in 0..self.len().min(PROBES) {
            self.next = index;
            match self.fill(&mut frame) {
                Ok(numbers) => {
                    self.info.size = Some(frame.size());
                    self.info.intrinsics = frame.intrinsics;
                    self.info.has_poses = frame.pose.is_some();
                    if numbers == Numbers::U16 && self.unit.is_none() {
                        notes.push(
                            "depth of 16 bits is taken to be millimetres, as ROS has it (--unit says otherwise)".into(),
                        );
                    }
                    first_error = None;
                    break;
                }
                Err(e) => first_error = first_error.or(Some(e)),
            }
        }
        self.next = 0;
        if let Some(e) = first_error {
            return Err(e);
        }
        if self.set.fx.is_some() {
            notes.push("the camera is the one given by hand, not the recording's".into());
        }
        if let Some(colour) = self.colour.and_then(|i| self.store.channel(i)) {
            let colour = colour.topic.clone();
            if self.said.is_none() {
                notes.push(self.colour_note(topic, &colour));
            }
        }
        if self.pose.is_some() && self.info.has_poses && self.moving.is_empty() {
            notes.push("the poses are taken to be the depth camera's".into());
        }
        if self.info.has_poses && self.info.up.is_none() && self.said.is_none() {
            // REP 103; Foxglove's world is the same.
            self.info.up = Some(Vec3::Z);
            notes.push("up is taken to be z of the poses' world, as ROS has it (--up says otherwise)".into());
        }
        self.info.notes = notes;
        Ok(())
    }

    /// Where the colour camera is, when that is known.
    fn colour_note(&mut self, depth: &str, colour: &str) -> String {
        let mut place = |topic: &str| {
            let channels = &self.store.contents.channels;
            let prefix = topic.split("/image/").next().unwrap_or(topic);
            let of = |c: &&crate::store::Channel| c.kind == Kind::BareTransform && c.topic.starts_with(prefix);
            let i = channels.iter().position(|c| of(&c))?;
            let at = *self.store.channel(i)?.messages.first()?;
            match self.store.message(i, at, &mut self.bytes) {
                Ok((_, Message::Transforms(list))) => list.first().and_then(pose_of),
                _ => None,
            }
        };
        // Each stream's transform leads to the same stream of reference.
        let apart = place(depth).zip(place(colour)).map(|(d, c)| d.inverse().compose(&c));
        match apart {
            Some(p) if p.translation().length() > 1e-6 => {
                let mm = p.translation() * 1e3;
                let turned = p.rotation().angle_between(Quat::IDENTITY).to_degrees();
                format!(
                    "colour is {colour}, another camera's: it stands ({:.1}, {:.1}, {:.1}) mm from depth's, turned by {turned:.2} degrees; its pixels are not aligned to depth's",
                    mm.x, mm.y, mm.z
                )
            }
            Some(_) => format!("colour is {colour}, from depth's own camera"),
            None => format!("colour is {colour}, taken to be of depth's view"),
        }
    }

    /// Fills the frame with the next message and what belongs to it.
    fn fill(&mut self, frame: &mut OwnedFrame) -> Result<Numbers, SourceError> {
        let index = self.next;
        self.next += 1;
        frame.clear();
        let Some(&place) = self.store.channel(self.depth).and_then(|c| c.messages.get(index)) else {
            return Err(SourceError::OutOfRange { asked: index, len: self.len() });
        };
        let restore = self.said.as_ref().and_then(|s| s.restore);
        let ours = self.said.is_some();
        let mut bytes = std::mem::take(&mut self.bytes);
        let read = self.store.message(self.depth, place, &mut bytes).and_then(|(sequence, message)| {
            let Message::Image(image) = message else { return Err(self.broken(index, "is no image")) };
            let numbers = depth_into(&image, restore, frame)
                .map_err(|e| self.broken(index, &format!("{}; {}", e.what, e.hint)))?;
            frame.time = image.stamp;
            // Of ours the sender's number is the frame's; others count as they like, or not at all.
            frame.sequence = if ours { u64::from(sequence) } else { index as u64 };
            Ok((numbers, image.frame.into_owned()))
        });
        self.bytes = bytes;
        let (numbers, camera_frame) = read?;
        if let (Numbers::U16, Some(unit)) = (numbers, self.unit) {
            frame.unit = unit;
        }
        if frame.time == Timestamp::ZERO && place.log_time > 0 && !ours {
            frame.time = Timestamp::from_nanos(i64::try_from(place.log_time).unwrap_or(i64::MAX));
        }
        let camera = self.camera(index, place.log_time, frame.size())?;
        self.images(place.log_time, frame);
        if let Some(limits) = self.limits {
            frame.apply_limits(limits);
        }
        frame.straighten(&camera);
        frame.pose = self.pose(place.log_time, &camera_frame);
        Ok(numbers)
    }

    /// Colour and confidence.
    fn images(&mut self, time: u64, frame: &mut OwnedFrame) {
        for (channel, what) in [(self.confidence, "confidence"), (self.colour, "colour")] {
            let Some((channel, c)) = channel.and_then(|i| Some((i, self.store.channel(i)?))) else { continue };
            let Some(place) = nearest(&c.messages, time).filter(|m| m.log_time.abs_diff(time) <= self.association)
            else {
                // In ours, what is not beside a frame was not there.
                if self.said.is_none() {
                    let within = self.association as f64 * 1e-9;
                    frame.notes.push(format!("no {what}: {} has none within {within} s", c.topic));
                }
                continue;
            };
            if self.said.is_some() && place.log_time != time {
                continue;
            }
            let read = self.store.message(channel, place, &mut self.bytes).map_err(|e| e.to_string());
            let filled = read.and_then(|(_, message)| match message {
                Message::Image(image) if what == "colour" => colour_into(&image, frame).map_err(|e| e.to_string()),
                Message::Image(image) => confidence_into(&image, frame).map_err(|e| e.to_string()),
                _ => Err("the message is no image".to_owned()),
            });
            if let Err(e) = filled {
                // Depth answers without; whoever wants them reads the note.
                if what == "colour" {
                    frame.clear_colour();
                } else {
                    frame.clear_confidence();
                }
                frame.notes.push(format!("no {what}: {e}"));
            }
        }
    }

    fn broken(&self, index: usize, what: &str) -> SourceError {
        let topic = self.store.channel(self.depth).map_or("", |c| c.topic.as_str());
        SourceError::Format {
            path: self.store.path().into(),
            line: None,
            what: format!("frame {index} ({topic}): {what}"),
            hint: "the other frames may be fine".into(),
        }
    }

    /// The camera of the frame written down at `time`.
    fn camera(&mut self, index: usize, time: u64, size: (usize, usize)) -> Result<Camera, SourceError> {
        let set = &self.set;
        if let (Some(fx), Some(fy), Some(cx), Some(cy)) = (set.fx, set.fy, set.cx, set.cy) {
            let intrinsics = Intrinsics::new(fx, fy, cx, cy).map_err(|e| self.broken(index, &e.to_string()))?;
            let distortion = set.distortion.as_deref().and_then(Distortion::from_slice).unwrap_or_default();
            return Ok(Camera { intrinsics, distortion });
        }
        let place = self.camera.and_then(|i| Some((i, nearest(&self.store.channel(i)?.messages, time)?)));
        let Some((channel, place)) = place else {
            return Err(SourceError::MissingCalibration {
                path: self.store.path().into(),
                needed: vec!["fx", "fy", "cx", "cy"],
                hint: "the recording has no camera info: give --intrinsics FX,FY,CX,CY --unit METRES_PER_STEP".into(),
            });
        };
        if self.known.place != Some(place) {
            let (_, message) = self.store.message(channel, place, &mut self.bytes)?;
            if let Message::CameraInfo(info) = message {
                self.known = Known { place: Some(place), info: Some(info) };
            }
        }
        let Some(info) = &self.known.info else { return Err(self.broken(index, "has no camera info")) };
        let said = (info.width as usize, info.height as usize);
        if said != (0, 0) && said != size {
            return Err(
                self.broken(index, &format!("is {}x{}, its camera info is for {}x{}", size.0, size.1, said.0, said.1))
            );
        }
        let [fx, _, cx, _, fy, cy, ..] = info.k.map(|v| v as f32);
        let intrinsics = Intrinsics::new(fx, fy, cx, cy).map_err(|e| self.broken(index, &e.to_string()))?;
        let d: Vec<f32> = info.d.iter().map(|&v| v as f32).collect();
        let distortion = if d.iter().all(|&v| v == 0.0) {
            Distortion::default()
        } else {
            Distortion::from_slice(&d).ok_or_else(|| {
                self.broken(
                    index,
                    &format!("has a lens of model {:?} with {} coefficients, which is not known", info.model, d.len()),
                )
            })?
        };
        Ok(Camera { intrinsics, distortion })
    }

    /// Where the camera stood.
    fn pose(&mut self, time: u64, camera: &str) -> Option<Pose> {
        let mut links: HashMap<String, (String, Pose, u64)> = HashMap::new();
        for i in self.moving.clone() {
            let messages = &self.store.channel(i)?.messages;
            let from = messages.partition_point(|m| m.log_time < time.saturating_sub(self.association));
            let to = messages.partition_point(|m| m.log_time <= time.saturating_add(self.association));
            for place in messages.get(from..to).unwrap_or(&[]).to_vec() {
                let Ok((_, Message::Transforms(list))) = self.store.message(i, place, &mut self.bytes) else {
                    continue;
                };
                let away = place.log_time.abs_diff(time);
                for t in list {
                    if links.get(&t.child).is_none_or(|(_, _, before)| away < *before)
                        && let Some(pose) = pose_of(&t)
                    {
                        links.insert(t.child, (t.parent, pose, away));
                    }
                }
            }
        }
        let (mut at, mut whole, mut moves) = (camera.to_owned(), Pose::IDENTITY, false);
        for _ in 0..MOST_LINKS {
            let (parent, pose) = match (links.get(&at), self.fixed.get(&at)) {
                (Some((parent, pose, _)), _) => {
                    moves = true;
                    (parent, pose)
                }
                (None, Some((parent, pose))) => (parent, pose),
                (None, None) => break,
            };
            whole = pose.compose(&whole);
            at.clone_from(parent);
        }
        if at != camera && (moves || matches!(at.trim_start_matches('/'), WORLD | "map" | "odom")) {
            return Some(whole);
        }
        let i = self.pose?;
        let place = nearest(&self.store.channel(i)?.messages, time)
            .filter(|m| m.log_time.abs_diff(time) <= self.association)?;
        match self.store.message(i, place, &mut self.bytes) {
            Ok((_, Message::Transforms(list))) => list.first().and_then(pose_of),
            _ => None,
        }
    }
}

impl Recording for MessageRecording {
    fn len(&self) -> usize {
        self.store.channel(self.depth).map_or(0, |c| c.messages.len())
    }

    fn position(&self) -> usize {
        self.next
    }

    fn set_position(&mut self, index: usize) {
        self.next = index;
    }
}

impl DepthSource for MessageRecording {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_into(&mut self, frame: &mut OwnedFrame, _: Deadline) -> Result<Outcome, SourceError> {
        if self.next >= self.len() {
            return Ok(Outcome::EndOfStream);
        }
        self.fill(frame).map(|_| Outcome::Frame)
    }
}
