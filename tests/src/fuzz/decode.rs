//! Depth formats.

use arbitrary::{Arbitrary, Result, Unstructured};
use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::sensing::depth::decode::{self, ByteOrder, DecodeError, DecodeReport, Disparity, Projective};
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::wire::keyframe::{self, KeyFrame, crc32};
use isobath::wire::rvl as wire;

use super::{elements, fill, number, shape, word};

/// The three counts must add up, and the output must hold what they say, whatever the input was.
fn report_holds<D: DepthSample>(result: Result<DecodeReport, DecodeError>, out: &[D]) {
    match result {
        Ok(report) => {
            assert_eq!(report.valid + report.holes + report.out_of_range, out.len());
            assert_eq!(report.valid, out.iter().filter(|v| v.is_valid()).count());
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

fn unit(u: &mut Unstructured<'_>) -> Result<DepthUnit> {
    Ok(DepthUnit::new(number(u)?).unwrap_or(DepthUnit::MILLIMETRE))
}

/// [`decode::u16_bytes`] on bytes of any length and stride.
pub fn u16_bytes(data: &[u8]) {
    let mut u = Unstructured::new(data);
    let _ = (|| -> Result<()> {
        let (width, height, _) = shape(&mut u)?;
        let stride = u.int_in_range(0..=200)?;
        let order = if bool::arbitrary(&mut u)? { ByteOrder::Big } else { ByteOrder::Little };
        let mut out = vec![0; width * height];
        let bytes = u.take_rest();
        let mut view = ImageViewMut::new(&mut out, width, height).expect("as long as asked");
        let result = decode::u16_bytes(bytes, stride, order, &mut view);
        if result.is_ok() && width * height > 0 {
            assert!(stride >= 2 * width && bytes.len() >= (height - 1) * stride + 2 * width);
        }
        report_holds(result, &out);
        Ok(())
    })();
}

/// [`decode::depth16`], with and without a confidence image, of equal and of other size.
pub fn depth16(data: &[u8]) {
    let mut u = Unstructured::new(data);
    let _ = (|| -> Result<()> {
        let (width, height, stride) = shape(&mut u)?;
        let other = u.int_in_range(0..=3)?;
        let raw = fill(&mut u, elements(width, height, stride), word)?;
        let Ok(raw) = ImageView::with_stride(&raw, width, height, stride) else {
            assert!(stride < width);
            return Ok(());
        };
        let mut out = vec![0; width * height];
        let mut view = ImageViewMut::new(&mut out, width, height).expect("as long as asked");
        let sure_width = width + usize::from(other == 3);
        let mut sure = vec![0; sure_width * height];
        let mut sure_view = ImageViewMut::new(&mut sure, sure_width, height).expect("as long as asked");
        let result = decode::depth16(raw, &mut view, (other > 0).then_some(&mut sure_view));
        assert_eq!(result.is_err(), other == 3);
        report_holds(result, &out);
        Ok(())
    })();
}

/// Runs a conversion into both output types.
fn both<S: Copy>(
    data: &[u8],
    next: impl Fn(&mut Unstructured<'_>) -> Result<S>,
    constants: impl Fn(&mut Unstructured<'_>) -> Result<[f32; 4]>,
    run_u16: impl Fn(ImageView<'_, S>, [f32; 4], DepthUnit, &mut ImageViewMut<'_, u16>) -> Result<DecodeReport, DecodeError>,
    run_f32: impl Fn(ImageView<'_, S>, [f32; 4], DepthUnit, &mut ImageViewMut<'_, f32>) -> Result<DecodeReport, DecodeError>,
) {
    let mut u = Unstructured::new(data);
    let _ = (|| -> Result<()> {
        let (width, height, stride) = shape(&mut u)?;
        let unit = unit(&mut u)?;
        let constants = constants(&mut u)?;
        let raw = fill(&mut u, elements(width, height, stride), &next)?;
        let Ok(raw) = ImageView::with_stride(&raw, width, height, stride) else {
            assert!(stride < width);
            return Ok(());
        };
        let mut out = vec![0_u16; width * height];
        let mut view = ImageViewMut::new(&mut out, width, height).expect("as long as asked");
        report_holds(run_u16(raw, constants, unit, &mut view), &out);
        let mut out = vec![0.0_f32; width * height];
        let mut view = ImageViewMut::new(&mut out, width, height).expect("as long as asked");
        report_holds(run_f32(raw, constants, unit, &mut view), &out);
        Ok(())
    })();
}

/// [`decode::metres`].
pub fn metres(data: &[u8]) {
    both(
        data,
        number,
        |_| Ok([0.0; 4]),
        |raw, _, unit, out| decode::metres(raw, unit, out),
        |raw, _, unit, out| decode::metres(raw, unit, out),
    );
}

fn four(u: &mut Unstructured<'_>) -> Result<[f32; 4]> {
    Ok([number(u)?, number(u)?, number(u)?, number(u)?])
}

/// [`decode::disparity`] from `f32` and from `u16`.
pub fn disparity(data: &[u8]) {
    let of = |[focal, baseline, offset, scale]: [f32; 4]| Disparity { focal, baseline, offset, scale };
    both(
        data,
        number,
        four,
        |raw, k, unit, out| decode::disparity(raw, of(k), unit, out),
        |raw, k, unit, out| decode::disparity(raw, of(k), unit, out),
    );
    both(
        data,
        word,
        four,
        |raw, k, unit, out| decode::disparity(raw, of(k), unit, out),
        |raw, k, unit, out| decode::disparity(raw, of(k), unit, out),
    );
}

/// [`decode::projective`].
pub fn projective(data: &[u8]) {
    let of = |[near, far, ..]: [f32; 4]| Projective { near, far };
    both(
        data,
        number,
        four,
        |raw, k, unit, out| decode::projective(raw, of(k), unit, out),
        |raw, k, unit, out| decode::projective(raw, of(k), unit, out),
    );
}

/// [`wire`]: any bytes decode or are refused; any image comes back from its own stream.
pub fn rvl(data: &[u8]) {
    let mut u = Unstructured::new(data);
    let _ = (|| -> Result<()> {
        let (width, height, _) = shape(&mut u)?;
        let mut out = vec![7; width * height];
        let mut view = ImageViewMut::new(&mut out, width, height).expect("as long as asked");
        let bytes = u.take_rest();
        match wire::decode(bytes, &mut view) {
            Ok(used) => assert!(used <= bytes.len() && used % 4 == 0),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
        // What was read of it, and the untouched rest, is an image like any other.
        let mut stream = vec![0; wire::most_bytes(out.len())];
        let used = wire::encode(ImageView::new(&out, width, height).expect("as long as asked"), &mut stream);
        let used = used.expect("most_bytes suffices");
        let mut back = vec![0; width * height];
        let mut view = ImageViewMut::new(&mut back, width, height).expect("as long as asked");
        assert_eq!(wire::decode(&stream[..used], &mut view), Ok(used));
        assert_eq!(back, out);
        Ok(())
    })();
}

/// [`keyframe`]: any message is a key frame or refused; what is one can be decoded or says why not. Half of them get the magic,
/// length and CRC that they should have: else none would get past the first eight bytes.
pub fn key_frame(data: &[u8]) {
    let Some((&seal, rest)) = data.split_first() else { return };
    let mut message = rest.to_vec();
    if seal % 2 == 1 && message.len() >= keyframe::PREFIX + 4 {
        let length = message.len();
        message[..2].copy_from_slice(&keyframe::MAGIC);
        message[2] = keyframe::VERSION;
        message[4..8].copy_from_slice(&(length as u32).to_le_bytes());
        let crc = crc32(&message[..length - 4]);
        message[length - 4..].copy_from_slice(&crc.to_le_bytes());
    }
    match KeyFrame::decode(&message) {
        Err(error) => assert!(!error.to_string().is_empty()),
        Ok(KeyFrame::Init(init)) => {
            let mut again = vec![0; message.len()];
            assert_eq!(keyframe::encode_init(&init, &mut again), Ok(message.len()));
            let again = KeyFrame::decode(&again).expect("what was decoded can be sent");
            assert_eq!(again, KeyFrame::Init(init));
        }
        Ok(KeyFrame::Near(near)) => {
            let (width, height) = near.size();
            assert!(near.readings() > 0 && near.readings() <= width * height);
            // What no caller here would have room for.
            if width * height > 1 << 14 {
                return;
            }
            let (mut depth, mut colour) = (vec![3; width * height], vec![[3; 3]; width * height]);
            let read = near.depth_into(&mut ImageViewMut::new(&mut depth, width, height).expect("as long as asked"));
            let holes = depth.iter().filter(|v| **v == 0).count();
            assert!(read.is_err() || holes + near.readings() == depth.len());
            let view = ImageView::new(&depth, width, height).expect("as long as asked");
            let mut out = ImageViewMut::new(&mut colour, width, height).expect("as long as asked");
            if near.colour_into(view, &mut out).is_ok() {
                assert!(colour.iter().zip(&depth).all(|(c, d)| *d > 0 || *c == [0; 3]));
            }
        }
        Ok(KeyFrame::Far(far)) => {
            let (width, height) = far.size();
            assert!((far.rotation().length() - 1.0).abs() < 1e-5);
            let mut picture = vec![[3; 3]; width * height];
            let _ = far.colour_into(&mut ImageViewMut::new(&mut picture, width, height).expect("as long as asked"));
        }
    }
}
