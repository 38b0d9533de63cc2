//! The height map, planning and planning anew.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::glam::Vec3;
use isobath_footprint::isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
use isobath_footprint::isobath::localized::planner::{Node, Plan, Planner, Walker};
use isobath_footprint::isobath::sensing::frame::DepthFrame;

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    let (mut cells, mut nodes, mut points) = ([HeightCell::UNKNOWN; 256], [Node::EMPTY; 256], [Vec3::ZERO; 16]);
    let Ok(grid) = Grid::new(black_box(Vec3::Z), Vec3::Y, Vec3::Z, 0.05, 16, 16) else { return };
    let Ok(mut map) = HeightMap::new(grid, &mut cells, HeightMapParams::DEFAULT) else { return };
    black_box(map.integrate(frame));
    let (from, to) = (black_box(Vec3::Z), black_box(Vec3::X));
    let mut planner = Planner::new(&mut nodes);
    if let Ok(Plan::Found(path)) = planner.plan(&map, &Walker::DEFAULT, from, to, &mut points) {
        black_box(planner.replan(&map, &Walker::DEFAULT, from, to, &path, &mut points).is_ok());
    }
});
