//! The results of the `vl53-8x8` driver, as they are.

use isobath::ground::image::ImageViewMut;
use isobath::sensing::camera::Intrinsics;
use vl53_8x8::{NB_TARGET_PER_ZONE, ResultsData};

use crate::{ZoneError, ZoneParams, ZoneReport, zones};

/// As [`zones`], for one measurement of the `vl53-8x8` driver: an 8 x 8 image takes its 64 zones, a 4 x 4 one the first 16, which are
/// what the sensor fills in that mode. The number of targets is the driver's, whatever `params` say.
///
/// With the driver's feature `raw-format`, distances are quarters of a millimetre: give the frame
/// [`DepthUnit::QUARTER_MILLIMETRE`](isobath::sensing::depth::DepthUnit::QUARTER_MILLIMETRE). Its features `disable-distance` and
/// `disable-target-status` leave nothing to convert, and this crate does not compile with them.
///
/// # Errors
/// [`ZoneError`], as [`zones`].
pub fn results(
    measured: &ResultsData,
    params: &ZoneParams,
    k: &Intrinsics,
    depth: &mut ImageViewMut<'_, u16>,
    confidence: Option<&mut ImageViewMut<'_, u8>>,
) -> Result<ZoneReport, ZoneError> {
    let params = ZoneParams { targets: NB_TARGET_PER_ZONE, ..*params };
    zones(&measured.distance_mm, &measured.target_status, &params, k, depth, confidence)
}
