//! From frames to a map: what ships, whole or in parts.

use isobath::ground::image::ImageViewMut;
use isobath::lighting::Preset;
use isobath::lighting::compose::compose;
use isobath::lighting::equirect::MapFrame;
use isobath::lighting::far::extrapolate::FarMap;
use isobath::lighting::far::observe::FarSampling;
use isobath::lighting::far::{FarField, FarParams, Unseen};
use isobath::lighting::near::{NearField, NearMemory, NearParams};
use isobath::lighting::preset::MOST_VIEWS;
use isobath::lighting::registration::{Progress, Registration, RegistrationParams, scratch_len};
use isobath::sensing::depth::noise::DepthNoise;
use isobath_sim::{LinearImage, V3};

use super::sights::Sight;
use crate::BenchError;
use crate::input::vec3;

/// How a map is made.
#[derive(Debug, Clone, Copy)]
pub(super) struct Recipe {
    pub(super) preset: Preset,
    pub(super) near: NearParams,
    pub(super) sampling: FarSampling,
    /// Whether frames that see the place are near views.
    pub(super) near_field: bool,
    /// Whether frames are light from afar.
    pub(super) far_field: bool,
    /// What stands where nobody looked.
    pub(super) unseen: Unseen,
    /// Whether views' poses are made to agree with the first one's.
    pub(super) register: bool,
}

/// Makes the views' poses agree; the first stays.
fn register(near: &mut NearField<'_>, map: &MapFrame) -> Result<(), BenchError> {
    let (width, height) = near.preset().view;
    let mut memory = vec![0.0; MOST_VIEWS * scratch_len(width, height)];
    let mut views = Registration::<MOST_VIEWS>::new(&mut memory, RegistrationParams::default());
    near.prepare(&mut views, &DepthNoise::NONE).map_err(BenchError::core)?;
    views.start(&[0]).map_err(BenchError::core)?;
    while views.step(usize::MAX) == Progress::Working {}
    for slot in 1..near.len() {
        if let Some(report) = views.report(slot).filter(|r| r.outcome.is_corrected()) {
            near.correct(slot, report.pose, map);
        }
    }
    Ok(())
}

impl Recipe {
    /// As shipped.
    pub(super) fn new(preset: Preset) -> Self {
        let (near, sampling) = (NearParams::default(), FarSampling::default());
        Self { preset, near, sampling, near_field: true, far_field: true, unseen: Unseen::Guess, register: false }
    }
}

/// The memory of a near field.
#[derive(Debug)]
pub(super) struct NearBox {
    depth: Vec<u16>,
    colour: Vec<[u8; 3]>,
    layers: Vec<u32>,
    picture: Vec<[u8; 4]>,
    strip: Vec<u32>,
}

impl NearBox {
    pub(super) fn new(preset: &Preset) -> Self {
        let (points, cells) = (preset.views * preset.view_pixels(), preset.level_pixels());
        Self {
            depth: vec![0; points],
            colour: vec![[0; 3]; points],
            layers: vec![0; preset.views * cells],
            picture: vec![[0; 4]; cells],
            strip: vec![0; preset.strip()],
        }
    }

    pub(super) fn lend(&mut self) -> NearMemory<'_> {
        let Self { depth, colour, layers, picture, strip } = self;
        NearMemory { depth, colour, layers, picture, strip }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.depth.as_slice())
            + size_of_val(self.colour.as_slice())
            + size_of_val(self.layers.as_slice())
            + size_of_val(self.picture.as_slice())
            + size_of_val(self.strip.as_slice())
    }
}

/// The map of a place, from views that see it and frames that need not; what nobody saw is `ambient`.
pub(super) fn reconstruct(
    recipe: &Recipe,
    at: V3,
    views: &[&Sight],
    frames: &[&Sight],
    ambient: [f32; 3],
) -> Result<LinearImage, BenchError> {
    // Part of what makes the tiny preset tiny.
    if recipe.preset == Preset::TINY {
        go::<64, 32>(recipe, at, views, frames, ambient)
    } else {
        go::<128, 64>(recipe, at, views, frames, ambient)
    }
}

fn go<const COLUMNS: usize, const ROWS: usize>(
    recipe: &Recipe,
    at: V3,
    views: &[&Sight],
    frames: &[&Sight],
    ambient: [f32; 3],
) -> Result<LinearImage, BenchError> {
    let preset = recipe.preset;
    let map = MapFrame::at(vec3(at));
    let mut memory = NearBox::new(&preset);
    let mut near = NearField::new(preset, recipe.near, memory.lend()).map_err(BenchError::core)?;
    let mut far = FarField::<1280>::new(FarParams { unseen: recipe.unseen, ..FarParams::default() }, ambient);
    let mut grid = Box::new(FarMap::<COLUMNS, ROWS>::new());
    for (number, sight) in views.iter().chain(frames).enumerate() {
        let frame = sight.frame(number as u64)?;
        if recipe.near_field && number < views.len() {
            near.insert(&frame, number as u32, &map).map_err(BenchError::core)?;
        }
        if recipe.far_field {
            far.add_frame(&frame, &map, &recipe.sampling).map_err(BenchError::core)?;
        }
    }
    if recipe.register {
        register(&mut near, &map)?;
    }
    near.merge();
    grid.update(&mut far);
    let (width, height) = preset.map;
    let mut pixels = vec![[0.0; 3]; width * height];
    compose(&near, &grid, &mut ImageViewMut::new(&mut pixels, width, height).map_err(BenchError::core)?);
    Ok(LinearImage { width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobath::lighting::Session;
    use isobath_sim::{Rigid, Scene, v3};

    #[test]
    fn parts_make_what_a_session_makes() {
        let scene = Scene::open("living-room").unwrap();
        let at = scene.places()["table"];
        let observer = at + v3(0.3, 0.6, 0.4);
        let near = Sight::new(&scene, (64, 48), &Rigid::looking_at(observer, at)).unwrap();
        let away = Sight::new(&scene, (32, 24), &Rigid::looking_at(observer, observer * 2.0 - at)).unwrap();
        let recipe = Recipe::new(Preset::LOW);
        let ours = reconstruct(&recipe, at, &[&near], &[&away], [0.1; 3]).unwrap();

        let mut memory = NearBox::new(&Preset::LOW);
        let field = NearField::new(Preset::LOW, recipe.near, memory.lend()).unwrap();
        let mut far = FarField::<1280>::new(FarParams::default(), [0.1; 3]);
        let mut grid = Box::new(FarMap::<128, 64>::new());
        let mut session = Session::new(MapFrame::at(vec3(at)), field, &mut far, &mut grid);
        for (i, sight) in [&near, &away].into_iter().enumerate() {
            session.observe(&sight.frame(i as u64).unwrap(), i as u32).unwrap();
        }
        let mut pixels = vec![[0.0_f32; 3]; 512 * 256];
        session.draw(&mut ImageViewMut::new(&mut pixels, 512, 256).unwrap());
        assert!(ours.pixels == pixels);

        let ambient = Recipe { near_field: false, far_field: false, ..recipe };
        let flat = reconstruct(&ambient, at, &[&near], &[&away], [0.1, 0.2, 0.3]).unwrap();
        assert!(flat.pixels.iter().all(|p| (p[2] - 0.3).abs() < 1e-6));
        let tiny = reconstruct(&Recipe::new(Preset::TINY), at, &[&near], &[], [0.1; 3]).unwrap();
        assert_eq!((tiny.width, tiny.height), (96, 48));
    }
}
