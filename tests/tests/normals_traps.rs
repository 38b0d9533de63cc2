//! What other libraries' normals get wrong (measured: host-tools/bench/peers/README.md), a test each, for every dense method:
//! exact and adaptive with each block size.

use isobath::ground::image::ImageView;
use isobath::localized::normals::adaptive::{self, AdaptiveParams, BlockSize};
use isobath::localized::normals::{NormalParams, dense};
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;

const W: usize = 96;
const H: usize = 64;
const BLOCKS: [BlockSize; 5] = [BlockSize::Auto, BlockSize::One, BlockSize::Four, BlockSize::Eight, BlockSize::Sixteen];

fn camera() -> Intrinsics {
    Intrinsics::new(80.0, 81.0, 47.93, 31.87).unwrap()
}

/// Depth of the plane n . p = d, metres; 0 where it is not seen.
fn plane(k: &Intrinsics, n: [f64; 3], d: f64) -> Vec<f32> {
    let ray = |i: usize| {
        let at = [((i % W) as f64, k.cx(), k.fx()), ((i / W) as f64, k.cy(), k.fy())];
        at.map(|(p, c, f)| (p - f64::from(c)) / f64::from(f))
    };
    let z = (0..W * H).map(|i| {
        let [x, y] = ray(i);
        let z = d / (n[0] * x + n[1] * y + n[2]);
        if z > 0.0 && z < 1e3 { z as f32 } else { 0.0 }
    });
    z.collect()
}

type Normals = Vec<[f32; 3]>;

/// The normals of every method, by name; NaN where there is none.
fn every_method<D: DepthSample>(depth: &[D], unit: DepthUnit, k: Intrinsics) -> Vec<(String, Normals)> {
    let frame = DepthFrame::new(ImageView::new(depth, W, H).unwrap(), unit, k);
    let none = vec![[f32::NAN; 3]; W * H];
    let mut exact = none.clone();
    let mut scratch = vec![0.0; dense::scratch_len(W)];
    dense::rows(&frame, &NormalParams::default(), &mut scratch, |y, row| {
        for x in 0..W {
            exact[y * W + x] = [row.x[x], row.y[x], row.z[x]];
        }
    })
    .unwrap();
    let mut all = vec![("exact".to_owned(), exact)];
    for block in BLOCKS {
        let mut normals = none.clone();
        let mut scratch = vec![0.0; adaptive::scratch_len(W)];
        let params = AdaptiveParams { noise: DepthNoise::NONE, block };
        adaptive::rows(&frame, &params, &mut scratch, |y, row| {
            for x in 0..W {
                normals[y * W + x] = [row.x[x], row.y[x], row.z[x]];
            }
        })
        .unwrap();
        all.push((format!("adaptive, {block:?}"), normals));
    }
    all
}

fn degrees(n: [f32; 3], t: [f64; 3]) -> f64 {
    let n = n.map(f64::from);
    let c = [n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2], n[0] * t[1] - n[1] * t[0]];
    c.iter().map(|v| v * v).sum::<f64>().sqrt().atan2(n[0] * t[0] + n[1] * t[1] + n[2] * t[2]).to_degrees()
}

const TILTED: [f64; 3] = [0.48, 0.36, -0.8];

/// FALS: a ring of normals up to 90 degrees off around one hole.
#[test]
fn one_hole_in_the_window_spoils_nothing() {
    let mut depth = plane(&camera(), TILTED, -2.0);
    // Not in the first and last rows: there a pixel may have no neighbour but the hole.
    for i in (5 * W + 7..(H - 2) * W).step_by(397) {
        depth[i] = f32::NAN;
    }
    for (name, normals) in every_method(&depth, DepthUnit::METRE, camera()) {
        for (i, n) in normals.iter().enumerate() {
            assert_eq!(n[0].is_nan(), depth[i].is_nan(), "{name}: an answer for every reading, none for holes ({i})");
            assert!(n[0].is_nan() || degrees(*n, TILTED) < 0.05, "{name}: {} degrees at {i}", degrees(*n, TILTED));
        }
    }
}

