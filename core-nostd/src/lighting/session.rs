//! A session: one virtual object's light, from the first frame on (LitAR 4.5.1).
//!
//! A frame that sees the object's place is a near view and, outside the boundary, light from afar; a frame that does not is light from afar
//! alone. A map can be drawn after the first frame and follows the rest; each step does only what its input changed and says how much that was.
//!
//! Several sessions live beside one another: each has its own memory.

use core::fmt;

use glam::Vec3;

use super::compose::{self, ComposeReport};
use super::equirect::{MapFrame, pixel_of_uv, uv_of_direction};
use super::far::extrapolate::{FarMap, FarMapReport};
use super::far::observe::{FarError, FarSampling};
use super::far::{FarField, FarReport};
use super::near::{NearError, NearField, NearReport};
use super::registration::{Registration, RegistrationError};
use crate::ground::colour::Colour;
use crate::ground::image::{ImageView, ImageViewMut};
use crate::ground::units::Timestamp;
use crate::sensing::camera::{Intrinsics, Pose};
use crate::sensing::depth::DepthSample;
use crate::sensing::depth::noise::DepthNoise;
use crate::sensing::frame::DepthFrame;

/// Why a frame was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LightError {
    /// As a near view.
    Near(NearError),
    /// As light from afar.
    Far(FarError),
}

impl fmt::Display for LightError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Near(e) => e.fmt(f),
            Self::Far(e) => e.fmt(f),
        }
    }
}

impl core::error::Error for LightError {}

/// What a frame gave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observed {
    /// As a near view, when the object's place is in it.
    pub near: Option<NearReport>,
    /// As light from afar.
    pub far: FarReport,
}

/// What a drawing of the map did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Drawn {
    /// Rows of the near picture that were made anew: first, one past the last.
    pub near_rows: (usize, usize),
    /// The far map.
    pub far: FarMapReport,
    /// The map itself.
    pub map: ComposeReport,
}

/// One object's light.
///
/// ```
/// use isobath::glam::{vec3, Vec3};
/// use isobath::ground::image::{ImageView, ImageViewMut};
/// use isobath::lighting::equirect::MapFrame;
/// use isobath::lighting::far::{FarField, FarParams, extrapolate::FarMap};
/// use isobath::lighting::near::{NearField, NearParams, NearStorage};
/// use isobath::lighting::{Preset, Session};
/// use isobath::sensing::{camera::{Intrinsics, Pose}, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
///
/// // All memory is the caller's; on a device, statics.
/// const P: Preset = Preset::TINY;
/// let mut storage =
///     NearStorage::<{ P.views * P.view_pixels() }, { P.views * P.level_pixels() }, { P.level_pixels() }, { P.strip() }>::new();
/// let mut far = FarField::<1280>::new(FarParams::default(), [0.2; 3]);
/// let mut grid = FarMap::<64, 32>::new();
/// let mut map = [[0_u8; 3]; P.map_pixels()];
///
/// // The object stands 1 m before the camera, on a white wall's foot, and the wall is 1.2 m away.
/// let at = MapFrame::at(vec3(0.0, 0.0, 1.0));
/// let near = NearField::new(P, NearParams::default(), storage.lend())?;
/// let mut session = Session::new(at, near, &mut far, &mut grid);
/// static WALL: DepthArray<96, 72> = DepthArray::filled(1200);
/// let white = [[255_u8; 3]; 96 * 72];
/// let frame = DepthFrame::new(WALL.view(), DepthUnit::MILLIMETRE, Intrinsics::from_fov(1.1, 96, 72)?)
///     .with_colour(ImageView::new(&white, 96, 72)?)?
///     .with_pose(Pose::IDENTITY);
/// let seen = session.observe(&frame, 0)?;
/// assert!(seen.near.unwrap().inside > 4000);
/// session.draw(&mut ImageViewMut::new(&mut map, 96, 48)?);
/// assert_eq!(map[24 * 96], [255; 3]); // +z, towards the wall: the map's first column
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Session<'m, const N: usize = 1280, const COLUMNS: usize = 128, const ROWS: usize = 64> {
    map: MapFrame,
    near: NearField<'m>,
    far: &'m mut FarField<N>,
    grid: &'m mut FarMap<COLUMNS, ROWS>,
    sampling: FarSampling,
    /// Views came or moved since the picture was made.
    moved: bool,
    /// The whole map must be drawn.
    whole: bool,
}

impl<'m, const N: usize, const COLUMNS: usize, const ROWS: usize> Session<'m, N, COLUMNS, ROWS> {
    /// An object's session, at its place.
    #[must_use]
    pub const fn new(
        map: MapFrame,
        near: NearField<'m>,
        far: &'m mut FarField<N>,
        grid: &'m mut FarMap<COLUMNS, ROWS>,
    ) -> Self {
        Self { map, near, far, grid, sampling: FarSampling::DEFAULT, moved: false, whole: true }
    }

    /// With another way of sampling light from afar.
    #[must_use]
    pub const fn with_sampling(self, sampling: FarSampling) -> Self {
        Self { sampling, ..self }
    }

    /// Where the map is seen from.
    #[must_use]
    pub const fn map(&self) -> &MapFrame {
        &self.map
    }

