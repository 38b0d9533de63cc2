//! From a path to a source: which node, which format, whose calibration, which nodes beside it.
//!
//! What a driver grants is looked at, never what was asked: `VIDIOC_S_FMT` succeeds with another format than it was given (vivid answers `Z16 ` with
//! `YUYV`), and frames of the wrong format are no frames.

use std::path::Path;

use isobath::sensing::depth::decode::format::Format as Pixels;
use isobath::wire::device::d4xx::intrinsics::colour as colour_camera;
use isobath_source::permission::Subsystem;
use isobath_source::stats::SequenceGaps;
use isobath_source::{BackPressure, Clock, DeviceClock, HostNanos, SourceError, SourceInfo};

use crate::colour::{ColourView, Form};
use crate::decode::{Decoder, stride};
use crate::meta::MetaStream;
use crate::options::OpenOptions;
use crate::profile::{ColourFacts, Facts, Family, calibrate, orbbec, realsense};
use crate::queue::{Failure, uninterrupted};
use crate::source::{Colour, Place, V4l2Source};
use crate::stream::Stream;
use crate::sys::{Errno, Format, FourCc, FrameSize, Kind, SysResult, V4l2Open, V4l2Sys};
use crate::sysfs::Node;

/// Depth formats, the best first.
const DEPTH: [Pixels; 8] =
    [Pixels::Z16, Pixels::Inzi, Pixels::Y16, Pixels::Y16Be, Pixels::Y14, Pixels::Y12, Pixels::Y10, Pixels::Y10b];
/// Formats and sizes that a node may list: a driver without an end must not keep us.
const LISTED: u32 = 256;
/// Sizes that are taken where nobody says one.
const SIZES: [(u32, u32); 2] = [(848, 480), (640, 480)];

/// The formats of a node.
pub(crate) fn formats(sys: &mut impl V4l2Sys, kind: Kind) -> Vec<FourCc> {
    (0..LISTED).map_while(|i| uninterrupted(|| sys.format_at(kind, i)).ok()).collect()
}

/// The sizes of a format.
pub(crate) fn sizes(sys: &mut impl V4l2Sys, fourcc: FourCc) -> Vec<FrameSize> {
    (0..LISTED).map_while(|i| uninterrupted(|| sys.size_at(fourcc, i)).ok()).collect()
}

/// Whether a size is among those listed.
fn has(sizes: &[FrameSize], (width, height): (u32, u32)) -> bool {
    sizes.iter().any(|size| match *size {
        FrameSize::Discrete(w, h) => (w, h) == (width, height),
        FrameSize::Range { least, most } => (least.0..=most.0).contains(&width) && (least.1..=most.1).contains(&height),
    })
}

/// The depth format among those of a node that is taken: the one asked for, or the best.
pub(crate) fn depth_format(formats: &[FourCc], asked: Option<FourCc>) -> Option<Pixels> {
    let mut depth = DEPTH.iter().filter(|f| f.fourcc().is_some_and(|code| formats.contains(&FourCc(code))));
    match asked {
        Some(asked) => depth.find(|f| f.fourcc() == Some(asked.0)).copied(),
        None => depth.next().copied(),
    }
}

