//! The whole of lighting: a session of any sizes, fed with frames of any numbers.

use arbitrary::{Arbitrary, Result, Unstructured};
use isobath::ground::colour::{Colour, Rgb9e5};
use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::ground::units::Timestamp;
use isobath::lighting::equirect::MapFrame;
use isobath::lighting::far::extrapolate::FarMap;
use isobath::lighting::far::observe::FarSampling;
use isobath::lighting::far::{FarField, FarParams, Unseen};
use isobath::lighting::near::{NearField, NearParams};
use isobath::lighting::{Preset, Session, cube};
use isobath::sensing::camera::Pose;
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;

use super::sensing::intrinsics;
use super::{fill, number, quat, vec3, word};
use crate::near::NearBox;

fn preset(u: &mut Unstructured<'_>) -> Result<Preset> {
    let levels =
        *u.choose(&[[16, 8, 0, 0], [24, 8, 4, 2], [8, 0, 0, 0], [12, 6, 2, 0], [7, 0, 0, 0], [0; 4], [16, 5, 0, 0]])?;
    Ok(Preset {
        views: u.int_in_range(0..=4)?,
        view: (u.int_in_range(0..=20)?, u.int_in_range(0..=12)?),
        levels,
        map: (u.int_in_range(0..=40)?, u.int_in_range(0..=20)?),
    })
}

fn place(u: &mut Unstructured<'_>) -> Result<MapFrame> {
    Ok(MapFrame { at: vec3(u)?, rotation: quat(u)? })
}

/// Feeds the session that the bytes describe; each drawing must be what drawing all anew gives.
fn sessions<D: DepthSample>(u: &mut Unstructured<'_>, next: impl Fn(&mut Unstructured<'_>) -> Result<D>) -> Result<()> {
    let preset = preset(u)?;
    let params = NearParams {
        half_side: number(u)?,
        confidence: u8::arbitrary(u)?,
        margin: number(u)?,
        thin: number(u)?,
        seam: u8::arbitrary(u)?,
    };
    let far_params = FarParams {
        cap: number(u)?,
        half_life: number(u)?,
        threshold: number(u)?,
        unseen: if u.arbitrary()? { Unseen::Guess } else { Unseen::Ambient },
    };
    let mut far = FarField::<40>::new(far_params, [number(u)?, number(u)?, number(u)?]);
    let mut grid = FarMap::<16, 8>::new();
    let mut memory = NearBox::new(&preset);
    let near = match NearField::new(preset, params, memory.lend()) {
        Ok(near) => near,
        Err(error) => {
            assert!(preset.check().is_err() && !error.to_string().is_empty());
            return Ok(());
        }
    };
    let sampling = FarSampling { columns: usize::arbitrary(u)? % 99, rows: u.int_in_range(0..=9)?, parallax: true };
    let mut session = Session::new(place(u)?, near, &mut far, &mut grid).with_sampling(sampling);
    let (width, height) = preset.map;
    let mut followed = vec![[0.0_f32; 3]; preset.map_pixels()];
    for step in 0..u.int_in_range(1..=4)? {
        let (w, h) = (u.int_in_range(0..=20)?, u.int_in_range(0..=12)?);
        let unit =
            if u.ratio(1, 4)? { DepthUnit::new(number(u)?).unwrap_or(DepthUnit::TUM) } else { DepthUnit::MILLIMETRE };
        let k = intrinsics(u)?;
        let pose = Pose::new(quat(u)?, vec3(u)?).ok();
        let values = fill(u, w * h, &next)?;
        let (cw, ch) = (u.int_in_range(0..=20)?, u.int_in_range(0..=12)?);
        let colours = fill(u, cw * ch, |u| Ok([u8::arbitrary(u)?, u8::arbitrary(u)?, u8::arbitrary(u)?]))?;
        let time = Timestamp::from_nanos(i64::arbitrary(u)?);
        let frame =
            DepthFrame::new(ImageView::new(&values, w, h).expect("as long as asked"), unit, k).with_time(time, step);
        let frame = pose.map_or(frame, |pose| frame.with_pose(pose));
        let frame = frame.with_colour(ImageView::new(&colours, cw, ch).expect("as long as asked")).unwrap_or(frame);
        match session.observe(&frame, u32::from(u8::arbitrary(u)? % 6)) {
            Ok(seen) => assert!(seen.far.samples + seen.far.rejected > 0),
            Err(error) => {
                assert!(frame.pose().is_none() || frame.colour().is_none() || !error.to_string().is_empty());
            }
        }
        match u.int_in_range(0..=9)? {
            0 => session.move_to(place(u)?),
            1 => _ = pose.map(|pose| session.correct(step as usize, pose)),
            2 => session.set_ambient([number(u)?, number(u)?, number(u)?]),
            _ => {}
        }
        let drawn = session.draw(&mut ImageViewMut::new(&mut followed, width, height).expect("as long as asked"));
        assert_eq!(drawn.map.written + drawn.map.skipped, followed.len(), "{preset:?} {drawn:?}");
        assert!(followed.iter().flatten().all(|v| *v >= 0.0 && v.is_finite()), "light of {followed:?}");
        let mut whole = vec![[0.0_f32; 3]; followed.len()];
        session.draw_all(&mut ImageViewMut::new(&mut whole, width, height).expect("as long as asked"));
        assert_eq!(followed, whole);
    }
    let light = session.far().harmonics();
    assert!(light.main_light().is_none_or(|l| (l.direction.length() - 1.0).abs() < 1e-3));
    let mut faces = [Rgb9e5::of_linear([0.0; 3]); 2 * 12];
    assert!(cube::draw(&mut ImageViewMut::new(&mut faces, 2, 12).expect("as long as asked"), 1, |d| session.towards(d)));
    Ok(())
}

/// Everything of lighting, with `u16` and with float depth.
pub fn lighting(data: &[u8]) {
    let _ = sessions(&mut Unstructured::new(data), word);
    let _ = sessions(&mut Unstructured::new(data), number);
}
