//! The lighting answers in the image, and the key frames they travel in.

use core::hint::black_box;

use isobath::glam::Vec3;
use isobath::ground::colour::Rgb9e5;
use isobath::ground::image::{Image, ImageViewMut};
use isobath::ground::units::Timestamp;
use isobath::lighting::compose::{compose, compose_changes};
use isobath::lighting::cube;
use isobath::lighting::equirect::{MapFrame, direction_of_pixel, pixel_of_uv, uv_of_direction};
use isobath::lighting::far::extrapolate::{FarMap, nearest_anchors};
use isobath::lighting::far::observe::FarSampling;
use isobath::lighting::far::{FarField, FarParams};
use isobath::lighting::near::{NearField, NearMemory, NearParams};
use isobath::lighting::policy::guided::{Directions, Guide, GuideParams};
use isobath::lighting::policy::motion::{AutoCapture, MotionParams};
use isobath::lighting::{Preset, Session};
use isobath::sensing::camera::Pose;
use isobath::sensing::frame::DepthFrame;
use isobath::wire::keyframe::{
    Ambient, Boundary, Brightness, FarOptions, Header, Init, KeyFrame, Knobs, NearOptions, encode_far, encode_init,
    encode_near, message_length,
};

use crate::{H, W};

/// Sizes that the compiler does not know: custom ones are as good as any.
const POINTS: usize = 4 * 96 * 72;
const LAYER: usize = 96 * 48;

/// Memory of the light, and of messages.
pub(crate) struct Memory {
    depth: [u16; POINTS],
    colour: [[u8; 3]; POINTS],
    layers: [u32; 4 * LAYER],
    picture: [[u8; 4]; LAYER],
    strip: [u32; 4 * LAYER],
    far: FarField<1280>,
    grid: FarMap<64, 32>,
    fine: FarMap<128, 64>,
    bytes: [u8; 4 * W * H],
    pub(crate) seen: Image<[u8; 3], W, H>,
    decoded: Image<u16, W, H>,
    bright: [[f32; 3]; LAYER],
    packed: [Rgb9e5; LAYER],
    map: [[u8; 3]; LAYER],
}

impl Memory {
    pub(crate) const NEW: Self = Self {
        depth: [0; POINTS],
        colour: [[0; 3]; POINTS],
        layers: [0; 4 * LAYER],
        picture: [[0; 4]; LAYER],
        strip: [0; 4 * LAYER],
        far: FarField::ZERO,
        grid: FarMap::new(),
        fine: FarMap::new(),
        bytes: [0; 4 * W * H],
        seen: Image::filled([0; 3]),
        decoded: Image::filled(0),
        bright: [[0.0; 3]; LAYER],
        packed: [Rgb9e5(0); LAYER],
        map: [[0; 3]; LAYER],
    };
}

/// Each call once; how many answered.
pub(crate) fn exercise(frame: &DepthFrame<'_>, metres: &DepthFrame<'_, f32>, memory: &mut Memory) -> usize {
    let mut sum = policies(frame);
    sum += key_frames(frame, metres, memory).unwrap_or(0);
    memory.far.restart(black_box(FarParams::default()), black_box([0.2; 3]));
    let at = MapFrame::with_up(black_box(Vec3::Z), black_box(Vec3::Y)).unwrap_or(MapFrame::at(Vec3::ZERO));
    sum += usize::from(session(&at, frame, metres, memory).is_some());
    sum + parts(&at, frame, memory)
}

fn lend<'m>(
    depth: &'m mut [u16],
    colour: &'m mut [[u8; 3]],
    layers: &'m mut [u32],
    picture: &'m mut [[u8; 4]],
    strip: &'m mut [u32],
) -> Option<NearField<'m>> {
    let preset = black_box(Preset::TINY);
    let memory = NearMemory { depth, colour, layers, picture, strip };
    NearField::new(preset, black_box(NearParams::default()), memory).ok()
}

fn session(at: &MapFrame, frame: &DepthFrame<'_>, metres: &DepthFrame<'_, f32>, memory: &mut Memory) -> Option<usize> {
    let Memory { depth, colour, layers, picture, strip, far, grid, seen, bright, packed, map, .. } = memory;
    let near = lend(depth, colour, layers, picture, strip)?;
    let mut session = Session::new(*at, near, far, grid).with_sampling(black_box(FarSampling {
        columns: 7,
        rows: 5,
        parallax: true,
    }));
    let seen_once = session.observe(frame, black_box(1)).is_ok() | session.observe(metres, 2).is_ok();
    let near_once = session.observe_near(frame, black_box(1)).is_ok();
    let camera = frame.intrinsics();
    let report = session.observe_far(seen.view(), camera, &Pose::IDENTITY, Timestamp::from_nanos(black_box(3)));
    let (width, height) = black_box((96, 48));
    black_box(session.draw(&mut ImageViewMut::new(map, width, height).ok()?));
    session.set_ambient(black_box([0.1; 3]));
    black_box(session.draw(&mut ImageViewMut::new(bright, width, height).ok()?));
    black_box(session.correct(black_box(0), frame.pose_or_identity()));
    black_box(session.draw_all(&mut ImageViewMut::new(packed, width, height).ok()?));
    session.move_to(MapFrame::at(black_box(Vec3::X)));
    black_box(session.draw(&mut ImageViewMut::new(map, width, height).ok()?));
    cube::draw(&mut ImageViewMut::new(map, 16, 96).ok()?, black_box(2), |d| session.towards(d));
    let harmonics = session.far().harmonics();
    black_box((
        harmonics.main_light(),
        harmonics.ambient(),
        harmonics.radiance(Vec3::X),
        harmonics.irradiance(Vec3::Z),
    ));
    black_box((session.map().at, session.near().depth(black_box(0)).is_some(), session.near().colour(0).is_some()));
    Some(usize::from(seen_once) + usize::from(near_once) + report.samples)
}