fn list(formats: &[FourCc]) -> String {
    let names: Vec<_> = formats.iter().map(FourCc::to_string).collect();
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

/// A node that was opened, with what it is.
struct Opened<S> {
    sys: S,
    kind: Kind,
    place: Place,
    node: Option<Node>,
    formats: Vec<FourCc>,
    card: String,
}

fn usb_of(node: Option<&Node>) -> Option<(u16, u16)> {
    let usb = node?.usb.as_ref()?;
    Some((usb.vendor, usb.product))
}

/// Opens a node and asks what it is.
fn look<O: V4l2Open>(opener: &O, path: &Path, node: Option<Node>) -> Result<Opened<O::Sys>, SourceError> {
    let place = Place { path: path.into(), usb: usb_of(node.as_ref()) };
    let mut sys = uninterrupted(|| opener.open(path))
        .map_err(|e| SourceError::open_device(path, Subsystem::Video4Linux, place.usb, e.into()))?;
    let doing = "asking what it is";
    let cap = uninterrupted(|| sys.capability()).map_err(|errno| match errno {
        Errno::ENOTTY | Errno::EINVAL => SourceError::Unsupported {
            path: path.into(),
            what: "is no Video4Linux device".into(),
            hint: "cameras are /dev/videoN; isobath devices lists them".into(),
        },
        errno => place.error(Failure { doing, errno }),
    })?;
    let kind = cap.kind().ok_or_else(|| SourceError::Unsupported {
        path: path.into(),
        what: format!("{} ({}) captures nothing", cap.card, cap.driver),
        hint: "another node of the same device may; isobath devices lists them".into(),
    })?;
    let formats = formats(&mut sys, kind);
    Ok(Opened { sys, kind, place, node, formats, card: cap.card })
}

/// A depth node, its format, and what to tell about the choice.
type Chosen<S> = (Opened<S>, Pixels, Vec<String>);

/// The node with depth: the one at `path`, or another of the same USB device.
fn depth_node<O: V4l2Open>(opener: &O, path: &Path, options: &OpenOptions) -> Result<Chosen<O::Sys>, SourceError> {
    let node = options.roots.find(path);
    let opened = look(opener, path, node)?;
    if opened.kind != Kind::Meta
        && let Some(pixels) = depth_format(&opened.formats, options.format)
    {
        return Ok((opened, pixels, Vec::new()));
    }
    // Depth in so many words: another grey node of the device would be a guess.
    let asked = options.format.unwrap_or(FourCc(*b"Z16 "));
    for sibling in opened.node.iter().flat_map(|node| options.roots.siblings(node)) {
        let Ok(other) = look(opener, &sibling.path.clone(), Some(sibling)) else { continue };
        if other.kind != Kind::Meta
            && let Some(pixels) = depth_format(&other.formats, Some(asked))
        {
            let note =
                format!("{} has no depth: {} of the same camera is read", path.display(), other.place.path.display());
            return Ok((other, pixels, vec![note]));
        }
    }
    let wanted = options.format.map_or_else(|| "depth in a known form".into(), |f| f.to_string());
    Err(SourceError::Unsupported {
        path: path.into(),
        what: format!("{} has no {wanted}; its formats: {}", opened.card, list(&opened.formats)),
        hint: "depth comes as Z16, INZI, or (with a calibration that says so) Y16, Y14, Y12, Y10, Y10B".into(),
    })
}

/// Asks for a format; what is granted must be it.
fn set<S: V4l2Sys>(opened: &mut Opened<S>, asked: &Format) -> Result<Format, SourceError> {
    let (sys, kind) = (&mut opened.sys, opened.kind);
    let granted = uninterrupted(|| sys.set_format(kind, asked))
        .map_err(|errno| opened.place.error(Failure { doing: "setting the format", errno }))?;
    if (granted.fourcc, granted.width, granted.height) == (asked.fourcc, asked.width, asked.height) {
        return Ok(granted);
    }
    let sizes: Vec<String> = sizes(sys, asked.fourcc)
        .iter()
        .map(|size| match size {
            FrameSize::Discrete(w, h) => format!("{w}x{h}"),
            FrameSize::Range { least, most } => format!("{}x{} to {}x{}", least.0, least.1, most.0, most.1),
        })
        .collect();
    Err(SourceError::Unsupported {
        path: opened.place.path.clone(),
        what: format!(
            "{} at {}x{} was asked for, {} at {}x{} was granted",
            asked.fourcc, asked.width, asked.height, granted.fourcc, granted.width, granted.height
        ),
        hint: format!(
            "ask for what it has: formats {}; sizes of {}: {}",
            list(&opened.formats),
            asked.fourcc,
            if sizes.is_empty() { "not listed".into() } else { sizes.join(", ") }
        ),
    })
}

/// The size to ask for.
fn size<S: V4l2Sys>(opened: &mut Opened<S>, fourcc: FourCc, given: Option<(u32, u32)>) -> (u32, u32) {
    if let Some(size) = given {
        return size;
    }
    let listed = sizes(&mut opened.sys, fourcc);
    if let Some(size) = SIZES.into_iter().find(|s| has(&listed, *s)) {
        return size;
    }
    let (sys, kind) = (&mut opened.sys, opened.kind);
    match (listed.first(), uninterrupted(|| sys.format(kind))) {
        (Some(FrameSize::Discrete(w, h)), _) => (*w, *h),
        (_, Ok(now)) if now.width > 0 && now.height > 0 => (now.width, now.height),
        (Some(FrameSize::Range { most, .. }), _) => *most,
        _ => SIZES[1],
    }
}

/// Sets the frame rate; a note when it is another.
fn rate<S: V4l2Sys>(sys: &mut S, kind: Kind, rate: u32, notes: &mut Vec<String>) {
    let granted: SysResult<(u32, u32)> = uninterrupted(|| sys.set_interval(kind, (1, rate.max(1))));
    match granted {
        Ok((n, d)) if n > 0 && d == rate.saturating_mul(n) => {}
        Ok((n, d)) if n > 0 => {
            notes.push(format!("the camera gives {:.1} frames a second, not {rate}", f64::from(d) / f64::from(n)));
        }
        Ok(_) | Err(Errno::ENOTTY | Errno::EINVAL) => {
            notes.push("the frame rate can't be set: it is what the camera gives".into());
        }
        Err(errno) => notes.push(format!("the frame rate could not be set: {errno}")),
    }
}

/// The metadata node of an interface.
fn metadata<O: V4l2Open>(
    opener: &O,
    options: &OpenOptions,
    node: &Node,
    notes: &mut Vec<String>,
) -> Option<MetaStream<O::Sys>> {
    // A UVC interface may have several streams; each one's metadata node is the next one registered.
    let mut siblings = options.roots.siblings(node);
    siblings.retain(|s| s.interface == node.interface);
    siblings.sort_by_key(|s| (s.index < node.index, s.index));
    for sibling in siblings {
        match look(opener, &sibling.path.clone(), Some(sibling.clone())) {
            Ok(opened) if opened.kind == Kind::Meta => match MetaStream::new(opened.sys) {
                Ok(meta) => return Some(meta),
                Err(failure) => notes.push(format!(
                    "{}: no known metadata format ({}); frames have their time of arrival",
                    sibling.path.display(),
                    failure.errno
                )),
            },
            Ok(_) => {}
            Err(error) => notes.push(format!("no metadata: {error}")),
        }
    }
    None
}

/// The colour camera of the device.
fn colour<O: V4l2Open>(
    opener: &O,
    options: &OpenOptions,
    node: &Node,
    facts: &ColourFacts,
    size: (u32, u32),
    notes: &mut Vec<String>,
) -> Option<Colour<O::Sys>> {
    for sibling in options.roots.siblings(node).into_iter().filter(|s| s.interface != node.interface) {
        let Ok(mut opened) = look(opener, &sibling.path.clone(), Some(sibling)) else { continue };
        if opened.kind == Kind::Meta {
            continue;
        }
        let Some(fourcc) =
            [b"YUYV", b"UYVY", b"MJPG"].into_iter().map(|c| FourCc(*c)).find(|c| opened.formats.contains(c))
        else {
            continue;
        };
        let form = Form::of(fourcc.0)?;
        // As large as depth, where there is that: nothing finer can be seen.
        let listed = sizes(&mut opened.sys, fourcc);
        let asked = [size, (640, 480), (1280, 720)].into_iter().find(|s| listed.is_empty() || has(&listed, *s))?;
        let granted = match set(&mut opened, &Format::ask(fourcc, asked.0, asked.1)) {
            Ok(granted) => granted,
            Err(error) => {
                notes.push(format!("no colour: {error}"));
                return None;
            }
        };
        rate(&mut opened.sys, opened.kind, options.rate, &mut Vec::new());
        let (w, h) = (granted.width as usize, granted.height as usize);
        let step = (granted.planes[0].bytes_per_line as usize).max(w * 2);
        let camera =
            colour_camera(&facts.table, u16::try_from(granted.width).ok()?, u16::try_from(granted.height).ok()?)?;
        let view = ColourView::new(form, (w, h), step, camera, facts.pose);
        let stream = Stream::new(opened.sys, opened.kind, granted, form.need(w, h, step), BackPressure::Latest);
        return Some(Colour { stream, view });
    }
    notes.push("no colour: the camera has no node with YUYV, UYVY or MJPG".into());
    None
}

/// Opens a depth camera through a system: Linux's (`open`, with the feature `live`), or a scripted one of tests.
///
/// # Errors
/// [`SourceError`]: no such node, not permitted, in use, no depth format, another format granted, or a calibration that neither camera nor caller has.
pub fn open_with<O: V4l2Open>(
    opener: &O,
    clock: Box<dyn Clock + Send>,
    path: &Path,
    options: &OpenOptions,
) -> Result<V4l2Source<O::Sys>, SourceError> {
    let values = options.values()?;
    let (mut opened, pixels, mut notes) = depth_node(opener, path, options)?;
    let fourcc = FourCc(pixels.fourcc().unwrap_or(*b"Z16 "));
    let from_file = || Some((u32::try_from(values.width?).ok()?, u32::try_from(values.height?).ok()?));
    let size = size(&mut opened, fourcc, options.size.or_else(from_file));
    let granted = set(&mut opened, &Format::ask(fourcc, size.0, size.1))?;
    rate(&mut opened.sys, opened.kind, options.rate, &mut notes);

    let family = Family::of(opened.place.usb);
    let mut facts = match family {
        Family::RealSense(model) => realsense::inspect(&mut opened.sys, model, size),
        Family::Orbbec(model) => orbbec::inspect(&mut opened.sys, model),
        Family::Generic => Facts { kind: format!("{} (generic profile)", opened.card), ..Facts::default() },
    };
    notes.append(&mut facts.notes);
    let calibration = calibrate(&facts, &values, size, &opened.place.path, options.camera.as_deref())?;

    let (width, height) = (size.0 as usize, size.1 as usize);
    let plane = granted.planes[0];
    let step = stride(pixels, width, plane.bytes_per_line as usize);
    let mut decoder = Decoder::new(pixels, (width, height), step, calibration.meaning);
    decoder.nothing = values.depth.background.map(|v| v as u16).or(decoder.nothing);
    decoder.ignore_rows = values.depth.ignore_rows.unwrap_or(0);
    decoder.limits = calibration.limits;
    if step < pixels.row_bytes(width) || decoder.need() > plane.size as usize {
        return Err(SourceError::Unsupported {
            path: opened.place.path.clone(),
            what: format!(
                "the driver grants {} bytes with {} a row for {width}x{height} of {fourcc}, which needs {} with {}",
                plane.size,
                plane.bytes_per_line,
                pixels.image_bytes(width, height, pixels.row_bytes(width)),
                pixels.row_bytes(width)
            ),
            hint: "the driver is at fault: report it with the kernel's version; another size may work".into(),
        });
    }

    let mut meta = None;
    let mut second = None;
    if let Some(node) = &opened.node {
        meta = metadata(opener, options, node, &mut notes);
        if let (true, Some(colour_facts)) = (options.colour, &facts.colour) {
            second = colour(opener, options, node, colour_facts, size, &mut notes);
        }
    }
    let device_clock = meta.as_ref().and(facts.clock_hz).and_then(|hz| DeviceClock::new(32, hz));
    notes.push(match &meta {
        Some(meta) if device_clock.is_some() && meta.format() == crate::meta::BARE => {
            "times are by the camera's clock (UVCH); the exposure and the camera's own count are not known: this kernel does not hand the camera's metadata over (Linux 6.17 does)".into()
        }
        Some(meta) if device_clock.is_some() => {
            format!("times are of the exposure's middle, by the camera's clock ({})", meta.format())
        }
        _ => "times are of arrival: later than the exposure by read-out and transfer".into(),
    });
    if !calibration.camera.distortion.is_none() {
        notes.push("depth is straightened by the lens model".into());
    }
    let info = SourceInfo {
        kind: format!("{}, {fourcc} {width}x{height}", facts.kind),
        path: opened.place.path.clone(),
        size: Some((width, height)),
        intrinsics: calibration.camera.intrinsics,
        up: None,
        has_colour: second.is_some(),
        has_poses: false,
        notes,
    };
    let need = decoder.need();
    Ok(V4l2Source {
        info,
        place: opened.place,
        clock,
        depth: Stream::new(opened.sys, opened.kind, granted, need, options.policy),
        decoder,
        camera: calibration.camera,
        meta,
        colour: second,
        device_clock,
        counter: SequenceGaps::default(),
        counted_at: None,
        last_info: None,
        started: false,
        last_time: HostNanos(0),
    })
}
