//! Kernels that build or search a map: pyramid, tiles, height map, planner.

use std::hint::black_box;

use isobath::glam::{Vec3, vec3};
use isobath::ground::image::ImageViewMut;
use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
use isobath::localized::normals::{NormalParams, dense};
use isobath::localized::planner::{Node, Planner, Walker};
use isobath::sensing::depth::noise::DepthNoise;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath::skipping::tiles::{Tile, TileMap, tiles_needed};

use crate::room::{HEIGHT, PIXELS, Room, WIDTH};
use crate::{Kernel, counted};

/// Cells along each side of the planner's grid.
const SIDE: usize = 128;

const fn kernel(name: &'static str, run: fn()) -> Kernel {
    Kernel { name, answers: PIXELS, unit: "pixel", run }
}

pub(crate) const ALL: &[Kernel] = &[
    kernel("pyramid-build", pyramid),
    kernel("tiles-new", || tiles(Seen::Nothing)),
    kernel("tiles-same", || tiles(Seen::Same)),
    kernel("tiles-noise", || tiles(Seen::Noise)),
    kernel("normals-update-still", normals_of_a_still_room),
    kernel("height-map-integrate", integrate),
    Kernel { name: "plan-open-floor", answers: SIDE * SIDE, unit: "cell", run: || plan(|_, _| 0.0) },
    Kernel { name: "plan-comb-of-walls", answers: SIDE * SIDE, unit: "cell", run: || plan(comb) },
];

fn pyramid() {
    let room = Room::new();
    let frame = room.coarse();
    let mut cells = vec![Cell::EMPTY; cells_needed(WIDTH, HEIGHT)];
    counted(|| Pyramid::build(black_box(frame.depth()), &mut cells).is_ok());
}

/// What the tile map has seen before the counted frame.
enum Seen {
    Nothing,
    Same,
    Noise,
}

fn tiles(seen: Seen) {
    let (exact, noisy) = (Room::new(), Room::noisy());
    let mut memory = Tiles::new();
    let mut map = memory.map();
    match seen {
        Seen::Nothing => {}
        Seen::Same => _ = map.update(&noisy.fine(), &DepthNoise::KINECT),
        Seen::Noise => _ = map.update(&exact.fine(), &DepthNoise::KINECT),
    }
    counted(|| map.update(black_box(&noisy.fine()), &DepthNoise::KINECT).changed);
}

/// The second of two equal frames, tile map and normals.
fn normals_of_a_still_room() {
    let room = Room::new();
    let frame = room.fine();
    let mut memory = Tiles::new();
    let mut map = memory.map();
    map.update(&frame, &DepthNoise::NONE);
    let mut scratch = vec![0.0; dense::scratch_len(WIDTH)];
    let mut planes = [(); 3].map(|()| vec![f32::NAN; PIXELS]);
    let [x, y, z] = planes.each_mut().map(|p| ImageViewMut::new(p, WIDTH, HEIGHT));
    let (Ok(mut x), Ok(mut y), Ok(mut z)) = (x, y, z) else { unreachable!("one value a pixel") };
    counted(|| {
        map.update(black_box(&frame), &DepthNoise::NONE);
        let planes = [&mut x, &mut y, &mut z];
        dense::update(&frame, &map, &NormalParams::default(), &mut scratch, planes).is_ok()
    });
}

/// A tile map's memory.
struct Tiles {
    reference: Vec<f32>,
    tiles: Vec<Tile>,
}

impl Tiles {
    fn new() -> Self {
        Self { reference: vec![0.0; PIXELS], tiles: vec![Tile::NEW; tiles_needed(WIDTH, HEIGHT)] }
    }

    fn map(&mut self) -> TileMap<'_, f32> {
        let reference = ImageViewMut::new(&mut self.reference, WIDTH, HEIGHT);
        let reference = reference.unwrap_or_else(|e| unreachable!("one value a pixel: {e}"));
        TileMap::new(reference, &mut self.tiles).unwrap_or_else(|e| unreachable!("as many as needed: {e}"))
    }
}

fn integrate() {
    let room = Room::new();
    let frame = room.coarse();
    let mut cells = vec![HeightCell::UNKNOWN; 64 * 64];
    let mut map = height_map(&mut cells, 64);
    counted(|| map.integrate(black_box(&frame)));
}

/// A map of the floor before the camera, `side` cells of 5 cm each way.
fn height_map(cells: &mut [HeightCell], side: usize) -> HeightMap<'_> {
    let grid = Grid::new(vec3(0.0, 0.0, -2.0), Vec3::Y, Vec3::NEG_Z, 0.05, side, side);
    let grid = grid.unwrap_or_else(|e| unreachable!("a grid of constants: {e}"));
    HeightMap::new(grid, cells, HeightMapParams::DEFAULT).unwrap_or_else(|e| unreachable!("as many as needed: {e}"))
}

/// Walls that make the way across wind through nearly every cell.
fn comb(x: usize, y: usize) -> f32 {
    let gap = if (x / 8).is_multiple_of(2) { y > 120 } else { y < 8 };
    if x % 8 == 4 && !gap { 1.0 } else { 0.0 }
}

fn plan(height: fn(usize, usize) -> f32) {
    let mut cells = vec![HeightCell::UNKNOWN; SIDE * SIDE];
    let mut map = height_map(&mut cells, SIDE);
    for i in 0..SIDE * SIDE {
        let h = height(i % SIDE, i / SIDE);
        map.set(i % SIDE, i / SIDE, h, h);
    }
    let mut nodes = vec![Node::EMPTY; SIDE * SIDE];
    let mut path = [Vec3::ZERO; 256];
    let grid = *map.grid();
    let (from, to) = (grid.point_of(1, 1, 0.0), grid.point_of(126, 60, 0.0));
    let walker = Walker { radius: 0.05, ..Walker::DEFAULT };
    counted(|| Planner::new(&mut nodes).plan(black_box(&map), &walker, from, to, &mut path).is_ok());
}
