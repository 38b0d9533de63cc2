//! `isobath run`: the main job, and its report.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath_source::OwnedFrame;

use crate::args::RunArgs;
use crate::failure::{Failure, Outcome};
use crate::files;
use crate::pipeline::{Findings, Memory, Pipeline, World, lay_grid};
use crate::report::drawings::Drawings;
use crate::report::run::{Overview, Stats};
use crate::say::Say;
use crate::source::{Source, Up};
use crate::stop::Stop;

/// Depth of a known number type.
trait Typed: DepthSample {
    fn view(frame: &OwnedFrame) -> Option<DepthFrame<'_, Self>>;
}

impl Typed for u16 {
    fn view(frame: &OwnedFrame) -> Option<DepthFrame<'_, Self>> {
        frame.view_u16()
    }
}

impl Typed for f32 {
    fn view(frame: &OwnedFrame) -> Option<DepthFrame<'_, Self>> {
        frame.view_f32()
    }
}

pub(crate) fn run(args: &RunArgs, say: &mut Say) -> Outcome {
    let mut source = Source::open(&args.source)?;
    let mut first = OwnedFrame::new();
    source.read(0, &mut first)?;
    let up = source.up(&first);
    if first.view_u16().is_some() {
        go::<u16>(args, source, &first, up, say)
    } else {
        go::<f32>(args, source, &first, up, say)
    }
}

fn go<D: Typed>(args: &RunArgs, mut source: Source, first: &OwnedFrame, up: Up, say: &mut Say) -> Outcome {
    // A live source goes on until --frames or Ctrl-C; what is shown is then the frame after that.
    let endless = source.len().is_none() && args.frames.is_none();
    let frames = args.frames.unwrap_or(usize::MAX).min(source.len().unwrap_or(usize::MAX));
    if frames == 0 {
        return Err(Failure::new("there are no frames to work on").at(source.name()).advise("give --frames 1 or more"));
    }
    let mut shown = args.show.unwrap_or(frames - 1);
    if shown >= frames {
        return Err(Failure::new(format!("frame {shown} is not among the {frames} frames worked on"))
            .at("--show")
            .advise(format!("give a frame from 0 to {}", frames - 1)));
    }
    let out = args.out.clone().unwrap_or_else(|| default_out(&args.source.src));
    files::create_folder(&out)?;
    let repeat = args.repeat.unwrap_or(if frames == 1 { 15 } else { 1 });

    let wrong_type = || Failure::new("the number type of depth changed within the recording").at(source.name());
    let view = D::view(first).ok_or_else(wrong_type)?;
    // Without poses each frame is a world of its own, and so is its map.
    let moves = frames > 1 && first.pose.is_some();
    let (grid, grounded) = lay_grid(&view, up.direction, moves)?;
    let world = World { up: up.direction, grid, grounded, moves };
    let (width, height) = view.size();
    let mut memory = Memory::<D>::new(width, height);
    let bytes = memory.bytes();

    let bar = progress((!endless).then_some(frames));
    let stop = Stop::on_ctrl_c();
    let mut done = 0;
    let mut stats = Stats::default();
    let mut drawings: Option<Drawings> = None;
    let mut frame = OwnedFrame::new();
    let mut pipeline = Pipeline::new(&mut memory, world)?;
    let mut unread = Vec::new();
    let mut last_shown = None;
    for index in 0..frames {
        let last = stop.asked();
        if last && drawings.is_none() {
            shown = index;
        }
        let start = Instant::now();
        if let Err(failure) = source.read(index, &mut frame) {
            // One broken file among many is a note; the only frame is a failure.
            if frames == 1 || (endless && unread.len() > 20) {
                return Err(failure);
            }
            unread.push(format!("frame {index} left out: {}", failure.to_string().replace('\n', ";")));
            bar.inc(1);
            continue;
        }
        stats.read(start.elapsed());
        let view = D::view(&frame)
            .filter(|v| v.size() == (width, height))
            .ok_or_else(|| Failure::new("size or number type of depth changed").at(format!("frame {index}")))?;
        let mut findings: Option<Findings> = None;
        for _ in 0..repeat {
            if !moves {
                pipeline.forget(view_world(&view, &world, frames)?)?;
            }
            let found = pipeline.frame(&view)?;
            stats.stages(&found.times);
            findings = Some(found);
        }
        if let Some(found) = findings {
            stats.frame(index, &found, frame.notes.clone());
            if index == shown || (index > shown && drawings.is_none()) {
                drawings = Some(Drawings::new(&view, &found, &pipeline)?);
                last_shown = Some((index, found));
            }
        }
        done = index + 1;
        bar.inc(1);
        if last {
            break;
        }
    }
    bar.finish_and_clear();
    let Some((shown, found)) = last_shown else {
        return Err(Failure::new("no frame could be read").at(source.name()).advise(unread.join("; ")));
    };
    let html = out.join("report.html");
    let json = out.join("report.json");
    let overview = Overview {
        source: &source,
        size: (width, height),
        frames: done.max(1),
        repeat,
        shown,
        found: &found,
        up,
        bytes: &bytes,
        stats: &stats,
        has_poses: first.pose.is_some(),
        unread: &unread,
        report: &html,
    };
    overview.tell(say);
    let value = overview.json();
    say.json(&value);
    let mut value = value;
    crate::say::shorten(&mut value);
    files::write_text(&json, &format!("{value:#}\n"))?;
    if let Some(drawings) = drawings {
        files::write_text(&html, &overview.page(drawings).html())?;
    }
    Ok(())
}

/// The world of one frame: as it is, or laid anew under a frame that shares no world with the first.
fn view_world<D: DepthSample>(view: &DepthFrame<'_, D>, world: &World, frames: usize) -> Outcome<World> {
    if frames == 1 {
        return Ok(*world);
    }
    let (grid, grounded) = lay_grid(view, world.up, false)?;
    Ok(World { grid, grounded, ..*world })
}

fn default_out(src: &Path) -> PathBuf {
    let src = match src.to_str().and_then(|src| src.split_once(':')) {
        Some(("mcap" | "bag", file)) => Path::new(file),
        Some(("sim" | "v4l2" | "usb", what)) => {
            let name = what.replace(|c: char| !c.is_ascii_alphanumeric(), "-");
            return Path::new("out").join(name.trim_start_matches('-'));
        }
        _ => src,
    };
    // `.` and `..` have no name of their own.
    let whole = std::fs::canonicalize(src).unwrap_or_else(|_| src.to_owned());
    let name = whole.file_stem().map_or_else(|| "report".into(), ToOwned::to_owned);
    Path::new("out").join(name)
}

/// Drawn on stderr, and only when that is a terminal; `None` frames: nobody knows how many.
pub(crate) fn progress(frames: Option<usize>) -> ProgressBar {
    let (template, len) = match frames {
        Some(n) if n < 2 => return ProgressBar::hidden(),
        Some(n) => ("{bar:40} {pos}/{len} frames, {eta} left", Some(n as u64)),
        None => ("{spinner} {pos} frames, {elapsed}; Ctrl-C ends it", None),
    };
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::with_draw_target(len, ProgressDrawTarget::stderr()).with_style(style);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}
