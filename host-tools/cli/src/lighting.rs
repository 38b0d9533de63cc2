//! What light falls on a place: a recording's frames offered to one object's session, and what comes of them.
//!
//! | who | needs |
//! |---|---|
//! | `isobath envmap`, `isobath probe` | [`gather`]: every frame of a recording, an environment map |
//! | `isobath run` | [`Memory`]: a session beside the other stages |
//!
//! Maps are linear; 1 is the white of the recording's colour images. Their axes have +y up, whichever way is up in the recording.

use std::time::Instant;

use isobath::glam::Vec3;
use isobath::ground::colour::Colour;
use isobath::ground::image::ImageViewMut;
use isobath::lighting::equirect::{MapFrame, direction_of_pixel};
use isobath::lighting::far::extrapolate::FarMap;
use isobath::lighting::far::harmonics::{Harmonics, MainLight};
use isobath::lighting::far::{FarField, FarParams};
use isobath::lighting::near::{NearField, NearMemory, NearParams};
use isobath::lighting::policy::guided::{Directions, Guide, GuideParams, Next};
use isobath::lighting::policy::motion::{AutoCapture, Decision, MotionParams};
use isobath::lighting::preset::MOST_VIEWS;
use isobath::lighting::registration::{Progress, Registration, RegistrationParams, scratch_len};
use isobath::lighting::{Observed, Preset, Session};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::frame::DepthFrame;
use isobath_sim::{Ball, LinearImage, Rigid, V3, covers, render_ball, v3};
use isobath_source::{OwnedFrame, with_frame};
use serde_json::{Value, json};

use crate::args::{LightArgs, PresetName};
use crate::failure::{Failure, Outcome};
use crate::picture::raster::Raster;
use crate::say::{Say, bytes, count, duration, metres, point};
use crate::source::{Source, Up};

/// Directions of the far field.
pub(crate) const ANCHORS: usize = 1280;

/// All memory of one object's light, taken once.
#[derive(Debug)]
pub(crate) struct Memory<const COLUMNS: usize = 128, const ROWS: usize = 64> {
    preset: Preset,
    depth: Vec<u16>,
    colour: Vec<[u8; 3]>,
    layers: Vec<u32>,
    picture: Vec<[u8; 4]>,
    strip: Vec<u32>,
    far: Box<FarField<ANCHORS>>,
    grid: Box<FarMap<COLUMNS, ROWS>>,
}

impl<const COLUMNS: usize, const ROWS: usize> Memory<COLUMNS, ROWS> {
    pub(crate) fn new(preset: Preset) -> Self {
        let (views, levels) = (preset.views * preset.view_pixels(), preset.level_pixels());
        Self {
            preset,
            depth: vec![0; views],
            colour: vec![[0; 3]; views],
            layers: vec![0; preset.views * levels],
            picture: vec![[0; 4]; levels],
            strip: vec![0; preset.strip()],
            far: Box::new(FarField::new(FarParams::default(), [0.0; 3])),
            grid: Box::new(FarMap::new()),
        }
    }

    /// A new object's session: what was there is forgotten.
    pub(crate) fn session(&mut self, map: MapFrame, ambient: [f32; 3]) -> Outcome<Session<'_, ANCHORS, COLUMNS, ROWS>> {
        *self.far = FarField::new(FarParams::default(), ambient);
        *self.grid = FarMap::new();
        let Self { preset, depth, colour, layers, picture, strip, .. } = self;
        let memory = NearMemory { depth, colour, layers, picture, strip };
        let near =
            NearField::new(*preset, NearParams::default(), memory).map_err(|e| Failure::of(&e, "environment light"))?;
        Ok(Session::new(map, near, &mut self.far, &mut self.grid))
    }

    /// What the memory is for, and its bytes.
    pub(crate) fn bytes(&self) -> [(&'static str, usize); 4] {
        let views = size_of_val(self.depth.as_slice()) + size_of_val(self.colour.as_slice());
        let layers = size_of_val(self.layers.as_slice())
            + size_of_val(self.picture.as_slice())
            + size_of_val(self.strip.as_slice());
        [
            ("near views", views),
            ("their layers", layers),
            ("far anchors", size_of_val(&*self.far)),
            ("far grid", size_of_val(&*self.grid)),
        ]
    }
}

