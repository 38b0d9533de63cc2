use super::*;
use crate::ground::image::ImageView;
use crate::sensing::camera::{Intrinsics, Pose};
use crate::sensing::depth::DepthUnit;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

fn grid(cell: f32, w: usize, d: usize) -> Grid {
    Grid::new(Vec3::new(0.5, 0.0, -1.0), Vec3::Y * 2.0, Vec3::new(0.3, 0.5, -1.0), cell, w, d).unwrap()
}

#[test]
fn grids_that_cannot_be_are_refused() {
    let make = |up, forward, cell, w| Grid::new(Vec3::ZERO, up, forward, cell, w, 10);
    for cell in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(matches!(make(Vec3::Y, Vec3::Z, cell, 10), Err(HeightMapError::BadCell { .. })));
    }
    assert_eq!(make(Vec3::Y, Vec3::Y, 0.1, 10), Err(HeightMapError::BadAxes));
    assert_eq!(make(Vec3::ZERO, Vec3::Y, 0.1, 10), Err(HeightMapError::BadAxes));
    assert!(make(Vec3::Y, Vec3::Z, 0.1, usize::MAX).is_err());
    let mut short = [HeightCell::UNKNOWN; 5];
    let e = HeightMap::new(grid(0.1, 3, 2), &mut short, HeightMapParams::DEFAULT).unwrap_err();
    assert_eq!(e, HeightMapError::CapacityExceeded { needed: 6, got: 5 });
    let bad = HeightMapParams { stride: 0, ..HeightMapParams::DEFAULT };
    assert_eq!(HeightMap::new(grid(0.1, 1, 1), &mut short, bad).unwrap_err(), HeightMapError::BadParams);
    let mut map = HeightMap::new(grid(0.1, 0, 0), &mut [], HeightMapParams::DEFAULT).unwrap();
    assert!(map.cell(0, 0).is_none() && !map.set(0, 0, 0.0, 0.0));
    map.fade();
}

#[test]
fn cells_and_points_agree() {
    let g = grid(0.07, 13, 8);
    for (c, r) in (0..8).flat_map(|r| (0..13).map(move |c| (c, r))) {
        let p = g.point_of(c, r, 0.4);
        assert_eq!(g.cell_of(p), Some((c, r)));
        assert!((g.height_of(p) - 0.4).abs() < 1e-6);
    }
    assert_eq!(g.cell_of(Vec3::NAN), None);
    assert_eq!(g.cell_of(Vec3::ONE * 1e30), None);
}

proptest! {
    /// The row-wise form gives what point by point gives.
    #[test]
    fn integration_matches_point_by_point(seed in 1_u32.., eye in proptest::array::uniform3(-2.0_f32..2.0)) {
        let (w, h) = (40, 30);
        let mut s = seed;
        let data: Vec<f32> = (0..w * h).map(|_| { s ^= s << 13; s ^= s >> 17; s ^= s << 5; (s % 4096) as f32 * 1e-3 }).collect();
        let eye = Vec3::from(eye) + Vec3::Y;
        let pose = Pose::looking_at(eye, Vec3::new(0.5, 0.0, -1.0), Vec3::new(0.1, 1.0, 0.2)).unwrap();
        let k = Intrinsics::new(35.0, 35.0, 19.5, 14.5).unwrap();
        let frame = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::METRE, k).with_pose(pose);
        let mut cells = vec![HeightCell::UNKNOWN; 400];
        let params = HeightMapParams { clearance: 100.0, reach: 50.0, ..HeightMapParams::DEFAULT };
        let mut map = HeightMap::new(grid(0.2, 20, 20), &mut cells, params).unwrap();
        let report = map.integrate(&frame);
        let (mut used, mut holes) = (0_i64, 0);
        let mut sums = vec![(f32::INFINITY, f32::NEG_INFINITY, 0_i64); 400];
        for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
            match frame.world_point(x, y) {
                None => holes += 1,
                Some(p) => if let Some((c, r)) = map.grid().cell_of(p) {
                    used += 1;
                    let (lo, hi, n) = &mut sums[r * 20 + c];
                    let height = map.grid().height_of(p);
                    (*lo, *hi, *n) = (lo.min(height), hi.max(height), *n + 1);
                }
            }
        }
        prop_assert_eq!(report.holes, holes);
        // A point on a cell's border may fall to either side by rounding.
        prop_assert!((i64::from(report.used) - used).abs() <= 2);
        prop_assert_eq!(report.used + report.outside + report.holes, (w * h) as u32);
        let off = map.cells().iter().zip(&sums).filter(|(c, (lo, hi, n))| {
            i64::from(c.support) != *n || (*n > 0 && ((c.min - lo).abs() > 1e-4 || (c.max - hi).abs() > 1e-4))
        }).count();
        prop_assert!(off <= 4, "{} cells differ", off);
        prop_assert!(map.cells().iter().all(|c| !c.is_known() || (c.min <= c.mean + 1e-5 && c.mean <= c.max + 1e-5)));
    }
}

