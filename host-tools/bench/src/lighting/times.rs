//! What each component takes, preset by preset, with all views stored: one core, the thread's own time.

use std::cell::RefCell;

use isobath::ground::colour::Colour;
use isobath::ground::image::ImageViewMut;
use isobath::lighting::compose::compose;
use isobath::lighting::equirect::MapFrame;
use isobath::lighting::far::extrapolate::FarMap;
use isobath::lighting::far::observe::FarSampling;
use isobath::lighting::far::{FarField, FarParams};
use isobath::lighting::near::{NearField, NearParams};
use isobath::lighting::{Preset, Session};
use isobath::sensing::frame::DepthFrame;
use isobath_sim::{Scene, orbit_stations};

use super::reconstruct::NearBox;
use super::report::Line;
use super::sights::{FAR, Sight, guided};
use crate::BenchError;
use crate::input::vec3;
use crate::measure::{Effort, alternating};
use crate::row::{Method, Score};

/// Milliseconds of: a view in, the merge, a far frame in, the far map, the composition; a near frame to the map, a far frame to the map;
/// and KiB of memory, without the map that is drawn.
pub(super) fn measure(scene: &Scene, effort: &Effort) -> Result<Vec<Line>, BenchError> {
    Ok(vec![
        of::<64, 32>("tiny", Preset::TINY, scene, effort)?,
        of::<128, 64>("low", Preset::LOW, scene, effort)?,
        of::<128, 64>("medium", Preset::MEDIUM, scene, effort)?,
        of::<128, 64>("high", Preset::HIGH, scene, effort)?,
    ])
}

const AMBIENT: [f32; 3] = [0.2; 3];

struct State<'m, const COLUMNS: usize, const ROWS: usize> {
    near: NearField<'m>,
    far: FarField<1280>,
    grid: Box<FarMap<COLUMNS, ROWS>>,
    tick: usize,
}