/// Mean linear colour of a frame, 64 pixels of each row and column at most: what an ambient light sensor would say.
pub(crate) fn mean_colour<D: DepthSample>(frame: &DepthFrame<'_, D>) -> [f32; 3] {
    let Some((colour, _)) = frame.colour() else { return [0.0; 3] };
    let (w, h) = colour.size();
    let (mut sum, mut n) = ([0.0_f32; 3], 0.0_f32);
    for y in (0..h).step_by(h.div_ceil(64).max(1)) {
        for pixel in colour.row(y).iter().step_by(w.div_ceil(64).max(1)) {
            n += 1.0;
            for (sum, v) in sum.iter_mut().zip(pixel.linear()) {
                *sum += v;
            }
        }
    }
    sum.map(|s| s / n.max(1.0))
}

/// The share of all directions in which a session's near field has something, 0 to 1.
pub(crate) fn near_share<const C: usize, const R: usize>(session: &Session<'_, ANCHORS, C, R>) -> f32 {
    let picture = session.near().picture();
    let (w, h) = picture.size();
    let (mut sum, mut all) = (0.0, 0.0);
    for (y, row) in picture.rows().enumerate() {
        let solid = (std::f32::consts::PI * (y as f32 + 0.5) / h as f32).sin();
        sum += solid * row.iter().filter(|p| p[3] > 0).count() as f32;
        all += solid * w as f32;
    }
    if all > 0.0 { sum / all } else { 0.0 }
}

/// A map's light as harmonics.
pub(crate) fn harmonics(map: &LinearImage) -> Harmonics {
    let (w, h) = (map.width.max(1), map.height);
    let mut sum = Harmonics::default();
    let columns: Vec<Vec3> = (0..w).map(|x| direction_of_pixel(x, 0, (w, 1))).collect();
    for (y, row) in map.pixels.chunks(w).enumerate() {
        let polar = |y: f32| std::f32::consts::PI * y / h as f32;
        let solid = std::f32::consts::TAU / w as f32 * (polar(y as f32).cos() - polar(y as f32 + 1.0).cos());
        let (sin, cos) = polar(y as f32 + 0.5).sin_cos();
        for (column, colour) in columns.iter().zip(row) {
            sum.add(Vec3::new(column.x * sin, cos, column.z * sin), *colour, solid);
        }
    }
    sum
}

/// Mirror, glossy and diffuse balls under a map, side by side, `size` pixels each, seen by a camera turned as `view`; 1 times
/// `exposure` is white.
pub(crate) fn balls(map: &LinearImage, view: &Rigid, size: usize, exposure: f32) -> Raster {
    let pictures = [Ball::Mirror, Ball::Glossy, Ball::Diffuse].map(|ball| render_ball(map, ball, view, size));
    let gap = size / 16;
    Raster::from_fn(3 * size + 4 * gap, size + 2 * gap, |x, y| {
        const AROUND: [u8; 3] = [30, 34, 40];
        let (Some(x), Some(y)) = (x.checked_sub(gap), y.checked_sub(gap)) else { return AROUND };
        let (which, x) = (x / (size + gap), x % (size + gap));
        match pictures.get(which) {
            Some(picture) if x < size && y < size && covers(x, y, size) => {
                <[u8; 3]>::of_linear(picture.get(x, y).map(|v| v * exposure))
            }
            _ => AROUND,
        }
    })
}

/// A map's pixels as bytes; 1 times `exposure` is white.
pub(crate) fn raster(map: &LinearImage, exposure: f32) -> Raster {
    Raster::from_fn(map.width, map.height, |x, y| <[u8; 3]>::of_linear(map.get(x, y).map(|v| v * exposure)))
}

