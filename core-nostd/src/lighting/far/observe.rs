//! A frame's samples for the far field: small colour images, and whole frames brought down to 32 x 24.
//!
//! A frame is cut into cells; a cell's sample is the mean, in linear light, of up to 4 x 4 of its pixels spread evenly. With depth at the
//! cell's middle and the map's place known, the sample is put in the direction in which that point is seen *from there*; the paper
//! takes all pixels at depth one, which is right only for what is far away.
//!
//! Cost: 768 samples, 12,288 pixels read: 70 to 120 us on a desktop core.

use core::fmt;

use glam::{Mat3, Vec2, Vec3};

use super::{FarField, FarReport};
use crate::ground::colour::Colour;
use crate::ground::image::ImageView;
use crate::ground::units::Timestamp;
use crate::lighting::equirect::MapFrame;
use crate::lighting::lattice::Lattice;
use crate::sensing::camera::{Intrinsics, Pose};
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

/// How frames are sampled. `FarSampling::default()` is 32 x 24 cells, with parallax.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FarSampling {
    /// Cells across; at least 1, at most the image's width. Default 32.
    pub columns: usize,
    /// Cells down; at least 1, at most the image's height. Default 24.
    pub rows: usize,
    /// Whether depth, where there is any, puts samples where the map's place sees them. Default true; false is the paper's form.
    pub parallax: bool,
}

impl FarSampling {
    /// As [`Self::default`].
    pub const DEFAULT: Self = Self { columns: 32, rows: 24, parallax: true };
}

impl Default for FarSampling {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Why a frame gave no samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum FarError {
    /// The frame has no colour image.
    NoColour,
    /// The frame has no pose.
    NoPose,
}

impl fmt::Display for FarError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoColour => write!(f, "lighting needs frames with colour; this one has depth alone"),
            Self::NoPose => {
                write!(f, "lighting needs frames with a pose: where the camera looks decides where the light goes")
            }
        }
    }
}

impl core::error::Error for FarError {}

/// Pixels of a cell that are read, along each side.
const PER_CELL: usize = 4;

impl<const N: usize> FarField<N> {
    /// Every pixel of a small colour image as a sample: the form in which far frames travel (32 x 24). `intrinsics` are the small
    /// image's own; only the camera's rotation counts (LitAR: "all pixels at depth one").
    ///
    /// ```
    /// use isobath::glam::Vec3;
    /// use isobath::ground::{image::ImageView, units::Timestamp};
    /// use isobath::lighting::equirect::MapFrame;
    /// use isobath::lighting::far::{FarField, FarParams};
    /// use isobath::sensing::camera::{Intrinsics, Pose};
    /// let mut far = FarField::<1280>::new(FarParams::default(), [0.0; 3]);
    /// let image = ImageView::new(&[[200_u8; 3]; 32 * 24], 32, 24).unwrap();
    /// let k = Intrinsics::from_fov(1.1, 32, 24)?;
    /// let report = far.add_image(image, &k, &Pose::IDENTITY, &MapFrame::at(Vec3::ZERO), Timestamp::ZERO);
    /// assert_eq!(report.samples, 768);
    /// assert!(far.seen() > 60);
    /// # Ok::<(), isobath::sensing::camera::intrinsics::IntrinsicsError>(())
    /// ```
    pub fn add_image<C: Colour>(
        &mut self,
        image: ImageView<'_, C>,
        intrinsics: &Intrinsics,
        camera: &Pose,
        map: &MapFrame,
        time: Timestamp,
    ) -> FarReport {
        let (turn, _) = map.of_camera(camera);
        let mut putter = Putter::new(self, time);
        for (y, row) in image.rows().enumerate() {
            for (x, pixel) in row.iter().enumerate() {
                putter.put(turn * intrinsics.ray(Vec2::new(x as f32, y as f32)), pixel.linear());
            }
        }
        putter.done()
    }