fn of<const COLUMNS: usize, const ROWS: usize>(
    name: &str,
    preset: Preset,
    scene: &Scene,
    effort: &Effort,
) -> Result<Line, BenchError> {
    let at = *scene.places().values().next().ok_or_else(|| BenchError::core("the scene has no places"))?;
    let orbit = orbit_stations(at);
    let map = MapFrame::at(vec3(at));
    // What they show is not what counts: large frames are small ones enlarged.
    let n = preset.view.0.div_ceil(512);
    let size = (preset.view.0 / n, preset.view.1 / n);
    let views: Vec<Sight> = orbit
        .iter()
        .take(preset.views.max(2))
        .map(|pose| Sight::new(scene, size, pose)?.enlarged(n))
        .collect::<Result<_, _>>()?;
    let views: Vec<DepthFrame<'_>> = (views.iter().zip(0..)).map(|(v, i)| v.frame(i)).collect::<Result<_, _>>()?;
    let observer = orbit.first().map_or(at, |pose| pose.translation);
    let away: Vec<Sight> =
        guided(observer, at)?.iter().take(2).map(|pose| Sight::new(scene, FAR, pose)).collect::<Result<_, _>>()?;
    // Two that look the same way and see other colours: the second one dark.
    let dark = away.first().map(Sight::darkened);
    let away: Vec<DepthFrame<'_>> =
        away.iter().take(1).chain(&dark).zip(100..).map(|(v, i)| v.frame(i)).collect::<Result<_, _>>()?;
    if away.len() < 2 {
        return Err(BenchError::core("no frames"));
    }

    let mut storage = NearBox::new(&preset);
    let bytes = storage.bytes() + size_of::<FarField<1280>>() + size_of::<FarMap<COLUMNS, ROWS>>();
    let mut field = NearField::new(preset, NearParams::default(), storage.lend()).map_err(BenchError::core)?;
    for (i, frame) in views.iter().take(preset.views).enumerate() {
        field.insert(frame, i as u32, &map).map_err(BenchError::core)?;
    }
    field.merge();
    let (mut far, mut grid) =
        (FarField::<1280>::new(FarParams::default(), AMBIENT), Box::new(FarMap::<COLUMNS, ROWS>::new()));
    let sampling = FarSampling::default();
    for frame in views.iter().chain(&away) {
        far.add_frame(frame, &map, &sampling).map_err(BenchError::core)?;
    }
    grid.update(&mut far);
    let state = RefCell::new(State { near: field, far, grid, tick: 0 });

    // A session that draws light as it is, and one that draws a camera's bytes.
    let (mut hdr, mut bytes_map) = (vec![[0.0_f32; 3]; preset.map_pixels()], vec![[0_u8; 3]; preset.map_pixels()]);
    let (mut hdr_box, mut bytes_box) = (NearBox::new(&preset), NearBox::new(&preset));
    let mut fields = [(); 2].map(|()| FarField::<1280>::new(FarParams::default(), AMBIENT));
    let mut grids = [(); 2].map(|()| Box::new(FarMap::<COLUMNS, ROWS>::new()));
    let ([hdr_far, bytes_far], [hdr_grid, bytes_grid]) = (&mut fields, &mut grids);
    let session = |memory, far, grid| -> Result<_, BenchError> {
        let near = NearField::new(preset, NearParams::default(), memory).map_err(BenchError::core)?;
        let mut session = Session::new(map, near, far, grid);
        for (i, frame) in views.iter().take(preset.views).enumerate() {
            session.observe(frame, i as u32).map_err(BenchError::core)?;
        }
        Ok(session)
    };
    let mut hdr_session = session(hdr_box.lend(), hdr_far, &mut **hdr_grid)?;
    hdr_session.draw(&mut view(&mut hdr, preset.map)?);
    let mut bytes_session = session(bytes_box.lend(), bytes_far, &mut **bytes_grid)?;
    bytes_session.draw(&mut view(&mut bytes_map, preset.map)?);
    let (hdr, in_bytes) =
        (RefCell::new((hdr_session, hdr, 0_usize)), RefCell::new((bytes_session, bytes_map, 0_usize)));
    let mut whole = vec![[0.0_f32; 3]; preset.map_pixels()];

    let cycle = |list: &'_ [DepthFrame<'_>], tick: usize| tick % list.len().max(1);
    let score = || Score::of([0.0]);
    // What can't fail was tried above; what it returns is not looked at.
    let mut methods = [
        Method::new(
            "view in",
            1,
            || {
                let mut s = state.borrow_mut();
                s.tick += 1;
                let i = cycle(&views[..preset.views], s.tick);
                let _ = s.near.insert(&views[i], i as u32, &map);
            },
            score,
        ),
        Method::new("merge", 1, || _ = state.borrow_mut().near.merge(), score),
        Method::new(
            "far frame in",
            1,
            || {
                let mut s = state.borrow_mut();
                s.tick += 1;
                let i = cycle(&away, s.tick);
                let _ = s.far.add_frame(&away[i], &map, &sampling);
            },
            score,
        ),
        Method::new(
            "far frame in, far map",
            1,
            || {
                let s = &mut *state.borrow_mut();
                s.tick += 1;
                let i = cycle(&away, s.tick);
                let _ = s.far.add_frame(&away[i], &map, &sampling);
                s.grid.update(&mut s.far);
            },
            score,
        ),
        Method::new(
            "compose",
            1,
            || {
                let s = state.borrow();
                if let Ok(mut out) = view(&mut whole, preset.map) {
                    compose(&s.near, &s.grid, &mut out);
                }
            },
            score,
        ),
        Method::new("near to map", 1, || to_map(&hdr, &views[..preset.views], 0, preset.map), score),
        Method::new("far to map", 1, || to_map(&hdr, &away, 1000, preset.map), score),
        Method::new("near to bytes", 1, || to_map(&in_bytes, &views[..preset.views], 0, preset.map), score),
        Method::new("far to bytes", 1, || to_map(&in_bytes, &away, 1000, preset.map), score),
    ];
    let times = alternating(&mut methods, effort);
    let mut ms: Vec<f64> = times.iter().map(|t| t.best / 1e6).collect();
    // The far map alone: what it adds.
    if let [_, _, frame, both, ..] = ms.as_mut_slice() {
        *both -= *frame;
    }
    ms.push(bytes as f64 / 1024.0);
    Ok(Line::new(name, ms))
}

/// The next frame into the session, and its map drawn.
fn to_map<C: Colour, const COLUMNS: usize, const ROWS: usize>(
    session: &RefCell<(Session<'_, 1280, COLUMNS, ROWS>, Vec<C>, usize)>,
    frames: &[DepthFrame<'_>],
    ids: u32,
    size: (usize, usize),
) {
    let (session, map, tick) = &mut *session.borrow_mut();
    *tick += 1;
    let i = *tick % frames.len().max(1);
    let _ = session.observe(&frames[i], ids + i as u32);
    if let Ok(mut out) = view(map, size) {
        session.draw(&mut out);
    }
}

fn view<C: Copy>(pixels: &mut [C], (w, h): (usize, usize)) -> Result<ImageViewMut<'_, C>, BenchError> {
    ImageViewMut::new(pixels, w, h).map_err(BenchError::core)
}
