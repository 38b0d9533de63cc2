//! The memory map of QEMU's virt board.

fn main() {
    println!("cargo::rustc-link-arg=-T{}/link.x", env!("CARGO_MANIFEST_DIR"));
    println!("cargo::rerun-if-changed=link.x");
}