    /// A whole frame, cut into cells. Cells without depth at their middle (all, of frames whose colour sees more than their depth, at the
    /// margin) go by rotation alone.
    ///
    /// # Errors
    /// [`FarError`] when the frame has no colour or no pose.
    pub fn add_frame<D: DepthSample>(
        &mut self,
        frame: &DepthFrame<'_, D>,
        map: &MapFrame,
        sampling: &FarSampling,
    ) -> Result<FarReport, FarError> {
        let (colour, crop) = frame.colour().ok_or(FarError::NoColour)?;
        let (turn, origin) = map.of_camera(&frame.pose().ok_or(FarError::NoPose)?);
        let (width, height) = colour.size();
        let (columns, rows) = (sampling.columns.clamp(1, width.max(1)), sampling.rows.clamp(1, height.max(1)));
        let mut putter = Putter::new(self, frame.time());
        for row in 0..rows {
            let (top, bottom) = (row * height / rows, (row + 1) * height / rows);
            for column in 0..columns {
                let (left, right) = (column * width / columns, (column + 1) * width / columns);
                let mean = mean_of(colour.crop(left, top, right - left, bottom - top));
                let centre = Vec2::new((left + right) as f32 * 0.5 - 0.5, (top + bottom) as f32 * 0.5 - 0.5);
                let pixel = crop.depth_coordinates(centre);
                let ray = frame.intrinsics().ray(pixel);
                let z = if sampling.parallax { depth_at(frame, pixel) } else { 0.0 };
                putter.put(seen_from(turn, origin, ray, z), mean);
            }
        }
        Ok(putter.done())
    }
}

/// The direction from the map's place to a point of a ray; the ray's own direction without depth.
fn seen_from(turn: Mat3, origin: Vec3, ray: Vec3, z: f32) -> Vec3 {
    if z > 0.0 { turn * (ray * z) + origin } else { turn * ray }
}

fn depth_at<D: DepthSample>(frame: &DepthFrame<'_, D>, pixel: Vec2) -> f32 {
    crate::sensing::camera::intrinsics::pixel_index(pixel, frame.size()).map_or(0.0, |(x, y)| frame.z(x, y))
}

/// Mean, in linear light, of at most 4 x 4 pixels spread evenly over a cell.
fn mean_of(cell: ImageView<'_, [u8; 3]>) -> [f32; 3] {
    let (width, height) = cell.size();
    let (columns, rows) = (width.clamp(1, PER_CELL), height.clamp(1, PER_CELL));
    let mut sum = [0.0; 3];
    for j in 0..rows {
        let row = cell.row((2 * j + 1) * height / (2 * rows));
        for i in 0..columns {
            let pixel = row.get((2 * i + 1) * width / (2 * columns)).copied().unwrap_or_default().linear();
            for (sum, p) in sum.iter_mut().zip(pixel) {
                *sum += p;
            }
        }
    }
    sum.map(|s| s / (columns * rows) as f32)
}

/// Puts samples, each found from the anchor before.
struct Putter<'a, const N: usize> {
    far: &'a mut FarField<N>,
    now: u32,
    anchor: Option<usize>,
    report: FarReport,
}

impl<'a, const N: usize> Putter<'a, N> {
    fn new(far: &'a mut FarField<N>, time: Timestamp) -> Self {
        let now = far.now(time);
        Self { far, now, anchor: None, report: FarReport::default() }
    }

    fn done(self) -> FarReport {
        self.far.guess_unseen();
        self.report
    }

    fn put(&mut self, direction: Vec3, colour: [f32; 3]) {
        let near = match (self.anchor, crate::ground::geometry::unit(direction)) {
            (Some(anchor), Some(unit)) => Lattice::<N>::nearest_from(unit, anchor),
            _ => Lattice::<N>::nearest(direction),
        };
        // A direction that is none must not be where the next search starts.
        self.anchor = near.or(self.anchor);
        match near.and_then(|anchor| self.far.put(anchor, colour, 1.0, self.now)) {
            Some(changed) => {
                self.report.samples += 1;
                self.report.changed += usize::from(changed);
            }
            None => self.report.rejected += 1,
        }
    }
}
