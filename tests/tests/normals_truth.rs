//! Normals against rendered ground truth (the published 3F2N and D2NT frames, `shared/data/d2nt_3f2n_normals`).
//!
//! The frames' own `params.txt` puts the principal point 50 rows too high (and half a pixel to the right): with
//! cy = 249.5 and 279.5 instead of 200 and 230 the exact method's median error falls from 0.67 to 0.006 degrees on both frames,
//! which can only happen at the truth, as the surfaces are flat facets. Both are printed; the bounds are held against the
//! true camera, and the mean also against the documented one.

use isobath::ground::image::ImageView;
use isobath::localized::normals::NormalParams;
use isobath::localized::normals::dense::{rows, scratch_len};
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::frame::DepthFrame;
use isobath_tests::shared;

const SIZE: (usize, usize) = (640, 480);

struct Scene {
    depth: Vec<f32>,
    /// Unit normals; `None` in the background.
    truth: Vec<Option<[f64; 3]>>,
}

fn load(depth: &std::path::Path, normals: &std::path::Path) -> Scene {
    let bytes = std::fs::read(depth).unwrap();
    let raw: Vec<f32> = bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let mut reader =
        png::Decoder::new(std::io::BufReader::new(std::fs::File::open(normals).unwrap())).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    let truth = pixels.as_chunks::<6>().0.iter().zip(&raw).map(|(p, &z)| {
        let part = |i: usize| 1.0 - 2.0 * f64::from(u16::from_be_bytes([p[2 * i], p[2 * i + 1]])) / 65_535.0;
        // The background is written as depth 1.
        (z != 1.0).then(|| [part(0), part(1), part(2)])
    });
    let truth: Vec<_> = truth.collect();
    let depth = raw.iter().map(|&z| if z == 1.0 { 0.0 } else { z }).collect();
    Scene { depth, truth }
}

/// Mean and median angle in degrees, over every pixel of the object; every one must have an answer.
fn errors(scene: &Scene, k: Intrinsics, params: &NormalParams) -> (f64, f64) {
    let frame = DepthFrame::new(ImageView::new(&scene.depth, SIZE.0, SIZE.1).unwrap(), DepthUnit::METRE, k);
    let mut scratch = vec![0.0; scratch_len(SIZE.0)];
    let mut errors = Vec::new();
    rows(&frame, params, &mut scratch, |y, row| {
        for (x, truth) in scene.truth[y * SIZE.0..(y + 1) * SIZE.0].iter().enumerate() {
            let Some(t) = truth else { continue };
            let n = [row.x[x], row.y[x], row.z[x]].map(f64::from);
            assert!(n[0].is_finite(), "no normal at {x},{y}");
            let cross = [n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2], n[0] * t[1] - n[1] * t[0]];
            let sine = cross.iter().map(|c| c * c).sum::<f64>().sqrt();
            errors.push(sine.atan2(n[0] * t[0] + n[1] * t[1] + n[2] * t[2]).to_degrees());
        }
    })
    .unwrap();
    errors.sort_by(f64::total_cmp);
    (errors.iter().sum::<f64>() / errors.len() as f64, errors[errors.len() / 2])
}

#[test]
fn exact_normals_beat_the_cross_product_baseline() {
    let Some(root) = shared::folder("d2nt_3f2n_normals") else { return };
    // Baseline (cross product of Scharr gradients): mean and median of the folder's README.
    for (name, depth, normals, documented_cy, true_cy, baseline) in [
        ("d2nt_demo", "d2nt_demo/depth.bin", "d2nt_demo/normal.png", 200.0, 249.5, (2.4, 0.38)),
        ("torusknot", "3f2n_torusknot/depth/000001.bin", "3f2n_torusknot/normal/000001.png", 230.0, 279.5, (3.3, 1.36)),
    ] {
        let scene = load(&root.join(depth), &root.join(normals));
        let documented = Intrinsics::new(1400.0, 1380.0, 350.0, documented_cy).unwrap();
        let camera = Intrinsics::new(1400.0, 1380.0, 349.5, true_cy).unwrap();
        let exact = NormalParams::default();
        let (mean, median) = errors(&scene, camera, &exact);
        let (doc_mean, doc_median) = errors(&scene, documented, &exact);
        let (paper_mean, paper_median) = errors(&scene, camera, &NormalParams::PAPER);
        println!(
            "{name}: exact mean {mean:.3} median {median:.4} (documented camera {doc_mean:.3}, {doc_median:.3}); \
             paper {paper_mean:.2}, {paper_median:.2}; baseline {}, {} degrees",
            baseline.0, baseline.1
        );
        assert!(mean < 0.28 && median < 0.01, "{name}: mean {mean}, median {median}");
        assert!(doc_mean < baseline.0, "{name}: documented camera, mean {doc_mean}");
        assert!(paper_mean > mean);
    }
}