/// What a session does not call itself.
fn parts(at: &MapFrame, frame: &DepthFrame<'_>, memory: &mut Memory) -> usize {
    let Memory { depth, colour, layers, picture, strip, far, fine, map, .. } = memory;
    let time = Timestamp::from_nanos(black_box(9));
    let mut sum = usize::from(far.sample(black_box(Vec3::Y), black_box([1.0; 3]), black_box(1.0), time));
    sum += far.seen() + usize::from(far.last_seen(black_box(3)).is_some());
    let direction = direction_of_pixel(black_box(3), black_box(4), black_box((8, 8)));
    let near: [u16; 32] = nearest_anchors::<1280, 32>(direction);
    black_box((
        far.sum_all(direction),
        far.sum_listed(direction, &near),
        far.sum_listed(direction, black_box(&[9, 0])),
    ));
    sum += fine.update(far).computed;
    black_box((fine.towards(direction), pixel_of_uv(uv_of_direction(direction), black_box((3, 5)))));
    let Ok(mut map) = ImageViewMut::new(map, black_box(96), black_box(48)) else { return sum };
    fine.render(&mut map);
    let Some(mut near) = lend(depth, colour, layers, picture, strip) else { return sum };
    sum += near.insert(frame, black_box(5), at).map_or(0, |r| r.points);
    near.project_all(at);
    let rows = near.merge();
    sum += compose(&near, fine, &mut map).written;
    sum += compose_changes(&near, black_box(rows), fine, &mut map).written;
    fine.settle();
    sum + usize::from(near.remove(black_box(0))) + near.len()
}

fn policies(frame: &DepthFrame<'_>) -> usize {
    let pose = frame.pose_or_identity();
    let mut sum = 0;
    let params = GuideParams { directions: black_box(Directions::Nine), ..GuideParams::default() };
    if let Ok(mut guide) = Guide::new(black_box(Vec3::Z), black_box(Vec3::X), Vec3::Y, params) {
        sum += guide.observe(&pose, frame.intrinsics(), frame.size());
        black_box((guide.next(&pose), guide.coverage()));
        sum += guide.turns(&pose).filter(|(_, done)| *done).count();
    }
    if let Ok(mut capture) = AutoCapture::<5, 5>::new(black_box(MotionParams::DEFAULT)) {
        for i in 0..black_box(3) {
            let time = Timestamp::from_nanos(black_box(i));
            capture.imu(black_box(Vec3::X), black_box(Vec3::Y), time);
            sum += usize::from(capture.offer(Some(&pose), time).captured().is_some());
            sum += usize::from(capture.offer(None, time).captured().is_some());
        }
        capture.reset();
    }
    sum
}

fn key_frames(frame: &DepthFrame<'_>, metres: &DepthFrame<'_, f32>, memory: &mut Memory) -> Option<usize> {
    let Memory { bytes, decoded, seen, .. } = memory;
    let init = Init {
        header: Header { session: black_box(1), ..Header::default() },
        intrinsics: *frame.intrinsics(),
        depth_size: black_box((1, 2)),
        colour_size: black_box((3, 4)),
        position: black_box(Vec3::Z),
        ambient: Ambient { temperature: black_box(5000.0), brightness: Brightness::Lux(black_box(300.0)) },
        knobs: black_box(Knobs::LOW),
    };
    let mut used = encode_init(&init, bytes).ok()?;
    let near =
        NearOptions { boundary: Some(Boundary { centre: black_box(Vec3::Z), half: 1.0 }), ..NearOptions::DEFAULT };
    used += encode_near(frame, &black_box(near), bytes).unwrap_or(0) + encode_near(metres, &near, bytes).unwrap_or(0);
    used += encode_far(frame, &black_box(FarOptions::DEFAULT), bytes).unwrap_or(0);
    let message = bytes.get(..black_box(message_length(black_box(bytes)).ok()?))?;
    match KeyFrame::decode(message).ok()? {
        KeyFrame::Init(init) => used += usize::from(init.depth_size.0),
        KeyFrame::Near(near) => {
            near.depth_into(&mut decoded.view_mut()).ok()?;
            near.colour_into(decoded.view(), &mut seen.view_mut()).ok()?;
        }
        KeyFrame::Far(far) => far.colour_into(&mut seen.view_mut()).ok()?,
    }
    Some(used)
}