/// FALS, LINEMOD: normals where nothing was measured. OpenCV, PCL, Open3D: 65535, -1 m taken for surfaces.
#[test]
fn what_is_no_reading_has_no_normal_and_bends_none() {
    let metres = plane(&camera(), TILTED, -2.0);
    let hole = |i: usize| (20..40).contains(&(i % W)) && (20..44).contains(&(i / W));
    for bad in [0.0, f32::NAN, f32::INFINITY, -1.0] {
        let depth: Vec<f32> = metres.iter().enumerate().map(|(i, &z)| if hole(i) { bad } else { z }).collect();
        for (name, normals) in every_method(&depth, DepthUnit::METRE, camera()) {
            for (i, n) in normals.iter().enumerate() {
                assert_eq!(n[0].is_nan(), hole(i), "{name}, {bad}: pixel {i}");
                assert!(hole(i) || degrees(*n, TILTED) < 0.05, "{name}, {bad}: {} at {i}", degrees(*n, TILTED));
            }
        }
    }
    for bad in [0, u16::MAX] {
        let depth: Vec<u16> =
            (0..W * H).map(|i| if hole(i) { bad } else { (metres[i] * 10_000.0).round() as u16 }).collect();
        for (name, normals) in every_method(&depth, DepthUnit::TENTH_MILLIMETRE, camera()) {
            for (i, n) in normals.iter().enumerate() {
                assert_eq!(n[0].is_nan(), hole(i), "{name}, {bad}: pixel {i}");
                assert!(hole(i) || degrees(*n, TILTED) < 2.0, "{name}, {bad}: {} at {i}", degrees(*n, TILTED));
            }
        }
    }
}

/// FALS turns 73 % of an exact floor away; LINEMOD answers none of it.
#[test]
fn a_floor_faces_the_camera_to_the_horizon() {
    let up = [0.0, -1.0, 0.0];
    let depth = plane(&camera(), up, -1.5);
    assert!(depth.iter().any(|&z| z > 40.0), "it is seen near the horizon");
    for (name, normals) in every_method(&depth, DepthUnit::METRE, camera()) {
        for (i, n) in normals.iter().enumerate().filter(|(i, _)| depth[*i] > 0.0) {
            let k = camera();
            let ray = [((i % W) as f32 - k.cx()) / k.fx(), ((i / W) as f32 - k.cy()) / k.fy(), 1.0];
            let towards = n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2];
            assert!(towards < 0.0, "{name}: faces away at {i}");
            assert!(degrees(*n, up) < 0.2, "{name}: {} at {i}, {} m", degrees(*n, up), depth[i]);
        }
    }
}

/// Open3D's vertex normals are 0.13 to 1 long; others truncate the principal point to a whole pixel.
#[test]
fn normals_are_of_unit_length_and_the_principal_point_has_its_fraction() {
    let depth = plane(&camera(), TILTED, -2.0);
    let whole = Intrinsics::new(80.0, 81.0, 47.0, 31.0).unwrap();
    let mean = |normals: &Normals| normals.iter().map(|n| degrees(*n, TILTED)).sum::<f64>() / (W * H) as f64;
    for ((name, right), (_, cut)) in
        every_method(&depth, DepthUnit::METRE, camera()).iter().zip(&every_method(&depth, DepthUnit::METRE, whole))
    {
        for n in right {
            assert!((n.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-5, "{name}: {n:?}");
        }
        assert!(mean(right) < 0.01, "{name}: {}", mean(right));
        assert!(mean(cut) > 0.1, "{name}: a principal point cut to whole pixels must show, {}", mean(cut));
    }
}

/// PCL: signal 11 below its window's size; OpenCV 4 throws.
#[test]
fn images_smaller_than_the_window() {
    for (w, h) in [(0, 0), (1, 1), (2, 2), (1, 9), (9, 1), (3, 2)] {
        let depth = vec![1000_u16; w * h];
        let frame = DepthFrame::new(ImageView::new(&depth, w, h).unwrap(), DepthUnit::MILLIMETRE, camera());
        let mut rows = 0;
        let mut scratch = vec![0.0; dense::scratch_len(w)];
        dense::rows(&frame, &NormalParams::default(), &mut scratch, |_, _| rows += 1).unwrap();
        for block in BLOCKS {
            let mut scratch = vec![0.0; adaptive::scratch_len(w)];
            let params = AdaptiveParams { noise: DepthNoise::KINECT, block };
            adaptive::rows(&frame, &params, &mut scratch, |_, row| {
                // Two by two pixels are a surface; one, or a line, is none.
                let answered = row.z.iter().filter(|z| z.is_finite()).count();
                assert!(answered == 0 || (w > 1 && h > 1) || block != BlockSize::One, "{w}x{h} {block:?}");
                rows += 1;
            })
            .unwrap();
        }
        assert_eq!(rows, if w == 0 { 0 } else { 6 * h }, "{w}x{h}");
    }
}
