use super::*;
use crate::ground::image::ImageView;
use crate::sensing::camera::Intrinsics;
use crate::sensing::depth::DepthUnit;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

const W: usize = 320;
const H: usize = 240;
const F: f64 = 262.5;

/// Standard normal numbers, from a seed.
struct Gauss(u64);

impl Gauss {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as f64 + 0.5) / f64::from(1_u32 << 31)
    }
    fn next(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (core::f64::consts::TAU * self.uniform()).cos()
    }
}

fn camera() -> Intrinsics {
    Intrinsics::new(F as f32, F as f32, 159.5, 119.5).unwrap()
}

/// A plane n · p = d.
type Plane = ([f64; 3], f64);

/// Depth and normal of the nearest of some planes; each only where its column range says.
fn render(planes: &[(Plane, core::ops::Range<usize>)]) -> (Vec<f64>, Vec<[f64; 3]>) {
    (0..W * H)
        .map(|i| {
            let d = [((i % W) as f64 - 159.5) / F, ((i / W) as f64 - 119.5) / F, 1.0];
            let mut best = (f64::INFINITY, [0.0; 3]);
            for ((n, o), columns) in planes {
                let z = o / (n[0] * d[0] + n[1] * d[1] + n[2] * d[2]);
                if columns.contains(&(i % W)) && z > 0.1 && z < best.0 {
                    best = (z, *n);
                }
            }
            best
        })
        .unzip()
}

fn error_deg(n: [f32; 3], t: [f64; 3]) -> f64 {
    let n = n.map(f64::from);
    let c = [n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2], n[0] * t[1] - n[1] * t[0]];
    let dot = n[0] * t[0] + n[1] * t[1] + n[2] * t[2];
    c.iter().map(|v| v * v).sum::<f64>().sqrt().atan2(dot).to_degrees()
}

/// A wall, a tilted wall beside it in front, and a floor.
fn scene() -> (Vec<f64>, Vec<[f64; 3]>) {
    let tilted = [-0.6, 0.0, -0.8];
    render(&[(([0.0, 0.0, -1.0], -4.0), 0..W), ((tilted, -2.0), 60..150), (([0.0, -1.0, 0.0], -1.1), 0..W)])
}

