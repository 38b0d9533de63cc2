//! Any numbers whatever in any call: a code or an answer, and never a panic, in a build that checks every overflow. Pointers are
//! good ones here; `tests/c/hostile.c` has the bad ones.
#![allow(unsafe_code, reason = "calls the C interface as C does")]

use std::ptr::{null, null_mut};

use isobath_capi::context::Context;
use isobath_capi::frames::{
    isobath_begin_frame, isobath_end_frame, isobath_init, isobath_push_frame, isobath_set_noise,
};
use isobath_capi::ground::{
    Map, Walker, isobath_ground_at, isobath_integrate, isobath_map_defaults, isobath_map_fade, isobath_map_restart,
    isobath_path,
};
use isobath_capi::memory::isobath_context_size;
use isobath_capi::points::{isobath_hit_test, isobath_normal, isobath_ray_cast};
use isobath_capi::room::{PlaceWish, VoteParams, isobath_place, isobath_vote};
use isobath_capi::status::Status;
use isobath_capi::types::{Box3, Camera, Pose, Quat, Vec3};
use proptest::prelude::*;

/// Numbers in turn: half of them any bits, half of them of a size that gets past the first check.
struct Numbers<'a>(std::iter::Cycle<std::slice::Iter<'a, u32>>);

impl Numbers<'_> {
    fn bits(&mut self) -> u32 {
        self.0.next().copied().unwrap_or_default()
    }

    fn float(&mut self) -> f32 {
        let bits = self.bits();
        if bits.is_multiple_of(2) { f32::from_bits(bits) } else { (bits >> 8) as f32 / 4e6 - 2.0 }
    }

    fn int(&mut self) -> u32 {
        let bits = self.bits();
        if bits.is_multiple_of(4) { bits } else { (bits >> 8) % 20 }
    }

    fn vec(&mut self) -> Vec3 {
        Vec3 { x: self.float(), y: self.float(), z: self.float() }
    }

    fn quat(&mut self) -> Quat {
        if self.bits().is_multiple_of(4) {
            return Quat { x: self.float(), y: self.float(), z: self.float(), w: self.float() };
        }
        let half = self.float().clamp(-3.0, 3.0);
        Quat { x: 0.0, y: half.sin(), z: 0.0, w: half.cos() }
    }

    fn pose(&mut self) -> Pose {
        Pose { rotation: self.quat(), position: self.vec() }
    }

    fn holes(&mut self) -> i32 {
        (self.bits() >> 8) as i32 % 4
    }

    fn map(&mut self) -> Map {
        Map {
            centre: self.vec(),
            up: self.vec(),
            forward: self.vec(),
            cell: self.float(),
            columns: self.int(),
            rows: self.int(),
            clearance: self.float(),
            reach: self.float(),
            pixel_step: self.int(),
        }
    }
}

#[test]
fn any_numbers_give_a_code_or_an_answer() {
    let (mut contexts, mut answers) = (0, 0);
    let numbers = (proptest::collection::vec(any::<u32>(), 64..256), proptest::collection::vec(any::<u16>(), 20 * 20));
    let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig::with_cases(20_000));
    let run = std::cell::RefCell::new((&mut contexts, &mut answers));
    runner
        .run(&numbers, |(numbers, depth)| {
            let (made, answered) = one(&mut Numbers(numbers.iter().cycle()), &depth);
            let mut counts = run.borrow_mut();
            *counts.0 += u32::from(made);
            *counts.1 += answered;
            Ok(())
        })
        .expect("no call panics");
    assert!(contexts > 2000 && answers > 20_000, "too few got past the checks: {contexts} contexts, {answers} answers");
}

