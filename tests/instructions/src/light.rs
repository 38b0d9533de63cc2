//! Kernels of the environment's light.

use std::hint::black_box;

use isobath::glam::{Vec3, vec3};
use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::ground::units::Timestamp;
use isobath::lighting::Preset;
use isobath::lighting::compose::compose;
use isobath::lighting::equirect::MapFrame;
use isobath::lighting::far::extrapolate::FarMap;
use isobath::lighting::far::{FarField, FarParams};
use isobath::lighting::near::{NearField, NearMemory, NearParams};
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::frame::DepthFrame;

use crate::room::{HEIGHT, PIXELS, Room, WIDTH};
use crate::{Kernel, counted};

/// The sizes; the room's frames are brought down to its views.
const LOW: Preset = Preset::LOW;
/// A far picture's pixels.
const FAR: usize = 32 * 24;

pub(crate) const ALL: &[Kernel] = &[
    Kernel { name: "light-near-insert", answers: LOW.view_pixels(), unit: "pixel", run: near_insert },
    Kernel { name: "light-near-merge", answers: LOW.level_pixels(), unit: "pixel", run: near_merge },
    Kernel { name: "light-far-frame", answers: FAR, unit: "sample", run: far_frame },
    Kernel { name: "light-far-whole", answers: 128 * 64, unit: "point", run: far_whole },
    Kernel { name: "light-draw", answers: LOW.map_pixels(), unit: "pixel", run: draw },
];

/// Before the box.
const AT: MapFrame = MapFrame::at(vec3(0.0, 0.5, -1.6));

/// The near field's memory.
struct Near {
    depth: Vec<u16>,
    colour: Vec<[u8; 3]>,
    layers: Vec<u32>,
    picture: Vec<[u8; 4]>,
    strip: Vec<u32>,
}

impl Near {
    fn new() -> Self {
        Self {
            depth: vec![0; LOW.views * LOW.view_pixels()],
            colour: vec![[0; 3]; LOW.views * LOW.view_pixels()],
            layers: vec![0; LOW.views * LOW.level_pixels()],
            picture: vec![[0; 4]; LOW.level_pixels()],
            strip: vec![0; LOW.strip()],
        }
    }

    fn field(&mut self) -> NearField<'_> {
        let Self { depth, colour, layers, picture, strip } = self;
        let memory = NearMemory { depth, colour, layers, picture, strip };
        NearField::new(LOW, NearParams::default(), memory).unwrap_or_else(|e| unreachable!("as much as needed: {e}"))
    }
}

/// The room's frame, coloured by `colours`.
fn frame<'a>(room: &'a Room, colours: &'a [[u8; 3]]) -> DepthFrame<'a> {
    let view = ImageView::new(colours, WIDTH, HEIGHT).unwrap_or_else(|e| unreachable!("one value a pixel: {e}"));
    room.coarse().with_colour(view).unwrap_or_else(|e| unreachable!("a colour image with pixels: {e}"))
}

/// Colours that differ from pixel to pixel.
fn colours(count: usize) -> Vec<[u8; 3]> {
    (0..count).map(|i| [i as u8, (i >> 3) as u8, (i * 7) as u8]).collect()
}

/// A near field of two views, and the frame for the third.
fn with_two(then: impl FnOnce(&mut NearField<'_>, &DepthFrame<'_>)) {
    let (room, colours) = (Room::new(), colours(PIXELS));
    let frame = frame(&room, &colours);
    let mut memory = Near::new();
    let mut near = memory.field();
    for id in [1, 2] {
        near.insert(&frame, id, &AT).unwrap_or_else(|e| unreachable!("a frame with colour and pose: {e}"));
    }
    near.merge();
    then(&mut near, &frame);
}

fn near_insert() {
    with_two(|near, frame| counted(|| near.insert(black_box(frame), 3, &AT).is_ok()));
}

fn near_merge() {
    with_two(|near, frame| {
        near.insert(frame, 3, &AT).unwrap_or_else(|e| unreachable!("a frame with colour and pose: {e}"));
        counted(|| near.merge());
    });
}

/// A far field that has seen some of its surroundings.
fn far_field() -> Box<FarField<1280>> {
    let mut far = Box::new(FarField::new(FarParams::default(), [0.2; 3]));
    for towards in [Vec3::X, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Z] {
        far_image(&mut far, towards);
    }
    far
}

/// A far picture, looking some way; how many samples it gave.
fn far_image(far: &mut FarField<1280>, towards: Vec3) -> usize {
    let picture: [[u8; 3]; FAR] = std::array::from_fn(|i| [i as u8, (i >> 3) as u8, 99]);
    let view = ImageView::new(&picture, 32, 24).unwrap_or_else(|e| unreachable!("one value a pixel: {e}"));
    let camera = Intrinsics::from_fov(1.1, 32, 24).unwrap_or_else(|e| unreachable!("a camera of constants: {e}"));
    let pose = Pose::looking_at(Vec3::ZERO, towards, Vec3::Y).unwrap_or_else(|| unreachable!("not straight up"));
    far.add_image(black_box(view), &camera, &pose, &AT, Timestamp::ZERO).samples
}

/// A picture in, and the map follows.
fn far_frame() {
    let mut far = far_field();
    let mut grid = Box::new(FarMap::<128, 64>::new());
    grid.update(&mut far);
    counted(|| (far_image(&mut far, vec3(0.3, -0.4, -0.8)), grid.update(&mut far).computed));
}

fn far_whole() {
    let mut far = far_field();
    let mut grid = Box::new(FarMap::<128, 64>::new());
    counted(|| grid.update(black_box(&mut far)).computed);
}

/// The whole map, near over far.
fn draw() {
    with_two(|near, _| {
        let mut far = far_field();
        let mut grid = Box::new(FarMap::<128, 64>::new());
        grid.update(&mut far);
        let mut map = vec![[0_u8; 3]; LOW.map_pixels()];
        let view = ImageViewMut::new(&mut map, LOW.map.0, LOW.map.1);
        let mut view = view.unwrap_or_else(|e| unreachable!("one value a pixel: {e}"));
        counted(|| compose(black_box(near), &grid, &mut view).written);
    });
}
