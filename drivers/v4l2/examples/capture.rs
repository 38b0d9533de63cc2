//! Reads frames of a camera and prints a line for each, then the counts: `capture /dev/videoN [--frames N] [--timeout-ms N] [--size WxH] [--rate N]
//! [--format FOURCC] [--unit METRES] [--intrinsics FX,FY,CX,CY] [--camera FILE] [--policy latest|every|N] [--no-colour]`, or `capture --list`.
//!
//! The exit code is 0 when all frames came, 1 for a wrong call or a camera that can't be opened, 2 when the device is gone, 3 after ten timeouts in a row.

use std::process::ExitCode;
use std::time::Duration;

use isobath_source::{BackPressure, Deadline, DepthSource, Outcome, OwnedFrame, SystemClock, Tracer};
use isobath_v4l2::OpenOptions;
use isobath_v4l2::sys::FourCc;
use isobath_v4l2::sys::live::Linux;

fn main() -> ExitCode {
    match run() {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            eprintln!("capture: {error}");
            ExitCode::FAILURE
        }
    }
}

fn pair(text: &str) -> Option<(u32, u32)> {
    let (a, b) = text.split_once('x')?;
    Some((a.parse().ok()?, b.parse().ok()?))
}

fn run() -> Result<u8, Box<dyn std::error::Error>> {
    let mut options = OpenOptions::default();
    let (mut path, mut frames, mut timeout) = (None, 30_u64, Duration::from_secs(2));
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| format!("{argument} needs a value"));
        match argument.as_str() {
            "--list" => {
                isobath_v4l2::devices().iter().for_each(|d| println!("{d}"));
                return Ok(0);
            }
            "--frames" => frames = value()?.parse()?,
            "--timeout-ms" => timeout = Duration::from_millis(value()?.parse()?),
            "--size" => options.size = Some(pair(&value()?).ok_or("--size is WxH")?),
            "--rate" => options.rate = value()?.parse()?,
            "--format" => {
                let text = format!("{:4}", value()?);
                let bytes: [u8; 4] = text.as_bytes().get(..4).ok_or("--format has four letters")?.try_into()?;
                options.format = Some(if text.ends_with("-BE") {
                    FourCc([bytes[0], bytes[1], bytes[2], b' ' | 0x80])
                } else {
                    FourCc(bytes)
                });
            }
            "--unit" => options.set.depth.unit = Some(value()?.parse()?),
            "--intrinsics" => {
                let numbers: Vec<f32> = value()?.split(',').map(str::parse).collect::<Result<_, _>>()?;
                let [fx, fy, cx, cy] = numbers[..] else { return Err("--intrinsics is FX,FY,CX,CY".into()) };
                let set = &mut options.set;
                (set.fx, set.fy, set.cx, set.cy) = (Some(fx), Some(fy), Some(cx), Some(cy));
            }
            "--camera" => options.camera = Some(value()?.into()),
            "--policy" => {
                options.policy = match value()?.as_str() {
                    "latest" => BackPressure::Latest,
                    "every" => BackPressure::Every,
                    n => BackPressure::Queue(n.parse()?),
                }
            }
            "--no-colour" => options.colour = false,
            _ => path = Some(argument),
        }
    }
    let path = path.ok_or("which node? capture /dev/videoN, or capture --list")?;
    let camera = isobath_v4l2::open_with(&Linux, Box::new(SystemClock), path.as_ref(), &options)?;
    let info = camera.info();
    let k = info.intrinsics;
    println!("opened {}: {}", info.path.display(), info.kind);
    println!("intrinsics {} {} {} {}", k.fx(), k.fy(), k.cx(), k.cy());
    info.notes.iter().for_each(|note| println!("note {note}"));

    let mut source = Tracer::new(camera, std::io::stdout(), SystemClock);
    source.start()?;
    let mut frame = OwnedFrame::new();
    let (mut got, mut timeouts, mut code) = (0, 0, 0);
    while got < frames {
        match source.next_into(&mut frame, Deadline::after(&SystemClock, timeout)) {
            Ok(Outcome::Frame) => {
                let (w, h) = frame.size();
                let colour = frame.colour().map(|c| c.size());
                println!(
                    "  unit {} valid {} middle {} m colour {colour:?}",
                    frame.unit.metres(),
                    frame.valid_pixels(),
                    frame.z(w / 2, h / 2)
                );
                (got, timeouts) = (got + 1, 0);
            }
            Ok(Outcome::TimedOut) => {
                timeouts += 1;
                if timeouts == 10 {
                    code = 3;
                    break;
                }
            }
            Ok(Outcome::EndOfStream) => break,
            Ok(_) => {}
            Err(error) if error.is_terminal() => {
                code = 2;
                break;
            }
            Err(_) => {}
        }
    }
    let stopped = source.stop();
    let (camera, ..) = source.into_parts();
    println!("stats {:?}", camera.stats());
    if let Some(estimate) = camera.clock_estimate() {
        println!("clock {estimate:?}");
    }
    if let Some(view) = camera.colour_view() {
        let (c, t) = (view.camera().intrinsics, view.pose().translation());
        println!("colour camera {} {} {} {} at {t} m, images {:?}", c.fx(), c.fy(), c.cx(), c.cy(), view.size());
    }
    stopped?;
    Ok(code)
}
