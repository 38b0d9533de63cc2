//! Where in the view is there room for the box? Tries spots on a grid of pixels, in rings outward from a start, and keeps the
//! best few that do not overlap.

use crate::ground::math;
use crate::localized::placement::{PlaceParams, Placement, Spot, place};
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;
use crate::skipping::pyramid::Pyramid;

/// How spots are tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SearchParams {
    /// Pixel from which the rings grow; `None` (default): the image's middle.
    pub start: Option<(usize, usize)>,
    /// Pixels between spots, at least 1; `None` (default): a twentieth of the image's longer side.
    pub step: Option<usize>,
    /// Spots tried at most. Default 450: all at the default step.
    pub max_tries: u32,
}

impl Default for SearchParams {
    fn default() -> Self {
        Self { start: None, step: None, max_tries: 450 }
    }
}

/// What a search did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SearchReport {
    /// Placements written, best first.
    pub found: usize,
    /// Spots tried.
    pub tried: u32,
    /// Spots that were left when [`SearchParams::max_tries`] ended the search: it may have missed a place.
    pub exhausted: bool,
    /// Pixels read and saved by all tries.
    pub work: Work,
}

impl Placement {
    /// How good a place is, 0 to 1: much of the footprint covered, flat and level within what `params` allow.
    #[must_use]
    pub fn score(&self, params: &PlaceParams) -> f32 {
        let share = |value: f32, most: f32| if most > 0.0 { (value / most).clamp(0.0, 1.0) } else { 0.0 };
        self.coverage
            * (1.0 - 0.5 * share(self.flatness, params.max_roughness))
            * (1.0 - 0.5 * share(self.tilt, params.max_tilt))
    }
}

/// Fills `best` with the best places in the view, best first; among equals, the one nearer to the start.
///
/// ```
/// use glam::{vec3, Vec3};
/// use isobath::localized::placement::{search::{find_place, SearchParams}, PlaceParams};
/// use isobath::sensing::{camera::Intrinsics, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// static TABLE: DepthArray<160, 120> = DepthArray::filled(1000);
/// let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5)?;
/// let frame = DepthFrame::new(TABLE.view(), DepthUnit::MILLIMETRE, k);
/// let params = PlaceParams::new(vec3(0.2, 0.1, 0.2), Vec3::NEG_Z);
/// let mut best = [None; 3];
/// let report = find_place(&frame, None, &params, &SearchParams::default(), &mut best);
/// assert_eq!(report.found, 3);
/// assert!(best[0].unwrap().pose.centre.length() > 0.9);
/// # Ok::<(), isobath::sensing::camera::intrinsics::IntrinsicsError>(())
/// ```
pub fn find_place<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    pyramid: Option<&Pyramid<'_, D>>,
    params: &PlaceParams,
    search: &SearchParams,
    best: &mut [Option<Placement>],
) -> SearchReport {
    best.fill(None);
    let mut report = SearchReport::default();
    let (width, height) = frame.size();
    let step = search.step.unwrap_or(width.max(height) / 20).clamp(1, 1 << 16) as i64;
    let (x0, y0) = search.start.unwrap_or((width / 2, height / 2));
    let (x0, y0) = (x0.min(width) as i64, y0.min(height) as i64);
    let rings = width.max(height) as i64 / step + 1;
    'rings: for ring in 0..=rings {
        // Only rows and columns within the image: a thin image has long rings of little.
        let (up, down) = ((y0 / step).min(ring), ((height as i64 - y0) / step).min(ring));
        let (left, right) = ((x0 / step).min(ring), ((width as i64 - x0) / step).min(ring));
        for j in -up..=down {
            // Whole rows at the top and the bottom of the ring, its two ends between.
            let whole = j.abs() == ring;
            let (first, last, stride) =
                if whole { (-left, right, 1) } else { (-ring, ring, (2 * ring as usize).max(1)) };
            for i in (first..=last).step_by(stride) {
                let spot = (usize::try_from(x0 + i * step), usize::try_from(y0 + j * step));
                let (Ok(x), Ok(y)) = spot else { continue };
                if x >= width || y >= height {
                    continue;
                }
                if report.tried >= search.max_tries {
                    report.exhausted = true;
                    break 'rings;
                }
                report.tried += 1;
                let answer = place(frame, pyramid, Spot::Pixel(x, y), params);
                report.work += answer.work;
                if let Ok(placement) = answer.outcome {
                    keep(best, placement, params);
                }
            }
        }
    }
    report.found = best.iter().flatten().count();
    report
}

/// Puts a placement among the best, in order, unless an overlapping one is as good.
fn keep(best: &mut [Option<Placement>], new: Placement, params: &PlaceParams) {
    // However they are turned, footprints farther apart than their diagonal do not overlap.
    let apart = math::sqrt(params.size.x * params.size.x + params.size.z * params.size.z);
    let overlaps = |p: &Placement| (p.pose.centre - new.pose.centre).length() < apart;
    let score = new.score(params);
    if best.iter().flatten().any(|p| overlaps(p) && p.score(params) >= score) {
        return;
    }
    for slot in best.iter_mut() {
        if slot.as_ref().is_some_and(overlaps) {
            *slot = None;
        }
    }
    // One pass: pushes what is worse down, and closes the gaps just made.
    let mut carried = Some(new);
    for slot in best.iter_mut() {
        let Some(c) = carried else { break };
        if slot.is_none_or(|p| p.score(params) < c.score(params)) {
            carried = slot.replace(c);
        }
    }
    close_gaps(best);
}

/// Moves the placements to the front, in their order.
fn close_gaps(best: &mut [Option<Placement>]) {
    let mut rest = best;
    while let Some(gap) = rest.iter().position(Option::is_none) {
        let Some((empty, tail)) = rest.get_mut(gap..).and_then(<[_]>::split_first_mut) else { return };
        let Some(next) = tail.iter_mut().find(|slot| slot.is_some()) else { return };
        *empty = next.take();
        rest = tail;
    }
}
