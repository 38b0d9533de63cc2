//! x
use isobath_vm::gadget::*;
use isobath_vm::guest::*;
use isobath_vm::profiles::headset::*;
use isobath_vm::usb::*;
#[test]
fn ffs() {
    modprobe(&["dummy_hcd is_super_speed=1", "libcomposite", "usb_f_fs"]);
    let g = Gadget::bind(Headset::new("gadget", (0xfff0, 2), Speed::Super)).unwrap();
    wait_for("gadget", || {
        std::fs::read_dir("/sys/bus/usb/devices")
            .unwrap()
            .flatten()
            .find(|d| text(d.path().join("serial")).as_deref() == Some("gadget"))
    });
    drop(g);
    let _g = Gadget::bind(Headset::new("gadget2", (0xfff0, 2), Speed::Super)).unwrap();
    let d = wait_for("gadget", || {
        std::fs::read_dir("/sys/bus/usb/devices")
            .unwrap()
            .flatten()
            .find(|d| text(d.path().join("serial")).as_deref() == Some("gadget2"))
    });
    println!("{:?}", text(d.path().join("speed")));
}
