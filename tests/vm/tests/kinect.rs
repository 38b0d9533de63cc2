//! Kinect v1.

use isobath_vm::guest::{first_video_node, modprobe, read_by_v4l2_ctl};
use isobath_vm::profiles::kinect::{Kinect, SIZE, disparity};
use isobath_vm::usb::Plugged;

/// The kernel's own driver knows ten of the eleven bits; it is a witness that the simulated device is a Kinect.
#[test]
fn the_kernels_driver_reads_it() {
    modprobe(&["vhci-hcd", "gspca_kinect depth_mode=1"]);
    let camera = Plugged::new(Kinect::new("kinect-gspca")).unwrap();
    let node = first_video_node("kinect-gspca");
    let bytes = read_by_v4l2_ctl(&node, "Y10B", SIZE, 3);
    assert!(!camera.device().is_streaming(), "it was switched off at the end");
    let (width, height) = SIZE;
    let frames = bytes.chunks(width * height * 10 / 8);
    assert_eq!(frames.len(), 3);
    for frame in frames {
        // Four pixels in five bytes, the highest bit first.
        let codes: Vec<u16> = frame
            .chunks_exact(5)
            .flat_map(|b| {
                let bits = b.iter().fold(0u64, |bits, byte| bits << 8 | u64::from(*byte));
                [30, 20, 10, 0].map(|shift| (bits >> shift & 0x3ff) as u16)
            })
            .collect();
        let number = u64::from(codes[0] - 200) * 2;
        let expected = |number: u64| -> Vec<u16> {
            (0..height).flat_map(|y| (0..width).map(move |x| disparity(x, y, number) >> 1)).collect()
        };
        assert!(codes == expected(number) || codes == expected(number + 1), "frame {number} has wrong pixels");
    }
}
