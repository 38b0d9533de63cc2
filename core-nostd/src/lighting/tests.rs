//! The whole session: what is drawn step by step is what is drawn at once.

use super::equirect::{MapFrame, direction_of_pixel};
use super::far::extrapolate::FarMap;
use super::far::{FarField, FarParams};
use super::near::{NearField, NearMemory, NearParams};
use super::{Preset, Session};
use crate::ground::image::{ImageView, ImageViewMut};
use crate::ground::units::Timestamp;
use crate::sensing::camera::{Intrinsics, Pose};
use crate::sensing::depth::DepthUnit;
use crate::sensing::frame::DepthFrame;
use glam::Vec3;
use proptest::prelude::*;
use std::boxed::Box;
use std::vec;
use std::vec::Vec;

#[derive(Debug, Clone)]
enum Step {
    Frame {
        eye: Vec3,
        target: Vec3,
        seed: u32,
        id: u32,
    },
    /// A far picture.
    Far {
        target: Vec3,
        seed: u32,
    },
    Ambient(f32),
    Correct(usize, Vec3),
    Move(Vec3),
}

fn vector(span: f32) -> impl Strategy<Value = Vec3> {
    (-span..span, -span..span, -span..span).prop_map(|(x, y, z)| Vec3::new(x, y, z))
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        8 => (vector(1.5), vector(0.4), any::<u32>(), 0_u32..5)
            .prop_map(|(eye, target, seed, id)| Step::Frame { eye, target, seed, id }),
        2 => (vector(1.0), any::<u32>()).prop_map(|(target, seed)| Step::Far { target, seed }),
        1 => (0.0_f32..2.0).prop_map(Step::Ambient),
        1 => (0_usize..3, vector(1.0)).prop_map(|(slot, eye)| Step::Correct(slot, eye)),
        1 => vector(0.2).prop_map(Step::Move),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn following_changes_gives_what_drawing_all_gives(steps in prop::collection::vec(step(), 1..12), wide in prop::sample::select(vec![33_usize, 64, 96])) {
        let preset = Preset { views: 2, view: (32, 24), levels: [64, 32, 0, 0], map: (wide, wide / 2) };
        let (mut depth, mut colour) = (vec![0; 2 * 768], vec![[0; 3]; 2 * 768]);
        let (mut layers, mut picture, mut strip) = (vec![0; 2 * 2048], vec![[0; 4]; 2048], vec![0; preset.strip()]);
        let memory = NearMemory { depth: &mut depth, colour: &mut colour, layers: &mut layers, picture: &mut picture, strip: &mut strip };
        let near = NearField::new(preset, NearParams::default(), memory).unwrap();
        let mut far = Box::new(FarField::<1280>::new(FarParams { threshold: 0.0, ..FarParams::default() }, [0.2; 3]));
        let mut grid = Box::new(FarMap::<64, 32>::new());
        let mut session = Session::new(MapFrame::at(Vec3::ZERO), near, &mut *far, &mut *grid);
        let mut followed = vec![[0.0_f32; 3]; wide * (wide / 2)];
        let look = |eye: Vec3, target: Vec3| Pose::looking_at(eye, target + Vec3::new(0.011, 0.0, 0.0), Vec3::new(0.1, 1.0, 0.05));
        for (i, step) in steps.into_iter().enumerate() {
            match step {
                Step::Frame { eye, target, seed, id } => {
                    let Some(pose) = look(eye, target) else { continue };
                    let depth: Vec<u16> = (0..768_u32).map(|i| ((i.wrapping_mul(seed | 1) >> 5) % 2500) as u16).collect();
                    let colour: Vec<[u8; 3]> = (0..768_u32).map(|i| [i as u8, (i.wrapping_mul(seed) >> 9) as u8, 99]).collect();
                    let frame = DepthFrame::new(ImageView::new(&depth, 32, 24).unwrap(), DepthUnit::MILLIMETRE, Intrinsics::from_fov(1.1, 32, 24).unwrap())
                        .with_colour(ImageView::new(&colour, 32, 24).unwrap()).unwrap()
                        .with_pose(pose)
                        .with_time(Timestamp::from_nanos(i as i64 * 100_000_000), i as u64);
                    // As from a near key frame, or from a camera.
                    if seed % 4 == 0 {
                        let seen = session.observe_near(&frame, id).unwrap();
                        prop_assert_eq!(session.near().view(seen.slot).unwrap().id, id);
                    } else {
                        let seen = session.observe(&frame, id).unwrap();
                        prop_assert_eq!(seen.near.is_some(), frame.pixel_of_world(session.map().at).is_some());
                    }
                }
                Step::Far { target, seed } => {
                    let Some(pose) = look(Vec3::ZERO, target) else { continue };
                    let picture: Vec<[u8; 3]> = (0..768_u32).map(|i| [(i.wrapping_mul(seed) >> 7) as u8, 9, i as u8]).collect();
                    let camera = Intrinsics::from_fov(1.1, 32, 24).unwrap();
                    let time = Timestamp::from_nanos(i as i64 * 100_000_000);
                    let report = session.observe_far(ImageView::new(&picture, 32, 24).unwrap(), &camera, &pose, time);
                    prop_assert_eq!(report.samples, 768);
                }
                Step::Ambient(light) => session.set_ambient([light, 0.5, 0.1]),
                Step::Correct(slot, eye) => _ = look(eye, Vec3::ZERO).map(|pose| session.correct(slot, pose)),
                Step::Move(at) => session.move_to(MapFrame::at(at)),
            }
            let drawn = session.draw(&mut ImageViewMut::new(&mut followed, wide, wide / 2).unwrap());
            prop_assert_eq!(drawn.map.written + drawn.map.skipped, followed.len());
            let mut whole = vec![[0.0_f32; 3]; followed.len()];
            let again = session.draw_all(&mut ImageViewMut::new(&mut whole, wide, wide / 2).unwrap());
            prop_assert_eq!(again.far.computed, 0);
            prop_assert!(followed == whole, "step {}: {} pixels differ", i, followed.iter().zip(&whole).filter(|(a, b)| a != b).count());
        }
        // A single direction is the map's pixel, where map and picture have the same pixels.
        if wide == 64 {
            for i in (0..followed.len()).step_by(37) {
                let light = session.towards(direction_of_pixel(i % 64, i / 64, (64, 32)));
                for (a, b) in light.iter().zip(followed[i]) {
                    prop_assert!((a - b).abs() < 2e-3 * (1.0 + b), "{:?} {:?}", light, followed[i]);
                }
            }
        }
    }
}
