//! Cameras' pixel formats, and what devices say. Inputs through `black_box`, outputs into the sum.

use core::hint::black_box;

use isobath::glam::Vec3;
use isobath::ground::image::Image;
use isobath::ground::units::Timestamp;
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::depth::decode::format::Format;
use isobath::sensing::depth::decode::kinect::Constants;
use isobath::sensing::depth::decode::packed::{Y12iOrder, y12i};
use isobath::sensing::depth::decode::planes::{cnf4, inzi};
use isobath::sensing::imu::ImuSample;
use isobath::wire::bulk::{self, Content, Encoding, Found, Hello, Serial};
use isobath::wire::device::d4xx::intrinsics::{colour, colour_pose, records, rectified};
use isobath::wire::device::d4xx::metadata::FrameInfo;
use isobath::wire::device::d4xx::monitor::{self, Opcode};
use isobath::wire::device::d4xx::tables::{ColourTable, DepthControl, DepthTable, Gvd, seal};
use isobath::wire::device::iio::{ChannelType, layout};
use isobath::wire::device::kinect::packets::{Assembler, Event, PACKET, write_packet};
use isobath::wire::device::{gmrb, kinect, uvc};

use crate::{H, W};

/// Each parser and decoder once on `bytes`, and the encoders of firmware.
pub(crate) fn exercise(
    bytes: &mut [u8],
    codes: &mut Image<u16, W, H>,
    other: &mut Image<u16, W, H>,
    sure: &mut Image<u8, W, H>,
) -> usize {
    let mut sum = 0;
    let mut add = |answered: bool| sum += usize::from(answered);

    // Pixels.
    let formats = [Format::Z16, Format::Y16Be, Format::Y12, Format::Y10b, Format::Kinect11, Format::Y12i, Format::Inzi];
    for format in formats.into_iter().chain([Format::Cnf4]).map(black_box) {
        add(format.codes(bytes, black_box(2 * W), &mut codes.view_mut()).is_ok());
    }
    add(y12i(bytes, black_box(3 * W), black_box(Y12iOrder::LeftLow), &mut codes.view_mut(), &mut other.view_mut())
        .is_ok());
    add(inzi(bytes, black_box(2 * W), &mut codes.view_mut(), Some(&mut other.view_mut())).is_ok());
    add(cnf4(bytes, black_box(W), &mut sure.view_mut()).is_ok());
    if let Ok(table) = black_box(Constants::NOMINAL).table() {
        add(table.decode(bytes, black_box(2 * W), &mut codes.view_mut()).is_ok());
        add(table.apply(&mut codes.view_mut()).valid > 0);
    }

    // Cameras that others make.
    for meta in uvc::metadata(bytes) {
        add(meta.is_ok_and(|meta| FrameInfo::parse(meta.blocks).is_ok()));
    }
    let question = monitor::question(black_box(Opcode::Gvd), [black_box(1); 4]);
    add(monitor::parse_question(&question).is_ok());
    add(monitor::answer(Opcode::Gvd, bytes).is_ok_and(|data| Gvd::parse(data).is_ok()));
    add(DepthControl::parse(bytes).is_ok());
    add(seal(black_box(25), bytes).is_ok());
    let table = DepthTable::parse(bytes).ok();
    add(rectified(black_box(640), 480, records(bytes), table.as_ref()).is_some());
    if let Ok(table) = ColourTable::parse(bytes) {
        add(colour(&table, black_box(640), 480).is_some() && colour_pose(&table).is_ok());
    }
    let mut command = [0; 64];
    let packet =
        gmrb::Packet { opcode: black_box(kinect::FIXED_PARAMS), id: 1, payload: &kinect::FIXED_PARAMS_PAYLOAD };
    add(gmrb::encode_question(&packet, &mut command).is_ok());
    add(gmrb::data(black_box(1), 2, bytes).is_ok_and(|data| gmrb::orbbec::Property::parse(data).is_ok()));
    add(kinect::constants(bytes, bytes).is_ok());
    let (mut assembler, mut out) = (Assembler::new(), [0; PACKET]);
    let used = write_packet(bytes, black_box(3), 4, 5, &mut out);
    if let Some(packet) = out.get(..used) {
        add(assembler.packet(packet, bytes) != Event::Wait);
        add(assembler.missing() == Event::Broken);
    }

    // Sensors of Linux.
    if let Ok(kind) = ChannelType::parse(black_box("le:s16/32>>0")) {
        let mut offsets = [0; 4];
        let scan = layout(&[kind, kind, black_box(kind), ChannelType::TIMESTAMP], &mut offsets);
        add(scan.is_ok_and(|scan| scan > 0) && kind.value(bytes, black_box(0)).is_some());
    }

    // Firmware to host, and back.
    let time = Timestamp::from_nanos(black_box(5));
    let hello = Hello {
        depth: None,
        frame_interval: black_box(33_333),
        imu_millihertz: 0,
        imu_offset: 0,
        firmware: 1,
        serial: Serial::new(black_box("S1")).unwrap_or_default(),
    };
    add(bulk::encode_hello(&hello, 0, time, bytes).is_ok());
    for encoding in [Encoding::Raw, Encoding::Rvl].map(black_box) {
        add(bulk::encode_depth(codes.view(), DepthUnit::MILLIMETRE, 0, encoding, 1, time, bytes).is_ok());
    }
    let reading = ImuSample { time, rate: black_box(Vec3::X), force: Vec3::Y, field: None };
    add(bulk::encode_imu(&[reading; 4], 2, bytes).is_ok());
    match bulk::find(bytes, black_box(100_000)) {
        Found::Message { message, .. } => match message.content() {
            Ok(Content::Depth(depth)) => add(depth.pixels_into(&mut codes.view_mut()).is_ok()),
            Ok(Content::Imu(readings)) => add(readings.iter().all(|r| r.force.y > 0.0)),
            Ok(content) => add(black_box(content) != Content::Other(9)),
            Err(_) => {}
        },
        found => add(black_box(found) != Found::More { garbage: 0, needed: 0 }),
    }
    sum
}