/// Errors in degrees and predicted errors in degrees, of every pixel.
fn evaluate<D: DepthSample>(
    depth: &[D],
    unit: DepthUnit,
    truth: &[[f64; 3]],
    params: &AdaptiveParams,
) -> (Vec<f64>, Vec<f64>) {
    let frame = DepthFrame::new(ImageView::new(depth, W, H).unwrap(), unit, camera());
    let mut scratch = vec![0.0; scratch_len(W)];
    let (mut errors, mut predicted) = (vec![], vec![]);
    let work = rows(&frame, params, &mut scratch, |y, row| {
        for x in 0..W {
            let n = [row.x[x], row.y[x], row.z[x]];
            assert_eq!(
                n[0].is_nan(),
                !depth[y * W + x].is_valid(),
                "an answer for every reading, none for holes: {x},{y}"
            );
            if !n[0].is_nan() {
                assert!((n.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-5);
                errors.push(error_deg(n, truth[y * W + x]));
                predicted.push(f64::from(row.sigma[x]).to_degrees());
            }
        }
    })
    .unwrap();
    assert_eq!(work.done as usize, errors.len());
    assert_eq!((work.done + work.skipped) as usize, W * H);
    (errors, predicted)
}

fn mean(v: &[f64]) -> f64 {
    v.iter().sum::<f64>() / v.len() as f64
}

fn median(v: &[f64]) -> f64 {
    let mut v = v.to_vec();
    v.sort_by(f64::total_cmp);
    v[v.len() / 2]
}

#[test]
fn kinect_noise_is_averaged_and_edges_are_kept() {
    let (z, truth) = scene();
    let mut gauss = Gauss(5);
    let noisy: Vec<f32> = z.iter().map(|z| (z + 1.425e-3 * z * z * gauss.next()) as f32).collect();
    let (errors, predicted) = evaluate(&noisy, DepthUnit::METRE, &truth, &AdaptiveParams::default());
    let edge: Vec<f64> =
        (0..W * H).filter(|i| [58, 59, 60, 61, 148, 149, 150, 151].contains(&(i % W))).map(|i| errors[i]).collect();
    std::println!(
        "Kinect noise: mean {:.2} median {:.2}, within 2 px of the depth edges {:.2}; predicted median {:.2} degrees",
        mean(&errors),
        median(&errors),
        mean(&edge),
        median(&predicted)
    );
    assert!(mean(&errors) < 3.0 && median(&errors) < 1.5 && mean(&edge) < 4.0);
    // Calibrated: away from creases the error is Rayleigh about the prediction; its median is 0.83 of its RMS.
    let ratio: Vec<f64> = errors.iter().zip(&predicted).map(|(e, p)| e / p).collect();
    assert!((0.6..1.1).contains(&median(&ratio)), "median of error over prediction {}", median(&ratio));
}

#[test]
fn millimetres_are_no_staircase() {
    let (z, truth) = scene();
    let mm: Vec<u16> = z.iter().map(|z| (z * 1000.0).round() as u16).collect();
    let params = AdaptiveParams { noise: DepthNoise::NONE, ..AdaptiveParams::default() };
    let (errors, _) = evaluate(&mm, DepthUnit::MILLIMETRE, &truth, &params);
    std::println!("1 mm steps: mean {:.3} median {:.3} degrees", mean(&errors), median(&errors));
    assert!(mean(&errors) < 0.4 && median(&errors) < 0.1);
}

#[test]
fn holes_shrink_the_support_not_the_truth() {
    let (z, truth) = scene();
    let mut gauss = Gauss(11);
    let holed: Vec<f32> = z
        .iter()
        .map(|z| if gauss.uniform() < 0.3 { f32::NAN } else { (z + 1.425e-3 * z * z * gauss.next()) as f32 })
        .collect();
    let (errors, _) = evaluate(&holed, DepthUnit::METRE, &truth, &AdaptiveParams::default());
    assert!(mean(&errors) < 4.0 && median(&errors) < 2.0, "{} {}", mean(&errors), median(&errors));
}

#[test]
fn block_size_follows_the_noise() {
    let far = vec![6000_u16; W * H];
    let near = vec![600_u16; W * H];
    let size = |data: &[u16], noise| {
        let frame = DepthFrame::new(ImageView::new(data, W, H).unwrap(), DepthUnit::MILLIMETRE, camera());
        resolve(&frame, &AdaptiveParams { noise, block: BlockSize::Auto })
    };
    assert_eq!(size(&near, DepthNoise::NONE), BlockSize::Four);
    assert_eq!(size(&far, DepthNoise::KINECT), BlockSize::Eight);
    let coarse = DepthNoise { constant: 0.0, linear: 0.0, quadratic: 0.02 };
    assert_eq!(size(&far, coarse), BlockSize::Sixteen);
}

proptest! {
    #[test]
    fn any_image_is_answered(w in 0_usize..40, h in 0_usize..40, seed in any::<u64>(), block in 0_usize..3, u16_depth in any::<bool>()) {
        let mut gauss = Gauss(seed);
        let block = [BlockSize::Four, BlockSize::Eight, BlockSize::Sixteen][block];
        let params = AdaptiveParams { noise: DepthNoise::NONE, block };
        let raw: Vec<u16> = (0..w * h).map(|_| match (gauss.uniform() * 5.0) as u8 {
            0 => 0,
            1 => u16::MAX,
            2 => (gauss.uniform() * 65_536.0) as u16,
            _ => 1000,
        }).collect();
        let float: Vec<f32> = raw.iter().map(|&v| match v { 0 => f32::NAN, u16::MAX => f32::INFINITY, 7 => 1e-30, 8 => 1e30, v => f32::from(v) }).collect();
        let k = Intrinsics::new(20.0, -21.0, 3.0, 4.0).unwrap();
        let mut scratch = vec![f32::NAN; scratch_len(w)];
        let check = |_: usize, row: AdaptiveRow<'_>| {
            for x in 0..w {
                let n = row.x[x] * row.x[x] + row.y[x] * row.y[x] + row.z[x] * row.z[x];
                assert!(n.is_nan() || (n - 1.0).abs() < 1e-4, "{n}");
            }
        };
        let work = if u16_depth {
            rows(&DepthFrame::new(ImageView::new(&raw, w, h).unwrap(), DepthUnit::MILLIMETRE, k), &params, &mut scratch, check)
        } else {
            rows(&DepthFrame::new(ImageView::new(&float, w, h).unwrap(), DepthUnit::METRE, k), &params, &mut scratch, check)
        };
        prop_assert_eq!((work.unwrap().done + work.unwrap().skipped) as usize, w * h);
    }
}

#[test]
fn scratch_must_suffice() {
    let data = [1000_u16; 4];
    let frame = DepthFrame::new(ImageView::new(&data, 2, 2).unwrap(), DepthUnit::MILLIMETRE, camera());
    let err = rows(&frame, &AdaptiveParams::default(), &mut [0.0; 3], |_, _| ()).unwrap_err();
    assert_eq!(err, DenseError::Scratch { needed: scratch_len(2), got: 3 });
}
