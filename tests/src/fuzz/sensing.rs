//! Cameras, poses and the pyramid.

use arbitrary::{Arbitrary, Result, Unstructured};
use isobath::glam::{Mat4, Vec4};
use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::sensing::camera::convention::Convention;
use isobath::sensing::camera::crop::CropMap;
use isobath::sensing::camera::intrinsics::pixel_index;
use isobath::sensing::camera::screen::{ScreenFit, ScreenMap, ScreenOrientation};
use isobath::sensing::camera::{Camera, Distortion, Intrinsics, Pose, rectify as straighten};
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};

use super::{elements, fill, number, quat, shape, vec2, vec3, word};

pub(super) fn intrinsics(u: &mut Unstructured<'_>) -> Result<Intrinsics> {
    let given = Intrinsics::new(number(u)?, number(u)?, number(u)?, number(u)?);
    Ok(given.unwrap_or_else(|error| {
        assert!(!error.to_string().is_empty());
        Intrinsics::new(120.0, -120.0, 31.5, 19.5).expect("a plain camera")
    }))
}

fn lens(u: &mut Unstructured<'_>) -> Result<Distortion> {
    let count = u.int_in_range(0..=9)?;
    let mut k = [0.0; 9];
    for v in &mut k[..count] {
        *v = number(u)?;
    }
    Ok(Distortion::from_slice(&k[..count])
        .unwrap_or(Distortion::Brown8([0.1, -0.1, 0.001, -0.001, 0.05, 0.0, 0.0, 0.0])))
}

/// Intrinsics, distortion, crops and screens from any numbers, asked about any points.
pub fn camera(data: &[u8]) {
    let mut u = Unstructured::new(data);
    let _ = (|| -> Result<()> {
        let k = intrinsics(&mut u)?;
        let camera = Camera { intrinsics: k, distortion: lens(&mut u)? };
        let (pixel, z, point) = (vec2(&mut u)?, number(&mut u)?, vec3(&mut u)?);
        for seen in [k.project(point), camera.project(point)].into_iter().flatten() {
            assert!(seen.is_finite() && point.z > 0.0);
        }
        if let Some(ray) = camera.ray(pixel) {
            assert!(ray.is_finite() && ray.z == 1.0);
        }
        let _ = camera.unproject(pixel, z);
        let _ = k.unproject_range(pixel, z);
        let _ = k.range_from_z(pixel, z);
        let _ = k.cropped(pixel.x, pixel.y);
        let _ = k.resized(point.x, point.y);

        let size = |u: &mut Unstructured<'_>| -> Result<(usize, usize)> {
            let mut side = || -> Result<usize> {
                Ok(if u.ratio(1, 8)? { usize::arbitrary(u)? } else { u.int_in_range(0..=2000)? })
            };
            Ok((side()?, side()?))
        };
        let (a, b) = (size(&mut u)?, size(&mut u)?);
        let _ = Intrinsics::from_fov(z, a.0, a.1);
        if let Some((x, y)) = pixel_index(pixel, a) {
            assert!(x < a.0 && y < a.1);
        }
        if let Some(map) = CropMap::centred(a, b) {
            let _ = (map.depth_from_colour(pixel), map.colour_from_depth(pixel), map.depth_intrinsics(&k));
        }
        use ScreenOrientation::{LandscapeLeft, LandscapeRight, Portrait, PortraitUpsideDown};
        for orientation in [LandscapeLeft, LandscapeRight, Portrait, PortraitUpsideDown] {
            for fit in [ScreenFit::Fill, ScreenFit::Fit, ScreenFit::Stretch] {
                if let Some(map) = ScreenMap::new(orientation, a, b, fit) {
                    let _ = (map.image_uv(pixel), map.screen_uv(pixel));
                }
            }
        }
        Ok(())
    })();
}

