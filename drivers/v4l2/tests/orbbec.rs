//! An Orbbec Gemini on the scripted kernel: the unit through the extension unit, intrinsics by hand.

mod kernel;

use std::fs;
use std::os::unix::fs::symlink;

use isobath::wire::device::gmrb::{Packet, encode_answer, question};
use isobath_source::{DepthSource, SourceError};
use isobath_v4l2::sys::{Errno, Query};
use isobath_v4l2::sysfs::Roots;
use isobath_v4l2::{OpenOptions, open_with};
use kernel::{Kernel, NodeScript};

#[test]
fn the_unit_comes_from_the_camera_and_intrinsics_from_the_caller() {
    for (product, unit, millimetres, status) in
        [("0670", 4, 0.1_f32, 0_u16), ("0803", 3, 1.0, 0x8001), ("0670", 4, f32::NAN, 0), ("0670", 4, 1.0, 7)]
    {
        let root = tempfile::tempdir().unwrap();
        let device = root.path().join("sys/devices/usb1/1-2");
        let interface = device.join("1-2:1.0");
        let node = interface.join("video4linux/video4");
        fs::create_dir_all(&node).unwrap();
        fs::create_dir_all(root.path().join("sys/class/video4linux")).unwrap();
        symlink(&interface, node.join("device")).unwrap();
        symlink(&node, root.path().join("sys/class/video4linux/video4")).unwrap();
        fs::write(device.join("idVendor"), "2bc5\n").unwrap();
        fs::write(device.join("idProduct"), product).unwrap();

        let mut answer = [0_u8; 64];
        let kernel = Kernel::new("/dev/video4", NodeScript::video(b"Y16 ", (64, 48))).with(|w| {
            w.extension = Some(Box::new(move |asked_unit, selector, query, data| {
                if (asked_unit, selector) != (unit, 2) {
                    return Err(Errno::ENOENT);
                }
                if data.len() != 64 {
                    return Err(Errno::ENOBUFS);
                }
                if query == Query::GetCurrent {
                    data.copy_from_slice(&answer);
                    return Ok(());
                }
                let asked = question(data).unwrap();
                assert_eq!((asked.opcode, asked.payload), (1, &176_u32.to_le_bytes()[..]));
                let mut payload = status.to_le_bytes().to_vec();
                payload.extend(millimetres.to_bits().to_le_bytes());
                payload.extend([0; 16]);
                encode_answer(&Packet { opcode: 1, id: asked.id, payload: &payload }, &mut answer).unwrap();
                Ok(())
            }));
        });
        let mut options = OpenOptions { size: Some((64, 48)), ..OpenOptions::default() };
        options.roots = Roots { sys: root.path().join("sys"), dev: "/dev".into() };
        let open =
            |options: &OpenOptions| open_with(&kernel, Box::new(kernel.clone()), "/dev/video4".as_ref(), options);
        let SourceError::MissingCalibration { needed, .. } = open(&options).unwrap_err() else {
            panic!("no intrinsics are known")
        };
        let known = status != 7 && millimetres.is_finite();
        assert_eq!(needed.contains(&"depth.unit"), !known, "{needed:?}");
        let set = &mut options.set;
        (set.fx, set.fy, set.cx, set.cy) = (Some(50.0), Some(50.0), Some(31.5), Some(23.5));
        if !known {
            options.set.depth.unit = Some(0.001);
        }
        let camera = open(&options).unwrap();
        assert!(camera.info().kind.starts_with("Orbbec Gemini"), "{}", camera.info().kind);
        assert_eq!(camera.info().notes.iter().any(|n| n.contains("does not say its depth unit")), !known);
    }
}
