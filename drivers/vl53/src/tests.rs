use super::*;
use isobath::ground::image::Image;
use isobath::sensing::depth::DepthArray;

const SURE: [u8; 64] = [5; 64];

fn numbered() -> [i16; 64] {
    core::array::from_fn(|zone| zone as i16 + 1)
}

/// Zones at the image's corners: top left, top right, bottom left, bottom right.
fn corners(order: Order) -> [u16; 4] {
    let mut depth = DepthArray::<8, 8>::filled(0);
    let params = ZoneParams { order, ..ZoneParams::default() };
    let k = pinhole(FOV_45, 8).unwrap();
    zones(&numbered(), &SURE, &params, &k, &mut depth.view_mut(), None).unwrap();
    [(0, 0), (7, 0), (0, 7), (7, 7)].map(|(x, y)| depth.view().get(x, y).unwrap())
}

#[test]
fn zones_lie_where_the_order_says() {
    assert_eq!(corners(Order::AS_LISTED), [1, 8, 57, 64]);
    assert_eq!(corners(Order::UPRIGHT), [8, 1, 64, 57]);
    assert_eq!(corners(Order::UPSIDE_DOWN), [57, 64, 1, 8]);
    assert_eq!(corners(Order { transposed: true, ..Order::AS_LISTED }), [1, 57, 8, 64]);
    // A quarter turn: every corner moves on by one.
    assert_eq!(corners(Order { transposed: true, mirrored: true, flipped: false }), [57, 1, 64, 8]);
}

#[test]
fn the_status_decides() {
    let statuses = [5, 9, 6, 0, 1, 2, 3, 4, 7, 8, 10, 11, 12, 13, 14, 255];
    let confidences = |accept: Accept| statuses.map(|s| accept.confidence(s));
    assert_eq!(confidences(Accept::Complete)[..4], [255, 0, 0, 0]);
    assert_eq!(confidences(Accept::Ranging)[..4], [255, 128, 0, 0]);
    assert_eq!(confidences(Accept::Unchecked)[..4], [255, 128, 128, 0]);
    assert!(confidences(Accept::Unchecked)[3..].iter().all(|c| *c == 0));

    let distances = [700, 0, 800, -5, 900, 1, i16::MIN, i16::MAX, 1, 1, 1, 1, 1, 1, 1, 1];
    let statuses = [5, 5, 9, 5, 6, 4, 5, 5, 255, 255, 255, 255, 255, 255, 255, 255];
    let mut depth = DepthArray::<4, 4>::filled(7);
    let mut sure = Image::<u8, 4, 4>::filled(7);
    let params = ZoneParams { order: Order::AS_LISTED, ..ZoneParams::default() };
    let k = pinhole(FOV_45, 4).unwrap();
    let report = zones(&distances, &statuses, &params, &k, &mut depth.view_mut(), Some(&mut sure.view_mut()));
    assert_eq!(report, Ok(ZoneReport { valid: 3, refused: 10, out_of_range: 3 }));
    assert_eq!(depth.as_slice()[..8], [700, 0, 800, 0, 0, 0, 0, 32_767]);
    assert_eq!(sure.as_slice()[..8], [255, 0, 128, 0, 0, 0, 0, 255]);
    assert!(depth.as_slice()[8..].iter().all(|z| *z == 0));
}

#[test]
fn the_length_of_the_ray_becomes_depth() {
    let k = pinhole(FOV_45, 8).unwrap();
    // A wall seen squarely at 1 m, by a sensor that reports the ray: 1.15 m in the corners.
    let ranges: [i16; 64] = core::array::from_fn(|zone| {
        let pixel = Vec2::new((zone % 8) as f32, (zone / 8) as f32);
        (k.range_from_z(pixel, 1000.0) + 0.5) as i16
    });
    assert!(ranges[0] > 1120 && ranges[27] < 1010);
    let mut depth = DepthArray::<8, 8>::filled(0);
    let params = ZoneParams { distance: Distance::Radial, ..ZoneParams::default() };
    zones(&ranges, &SURE, &params, &k, &mut depth.view_mut(), None).unwrap();
    assert!(depth.as_slice().iter().all(|z| z.abs_diff(1000) <= 1), "{depth:?}");
}