#[test]
fn ceilings_do_not_block_in_either_order() {
    let p = HeightMapParams::DEFAULT;
    for order in [[0.0, 0.1, 2.4], [2.4, 0.0, 0.1], [0.1, 2.4, 0.0]] {
        let mut cell = HeightCell::UNKNOWN;
        for h in order {
            cell.take(h, &p, 50.0);
        }
        assert_eq!((cell.min, cell.max), (0.0, 0.1), "{order:?}");
    }
}

#[test]
fn change_and_fading_leave_marks() {
    let mut cells = [HeightCell::UNKNOWN; 100];
    let g = Grid::new(Vec3::ZERO, Vec3::Y, Vec3::NEG_Z, 0.1, 10, 10).unwrap();
    let mut map = HeightMap::new(g, &mut cells, HeightMapParams::DEFAULT).unwrap();
    let pose = Pose::looking_at(Vec3::Y * 2.0, Vec3::ZERO, Vec3::NEG_Z).unwrap();
    let k = Intrinsics::new(50.0, 50.0, 31.5, 23.5).unwrap();
    let mut data = vec![2000_u16; 64 * 48];
    let see = |map: &mut HeightMap<'_>, data: &[u16]| {
        let view = ImageView::new(data, 64, 48).unwrap();
        map.integrate(&DepthFrame::new(view, DepthUnit::MILLIMETRE, k).with_pose(pose)).generation
    };
    let first = see(&mut map, &data);
    assert!(map.cells().iter().all(|c| c.is_known() && u32::from(c.changed) == first));
    let second = see(&mut map, &data);
    assert!(map.cells().iter().all(|c| u32::from(c.changed) < second), "the same again changes nothing");
    data[24 * 64 + 32] = 1500;
    let third = see(&mut map, &data);
    assert_eq!(map.cells().iter().filter(|c| u32::from(c.changed) == third).count(), 1);
    for _ in 0..10 {
        map.fade();
    }
    assert!(map.cells().iter().all(|c| !c.is_known()));
}

#[test]
fn hostile_frames_leave_the_map_sane() {
    let k = Intrinsics::new(1e-3, -1e7, 1e6, -1e6).unwrap();
    for (w, h) in [(0, 0), (1, 50), (50, 1)] {
        let data: Vec<f32> = (0..w * h).map(|i| [f32::NAN, 1e38, -1.0, f32::INFINITY][i % 4]).collect();
        let frame = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::METRE, k);
        let mut cells = [HeightCell::UNKNOWN; 4];
        let mut map = HeightMap::new(grid(1000.0, 2, 2), &mut cells, HeightMapParams::DEFAULT).unwrap();
        let r = map.integrate(&frame);
        assert_eq!((r.used + r.overhead + r.outside + r.holes) as usize, w * h);
        assert!(map.cells().iter().all(|c| c.mean.is_finite()));
    }
}

