//! A camera like Intel's D435i.

use std::fs;
use std::io::Read;

use isobath_vm::guest::{camera_modules, iio_device, motion_modules, read_by_v4l2_ctl, text, video_nodes, wait_for};
use isobath_vm::pattern;
use isobath_vm::profiles::d435::D435;
use isobath_vm::usb::{Plugged, Speed};

#[test]
fn the_kernel_sees_two_cameras_with_metadata_and_a_motion_module() {
    camera_modules();
    motion_modules();
    let camera = Plugged::new(D435::new("d435-seen", Speed::Super)).unwrap();
    let nodes = wait_for("four nodes", || Some(video_nodes("d435-seen")).filter(|nodes| nodes.len() == 4));
    println!("{nodes:?}");
    println!(
        "{}",
        String::from_utf8_lossy(
            &std::process::Command::new("v4l2-ctl")
                .arg("-d")
                .arg(&nodes[1])
                .args(["--all", "--list-formats-meta"])
                .output()
                .unwrap()
                .stdout
        )
    );
    for size in [(640, 480), (848, 480)] {
        let bytes = read_by_v4l2_ctl(&nodes[0], "Z16 ", size, 3);
        let pixels: Vec<u16> = bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
        for frame in pixels.chunks(size.0 * size.1) {
            println!("{}", pattern::recognise(frame, size.0).unwrap());
        }
    }
    let accelerometer = iio_device("accel_3d");
    for f in [
        "in_accel_scale",
        "in_accel_x_raw",
        "in_accel_y_raw",
        "in_accel_sampling_frequency",
        "trigger/current_trigger",
        "current_timestamp_clock",
    ] {
        println!("{f} {:?}", text(accelerometer.join(f)));
    }
    let gyroscope = iio_device("gyro_3d");
    println!("{:?}", text(gyroscope.join("in_anglvel_scale")));
    for f in fs::read_dir(accelerometer.join("scan_elements")).unwrap().flatten() {
        if f.file_name().to_string_lossy().ends_with("_en") {
            fs::write(f.path(), "1").unwrap();
        }
        println!("{:?} {:?}", f.path(), text(f.path()));
    }
    fs::write(accelerometer.join("buffer/length"), "16").unwrap();
    fs::write(accelerometer.join("buffer/enable"), "1").unwrap();
    let mut file = fs::File::open(std::path::Path::new("/dev").join(accelerometer.file_name().unwrap())).unwrap();
    let mut b = [0; 24];
    for _ in 0..5 {
        file.read_exact(&mut b).unwrap();
        println!("{b:?}");
    }
    fs::write(accelerometer.join("buffer/enable"), "0").unwrap();
    drop(camera);
    wait_for("the nodes to go", || video_nodes("d435-seen").is_empty().then_some(()));
}