#[test]
fn the_first_of_several_targets_is_taken() {
    let distances: [i16; 128] = core::array::from_fn(|i| if i % 2 == 0 { 500 } else { 2000 });
    let mut depth = DepthArray::<8, 8>::filled(0);
    let params = ZoneParams { targets: 2, ..ZoneParams::default() };
    let k = pinhole(FOV_45, 8).unwrap();
    zones(&distances, &[5; 128], &params, &k, &mut depth.view_mut(), None).unwrap();
    assert!(depth.as_slice().iter().all(|z| *z == 500));
}

#[test]
fn sizes_that_do_not_fit_are_told() {
    let k = pinhole(FOV_45, 8).unwrap();
    let mut depth = DepthArray::<8, 8>::filled(3);
    let mut wide = DepthArray::<8, 4>::filled(3);
    let mut small = Image::<u8, 4, 4>::filled(3);
    let params = ZoneParams::default();
    let near = [1_i16; 64];
    let short = zones(&near[..63], &SURE, &params, &k, &mut depth.view_mut(), None);
    assert_eq!(short, Err(ZoneError::TooFew { needed: 64, got: 63 }));
    let none = zones(&near, &SURE, &ZoneParams { targets: 0, ..params }, &k, &mut depth.view_mut(), None);
    assert_eq!(none, Err(ZoneError::TooFew { needed: usize::MAX, got: 64 }));
    let many = zones(&near, &SURE, &ZoneParams { targets: usize::MAX, ..params }, &k, &mut depth.view_mut(), None);
    assert!(matches!(many, Err(ZoneError::TooFew { needed: usize::MAX, .. })));
    let oblong = zones(&near, &SURE, &params, &k, &mut wide.view_mut(), None);
    assert_eq!(oblong, Err(ZoneError::NotSquare { size: (8, 4) }));
    let other = zones(&near, &SURE, &params, &k, &mut depth.view_mut(), Some(&mut small.view_mut()));
    assert_eq!(other, Err(ZoneError::ConfidenceSize { size: (4, 4) }));
    assert!(depth.as_slice().iter().all(|z| *z == 3), "an error leaves the image alone");
    assert!(pinhole(0.0, 8).is_err() && pinhole(f32::NAN, 8).is_err() && pinhole(4.0, 8).is_err());
    let mut nothing = DepthArray::<0, 0>::filled(0);
    assert_eq!(zones(&[], &[], &params, &k, &mut nothing.view_mut(), None), Ok(ZoneReport::default()));
}

#[cfg(feature = "vl53-8x8")]
#[test]
fn the_driver_s_results_are_taken_as_they_are() {
    let mut measured = vl53_8x8::ResultsData { distance_mm: numbered(), target_status: SURE, ..Default::default() };
    measured.target_status[1] = 255;
    let k = pinhole(FOV_45, 8).unwrap();
    let mut depth = DepthArray::<8, 8>::filled(0);
    let report = results(&measured, &ZoneParams::default(), &k, &mut depth.view_mut(), None).unwrap();
    assert_eq!((report.valid, report.refused), (63, 1));
    assert_eq!(depth.as_slice()[..8], [8, 7, 6, 5, 4, 3, 0, 1]);
    // In 4 x 4 mode the first sixteen.
    let mut depth = DepthArray::<4, 4>::filled(0);
    results(&measured, &ZoneParams::default(), &pinhole(FOV_45, 4).unwrap(), &mut depth.view_mut(), None).unwrap();
    assert_eq!(depth.as_slice()[12..], [16, 15, 14, 13]);
}