    /// The near field.
    #[must_use]
    pub const fn near(&self) -> &NearField<'m> {
        &self.near
    }

    /// The far field.
    #[must_use]
    pub const fn far(&self) -> &FarField<N> {
        self.far
    }

    /// The far field's map.
    #[must_use]
    pub const fn grid(&self) -> &FarMap<COLUMNS, ROWS> {
        self.grid
    }

    /// Whether a frame sees the object's place: then it is a near view.
    #[must_use]
    pub fn sees<D: DepthSample>(&self, frame: &DepthFrame<'_, D>) -> bool {
        frame.pose().is_some() && frame.pixel_of_world(self.map.at).is_some()
    }

    /// Takes a frame with colour and pose. `id` names the place it was taken from: a near view of the same id is replaced.
    ///
    /// # Errors
    /// [`LightError`] for a frame without colour or pose; nothing is changed.
    pub fn observe<D: DepthSample>(&mut self, frame: &DepthFrame<'_, D>, id: u32) -> Result<Observed, LightError> {
        let near = if self.sees(frame) { Some(self.observe_near(frame, id)?) } else { None };
        let far = self.far.add_frame(frame, &self.map, &self.sampling).map_err(LightError::Far)?;
        Ok(Observed { near, far })
    }

    /// Takes a frame as a near view alone: what a near key frame holds, of which only pixels within the boundary have their colour.
    ///
    /// # Errors
    /// As [`Self::observe`].
    pub fn observe_near<D: DepthSample>(
        &mut self,
        frame: &DepthFrame<'_, D>,
        id: u32,
    ) -> Result<NearReport, LightError> {
        let report = self.near.insert(frame, id, &self.map).map_err(LightError::Near)?;
        self.moved = true;
        Ok(report)
    }

    /// Takes a small picture as light from afar: what a far key frame holds. `intrinsics` are the picture's; of the camera's pose only the rotation counts.
    pub fn observe_far<C: Colour>(
        &mut self,
        picture: ImageView<'_, C>,
        intrinsics: &Intrinsics,
        camera: &Pose,
        time: Timestamp,
    ) -> FarReport {
        self.far.add_image(picture, intrinsics, camera, &self.map, time)
    }

    /// A new reading of the ambient light.
    pub fn set_ambient(&mut self, linear: [f32; 3]) {
        self.far.set_ambient(linear);
    }

    /// A near view's pose, corrected by registration. False without such a view.
    pub fn correct(&mut self, slot: usize, pose: Pose) -> bool {
        let was = self.near.correct(slot, pose, &self.map);
        self.moved |= was;
        was
    }

    /// Gives the near views to a registration: [`NearField::prepare`]. Start it with the slots that stay, step it beside the frames that come, and
    /// [adopt](Self::adopt) what it found.
    ///
    /// # Errors
    /// Those of [`Registration::set`].
    pub fn prepare<const V: usize>(
        &self,
        registration: &mut Registration<'_, V>,
        noise: &DepthNoise,
    ) -> Result<(), RegistrationError> {
        self.near.prepare(registration, noise)
    }

    /// Takes the poses that a finished registration [corrected](super::registration::Outcome::is_corrected), in some directions alone included. Views that were replaced since
    /// stay. How many moved.
    pub fn adopt<const V: usize>(&mut self, registration: &Registration<'_, V>) -> usize {
        let mut moved = 0;
        for slot in 0..self.near.preset().views {
            let Some(report) = registration.report(slot) else { continue };
            let same = self.near.view(slot).is_some_and(|view| view.pose == report.tracked);
            if report.outcome.is_corrected() && same && self.correct(slot, report.pose) {
                moved += 1;
            }
        }
        moved
    }

    /// The object has moved: near views are seen from the new place; light from afar stays what it was.
    pub fn move_to(&mut self, map: MapFrame) {
        self.map = map;
        self.near.project_all(&map);
        self.moved = true;
        self.whole = true;
    }

    /// The light from a unit direction (map's axes), near over far, as of the last drawing: for cube maps and single rays.
    #[must_use]
    pub fn towards(&self, direction: Vec3) -> [f32; 3] {
        let far = self.grid.towards(direction);
        let picture = self.near.picture();
        let over = pixel_of_uv(uv_of_direction(direction), picture.size()).and_then(|(x, y)| picture.get(x, y));
        over.map_or(far, |over| compose::lay(over, far))
    }

    /// Draws what changed since the last drawing into the map, which must be the same image as then (the first time any).
    pub fn draw<C: Colour>(&mut self, out: &mut ImageViewMut<'_, C>) -> Drawn {
        let near_rows = if core::mem::take(&mut self.moved) { self.near.merge() } else { (0, 0) };
        let far = self.grid.update(self.far);
        let map = if core::mem::take(&mut self.whole) {
            compose::compose(&self.near, self.grid, out)
        } else {
            compose::compose_changes(&self.near, near_rows, self.grid, out)
        };
        self.grid.settle();
        Drawn { near_rows, far, map }
    }

    /// Draws the whole map, into any image.
    pub fn draw_all<C: Colour>(&mut self, out: &mut ImageViewMut<'_, C>) -> Drawn {
        self.whole = true;
        self.draw(out)
    }
}
