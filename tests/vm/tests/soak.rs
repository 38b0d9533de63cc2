//! x
use isobath_vm::guest::*;
use isobath_vm::profiles::generic::*;
use isobath_vm::usb::*;
use isobath_vm::uvc::*;
#[test]
fn soak() {
    camera_modules();
    let camera = Plugged::new(Generic::new("s", Speed::Super, Transport::BulkWhole, &[(160, 120)])).unwrap();
    let node = first_video_node("s");
    let t = std::time::Instant::now();
    let s = std::process::Command::new("v4l2-ctl")
        .arg("-d")
        .arg(&node)
        .args([
            "--set-fmt-video=width=160,height=120,pixelformat=Z16 ",
            "--stream-mmap=4",
            "--stream-count=3000",
            "--stream-to=/dev/null",
        ])
        .output()
        .unwrap();
    println!("{:?} {}", t.elapsed(), String::from_utf8_lossy(&s.stderr).len());
    println!("{} {}", camera.device().stream().next_frame(), resident_kb());
}