/// Poses from quaternions, matrices and look-at in every convention; what is accepted is rigid.
pub fn pose(data: &[u8]) {
    let mut u = Unstructured::new(data);
    let _ = (|| -> Result<()> {
        let (q, t, p, up) = (quat(&mut u)?, vec3(&mut u)?, vec3(&mut u)?, vec3(&mut u)?);
        let mut row = || -> Result<Vec4> { Ok(vec3(&mut u)?.extend(number(&mut u)?)) };
        let any = Mat4::from_cols(row()?, row()?, row()?, row()?);
        let poses = [Pose::new(q, t).ok(), Pose::looking_at(t, p, up), Pose::from_matrix(any).ok()];
        for pose in poses.into_iter().flatten() {
            assert!((pose.rotation().length() - 1.0).abs() < 1e-3);
            assert!(pose.translation().is_finite());
            let _ = (pose.to_world(p), pose.to_camera(p));
            for convention in [Convention::OpenCv, Convention::OpenGl, Convention::Unity] {
                let there = convention.matrix_from_pose(&pose);
                assert!(convention.pose_from_matrix(there).is_ok(), "{pose:?} {convention:?}");
            }
        }
        for convention in [Convention::OpenCv, Convention::OpenGl, Convention::Unity] {
            let _ = convention.pose_from_matrix(any);
        }
        Ok(())
    })();
}

/// Straightening an image through any lens: every output pixel is an input pixel or the hole.
pub fn rectify(data: &[u8]) {
    let mut u = Unstructured::new(data);
    let _ = (|| -> Result<()> {
        let from = Camera { intrinsics: intrinsics(&mut u)?, distortion: lens(&mut u)? };
        let to = intrinsics(&mut u)?;
        let (width, height, _) = shape(&mut u)?;
        let (out_width, out_height, _) = shape(&mut u)?;
        let source = fill(&mut u, width * height, |u| Ok(word(u)?.max(1)))?;
        let view = ImageView::new(&source, width, height).expect("as long as asked");
        let mut out = vec![9; out_width * out_height];
        let mut out_view = ImageViewMut::new(&mut out, out_width, out_height).expect("as long as asked");
        straighten::rectify(view, &from, &to, 0, &mut out_view);
        assert!(out.iter().all(|v| *v == 0 || source.contains(v)));
        Ok(())
    })();
}

fn pyramid_of<D: DepthSample>(
    u: &mut Unstructured<'_>,
    next: impl Fn(&mut Unstructured<'_>) -> Result<D>,
) -> Result<()> {
    let (width, height, stride) = shape(u)?;
    let k = intrinsics(u)?;
    let storage_short = u.ratio(1, 8)?;
    let values = fill(u, elements(width, height, stride), next)?;
    let Ok(depth) = ImageView::with_stride(&values, width, height, stride) else { return Ok(()) };
    let needed = cells_needed(width, height);
    let mut storage = vec![Cell::EMPTY; needed.saturating_sub(usize::from(storage_short))];
    match Pyramid::build(depth, &mut storage) {
        Ok(pyramid) => {
            for level in 0..=pyramid.levels() {
                let (w, h) = pyramid.level_size(level);
                let tile = Pyramid::<D>::tile(level);
                for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
                    let cell = pyramid.cell(level, x, y).expect("within its level");
                    for row in depth.crop(x * tile, y * tile, tile, tile).rows() {
                        assert!(row.iter().all(|v| !v.is_valid() || (*v >= cell.min && *v <= cell.max)));
                    }
                }
            }
        }
        Err(error) => assert!(storage_short && error.needed == needed),
    }
    let frame = DepthFrame::new(depth, DepthUnit::MILLIMETRE, k);
    for (x, y) in [(0, 0), (width, height), (width / 2, height / 2), (usize::MAX, 0)] {
        let z = frame.z(x, y);
        assert!(z >= 0.0 && z.is_finite());
        assert_eq!(frame.point(x, y).is_some(), z > 0.0);
    }
    Ok(())
}

/// The pyramid bounds every reading below each of its cells; a frame answers for every pixel, inside or not.
pub fn pyramid(data: &[u8]) {
    let _ = pyramid_of(&mut Unstructured::new(data), word);
    let _ = pyramid_of(&mut Unstructured::new(data), number);
}