/// The view of someone who looks at a map's middle place from `from` (map's axes), level.
pub(crate) fn view_from(from: Vec3) -> Rigid {
    let from = Vec3::new(from.x, 0.0, from.z).try_normalize().unwrap_or(Vec3::Z);
    Rigid::looking_at(v3(f64::from(from.x), 0.0, f64::from(from.z)), V3::ZERO)
}

/// What was taken of a recording.
#[derive(Debug, Default)]
pub(crate) struct Taken {
    /// Frames offered, and taken.
    pub(crate) offered: usize,
    pub(crate) frames: usize,
    /// Not taken: the camera moved; there was nothing new.
    moving: usize,
    not_new: usize,
    pub(crate) near: usize,
    pub(crate) points: usize,
    pub(crate) unsure: usize,
    pub(crate) far: usize,
    pub(crate) samples: usize,
    left_out: Vec<String>,
    observe: Vec<u64>,
    draw: Vec<u64>,
}

/// A place's light.
#[derive(Debug)]
pub(crate) struct Light {
    pub(crate) source: Source,
    pub(crate) frame: MapFrame,
    pub(crate) map: LinearImage,
    /// Where the last camera stood, from the place, in the map's axes.
    pub(crate) camera: Vec3,
    up: Up,
    preset: PresetName,
    taken: Taken,
    kept: usize,
    seen: usize,
    near_share: f32,
    memory: [(&'static str, usize); 5],
    /// And where to look next.
    guide: Option<(Guide, Next)>,
    registered: Option<Registered>,
}

/// What registration did.
#[derive(Debug, Default)]
struct Registered {
    times: Vec<u64>,
    corrected: usize,
    /// Of the corrected, those of which some directions are not known.
    degenerate: usize,
    /// Views left as tracked.
    left: usize,
    /// Largest correction, metres and radians.
    shift: f32,
    turn: f32,
    bytes: usize,
}

/// Makes near views agree with the newest one, whose pose is the tracker's word of now.
struct Registrar {
    memory: Vec<f32>,
    done: Registered,
}

impl Registrar {
    fn new(preset: &Preset) -> Self {
        let memory = vec![0.0; MOST_VIEWS * scratch_len(preset.view.0, preset.view.1)];
        let bytes = size_of_val(memory.as_slice()) + size_of::<Registration<'_, MOST_VIEWS>>();
        Self { memory, done: Registered { bytes, ..Registered::default() } }
    }

    fn run<const C: usize, const R: usize>(
        &mut self,
        session: &mut Session<'_, ANCHORS, C, R>,
        newest: usize,
        source: &str,
    ) -> Outcome {
        let slots = session.near().len();
        if slots < 2 {
            return Ok(());
        }
        let failed = |e: &dyn std::error::Error| Failure::of(e, format!("{source}, --register"));
        let start = Instant::now();
        let mut views = Registration::<MOST_VIEWS>::new(&mut self.memory, RegistrationParams::default());
        session.prepare(&mut views, &DepthNoise::KINECT).map_err(|e| failed(&e))?;
        views.start(&[newest]).map_err(|e| failed(&e))?;
        while views.step(usize::MAX) == Progress::Working {}
        let done = &mut self.done;
        for report in (0..slots).filter(|slot| *slot != newest).map(|slot| (slot, views.report(slot))) {
            let (slot, Some(report)) = report else { continue };
            if !report.outcome.is_corrected() {
                done.left += 1;
                continue;
            }
            session.correct(slot, report.pose);
            done.corrected += 1;
            done.degenerate += usize::from(report.unknown > 0);
            done.shift = done.shift.max(report.pose.translation().distance(report.tracked.translation()));
            done.turn = done.turn.max(report.pose.rotation().angle_between(report.tracked.rotation()));
        }
        done.times.push(nanos(start));
        Ok(())
    }
}

/// Offers every frame of a recording to a session at a place.
pub(crate) fn gather(args: &LightArgs) -> Outcome<Light> {
    let preset = args.preset.unwrap_or(PresetName::Low);
    match preset {
        // Its grid of 64 x 32 is part of what makes it tiny.
        PresetName::Tiny => go::<64, 32>(args, preset),
        _ => go::<128, 64>(args, preset),
    }
}

fn go<const COLUMNS: usize, const ROWS: usize>(args: &LightArgs, quality: PresetName) -> Outcome<Light> {
    let mut source = Source::open(&args.source)?;
    let mut frame = OwnedFrame::new();
    source.read(0, &mut frame)?;
    lit(&source, &frame)?;
    let up = source.up(&frame);
    let map = MapFrame::with_up(args.at, up.direction)
        .ok_or_else(|| Failure::new("the up direction has no length").at(source.name()))?;
    let preset = quality.preset();
    let mut memory = Memory::<COLUMNS, ROWS>::new(preset);
    let [views, layers, far, grid] = memory.bytes();
    let mut pixels = vec![[0.0_f32; 3]; preset.map_pixels()];
    let memory_of = [views, layers, far, grid, ("map", size_of_val(pixels.as_slice()))];
    let ambient = args.ambient.unwrap_or_else(|| with_frame!(frame, |f| mean_colour(f)));
    let mut session = memory.session(map, ambient)?;
    let mut out =
        ImageViewMut::new(&mut pixels, preset.map.0, preset.map.1).map_err(|e| Failure::of(&e, "environment map"))?;
    let mut taken = Taken::default();
    let mut policy = AutoCapture::<5, 5>::new(MotionParams::default()).map_err(|e| Failure::of(&e, "capture"))?;
    let mut guide: Option<Guide> = None;
    let mut registrar = args.register.then(|| Registrar::new(&preset));
    let mut last = isobath::sensing::camera::Pose::IDENTITY;
    let mut camera = Vec3::Z;
    let frames = source.len().ok_or_else(|| {
        Failure::new("the light of a place is gathered from a recording")
            .at(source.name())
            .advise("record one first: isobath record SRC --out F.mcap")
    })?;
    let bar = crate::commands::run::progress(Some(frames));
    for index in 0..frames {
        bar.inc(1);
        if let Err(failure) = source.read(index, &mut frame) {
            if frames == 1 {
                return Err(failure);
            }
            taken.left_out.push(format!("frame {index} left out: {}", failure.to_string().replace('\n', ";")));
            continue;
        }
        let Some(pose) = frame.pose.filter(|_| frame.colour().is_some()) else {
            taken.left_out.push(format!("frame {index} left out: it has no pose or no colour"));
            continue;
        };
        taken.offered += 1;
        if guide.is_none()
            && let Some(directions) = args.guided
            && (index + 1 == frames || with_frame!(frame, |f| session.sees(f)))
        {
            guide = Some(guide_from(args.at, pose.translation(), up.direction, directions)?);
        }
        let (k, size) = with_frame!(frame, |f| (*f.intrinsics(), f.size()));
        let asked_for = |guide: &Option<Guide>| guide.is_some_and(|mut g| g.observe(&pose, &k, size) > 0);
        let id = match policy.offer(Some(&pose), frame.time) {
            _ if args.all => u32::try_from(index).unwrap_or(u32::MAX),
            Decision::Capture { view, .. } => u32::from(view),
            Decision::Moving { .. } | Decision::Blind => {
                taken.moving += 1;
                continue;
            }
            // A direction that the user was asked to look in; the policy's own ids are below.
            _ if asked_for(&guide) => u32::try_from(index).unwrap_or(u32::MAX).saturating_add(0x1_0000),
            _ => {
                taken.not_new += 1;
                continue;
            }
        };
        if let Some(guide) = &mut guide {
            guide.observe(&pose, &k, size);
        }
        let start = Instant::now();
        let observed = with_frame!(frame, |f| session.observe(f, id));
        taken.observe.push(nanos(start));
        let observed = observed.map_err(|e| Failure::of(&e, format!("{}, frame {index}", source.name())))?;
        if let Some(registrar) = &mut registrar
            && let Some(near) = observed.near
        {
            registrar.run(&mut session, near.slot, source.name())?;
        }
        let between = Instant::now();
        session.draw(&mut out);
        taken.draw.push(nanos(between));
        taken.take(&observed);
        camera = map.direction(pose.translation() - map.at);
        last = pose;
    }
    bar.finish_and_clear();
    if taken.frames == 0 {
        return Err(Failure::new("no frame could be used").at(source.name()).advise(taken.left_out.join("; ")));
    }
    let next = guide.map(|g| g.next(&last));
    let (kept, seen, near_share) = (session.near().len(), session.far().seen(), near_share(&session));
    let map_of = LinearImage { width: preset.map.0, height: preset.map.1, pixels };
    Ok(Light {
        source,
        frame: map,
        map: map_of,
        camera,
        up,
        preset: quality,
        taken,
        kept,
        seen,
        near_share,
        memory: memory_of,
        guide: guide.zip(next),
        registered: registrar.map(|r| r.done),
    })
}

/// Which ways to look, from where the object is seen.
fn guide_from(at: Vec3, viewer: Vec3, up: Vec3, directions: usize) -> Outcome<Guide> {
    let failed = |e: &dyn std::error::Error| Failure::of(e, "--guided");
    let directions = Directions::of_count(directions)
        .ok_or_else(|| Failure::new("there is no such grid").at("--guided").advise("give 1, 3, 5 or 9"))?;
    Guide::new(at, viewer, up, GuideParams { directions, ..GuideParams::default() }).map_err(|e| failed(&e))
}

fn nanos(since: Instant) -> u64 {
    u64::try_from(since.elapsed().as_nanos()).unwrap_or(u64::MAX)
}

/// Whether a frame has what light needs; else what is missing.
fn lit(source: &Source, frame: &OwnedFrame) -> Outcome {
    let what = match (frame.colour().is_some(), frame.pose.is_some()) {
        (true, true) => return Ok(()),
        (true, false) => "the frames have colour but no poses: where the camera looked decides where the light goes",
        (false, true) => "the frames have poses but no colour: there is no light in depth alone",
        (false, false) => "the frames have neither colour nor poses: light needs both",
    };
    let advice = if frame.pose.is_none() {
        "use a recording with poses (TUM RGB-D with groundtruth.txt, 7-Scenes), or a simulated one: sim:living-room"
    } else {
        "use a recording with colour images, or a simulated one: sim:living-room"
    };
    Err(Failure::new(what).at(source.name()).advise(advice))
}

impl Registered {
    fn json(&self) -> Value {
        let (median, worst) = spread(&self.times);
        json!({
            "runs": self.times.len(), "median_ns": median, "worst_ns": worst, "corrected": self.corrected,
            "degenerate": self.degenerate, "left": self.left, "largest_shift_m": self.shift, "largest_turn_rad": self.turn,
            "bytes": self.bytes,
        })
    }
}

impl Taken {
    fn take(&mut self, observed: &Observed) {
        self.frames += 1;
        self.far += 1;
        self.samples += observed.far.samples;
        if let Some(near) = &observed.near {
            self.near += 1;
            self.points += near.inside;
            self.unsure += near.unsure;
        }
    }
}

/// Median and worst of some times, nanoseconds.
fn spread(times: &[u64]) -> (f64, f64) {
    let mut sorted = times.to_vec();
    sorted.sort_unstable();
    let at = |i: usize| sorted.get(i).copied().unwrap_or_default() as f64;
    (at(sorted.len() / 2), at(sorted.len().saturating_sub(1)))
}

impl Light {
    /// For people.
    pub(crate) fn tell(&self, say: &mut Say) {
        let t = &self.taken;
        let (w, h) = (self.map.width, self.map.height);
        say.head(&format!(
            "light at {} m in {}: {} preset, {w} x {h}",
            point(self.frame.at),
            self.source.name(),
            self.preset.name()
        ));
        say.fact(
            "frames",
            &format!(
                "{} of {} taken; not taken: {} while the camera moved, {} with nothing new",
                t.frames, t.offered, t.moving, t.not_new
            ),
        );
        if t.moving > t.frames {
            say.fact("note", "most frames count as blurred; give --all when the camera stood still for each");
        }
        if t.near == 0 {
            say.fact("near views", "none: no frame sees the place, so all light is from afar");
        } else {
            let most = self.preset.preset().views;
            let kept = format!("{} frames see the place; the last {} of at most {most} are kept", t.near, self.kept);
            let unsure = if t.unsure > 0 {
                format!(", {} unsure pixels left out", count(t.unsure as u64))
            } else {
                String::new()
            };
            say.fact(
                "near views",
                &format!("{kept}, {} points a view within 1 m{unsure}", count((t.points / t.near) as u64)),
            );
        }
        say.fact("far frames", &format!("{}, {} samples", t.far, count(t.samples as u64)));
        say.fact(
            "coverage",
            &format!(
                "{} of {} far anchors seen ({:.0} %), the rest is ambient; near points in {:.0} % of all directions",
                count(self.seen as u64),
                count(ANCHORS as u64),
                100.0 * self.seen as f32 / ANCHORS as f32,
                100.0 * self.near_share
            ),
        );
        if let Some(r) = &self.registered {
            let (median, worst) = spread(&r.times);
            say.fact(
                "registered",
                &format!(
                    "{} times, {} (worst {}); {} views corrected by at most {} and {:.1}°, {} of them in the directions that the \
                     surfaces tell; {} left as tracked",
                    r.times.len(),
                    duration(median),
                    duration(worst),
                    r.corrected,
                    metres(r.shift),
                    r.turn.to_degrees(),
                    r.degenerate,
                    r.left
                ),
            );
        }
        if let Some((guide, next)) = &self.guide {
            say.fact("guided", &guided_sentence(guide, next));
        }
        for note in t.left_out.iter().take(5) {
            say.fact("note", note);
        }
        if t.left_out.len() > 5 {
            say.fact("note", &format!("{} more frames were left out", t.left_out.len() - 5));
        }
        let ((observe, o_worst), (draw, d_worst)) = (spread(&t.observe), spread(&t.draw));
        say.fact(
            "time",
            &format!(
                "to take a frame {} (worst {}), to draw what it changed {} (worst {})",
                duration(observe),
                duration(o_worst),
                duration(draw),
                duration(d_worst)
            ),
        );
        let total: usize = self.memory.iter().map(|m| m.1).sum();
        let parts: Vec<String> =
            self.memory.iter().map(|(name, n)| format!("{name} {}", bytes(*n).replace(' ', "\u{a0}"))).collect();
        say.fact("memory", &format!("{}: {}", bytes(total), parts.join(", ")));
        say.fact("up", &self.up.sentence());
    }

    /// A direction of the map, in the world.
    pub(crate) fn to_world(&self, direction: Vec3) -> Vec3 {
        self.frame.rotation.inverse() * direction
    }

    /// For machines.
    pub(crate) fn json(&self, command: &str) -> serde_json::Map<String, Value> {
        let t = &self.taken;
        let ((observe, o_worst), (draw, d_worst)) = (spread(&t.observe), spread(&t.draw));
        let memory: serde_json::Map<String, Value> =
            self.memory.iter().map(|(name, n)| (name.replace(' ', "_"), (*n).into())).collect();
        let mut out = serde_json::Map::new();
        crate::commands::info::extend(
            &mut out,
            json!({
                "command": command, "source": self.source.name(), "at_m": self.frame.at.to_array(),
                "preset": self.preset.name(), "width": self.map.width, "height": self.map.height,
                "frames": t.frames, "near_frames": t.near, "near_views_kept": self.kept, "far_frames": t.far,
                "far_samples": t.samples, "anchors": ANCHORS, "anchors_seen": self.seen, "near_share": self.near_share,
                "times": {
                    "observe": { "median_ns": observe, "worst_ns": o_worst },
                    "draw": { "median_ns": draw, "worst_ns": d_worst },
                },
                "frames_offered": t.offered, "not_taken_moving": t.moving, "not_taken_not_new": t.not_new,
                "registration": self.registered.as_ref().map(Registered::json),
                "guided": self.guide.as_ref().map(|(guide, next)| guided_json(guide, next)),
                "memory_bytes": memory, "up": self.up.json(), "notes": t.left_out,
            }),
        );
        out
    }
}

/// Which directions are done, and where to turn from where the camera looked last.
fn guided_sentence(guide: &Guide, next: &Next) -> String {
    let done = format!("{} of {} directions seen", guide.done(), guide.directions().len());
    let Next::Look(turn) = next else { return done };
    let side = if turn.yaw < 0.0 { "left" } else { "right" };
    let height = if turn.pitch < 0.0 { "down" } else { "up" };
    format!(
        "{done}; next, from the last frame: {:.0}° to the {side}, {:.0}° {height}",
        turn.yaw.to_degrees().abs(),
        turn.pitch.to_degrees().abs()
    )
}

fn guided_json(guide: &Guide, next: &Next) -> Value {
    let directions: Vec<Value> = (guide.directions().iter().enumerate())
        .map(|(i, d)| json!({ "direction": d.to_array(), "seen": guide.is_done(i) }))
        .collect();
    let next = match next {
        Next::Look(turn) => {
            json!({ "direction": turn.direction.to_array(), "yaw_rad": turn.yaw, "pitch_rad": turn.pitch })
        }
        Next::Done => Value::Null,
    };
    json!({ "directions": directions, "seen": guide.done(), "next": next })
}

/// A main light for people: from where, and how strong beside the rest.
pub(crate) fn light_words(light: Option<&MainLight>) -> (String, String) {
    let Some(light) = light else { return ("from everywhere alike".to_owned(), "no direction stands out".to_owned()) };
    let luminance = |c: [f32; 3]| c.iter().zip([0.2126, 0.7152, 0.0722]).map(|(c, l)| c * l).sum::<f32>();
    let (own, rest) = (luminance(light.colour), luminance(light.ambient));
    let up = light.direction.y.clamp(-1.0, 1.0).asin().to_degrees();
    let side = if up < 0.0 { "below" } else { "above" };
    let strength = format!("{own:.2} on a surface that faces it, {rest:.2} from all around (1: a camera's white)");
    (format!("from {:.0}° {side} the horizon", up.abs()), strength)
}

/// The same in one.
pub(crate) fn light_sentence(light: Option<&MainLight>) -> String {
    let (from, strength) = light_words(light);
    format!("{from}: {strength}")
}

/// Harmonics and main light for machines; directions as `turn` makes them.
pub(crate) fn light_json(sh: &Harmonics, turn: impl Fn(Vec3) -> Vec3) -> Value {
    let main = sh
        .main_light()
        .map(|m| json!({ "direction": turn(m.direction).to_array(), "colour": m.colour, "ambient": m.ambient }));
    json!({ "coefficients": sh.coefficients, "main_light": main, "ambient": sh.ambient() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_even_map_has_even_harmonics_and_grey_balls() {
        let map = LinearImage::filled(64, 32, [0.25; 3]);
        let sh = harmonics(&map);
        assert!((sh.irradiance(Vec3::Y)[1] - 0.25).abs() < 1e-3, "{sh:?}");
        assert!(sh.main_light().is_none(), "{sh:?}");
        assert!(light_sentence(None).contains("alike"));
        let picture = balls(&map, &view_from(Vec3::ZERO), 16, 1.0);
        assert_eq!(picture.size(), (3 * 16 + 4, 18));
    }

    #[test]
    fn light_from_above_is_told_so() {
        let mut map = LinearImage::filled(64, 32, [0.1; 3]);
        map.pixels[..64 * 8].fill([2.0; 3]);
        let light = harmonics(&map).main_light().unwrap();
        assert!(light.direction.y > 0.999);
        assert!(light_sentence(Some(&light)).starts_with("from 9"), "{}", light_sentence(Some(&light)));
    }

    #[test]
    fn tiny_is_tiny() {
        let total = |bytes: [(&str, usize); 4]| bytes.iter().map(|b| b.1).sum::<usize>();
        assert!(total(Memory::<64, 32>::new(Preset::TINY).bytes()) < 140 * 1024);
        assert!(total(Memory::<128, 64>::new(Preset::LOW).bytes()) < 3 * 1024 * 1024);
    }
}
