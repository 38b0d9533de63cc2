//! Pixel formats of cameras, and what devices say.

use arbitrary::{Arbitrary, Result, Unstructured};
use isobath::ground::image::ImageViewMut;
use isobath::sensing::depth::decode::format::Format;
use isobath::sensing::depth::decode::kinect::Constants;
use isobath::sensing::depth::decode::packed::{Y12iOrder, y12i};
use isobath::sensing::depth::decode::{DecodeError, planes};
use isobath::wire::bulk::{self, Content, Found};
use isobath::wire::crc::crc32;
use isobath::wire::device::d4xx::intrinsics::{colour, colour_pose, records, rectified};
use isobath::wire::device::d4xx::metadata::FrameInfo;
use isobath::wire::device::d4xx::monitor::{self, Opcode};
use isobath::wire::device::d4xx::tables::{ColourTable, DepthControl, DepthTable, Gvd, Table};
use isobath::wire::device::iio::{ChannelType, layout};
use isobath::wire::device::kinect::packets::{Assembler, Event};
use isobath::wire::device::{gmrb, kinect, uvc};
use isobath::wire::malformed::Malformed;

use super::{number, shape};

const FORMATS: [Format; 11] = [
    Format::Z16,
    Format::Y16,
    Format::Y16Be,
    Format::Y10,
    Format::Y12,
    Format::Y14,
    Format::Y10b,
    Format::Kinect11,
    Format::Y12i,
    Format::Inzi,
    Format::Cnf4,
];

/// Every pixel format on bytes of any length and stride: exactly the bytes that [`Format::image_bytes`] says are needed.
pub fn pixel_formats(data: &[u8]) {
    let mut u = Unstructured::new(data);
    let _ = (|| -> Result<()> {
        let (width, height, _) = shape(&mut u)?;
        let format = *u.choose(&FORMATS)?;
        let stride = if u.ratio(1, 4)? { u.int_in_range(0..=250)? } else { format.row_bytes(width) };
        let k = if u.ratio(1, 2)? {
            Constants::NOMINAL
        } else {
            let [baseline, distance, pixel_size, shift] =
                [number(&mut u)?, number(&mut u)?, number(&mut u)?, number(&mut u)?];
            Constants { baseline, distance, pixel_size, shift }
        };
        let bytes = u.take_rest();
        let mut out = vec![0; width * height];
        let mut view = ImageViewMut::new(&mut out, width, height).expect("as long as asked");
        let needed = format.image_bytes(width, height, stride);
        match format.codes(bytes, stride, &mut view) {
            Ok(()) => assert!(bytes.len() >= needed),
            Err(DecodeError::StrideBelowRow { .. }) => assert!(stride < format.row_bytes(width)),
            Err(DecodeError::TooShort { .. }) => assert!(bytes.len() < needed),
            Err(e) => panic!("{e}"),
        }
        let mut other = vec![0; width * height];
        let mut other = ImageViewMut::new(&mut other, width, height).expect("as long as asked");
        let _ = y12i(bytes, stride, Y12iOrder::RightLow, &mut view, &mut other);
        let _ = planes::inzi(bytes, stride, &mut view, Some(&mut other));
        let mut sure = vec![0; width * height];
        let _ =
            planes::cnf4(bytes, stride, &mut ImageViewMut::new(&mut sure, width, height).expect("as long as asked"));
        assert!(sure.iter().all(|s| s % 17 == 0));
        if let Ok(table) = k.table()
            && let Ok(report) = table.decode(bytes, stride, &mut view)
        {
            assert_eq!(report.valid + report.holes + report.out_of_range, width * height);
        }
        Ok(())
    })();
}

fn said<T>(result: std::result::Result<T, Malformed>) -> Option<T> {
    result.map_err(|error| assert!(!error.to_string().is_empty())).ok()
}

/// UVC payload headers, metadata buffers, and the blocks behind them.
pub fn uvc_metadata(data: &[u8]) {
    if let Some((_, blocks, length)) = said(uvc::PayloadHeader::parse(data)) {
        assert!(blocks.len() < length && length <= data.len());
    }
    for meta in uvc::metadata(data) {
        let Some(meta) = said(meta) else { continue };
        said(FrameInfo::parse(meta.blocks));
    }
    let bytes: usize = uvc::blocks(data).flatten().map(|block| block.body.len() + 8).sum();
    assert!(bytes <= data.len());
    for block in uvc::blocks(data).flatten() {
        let _ = uvc::exposure_nanos(&block);
    }
    said(FrameInfo::parse(data));
}

/// The hardware monitor's answers, tables and device data; half of the tables get the number, length and CRC that they should have.
pub fn d4xx(data: &[u8]) {
    let Some((&seal, rest)) = data.split_first() else { return };
    for opcode in [Opcode::Gvd, Opcode::Calibration, Opcode::RectifiedParams] {
        if let Some(answer) = said(monitor::answer(opcode, rest)) {
            assert!(answer.len() <= 1016);
        }
    }
    said(monitor::parse_question(rest));
    said(Gvd::parse(rest));
    said(DepthControl::parse(rest));
    let mut table = rest.to_vec();
    if seal % 2 == 1 && table.len() >= 16 {
        let number: u16 = if seal % 4 == 1 { 25 } else { 32 };
        table[2..4].copy_from_slice(&number.to_le_bytes());
        let length = (table.len() - 16) as u32;
        table[4..8].copy_from_slice(&length.to_le_bytes());
        let crc = crc32(&table[16..]);
        table[12..16].copy_from_slice(&crc.to_le_bytes());
        assert!(Table::parse(&table).is_ok());
    }
    let depth = said(DepthTable::parse(&table));
    if let Some(depth) = &depth {
        assert!(depth.baseline > 0.0 && depth.baseline < 10.0);
    }
    for (w, h) in [(640, 480), (848, 100), (256, 144), (0, 1), (u16::MAX, 1), (123, 456)] {
        if let Some((k, _)) = rectified(w, h, records(rest), depth.as_ref()) {
            assert!(k.fx() >= 1.0 && k.cx().is_finite());
        }
        if let Some(table) = said(ColourTable::parse(&table)) {
            let _ = colour(&table, w, h);
            said(colour_pose(&table));
        }
    }
}