/// Whether a context was made, and how many calls on it returned `Ok`.
fn one(n: &mut Numbers<'_>, depth: &[u16]) -> (bool, u32) {
    let (width, height) = (n.int() % 20 + 1, n.int() % 20 + 1);
    let mut map = n.map();
    if n.bits() % 2 == 1 {
        // SAFETY: a good pointer.
        unsafe { isobath_map_defaults(&raw mut map) };
        (map.columns, map.rows) = (n.int() % 20 + 1, n.int() % 20 + 1);
    }
    let mut memory = vec![0_u64; isobath_context_size(20, 20, 20, 20) / 8];
    let mut camera = Camera { fx: n.float() * 9.0, fy: n.float() * 9.0, cx: n.float(), cy: n.float() };
    if n.bits().is_multiple_of(2) {
        camera = Camera { fx: 15.0, fy: 15.0, cx: 9.5, cy: 9.5 };
    }
    let mut context: *mut Context = null_mut();
    let bytes = memory.len() * 8;
    // SAFETY: for all calls, pointers to values of their types that live on this stack, a block of the size told, and an image
    // of at least 20 rows of 20.
    unsafe {
        let unit = if n.bits().is_multiple_of(2) { 0.001 } else { n.float() };
        let status = isobath_init(
            memory.as_mut_ptr().cast(),
            bytes,
            &raw const camera,
            width,
            height,
            unit,
            &raw const map,
            &raw mut context,
        );
        if status != Status::Ok {
            assert!(context.is_null());
            return (false, 0);
        }
        let mut answered = 0;
        for _ in 0..20 {
            let status = match n.bits() % 13 {
                0 => isobath_push_frame(context, depth.as_ptr(), 2 * width as usize, null(), i64::from(n.bits())),
                1 => isobath_push_frame(context, depth.as_ptr(), 2 * width as usize, &n.pose(), -1),
                2 => {
                    let mut image = null_mut();
                    assert_eq!(isobath_begin_frame(context, &raw mut image), Status::Ok);
                    for i in 0..(width * height) as usize {
                        image.add(i).write(n.bits() as u16);
                    }
                    isobath_end_frame(context, null(), 0)
                }
                3 => isobath_hit_test(context, n.float() * 9.0, n.float() * 9.0, &mut std::mem::zeroed()),
                4 => isobath_normal(context, n.int(), n.int(), n.int(), &mut std::mem::zeroed()),
                5 => {
                    isobath_ray_cast(context, &n.vec(), &n.vec(), n.float() * 30.0, n.holes(), &mut std::mem::zeroed())
                }
                6 => {
                    let object = Box3 { centre: n.vec(), half: n.vec(), rotation: n.quat() };
                    let params = VoteParams {
                        up: n.vec(),
                        tolerance: n.float(),
                        threshold: n.float(),
                        min_voters: n.float(),
                        holes: n.holes(),
                    };
                    let params = if n.bits().is_multiple_of(2) { &raw const params } else { null() };
                    isobath_vote(context, &raw const object, params, &mut std::mem::zeroed())
                }
                7 => {
                    let wish = PlaceWish {
                        half: n.vec(),
                        up: n.vec(),
                        facing: n.vec(),
                        upright: n.holes(),
                        max_tilt: n.float(),
                        max_roughness: n.float(),
                        min_coverage: n.float(),
                        clearance: n.float(),
                        max_hidden: n.float(),
                        max_unknown: n.float(),
                        holes: n.holes(),
                    };
                    isobath_place(context, n.int(), n.int(), &raw const wish, &mut std::mem::zeroed())
                }
                8 => isobath_integrate(context, null_mut()),
                9 => isobath_ground_at(context, &n.vec(), &mut std::mem::zeroed()),
                10 => {
                    isobath_map_fade(context);
                    isobath_set_noise(context, n.float(), n.float(), n.float())
                }
                11 => isobath_map_restart(context, &n.map()),
                _ => {
                    let walker = Walker {
                        radius: n.float(),
                        max_step: n.float(),
                        max_slope: n.float(),
                        climb_cost: n.float(),
                        unknown: n.holes(),
                    };
                    let walker = if n.bits().is_multiple_of(2) { &raw const walker } else { null() };
                    let mut points = [Vec3::default(); 5];
                    let capacity = n.bits() as usize % 6;
                    let (from, to) = (n.vec(), n.vec());
                    let points = points.as_mut_ptr();
                    isobath_path(context, &from, &to, walker, points, capacity, &mut std::mem::zeroed())
                }
            };
            answered += u32::from(status == Status::Ok);
        }
        (true, answered)
    }
}