#[test]
fn a_restarted_map_knows_nothing_and_lies_elsewhere() {
    let mut cells = [HeightCell::UNKNOWN; 12];
    let mut map = HeightMap::new(grid(0.1, 4, 3), &mut cells, HeightMapParams::DEFAULT).unwrap();
    map.set(1, 1, 0.3, 0.4);
    let before = map.generation();
    map.restart(grid(0.2, 2, 3)).unwrap();
    assert_eq!(map.grid(), &grid(0.2, 2, 3));
    assert!(map.cells().len() == 6 && map.cells().iter().all(|c| !c.is_known() && u32::from(c.changed) > before));
    let e = map.restart(grid(0.1, 5, 3)).unwrap_err();
    assert_eq!(e, HeightMapError::CapacityExceeded { needed: 15, got: 12 });
    assert_eq!(map.grid(), &grid(0.2, 2, 3), "kept");
}

#[test]
fn a_resumed_map_goes_on_where_it_was() {
    let data = vec![1500_u16; 32 * 24];
    let k = Intrinsics::new(30.0, 30.0, 15.5, 11.5).unwrap();
    let frame = DepthFrame::new(ImageView::new(&data, 32, 24).unwrap(), DepthUnit::MILLIMETRE, k)
        .with_pose(Pose::looking_at(Vec3::Y * 1.5, Vec3::ZERO, Vec3::NEG_Z).unwrap());
    let (mut kept, mut resumed) = (vec![HeightCell::UNKNOWN; 400], vec![HeightCell::UNKNOWN; 400]);
    let (grid, params) = (grid(0.1, 20, 20), HeightMapParams::DEFAULT);
    let mut one = HeightMap::new(grid, &mut kept, params).unwrap();
    let mut generation = HeightMap::new(grid, &mut resumed, params).unwrap().generation();
    for _ in 0..3 {
        let mut two = HeightMap::resume(grid, &mut resumed, params, generation).unwrap();
        assert_eq!(one.integrate(&frame), two.integrate(&frame));
        generation = two.generation();
    }
    assert_eq!(kept, resumed);
    assert!(HeightMap::resume(grid, &mut resumed[..10], params, 0).is_err());
}

/// Marks of 16 bits tell what the whole numbers would for as long as is promised, and never less than the truth after that.
#[test]
fn changes_outlive_their_sixteen_bits() {
    let mut cells = [HeightCell::UNKNOWN; 6];
    let mut map = HeightMap::new(grid(0.1, 3, 2), &mut cells, HeightMapParams::DEFAULT).unwrap();
    let (mut truth, mut s) = ([0_u32; 6], 7_u32);
    for turn in 0..300_000_u32 {
        s ^= s << 13;
        s ^= s >> 17;
        s ^= s << 5;
        // The first cell once, the second seldom, one never.
        let i = if turn == 5 {
            0
        } else if s % 50_000 == 0 {
            1
        } else {
            2 + s as usize % 3
        };
        assert!(map.set(i % 3, i / 3, turn as f32 * 1e-3, 0.0));
        truth[i] = map.generation();
        if turn % 97 > 0 && turn % EPOCH > 3 {
            continue;
        }
        let now = map.generation();
        for (i, &truth) in truth.iter().enumerate() {
            let said = map.changed(i % 3, i / 3).unwrap();
            if now - truth < EPOCH {
                assert_eq!(said, truth);
            } else {
                assert!(said >= truth && now - said >= EPOCH, "{said} for {truth} at {now}");
            }
            for since in [0, truth.saturating_sub(1), truth, said, now - now.min(EPOCH), now - now.min(3 * EPOCH), now]
            {
                let any = map.any_changed(i / 3, i % 3..i % 3 + 1, since);
                assert!(any || truth <= since, "a change is missed");
                assert!(!any || truth > since || now - since > EPOCH, "none, and no reason to fear one");
            }
        }
    }
    assert_eq!(map.changed(3, 0), None);
}