/// GM/RB commands, and what a Kinect v1 says: constants, and packets, whose frames are never whole by chance.
pub fn gmrb(data: &[u8]) {
    let mut u = Unstructured::new(data);
    let _ = (|| -> Result<()> {
        let (opcode, id) = (u16::arbitrary(&mut u)?, u16::arbitrary(&mut u)?);
        let rest = u.take_rest();
        said(gmrb::payload(opcode, id, rest));
        said(gmrb::orbbec::Property::parse(rest));
        said(gmrb::question(rest));
        let mut out = vec![0; rest.len() + 8];
        let packet = gmrb::Packet { opcode, id, payload: rest };
        if let Some(used) = said(gmrb::encode_answer(&packet, &mut out)) {
            let payload = said(gmrb::payload(opcode, id, &out[..used]));
            assert!(payload.is_none_or(|payload| payload == rest));
            said(kinect::constants(&out, rest));
        }
        let mut assembler = Assembler::new();
        let mut frame = vec![0; kinect::FRAME_BYTES];
        for packet in rest.chunks(20) {
            assert!(!matches!(assembler.packet(packet, &mut frame), Event::Frame { .. }));
        }
        Ok(())
    })();
}

/// Channel types of IIO, a type a line; the layout of a scan of them, and their values in any bytes.
pub fn iio(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    let kinds: Vec<ChannelType> = text.lines().take(32).filter_map(|line| said(ChannelType::parse(line))).collect();
    for kind in &kinds {
        assert_eq!(ChannelType::parse(&kind.to_string()), Ok(*kind));
    }
    let mut offsets = vec![0; kinds.len()];
    let scan = layout(&kinds, &mut offsets).expect("as long as asked");
    for (kind, at) in kinds.iter().zip(&offsets) {
        assert!(at % kind.bytes() == 0 && at + kind.bytes() <= scan);
        for index in 0..17 {
            let value = kind.value(data.get(*at..).unwrap_or_default(), index);
            if let Some(value) = value.filter(|_| kind.bits < 64) {
                let (value, range) = (i128::from(value), 1_i128 << (kind.bits - u8::from(kind.signed)));
                assert!(value < range && value >= if kind.signed { -range } else { 0 });
            }
        }
    }
}

/// A stream of the bulk protocol; half of the time what looks like a header gets its CRC, or none would ever be right.
pub fn bulk(data: &[u8]) {
    let Some((&seal, rest)) = data.split_first() else { return };
    let mut stream = rest.to_vec();
    if seal % 2 == 1 {
        let mut at = 0;
        while let Some(message) = stream.get_mut(at..).filter(|rest| rest.len() >= bulk::OVERHEAD) {
            let length = usize::from(message[4]).min(message.len() - bulk::OVERHEAD);
            message[..3].copy_from_slice(&[b'i', b'B', 1]);
            message[4..8].copy_from_slice(&(length as u32).to_le_bytes());
            let crc = crc32(&message[..20]);
            message[20..24].copy_from_slice(&crc.to_le_bytes());
            let crc = crc32(&message[24..24 + length]);
            message[24 + length..28 + length].copy_from_slice(&crc.to_le_bytes());
            at += bulk::OVERHEAD + length;
        }
    }
    let mut rest = &stream[..];
    loop {
        match bulk::find(rest, 100_000) {
            Found::More { garbage, needed } => {
                assert!(garbage <= rest.len() && needed > rest.len() - garbage);
                break;
            }
            Found::Damaged { error, used } => {
                assert!(!error.to_string().is_empty() && used > 0);
                rest = &rest[used..];
            }
            Found::Message { message, garbage, used } => {
                assert_eq!(garbage + bulk::OVERHEAD + message.body.len(), used);
                match said(message.content()) {
                    Some(Content::Depth(depth)) if depth.size.0 * depth.size.1 <= 1 << 14 => {
                        let (w, h) = depth.size;
                        let mut pixels = vec![0; w * h];
                        let mut view = ImageViewMut::new(&mut pixels, w, h).expect("as long as asked");
                        said(depth.pixels_into(&mut view));
                    }
                    Some(Content::Imu(imu)) => {
                        assert_eq!(imu.iter().count(), imu.len());
                        assert!(imu.iter().all(|r| r.rate.is_finite() && r.force.is_finite()));
                    }
                    Some(Content::Hello(hello)) => {
                        let mut again = [0; 144];
                        let header = message.header;
                        let used = bulk::encode_hello(&hello, header.sequence, header.time, &mut again);
                        assert_eq!(used, Ok(144));
                        let Found::Message { message, .. } = bulk::find(&again, 200) else { panic!("encoded") };
                        assert_eq!(message.content(), Ok(Content::Hello(hello)));
                    }
                    _ => {}
                }
                rest = &rest[used..];
            }
        }
    }
}
